//! Spectra: what 31 bands cost beside R, G, B and how well they are predicted, and what refining for several lights brings.
//!
//! `cargo bench -p pellucid-benches --bench spectral`: small, in minutes; `-- --full` for the published figures.

mod compensation;
mod metamers;
mod patches;
mod prediction;
mod report;

use std::path::{Path, PathBuf};

use clap::Parser;
use pellucid::color::spectrum::Illuminant;
use pellucid::core::files::write_whole_bytes;
use pellucid::job::Aimed;
use pellucid::mesh::{ImportLimits, Model, Scale, import_path};
use pellucid::voxel::{LabelGrid, MaterialTable};
use pellucid::{Monitor, PrintJob, PrintSettings, StrategyKind, Workspace};
use pellucid_benches::study::{Record, Study, StudySettings};

type Error = Box<dyn std::error::Error + Send + Sync>;

/// Spectra: prediction and compensation
#[derive(Parser)]
struct Args {
    #[command(flatten)]
    study: StudySettings,
    /// Further models with their heights in mm, for the cost of prediction
    #[arg(long, value_name = "FILE=MM")]
    also: Vec<String>,
    /// Only these parts: metamers, cost, bands, patches, lights
    #[arg(long, value_name = "PART", value_delimiter = ',')]
    only: Vec<String>,
    /// Height in mm of the models that are refined; 8 in the full study, 3 in the small one
    #[arg(long, value_name = "MM")]
    height_mm: Option<f64>,
}

/// The lights that prints are looked at under, the first among them.
pub const LIGHTS: [Illuminant; 4] = [Illuminant::D65, Illuminant::A, Illuminant::Led, Illuminant::F11];

/// A model at a height.
pub struct Subject {
    /// What it is called in tables.
    pub name: String,
    /// The model.
    pub model: Model,
    /// The size that it is printed in.
    pub scale: Scale,
}

fn subject(file: &Path, mm: f64) -> Result<Subject, Error> {
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    let model = import_path(file, &ImportLimits::default())?;
    Ok(Subject { name: format!("{stem} {mm} mm"), model, scale: Scale::HeightMm(mm) })
}

/// A material table of the repository.
fn table(name: &str) -> Result<MaterialTable, Error> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../datasets/materials");
    Ok(MaterialTable::load(folder.join(name))?)
}

/// The unrefined halftone of a model.
fn halftone(subject: &Subject, materials: MaterialTable) -> Result<(LabelGrid, Aimed), Error> {
    let mut settings = PrintSettings {
        scale: subject.scale,
        materials,
        strategy: StrategyKind::SurfaceFirst,
        spp: Some(1),
        ..PrintSettings::default()
    };
    settings.refine.iterations = Some(0);
    let job = PrintJob::new(settings)?;
    let monitor = Monitor::silent();
    let aimed = job.aim(job.place(&subject.model, &monitor)?, &monitor)?;
    let refined = job.refine(&aimed, &Workspace::none(), &monitor)?;
    Ok((refined.labels, aimed))
}

fn main() -> Result<(), Error> {
    let args = Args::parse();
    let full = args.study.full;
    let mut record = Record::now("spectral", rayon::current_num_threads());
    record.add("materials", "datasets/materials/cmykw-spectral.json (virtual), beside cmykw.json");
    let study = Study::new("spectral", env!("CARGO_TARGET_TMPDIR"), &args.study, record)?;
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../datasets/models");
    let wanted = |part: &str| args.only.is_empty() || args.only.iter().any(|only| only == part);
    let mut found = report::Found::default();
    if wanted("metamers") {
        found.rings = metamers::rings()?;
    }
    if wanted("cost") {
        let own = subject(&models.join("vase-handle.glb"), if full { 12.0 } else { 4.0 })?;
        let mut subjects = vec![own];
        for given in &args.also {
            let (file, mm) = given.rsplit_once('=').ok_or_else(|| format!("{given}: FILE=MM is wanted"))?;
            subjects.push(subject(&PathBuf::from(file), mm.parse()?)?);
        }
        for subject in &subjects {
            found.costs.extend(prediction::costs(subject, full)?);
        }
    }
    if wanted("bands") {
        found.bands = prediction::held_out(if full { 32 } else { 6 })?;
    }
    if wanted("patches") {
        let mm = if full { 12.0 } else { 6.0 };
        found.patches = patches::patches(&subject(&models.join("vase-handle.glb"), mm)?)?;
        let svg = report::spectra(&found.patches).svg();
        write_whole_bytes(study.folder().join("patches.svg"), svg.as_bytes())?;
    }
    if wanted("lights") {
        let mm = args.height_mm.unwrap_or(if full { 8.0 } else { 3.0 });
        for name in ["vase-handle", "showcase"] {
            let subject = subject(&models.join(format!("{name}.glb")), mm)?;
            found.lights.extend(compensation::runs(&subject, full, study.folder())?);
        }
    }
    study.write("Spectra", &found.markdown(), &found.table(), &found.plot())?;
    Ok(())
}
