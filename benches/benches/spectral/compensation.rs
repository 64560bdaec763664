//! Refining for one light, and for several.

use std::path::Path;

use pellucid::color::spectrum::Illuminant;
use pellucid::core::ErrorStats;
use pellucid::job::Aimed;
use pellucid::predict::{Changed, Draw, MonteCarlo, Pass, Predictor, predict_all};
use pellucid::proof::{Proof, View, false_color};
use pellucid::refine::{Aim, Viewed};
use pellucid::voxel::{Control, LabelGrid};
use pellucid::{Monitor, PrintJob, PrintSettings, Workspace};

use super::{Error, LIGHTS, Subject, table};

/// Paths a point and band by which results are looked at.
const PATHS: u32 = 64;
/// CIEDE2000 at the upper end of the maps of inconstancy.
const SCALE: f32 = 8.0;

/// What refining for some lights came to.
pub struct Run {
    pub object: String,
    pub points: usize,
    /// The lights that it was refined for; none for the unrefined halftone.
    pub lights: Vec<Illuminant>,
    /// By light of [`LIGHTS`]: to what the print should look like under it.
    pub errors: Vec<ErrorStats>,
    /// By light: from the look under the first.
    pub inconstancy: Vec<ErrorStats>,
    /// The same of what the print should look like.
    pub wanted: Vec<ErrorStats>,
    /// Share of black among cyan, magenta, yellow and black.
    pub black: f64,
    pub seconds: f64,
}

/// Refines a model for D65; for D65 and A; for D65, A and LED; and looks at each under all lights.
pub fn runs(subject: &Subject, full: bool, folder: &Path) -> Result<Vec<Run>, Error> {
    let mut settings = PrintSettings {
        scale: subject.scale,
        materials: table("cmykw-spectral.json")?,
        also_under: LIGHTS[1..].to_vec(),
        ..PrintSettings::default()
    };
    if !full {
        settings.refine.iterations = Some(20);
    }
    let job = PrintJob::new(settings)?;
    let monitor = Monitor::silent();
    let aimed = job.aim(job.place(&subject.model, &monitor)?, &monitor)?;
    let mut found = Vec::new();
    let mut looks = Vec::new();
    for lights in [&LIGHTS[..1], &LIGHTS[..2], &LIGHTS[..3]] {
        let mut some = aimed.clone();
        some.further.retain(|further| lights.contains(&further.illuminant));
        let start = std::time::Instant::now();
        let refined = job.refine(&some, &Workspace::none(), &monitor)?;
        let seconds = start.elapsed().as_secs_f64();
        if found.is_empty() {
            found.push(run(subject, &aimed, &[], &refined.unrefined, 0.0)?.0);
        }
        let (run, viewed) = run(subject, &aimed, lights, &refined.labels, seconds)?;
        println!(
            "{}: for {} lights: dE {:.2} under D65, inconstancy {:.2} to A ({seconds:.0} s)",
            run.object,
            lights.len(),
            run.errors[0].mean,
            run.inconstancy[1].mean
        );
        found.push(run);
        looks.push((refined.labels, viewed));
    }
    draw(subject, &aimed, &looks, folder)?;
    Ok(found)
}

fn run(
    subject: &Subject,
    aimed: &Aimed,
    lights: &[Illuminant],
    labels: &LabelGrid,
    seconds: f64,
) -> Result<(Run, Viewed), Error> {
    let control = Control::none();
    let own = Aim { viewing: &aimed.viewing, printable_target: &aimed.printable_target };
    let aims: Vec<Aim<'_>> = std::iter::once(own).chain(aimed.further_aims()).collect();
    let mut bound = MonteCarlo::new(PATHS)?.bind(aimed.object.clone())?;
    bound.update(labels, Changed::Unknown, &control)?;
    let (radiance, _) = predict_all(&*bound, &aimed.object, Draw::new(77, Pass::Trial), &control)?;
    let viewed = Viewed::of(aimed.object.surface(), &aims, &radiance, &control)?;
    let counts = labels.histogram();
    let inks: u64 = counts[1..=4].iter().sum();
    let run = Run {
        object: subject.name.clone(),
        points: aimed.object.surface().len(),
        lights: lights.to_vec(),
        errors: viewed.errors.clone(),
        inconstancy: viewed.inconstancy.clone(),
        wanted: viewed.wanted_inconstancy.clone(),
        black: counts[4] as f64 / inks.max(1) as f64,
        seconds,
    };
    Ok((run, viewed))
}

/// A picture: rows for what was refined for one, two and three lights; columns for the look under each of [`LIGHTS`],
/// and for the inconstancy from the first to the second.
fn draw(subject: &Subject, aimed: &Aimed, looks: &[(LabelGrid, Viewed)], folder: &Path) -> Result<(), Error> {
    let control = Control::none();
    let mut rows = Vec::new();
    for (labels, viewed) in looks {
        let map: Vec<[f32; 3]> = viewed.maps[1].iter().map(|de| false_color(de / SCALE)).collect();
        let names: Vec<&str> = LIGHTS.iter().map(|light| light.name()).collect();
        let mut states: Vec<(&str, &[[f32; 3]])> =
            names.iter().zip(&viewed.shown).map(|(&name, shown)| (name, &shown[..])).collect();
        states.push(("inconstancy", &map));
        let views = View::front_and_back();
        let proof = Proof::draw(labels, aimed.object.surface(), &views[..1], 240, &states, &control)?;
        rows.extend(proof.rows);
    }
    let states = LIGHTS.iter().map(|light| light.name().to_owned()).chain(["inconstancy".to_owned()]);
    let stem = subject.name.split(' ').next().unwrap_or("model");
    let mut sheet = Proof::draw(&looks[0].0, aimed.object.surface(), &[], 240, &[], &control)?;
    (sheet.states, sheet.rows) = (states.collect(), rows);
    sheet.write_png(folder.join(format!("lights-{stem}.png")), &control)?;
    Ok(())
}
