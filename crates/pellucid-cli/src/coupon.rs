//! `pellucid coupon`: a small test print that shows whether a printer mirrors.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use pellucid::core::Control;
use pellucid::slice;
use pellucid::voxel::MaterialTable;

use crate::{Failure, arguments, terminal};

/// Arguments of `pellucid coupon`.
#[derive(clap::Args)]
pub struct Args {
    /// Folder to create: slices and manifest.json
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    slices: arguments::Slices,
    /// Materials in a file; cyan, magenta, yellow, black and white without it
    #[arg(long, value_name = "FILE")]
    materials: Option<PathBuf>,
    /// Material of the plate
    #[arg(long, value_name = "NAME", default_value = "white")]
    plate: String,
    /// Material of the raised letter F
    #[arg(long, value_name = "NAME", default_value = "black")]
    letter: String,
}

/// Runs the command.
pub fn run(args: &Args, cancel: &AtomicBool) -> Result<(), Failure> {
    let printer = args.slices.printer()?;
    let materials = args.materials.as_deref().map_or(Ok(MaterialTable::cmykw()), arguments::materials)?;
    let grid = slice::coupon(&printer, &materials, &args.plate, &args.letter)?;
    let control = Control::none().with_cancel(cancel);
    slice::export(&grid, &materials, &printer, &args.slices.export(), &args.out, &control)?;
    terminal::print(&format!(
        "looking down on the print, the F must read as on a page; if it is mirrored, change row_order in the \
         printer's profile\nwrote {}\n",
        args.out.display()
    ))?;
    Ok(())
}
