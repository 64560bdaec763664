//! The same in the full setting: layers, inks and halftone of a print.

use std::path::Path;

use pellucid::mesh::{ImportLimits, Scale, import_path};
use pellucid::predict::{MonteCarlo, Predictor};
use pellucid::proof::{View, Visibility};
use pellucid::refine::{Effort, Judge, JudgeInput, StepRule};
use pellucid::voxel::Control;
use pellucid::{Monitor, PrintJob, PrintSettings, StrategyKind, Workspace};
use pellucid_benches::appearance::Error;
use pellucid_benches::pixels::Pixels;
use pellucid_benches::study::Kept;
use serde::{Deserialize, Serialize};

/// The heuristic's iterations: the paper's.
const HEURISTIC_ITERATIONS: u32 = 24;
/// Paths of the judge, of every surface voxel in each of two passes and of those that single errors are taken from.
const JUDGE_SPP: [u32; 2] = [16, 256];
/// The judge's seed: no path of the loop's.
const JUDGE_SEED: u64 = 1;
/// Longer edge of a picture in pixels.
const EDGE: u32 = 320;

/// An iterate as the loop sees it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ModelPoint {
    pub iteration: u32,
    /// Paths a point and channel so far; those that are walked twice count twice.
    pub paths: f64,
    /// Seconds so far.
    pub seconds: f64,
    /// Mean CIEDE2000 at 0.1 mm, the loop's noise in it.
    pub delta_e: f64,
}

/// A refined model.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ModelRun {
    pub model: String,
    pub method: String,
    pub surface_voxels: usize,
    pub points: Vec<ModelPoint>,
    /// The iteration that was kept.
    pub best: u32,
    /// What the judge finds of it: root mean square of linear colours, noise taken out; mean CIEDE2000 by voxel and at
    /// 0.1 mm.
    pub rmse: f64,
    pub voxel: f64,
    pub delta_e: f64,
    pub sharpness: Option<f64>,
    /// The target and the print, from the front.
    pub pictures: [Pixels; 2],
}

/// The ways to refine.
const METHODS: [(&str, StrategyKind, StepRule); 3] = [
    ("surface-first", StrategyKind::SurfaceFirst, StepRule::Bound),
    ("descent, bound", StrategyKind::Descent, StepRule::Bound),
    ("descent, Adam", StrategyKind::Descent, StepRule::Adam),
];

/// All models by all ways.
pub fn all(full: bool, kept: &Kept) -> Result<Vec<ModelRun>, Error> {
    let models: &[(&str, f64)] =
        if full { &[("vase-handle", 8.0), ("showcase", 8.0)] } else { &[("vase-handle", 4.0)] };
    let mut runs = Vec::new();
    for &(model, height_mm) in models {
        for (method, strategy, rule) in METHODS {
            let settings = settings(height_mm, strategy, rule);
            runs.push(kept.or(&format!("{model} by {method}"), || refined(model, method, settings))?);
        }
    }
    Ok(runs)
}

fn settings(height_mm: f64, strategy: StrategyKind, rule: StepRule) -> PrintSettings {
    let mut settings =
        PrintSettings { scale: Scale::HeightMm(height_mm), strategy, ..PrintSettings::default() };
    settings.descent.rule = rule;
    if strategy == StrategyKind::SurfaceFirst {
        settings.refine.iterations = Some(HEURISTIC_ITERATIONS);
    }
    settings
}

fn refined(model: &str, method: &str, settings: PrintSettings) -> Result<ModelRun, Error> {
    let (monitor, control) = (Monitor::silent(), Control::none());
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../datasets/models").join(format!("{model}.glb"));
    let job = PrintJob::new(settings)?;
    let placed = job.place(&import_path(file, &ImportLimits::default())?, &monitor)?;
    let aimed = job.aim(placed, &monitor)?;
    let refined = job.refine(&aimed, &Workspace::none(), &monitor)?;

    let judge = Judge::new(JudgeInput::from(aimed.problem()), Effort::default(), JUDGE_SEED, &control)?;
    let tracer = MonteCarlo::new(1)?;
    let capabilities = tracer.supports(&aimed.object)?;
    let mut bound = tracer.bind(aimed.object.clone())?;
    let judged = judge.judge_with(&refined.labels, &mut *bound, JUDGE_SPP, capabilities, &control)?;
    let pairs = judged.shown[0].iter().zip(&judged.shown[1]).zip(&aimed.printable_target);
    let products =
        pairs.flat_map(|((a, b), t)| (0..3).map(|c| f64::from(a[c] - t[c]) * f64::from(b[c] - t[c])));
    let surface = aimed.object.surface();
    let rmse = (products.sum::<f64>() / (3 * surface.len()) as f64).max(0.0).sqrt();

    let view = View::front_and_back().swap_remove(0);
    let seen = Visibility::trace(&refined.labels, surface, &view, EDGE, &control)?;
    let picture = |colors: &[[f32; 3]]| Ok::<_, Error>(Pixels::of(&seen.shade(colors, &control)?));
    Ok(ModelRun {
        model: model.to_owned(),
        method: method.to_owned(),
        surface_voxels: surface.len(),
        points: points(&job, &refined.report, surface.len() * 3),
        best: refined.report.best,
        rmse,
        voxel: judged.errors.voxel.printable.mean,
        delta_e: judged.errors.at_0_1_mm.printable.mean,
        sharpness: judged.errors.sharpness.slope,
        pictures: [picture(&aimed.printable_target)?, picture(&judged.appearance())?],
    })
}

fn points(job: &PrintJob, report: &pellucid::refine::RefineReport, values: usize) -> Vec<ModelPoint> {
    let (mut paths, mut seconds) = (0.0, 0.0);
    let derivative = 2.0 * f64::from(job.settings().gradient_spp);
    let first = report.iterations.first().map_or(0, |i| i.paths);
    let each = report.iterations.iter().map(|i| {
        seconds += i.halftone_seconds + i.predict_seconds;
        let traced = paths + i.paths as f64 / values as f64;
        let point = ModelPoint { iteration: i.iteration, paths: traced, seconds, delta_e: i.smoothed.mean };
        // Only steps by derivatives have a loss.
        // As predictions, they take twice the paths once steps are fine.
        let effort = i.paths.checked_div(first).unwrap_or(1).min(2) as f64;
        paths = traced + if i.loss.is_some() { effort * derivative } else { 0.0 };
        seconds += i.update_seconds;
        point
    });
    each.collect()
}
