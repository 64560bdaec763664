//! The models of `datasets/models` as prints before refinement.

use std::path::{Path, PathBuf};

use pellucid::job::Aimed;
use pellucid::mesh::{ImportLimits, Scale, import_path};
use pellucid::refine::{Refinement, SurfaceFirst};
use pellucid::voxel::{Control, LabelGrid};
use pellucid::{Monitor, PrintJob, PrintSettings};

use crate::appearance::Error;

/// The file of a model.
pub fn file(model: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../datasets/models").join(format!("{model}.glb"))
}

/// A model as `prepare` halftones it before the first correction, for the default printer and inks, at its own size or a
/// height in mm.
///
/// # Errors
/// Those of import and of the job's first stages.
pub fn unrefined(
    model: &str,
    height_mm: Option<f64>,
    control: &Control<'_>,
) -> Result<(Aimed, LabelGrid), Error> {
    let scale = height_mm.map_or(Scale::Native, Scale::HeightMm);
    let job = PrintJob::new(PrintSettings { scale, ..PrintSettings::default() })?;
    let monitor = Monitor::silent();
    let imported = import_path(file(model), &ImportLimits::default())?;
    let aimed = job.aim(job.place(&imported, &monitor)?, &monitor)?;
    let settings = job.settings().refine.clone();
    let labels = Refinement::new(aimed.problem(), SurfaceFirst::default(), settings, control)?
        .unrefined(&aimed.solid, control)?;
    Ok((aimed, labels))
}
