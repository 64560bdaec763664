//! What the prints look like beside each other.

use std::path::Path;

use pellucid::proof::{Picture, contact_sheet};
use pellucid::voxel::Control;
use pellucid_benches::appearance::Error;
use pellucid_benches::pixels::Pixels;

use super::runs::Run;

/// `OBJECT.png` of the runs of one object: the texture, the halftone before refinement, and each way; their errors
/// below.
///
/// # Errors
/// When the file cannot be written.
pub fn sheet(folder: &Path, runs: &[Run]) -> Result<(), Error> {
    let Some(first) = runs.first() else { return Ok(()) };
    let control = Control::none();
    let [target, unrefined, _] = &first.pictures;
    let shown = [target, unrefined].into_iter().chain(runs.iter().map(|run| &run.pictures[2]));
    let maps = std::iter::once(&first.maps[0]).chain(runs.iter().map(|run| &run.maps[1]));
    let blank = target.picture().and_then(|p| {
        let pixels = p.width() as usize * p.height() as usize;
        Ok(Picture::new(p.width(), p.height(), vec![0.0; 4 * pixels])?)
    });
    let below = std::iter::once(blank).chain(maps.map(Pixels::picture));
    let rows = [shown.map(Pixels::picture).collect::<Result<_, _>>()?, below.collect::<Result<_, _>>()?];
    contact_sheet(&rows, &control)?.write_png(folder.join(format!("{}.png", first.object)), &control)?;
    Ok(())
}
