//! The models, and their sizes.

use std::path::{Path, PathBuf};

use pellucid::mesh::{ImportLimits, Model, Scale, import_path};
use pellucid::{Monitor, PrintJob, PrintSettings};

use super::Error;

/// Surface voxels that models are scaled to.
pub const WANTED: f64 = 250_000.0;
/// Those of the small study.
pub const WANTED_SMALL: f64 = 25_000.0;
/// Height in mm at which the surface is counted, to find the one that has as many as are wanted.
const PROBE_MM: f64 = 6.0;

/// A model to refine.
pub struct Subject {
    /// What it is called in tables.
    pub name: String,
    file: PathBuf,
    size: Size,
}

enum Size {
    /// The model's own: thickness decides what thin objects can show.
    Native,
    HeightMm(f64),
    SurfaceVoxels(f64),
}

/// The models of the repository, scaled to so many surface voxels, and `FILE=MM`s.
pub fn all(full: bool, wanted: f64, also: &[String]) -> Result<Vec<Subject>, Error> {
    let names: &[&str] = match full {
        true => &["vase-handle", "vase-hollow", "showcase", "bone", "plane", "wedge", "octostar", "tubes"],
        false => &["vase-handle", "showcase"],
    };
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../datasets/models");
    let own = names.iter().map(|&name| {
        let size = match (name, full) {
            ("plane" | "wedge", true) => Size::Native,
            _ => Size::SurfaceVoxels(wanted),
        };
        Ok(Subject { name: name.to_owned(), file: folder.join(format!("{name}.glb")), size })
    });
    let further = also.iter().map(|given| {
        let (file, mm) = given.rsplit_once('=').ok_or_else(|| format!("{given}: FILE=MM is wanted"))?;
        let file = PathBuf::from(file);
        let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Subject { name, file, size: Size::HeightMm(mm.parse()?) })
    });
    own.chain(further).collect()
}

impl Subject {
    /// The model.
    pub fn model(&self) -> Result<Model, Error> {
        Ok(import_path(&self.file, &ImportLimits::default())?)
    }

    /// Its size.
    pub fn scale(&self) -> Result<Scale, Error> {
        let wanted = match self.size {
            Size::Native => return Ok(Scale::Native),
            Size::HeightMm(mm) => return Ok(Scale::HeightMm(mm)),
            Size::SurfaceVoxels(wanted) => wanted,
        };
        let settings = PrintSettings { scale: Scale::HeightMm(PROBE_MM), ..PrintSettings::default() };
        let placed = PrintJob::new(settings)?.place(&self.model()?, &Monitor::silent())?;
        // A surface grows as the square; a round size reads better.
        let mm = PROBE_MM * (wanted / placed.surface.len() as f64).sqrt();
        Ok(Scale::HeightMm((2.0 * mm).round() / 2.0))
    }
}
