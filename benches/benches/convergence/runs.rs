//! One object refined one way, and its iterates judged.

use std::path::Path;

use pellucid::core::stats::quantile;
use pellucid::job::{Aimed, Prepared};
use pellucid::predict::{MonteCarlo, Predictor};
use pellucid::proof::{View, Visibility};
use pellucid::refine::{Judge, JudgeInput, StateErrors};
use pellucid::voxel::{Control, LabelGrid};
use pellucid::{Monitor, PrintJob, PrintSettings, Report, Workspace};
use pellucid_benches::appearance::{Error, heat_color};
use pellucid_benches::faces::Faces;
use pellucid_benches::pixels::Pixels;
use pellucid_benches::study::Kept;
use pellucid_benches::study::record::processor;
use serde::{Deserialize, Serialize};

use super::objects::Subject;
use super::watched::Watched;
use super::ways::Way;

/// Iterations whose labels are judged.
const JUDGED: [u32; 8] = [1, 2, 4, 7, 10, 20, 30, 40];
/// Quantiles of the last iterate's errors, as the paper's box plots have them.
pub const QUANTILES: [f64; 5] = [0.05, 0.25, 0.5, 0.75, 0.95];
/// Longer edge of a picture in pixels.
const EDGE: u32 = 200;
/// CIEDE2000 that is shown brightest.
pub const FULL_DELTA_E: f32 = 20.0;

/// What fresh paths say of an iterate.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Iterate {
    pub iteration: u32,
    /// Seconds from the model on, without what the judge takes.
    pub seconds: f64,
    /// Mean CIEDE2000 to the printable target at 0.045, 0.1 and 0.2 mm.
    pub delta_e: [f64; 3],
    /// 95 % quantile at 0.1 mm.
    pub p95: f64,
    pub sharpness: Option<f64>,
}

/// A refined object.
#[derive(Serialize, Deserialize)]
pub struct Run {
    pub object: String,
    /// [`Way::name`].
    pub way: String,
    /// The processor.
    pub machine: String,
    pub report: Report,
    /// By time; the first is the halftone before refinement, the last what is printed: the best of all.
    pub iterates: Vec<Iterate>,
    /// [`QUANTILES`] of CIEDE2000 to the texture itself at 0.1 mm, before and after.
    pub quantiles: [[f64; 5]; 2],
    /// What is wrong on the faces of a box, before and after.
    pub faces: Option<[Faces; 2]>,
    /// From the front: the texture's colours relative to the print's white, before, after.
    pub pictures: [Pixels; 3],
    /// Errors to the texture at 0.1 mm, before and after.
    pub maps: [Pixels; 2],
}

impl Run {
    /// Those of the labels to print.
    pub fn after(&self) -> &StateErrors {
        &self.report.evaluation.refined
    }

    /// Those before refinement.
    pub fn before(&self) -> &StateErrors {
        &self.report.evaluation.unrefined
    }

    fn stage_seconds(&self, wanted: impl Fn(&str) -> bool) -> f64 {
        self.report.stages.iter().filter(|s| wanted(&s.stage)).map(|s| s.seconds).sum()
    }

    /// Those of the refinement.
    pub fn refine_seconds(&self) -> f64 {
        self.stage_seconds(|stage| stage == "refine")
    }

    /// Those of all stages.
    pub fn all_seconds(&self) -> f64 {
        self.stage_seconds(|_| true)
    }

    /// The least error at 0.1 mm that was reached and judged so many seconds from the model on.
    pub fn best_within(&self, seconds: f64) -> Option<f64> {
        let done = self.iterates.iter().filter(|i| i.seconds <= seconds);
        done.map(|i| i.delta_e[1]).min_by(f64::total_cmp)
    }

    /// A run in one line.
    pub fn line(&self) -> String {
        format!(
            "{}, {}: voxel {:.2}, 0.1 mm {:.2}, {:.0} s",
            self.object,
            self.way,
            self.after().voxel.printable.mean,
            self.after().at_0_1_mm.printable.mean,
            self.refine_seconds()
        )
    }
}

/// The name under which a run is kept.
fn key(subject: &Subject, way: &Way) -> String {
    format!("{} {}", subject.key(), way.name)
}

/// What an earlier run of the study left.
///
/// # Errors
/// When the file cannot be read.
pub fn done(subject: &Subject, way: &Way, kept: &Kept) -> Result<Option<Run>, Error> {
    kept.get(&key(subject, way))
}

/// Refines an object, or reads what an earlier run left; prints lie in `prints`.
///
/// # Errors
/// Those of the job.
pub fn refined(subject: &Subject, way: &Way, kept: &Kept, prints: &Path) -> Result<Run, Error> {
    let key = key(subject, way);
    kept.or(&key, || {
        let (model, scale) = subject.sized()?;
        let job = PrintJob::new(way.settings(PrintSettings { scale, ..PrintSettings::default() }))?;
        let watched = Watched::new(way.predictor(&job)?, &JUDGED);
        let out = prints.join(key.replace([' ', ','], "-"));
        // One for all stages: it keeps their times.
        let monitor = Monitor::silent();
        // What goes on with half a job would lack its first iterates.
        let _ = std::fs::remove_dir_all(Workspace::folder_of(&out));
        let workspace = Workspace::resume(&out);
        let prepared = job.prepare_with(&watched, &model, &workspace, &monitor)?;
        let report = prepared.write(&out, true, &monitor)?;
        workspace.finish()?;
        let iterates = judged(&job, &prepared.aimed, &report, watched.iterates())?;
        let [before, after] = errors(&prepared);
        let quantiles = [&before, &after].map(|errors| {
            let mut sorted = errors.clone();
            sorted.sort_unstable_by(f32::total_cmp);
            QUANTILES.map(|q| quantile(&sorted, q))
        });
        let faces = subject.is_box().then(|| {
            let aimed = &prepared.aimed;
            let faces =
                |shown: &Vec<[f32; 3]>| Faces::of(aimed.object.surface(), shown, &aimed.printable_target);
            prepared.judged.appearance.each_ref().map(faces)
        });
        let (pictures, maps) = pictures(&prepared, [&before, &after])?;
        let (object, way) = (subject.name.clone(), way.name.to_owned());
        Ok(Run { object, way, machine: processor(), report, iterates, quantiles, faces, pictures, maps })
    })
}

/// What fresh paths say of the iterates.
fn judged(
    job: &PrintJob,
    aimed: &Aimed,
    report: &Report,
    kept: Vec<(u32, LabelGrid)>,
) -> Result<Vec<Iterate>, Error> {
    let control = Control::none();
    let settings = job.settings();
    let judge = Judge::new(JudgeInput::from(aimed.problem()), settings.judge, settings.seed, &control)?;
    let tracer = MonteCarlo::new(1)?;
    let capabilities = tracer.supports(&aimed.object)?;
    let mut bound = tracer.bind(aimed.object.clone())?;
    let seconds = seconds(report);
    let iterate = |iteration: u32, errors: &StateErrors| Iterate {
        iteration,
        seconds: seconds[iteration as usize],
        delta_e: [&errors.at_0_045_mm, &errors.at_0_1_mm, &errors.at_0_2_mm].map(|e| e.printable.mean),
        p95: errors.at_0_1_mm.printable.p95,
        sharpness: errors.sharpness.slope,
    };
    let mut iterates = vec![iterate(0, &report.evaluation.unrefined)];
    for (iteration, labels) in kept {
        // Errors of single voxels are not wanted here, so that few paths will do for them.
        let judged =
            judge.judge_with(&labels, &mut *bound, [settings.judge_spp, 1], capabilities, &control)?;
        iterates.push(iterate(iteration, &judged.errors));
    }
    let end = seconds.last().copied().unwrap_or_default();
    iterates.push(Iterate { seconds: end, ..iterate(report.refinement.best, &report.evaluation.refined) });
    Ok(iterates)
}

/// Seconds from the model on until each iterate is there and was looked at by the loop.
fn seconds(report: &Report) -> Vec<f64> {
    let before = report.stages.iter().take_while(|s| s.stage != "refine").map(|s| s.seconds);
    let mut sum: f64 = before.sum();
    let each = report.refinement.iterations.iter().map(|i| {
        sum += i.halftone_seconds + i.predict_seconds;
        let at = sum;
        sum += i.update_seconds;
        at
    });
    each.collect()
}

/// Errors of every surface voxel to the texture at 0.1 mm, before and after.
fn errors(prepared: &Prepared) -> [Vec<f32>; 2] {
    prepared.judged.error_parts.each_ref().map(|parts| parts.iter().map(|p| p.iter().sum()).collect())
}

/// Pictures of target, before and after; and maps of errors.
fn pictures(prepared: &Prepared, errors: [&[f32]; 2]) -> Result<([Pixels; 3], [Pixels; 2]), Error> {
    let control = Control::none();
    let Prepared { aimed, refined, judged, .. } = prepared;
    let view = View::front_and_back().swap_remove(0);
    let seen = Visibility::trace(&refined.labels, aimed.object.surface(), &view, EDGE, &control)?;
    let picture = |colors: &[[f32; 3]]| Ok::<_, Error>(Pixels::of(&seen.shade(colors, &control)?));
    let map = |errors: &[f32]| {
        let colors: Vec<_> = errors.iter().map(|&e| heat_color(e, FULL_DELTA_E)).collect();
        picture(&colors)
    };
    let [before, after] = &judged.appearance;
    let pictures = [picture(&aimed.target)?, picture(before)?, picture(after)?];
    Ok((pictures, [map(errors[0])?, map(errors[1])?]))
}
