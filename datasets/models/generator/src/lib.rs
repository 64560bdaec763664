//! The project's own test models: geometry and textures made by formulas, written as GLB.
//!
//! Run `cargo run --release -p pellucid-models` to write them again; the same bytes come out on
//! every machine (transcendental functions are those of the `libm` crate). `--render sheet.png`
//! draws a picture of all of them.
#![forbid(unsafe_code)]

pub mod cube_sphere;
pub mod glb;
pub mod image;
pub mod models;
pub mod noise;
pub mod part;
pub mod render;
pub mod sheet;
pub mod vec3;

use image::Image;
use part::Part;

/// One model.
pub struct Model {
    /// File name without its extension.
    pub name: &'static str,
    /// The mesh in print millimetres, z up.
    pub part: Part,
    /// The texture.
    pub texture: Image,
    /// Compass direction in degrees of the first picture's camera, counter-clockwise from -y.
    pub view: f64,
}
