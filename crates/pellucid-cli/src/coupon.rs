//! `pellucid coupon`: a small test print that shows whether a printer mirrors.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use pellucid::core::Control;
use pellucid::slice::{self, Container, ExportSettings};
use pellucid::voxel::MaterialTable;

use crate::{Failure, arguments, terminal};

/// Arguments of `pellucid coupon`.
#[derive(clap::Args)]
pub struct Args {
    /// Folder to create: slices and manifest.json
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Printer: j750, j750-high-quality-vivid and so on, or the file of a profile
    #[arg(long, value_name = "NAME|FILE", default_value = "j750")]
    printer: String,
    /// What the slices are written as: png (a folder of them), gcvf, nrrd or npy
    #[arg(long, value_name = "FORMAT", value_parser = arguments::format, default_value = "png")]
    format: Container,
    /// Materials in a file; cyan, magenta, yellow, black and white without it
    #[arg(long, value_name = "FILE")]
    materials: Option<PathBuf>,
    /// Material of the plate
    #[arg(long, value_name = "NAME", default_value = "white")]
    plate: String,
    /// Material of the raised letter F
    #[arg(long, value_name = "NAME", default_value = "black")]
    letter: String,
    /// Replace an output folder of an earlier run
    #[arg(long)]
    force: bool,
}

/// Runs the command.
pub fn run(args: &Args, cancel: &AtomicBool) -> Result<(), Failure> {
    let printer = arguments::printer(&args.printer)?;
    let materials = args.materials.as_deref().map_or(Ok(MaterialTable::cmykw()), arguments::materials)?;
    let grid = slice::coupon(&printer, &materials, &args.plate, &args.letter)?;
    let settings = ExportSettings {
        force: args.force,
        format: args.format,
        generator: concat!("pellucid ", env!("CARGO_PKG_VERSION")).into(),
        ..ExportSettings::default()
    };
    let control = Control::none().with_cancel(cancel);
    slice::export(&grid, &materials, &printer, &settings, &args.out, &control)?;
    terminal::print(&format!(
        "looking down on the print, the F must read as on a page; if it is mirrored, change row_order in the \
         printer's profile\nwrote {}\n",
        args.out.display()
    ))?;
    Ok(())
}
