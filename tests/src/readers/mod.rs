//! Every reader of the workspace as a function of bytes, for fuzzing and for the replay of what fuzzing found.
//!
//! | module | reads |
//! | --- | --- |
//! | `models` | models, textures and colour profiles |
//! | `slices` | slices and volumes, manifests |
//! | `documents` | settings, materials, printers, recipes, measurements, reference cases |
//! | `states` | weights, runs, labelled sets, grids, checkpoints |
//! | `seal` | checksums put right, so that damage behind them is seen |
//!
//! A reader may refuse its bytes by an error. It may not panic, and what it took must come back when it is written and read
//! again.

mod documents;
mod models;
mod seal;
mod slices;
mod states;

use std::error::Error;

pub use slices::any_height;

/// Whether bytes were taken, or why not.
pub type Outcome = Result<(), Box<dyn Error>>;

/// A reader by its name, which is that of its fuzz target and of its folder of seeds.
pub struct Reader {
    /// The name.
    pub name: &'static str,
    /// Reads bytes.
    pub read: fn(&[u8]) -> Outcome,
}

macro_rules! readers {
    ($($module:ident: $($name:ident),+;)+) => {
        /// All readers.
        pub const READERS: &[Reader] = &[$($(Reader { name: stringify!($name), read: $module::$name }),+),+];
        $(pub use $module::{$($name),+};)+
    };
}

readers! {
    models: gltf, icc, obj, picture, ply, spectral, stl, threemf;
    slices: gcvf, manifest, npy, nrrd, png_stack;
    documents: cases, materials, measurements, printer, recipe, settings;
    states: grid, job_record, refinement, run, set, weights;
}

/// A folder of its own that ends with the call.
fn folder() -> Result<tempfile::TempDir, Box<dyn Error>> {
    Ok(tempfile::tempdir()?)
}

/// Bytes as text, as a reader of a text file takes them.
fn text(bytes: &[u8]) -> Result<&str, Box<dyn Error>> {
    Ok(std::str::from_utf8(bytes)?)
}
