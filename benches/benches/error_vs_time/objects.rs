//! What the predictors are judged on.

use pellucid::mesh::{ImportLimits, Scale, import_path};
use pellucid::voxel::{Control, LabelGrid, Surface, SurfaceOptions};
use pellucid::{Monitor, PrintJob, PrintSettings, Workspace};
use pellucid_benches::appearance::Error;
use pellucid_benches::judged::Judged;
use pellucid_benches::prints::file;
use pellucid_benches::solids::{ball, sheet};

/// Neighbouring points on which times are taken, and those of them that are judged.
pub const POINTS: [usize; 2] = [40_000, 800];
/// Thickness of a halftoned skin in mm.
const SKIN_MM: f64 = 0.5;
/// Steps of the refinement whose labels are judged: its first ones move most of what it moves.
const ITERATIONS: u32 = 12;

/// An object, before it is made.
pub struct Subject {
    /// Its name.
    pub name: String,
    /// Its class in the report.
    pub class: &'static str,
    what: What,
}

enum What {
    /// Halftoned, of so many mm.
    Ball(f64),
    /// Of white, of so many mm.
    White(f64),
    /// Halftoned through and through, so many mm thick.
    Sheet(f64),
    /// A model after refinement, so many mm high.
    Refined(&'static str, f64),
}

/// The objects of a study.
pub fn all(full: bool) -> Vec<Subject> {
    let ball = |mm| Subject { name: format!("ball of {mm} mm"), class: "balls", what: What::Ball(mm) };
    let white =
        |mm| Subject { name: format!("white ball of {mm} mm"), class: "white", what: What::White(mm) };
    let sheet = |mm| Subject { name: format!("sheet of {mm} mm"), class: "sheets", what: What::Sheet(mm) };
    let refined = |model, mm| Subject {
        name: format!("refined {model}, {mm} mm"),
        class: "refined prints",
        what: What::Refined(model, mm),
    };
    if !full {
        return vec![ball(6.0), sheet(0.5)];
    }
    vec![
        ball(10.0),
        ball(20.0),
        ball(40.0),
        sheet(0.3),
        sheet(0.5),
        sheet(1.0),
        sheet(2.0),
        white(10.0),
        refined("vase-handle", 9.0),
        refined("octostar", 8.0),
        refined("tubes", 12.0),
    ]
}

impl Subject {
    /// The object, with its reference.
    pub fn judged(&self, control: &Control<'_>) -> Result<Judged, Error> {
        let labels = match self.what {
            What::Ball(mm) => ball(mm, SKIN_MM),
            What::White(mm) => ball(mm, 0.0),
            What::Sheet(mm) => sheet(mm, SKIN_MM),
            What::Refined(model, mm) => refined(model, mm)?,
        };
        let surface = Surface::extract(&labels, &SurfaceOptions::default(), control)?;
        Judged::traced(&self.name, labels, surface, POINTS, control)
    }
}

/// Labels of a refined print.
fn refined(model: &str, height_mm: f64) -> Result<LabelGrid, Error> {
    let mut settings = PrintSettings { scale: Scale::HeightMm(height_mm), ..PrintSettings::default() };
    settings.refine.iterations = Some(ITERATIONS);
    let job = PrintJob::new(settings)?;
    let monitor = Monitor::silent();
    println!("refining {model}");
    let placed = job.place(&import_path(file(model), &ImportLimits::default())?, &monitor)?;
    let aimed = job.aim(placed, &monitor)?;
    Ok(job.refine(&aimed, &Workspace::none(), &monitor)?.labels)
}
