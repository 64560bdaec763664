//! Runs on the slab.

use pellucid_benches::appearance::Error;
use pellucid_benches::slab::Albedo;
use pellucid_benches::slab::heuristic::Heuristic;
use pellucid_benches::slab::judge::{Judge, Judged, relative};
use pellucid_benches::slab::loss::{Loss, LossKind};
use pellucid_benches::slab::rule::{Descent, Rule};
use pellucid_benches::slab::tracer::Draw;
use pellucid_benches::study::Kept;
use pellucid_core::random::{Domain, uniform};
use serde::{Deserialize, Serialize};

use super::scene::Scene;

const PREDICT: Domain = Domain::new("differentiable: predict");
const DERIVE: Domain = Domain::new("differentiable: derive");
const RANDOM: Domain = Domain::new("differentiable: random start");
/// Depth in mm in which absorption counts as near the surface.
pub const NEAR_MM: f64 = 0.2;
/// Colour, relative to white, of the grey that descent starts from.
const GREY: f64 = 0.5;
/// Smoothing in mm of what the target lacks, in the heuristic's two forms: the library's, and each voxel's own.
const SMOOTHING_MM: [f64; 2] = [0.1, 0.0];

/// Where descent starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    Grey,
    Extruded,
    Random,
    Heuristic,
}

impl Start {
    pub const ALL: [Self; 4] = [Self::Grey, Self::Extruded, Self::Random, Self::Heuristic];

    pub fn name(self) -> &'static str {
        match self {
            Self::Grey => "grey",
            Self::Extruded => "texture, extruded",
            Self::Random => "random",
            Self::Heuristic => "the heuristic's result",
        }
    }
}

/// An iterate.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Point {
    pub iteration: u32,
    /// Paths a point and channel so far; those that are walked twice count twice.
    pub paths: u32,
    pub rmse: f64,
    pub delta_e: f64,
    pub sharpness: Option<f64>,
}

/// A run.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Run {
    pub method: String,
    pub start: String,
    /// Rate of descent.
    pub rate: Option<f64>,
    /// Iterates that were judged.
    pub points: Vec<Point>,
    /// The last one, judged by more paths.
    pub last: Point,
    /// Of what absorbs, the share within [`NEAR_MM`].
    pub near_surface: f64,
    /// Relative colours at the end, `[y][x]`.
    pub shown: Vec<[f32; 3]>,
    /// Albedos at the end, `[channel][z][y][x]`.
    pub albedo: [Vec<f32>; 3],
}

/// Names of the methods.
pub const HEURISTICS: [&str; 2] = ["heuristic", "heuristic, unsmoothed"];

pub fn descent_name(rule: Rule, loss: LossKind) -> String {
    format!("{} on {}", rule.name(), loss.name())
}

/// All runs: the heuristics first.
pub fn all(scene: &Scene, kept: &Kept) -> Result<Vec<Run>, Error> {
    let mut runs = Vec::new();
    for (i, name) in HEURISTICS.into_iter().enumerate() {
        let (spp, smoothing_mm) = (scene.effort.heuristic_spp[i], SMOOTHING_MM[i]);
        runs.push(kept.or(name, || Ok(heuristic(scene, name, spp, smoothing_mm)))?);
    }
    let refined = runs[0].albedo.clone();
    for loss in LossKind::ALL {
        for rule in Rule::ALL {
            let method = descent_name(rule, loss);
            let rate = kept.or(&format!("rate of {method}"), || Ok(best_rate(scene, rule, loss)))?;
            for start in Start::ALL {
                let way = Way { rule, loss, rate, iterations: scene.effort.iterations };
                let albedo = started(scene, start, &refined);
                let name = format!("{method} from {}", start.name());
                runs.push(kept.or(&name, || Ok(descent(scene, way, start, albedo, scene.effort.last_spp)))?);
            }
        }
    }
    Ok(runs)
}

/// Where a descent starts.
fn started(scene: &Scene, start: Start, refined: &[Vec<f32>; 3]) -> Albedo {
    let slab = &scene.slab;
    let of_color = |c: usize, color: f64| scene.ink.albedo(c, color.cbrt()).0;
    match start {
        Start::Grey => Albedo::of(slab, |c, _| of_color(c, GREY)),
        Start::Extruded => Albedo::of(slab, |c, voxel| of_color(c, scene.target[voxel % slab.points()][c])),
        Start::Random => Albedo::of(slab, |c, voxel| of_color(c, uniform(0, RANDOM, voxel as u64, c as u64))),
        Start::Heuristic => Albedo::of(slab, |c, voxel| f64::from(refined[c][voxel])),
    }
}

/// Whether an iterate is judged: all early ones, then ever fewer.
fn is_judged(iteration: u32, last: u32) -> bool {
    let step = 1 + iteration / 8;
    iteration.is_multiple_of(step) || iteration == last
}

/// Paths and errors of a run on its way.
struct Log<'a> {
    scene: &'a Scene,
    judge: Judge<'a>,
    points: Vec<Point>,
    last_iteration: u32,
}

impl<'a> Log<'a> {
    fn new(scene: &'a Scene, last_iteration: u32) -> Self {
        let judge = Judge::new(&scene.slab, scene.white, &scene.target);
        Self { scene, judge, points: Vec::new(), last_iteration }
    }

    fn point(iteration: u32, paths: u32, judged: &Judged) -> Point {
        let Judged { rmse, delta_e, sharpness, .. } = *judged;
        Point { iteration, paths, rmse, delta_e, sharpness }
    }

    fn see(&mut self, iteration: u32, paths: u32, albedo: &Albedo) {
        if is_judged(iteration, self.last_iteration) {
            let judged = self.judge.judge(albedo, self.scene.effort.judge_spp, 0);
            self.points.push(Self::point(iteration, paths, &judged));
        }
    }

    fn end(
        self,
        method: String,
        start: &str,
        rate: Option<f64>,
        paths: u32,
        albedo: &Albedo,
        spp: u32,
    ) -> Run {
        let judged = self.judge.judge(albedo, spp, 1);
        Run {
            method,
            start: start.to_owned(),
            rate,
            points: self.points,
            last: Self::point(self.last_iteration, paths, &judged),
            near_surface: albedo.share_above(&self.scene.slab, NEAR_MM),
            shown: judged.shown.iter().map(|v| v.map(|v| v as f32)).collect(),
            albedo: std::array::from_fn(|c| albedo.channel(c).to_vec()),
        }
    }
}

fn heuristic(scene: &Scene, name: &str, spp: u32, smoothing_mm: f64) -> Run {
    let (slab, iterations) = (&scene.slab, scene.effort.heuristic_iterations);
    let mut heuristic = Heuristic::new(slab, &scene.ink, &scene.target, smoothing_mm);
    let mut log = Log::new(scene, iterations);
    let mut albedo = heuristic.albedo(slab);
    for iteration in 0..iterations {
        log.see(iteration, iteration * spp, &albedo);
        let draw = Draw { seed: 0, domain: PREDICT.pass(iteration), spp };
        heuristic.update(&relative(slab.radiance(&albedo, draw), scene.white));
        albedo = heuristic.albedo(slab);
    }
    let paths = iterations * spp;
    log.see(iterations, paths, &albedo);
    log.end(name.to_owned(), Start::Extruded.name(), None, paths, &albedo, scene.effort.last_spp)
}

/// How a descent goes.
#[derive(Clone, Copy)]
struct Way {
    rule: Rule,
    loss: LossKind,
    rate: f64,
    iterations: u32,
}

fn descent(scene: &Scene, way: Way, start: Start, mut albedo: Albedo, last_spp: u32) -> Run {
    let (slab, spp) = (&scene.slab, scene.effort.spp);
    let loss = Loss::new(slab, way.loss, &scene.target);
    let mut descent = Descent::new(slab, way.rule, way.rate, f64::from(way.iterations) / 4.0);
    let mut log = Log::new(scene, way.iterations);
    // A prediction, and a derivative by other paths, which are walked twice.
    let paths = |iteration: u32| iteration * 3 * spp;
    for iteration in 0..way.iterations {
        log.see(iteration, paths(iteration), &albedo);
        let draw = |domain: Domain| Draw { seed: 0, domain: domain.pass(iteration), spp };
        let shown = relative(slab.radiance(&albedo, draw(PREDICT)), scene.white);
        let by_radiance = relative(loss.of(&shown).1, scene.white);
        let gradient = slab.pullback(&albedo, &by_radiance, draw(DERIVE));
        descent.step(slab, &mut albedo, &gradient);
    }
    let paths = paths(way.iterations);
    log.see(way.iterations, paths, &albedo);
    log.end(descent_name(way.rule, way.loss), start.name(), Some(way.rate), paths, &albedo, last_spp)
}

/// The rate that leads furthest from grey in a few steps, by the error that belongs to the loss.
fn best_rate(scene: &Scene, rule: Rule, loss: LossKind) -> f64 {
    let grey = started(scene, Start::Grey, &Default::default());
    let error = |rate: f64| {
        let way = Way { rule, loss, rate, iterations: scene.effort.trial_iterations };
        let run = descent(scene, way, Start::Grey, grey.clone(), scene.effort.judge_spp);
        match loss {
            LossKind::Mse => run.last.rmse,
            LossKind::Perceptual => run.last.delta_e,
        }
    };
    let tried = rule.rates().map(|rate| (error(rate), rate));
    tried.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).map_or(rule.rates()[0], |(_, rate)| rate)
}
