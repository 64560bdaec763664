//! Errors and times of every predictor on a labelled set.

use std::ops::Range;
use std::sync::Arc;

use pellucid::color::Viewing;
use pellucid::dataset::{Judgement, LabelledSet, Sampler, ShapeClass};
use pellucid::predict::Object;
use pellucid::trace::{Boundary, TraceOptions, Tracer, Volume};
use pellucid::voxel::{Control, Surface, SurfaceOptions};

use super::shared::{name_in_use, sample_seconds, shares};
use super::{Candidate, Error, shared};
use pellucid_benches::appearance::{mean_delta_e, stencil_seconds};
use pellucid_benches::study::stopwatch::seconds;

/// Paths a point and channel of the Monte Carlo estimates.
const PATHS: [u32; 7] = [1, 2, 4, 8, 16, 32, 64];
const MOST: u32 = PATHS[PATHS.len() - 1];
/// Samples that a network predicts at a time.
const CHUNK: usize = 4096;

/// One predictor on one set, or on one shape family of it.
pub struct Row {
    pub set: String,
    /// `None` for the whole set.
    pub class: Option<ShapeClass>,
    pub predictor: String,
    /// Paths; 0 for a network.
    pub spp: u32,
    /// Processor time a sample, one point in one channel; a network's includes its stencils.
    pub microseconds: f64,
    pub samples: u64,
    pub rmse: f64,
    pub bias: f64,
    pub p95: f64,
    /// Mean CIEDE2000, relative to the print's white, the labels' noise included.
    pub delta_e: f64,
}

/// Adds a row for every predictor and shape family.
pub fn measure(
    name: &str,
    set: &LabelledSet,
    viewing: &Viewing,
    candidates: &[Candidate],
    rows: &mut Vec<Row>,
    control: &Control<'_>,
) -> Result<(), Error> {
    let header = set.header();
    let boundary = Boundary::with_index(header.recipe.refractive_index)?;
    let sampler = Sampler::new(&header.recipe, &header.split, &header.materials, boundary)?;
    let volumes = volumes(set);
    let extraction = stencil_seconds(&sampler, volumes.first().map_or(0, |v| v.0), control)?;
    for candidate in candidates {
        let mut inference = candidate.inference()?;
        let mut spent = 0.0;
        let predicted = set.predictions(CHUNK, control, |stencils, flights, out| {
            let start = seconds();
            inference.radiance(stencils, flights, out)?;
            spent += seconds() - start;
            Ok::<_, Error>(())
        })?;
        let time = 1e6 * (spent / set.len() as f64 + extraction);
        add(name, set, viewing, (&candidate.name, 0, time), &predicted, rows)?;
    }
    let sharing = candidates.first().filter(|c| shares(c));
    let (mut shared_predicted, mut shared_seconds) = (vec![0.0; set.len()], 0.0);
    let mut predicted = PATHS.map(|_| vec![0.0; set.len()]);
    let mut spent = 0.0;
    for (n, (volume, samples)) in volumes.into_iter().enumerate() {
        let grid = sampler.grid(volume)?;
        let surface = Surface::extract(&grid, &SurfaceOptions::default(), control)?;
        let traced = Volume::new(&grid, &surface, control)?;
        let points = samples
            .clone()
            .step_by(set.channels())
            .map(|i| surface.index_of(set.voxel(i)).ok_or("a labelled voxel is not on the surface"))
            .collect::<Result<Vec<u32>, _>>()?;
        if let Some(candidate) = sharing {
            let index = header.recipe.refractive_index;
            let object = Arc::new(Object::new(surface, sampler.materials().clone(), index)?);
            let predicted = shared::predict(candidate, &grid, &object, &points, control)?;
            shared_predicted[samples.clone()].copy_from_slice(&predicted);
            if n == 0 {
                shared_seconds = sample_seconds(candidate, &grid, &object, control)?;
            }
        }
        for (spp, out) in PATHS.iter().zip(&mut predicted) {
            let options = TraceOptions { spp: *spp, seed: u64::from(volume), boundary, ..Default::default() };
            let tracer = Tracer::new(&traced, sampler.materials(), options)?;
            let start = seconds();
            // Other paths than the labels', which are iterations 0 and 1 of other seeds.
            tracer.radiance(&points, 2, &mut out[samples.clone()], control)?;
            if *spp == MOST {
                spent += seconds() - start;
            }
        }
    }
    if let Some(candidate) = sharing {
        let time = 1e6 * shared_seconds;
        add(name, set, viewing, (&name_in_use(candidate), 0, time), &shared_predicted, rows)?;
    }
    for (spp, predicted) in PATHS.iter().zip(&predicted) {
        // Fewer paths on the points of one volume take less than the system's tick.
        let time = 1e6 * spent / set.len() as f64 * f64::from(*spp) / f64::from(MOST);
        add(name, set, viewing, (&format!("Monte Carlo, {spp} paths"), *spp, time), predicted, rows)?;
    }
    Ok(())
}

/// Runs of samples of one volume.
fn volumes(set: &LabelledSet) -> Vec<(u32, Range<usize>)> {
    let mut runs: Vec<(u32, Range<usize>)> = Vec::new();
    for i in 0..set.len() {
        match runs.last_mut() {
            Some((volume, run)) if *volume == set.volume(i) => run.end = i + 1,
            _ => runs.push((set.volume(i), i..i + 1)),
        }
    }
    runs
}

fn add(
    name: &str,
    set: &LabelledSet,
    viewing: &Viewing,
    (predictor, spp, microseconds): (&str, u32, f64),
    predicted: &[f32],
    rows: &mut Vec<Row>,
) -> Result<(), Error> {
    let judgement = Judgement::of(set, predicted)?;
    let classes = judgement.classes.iter().map(|(class, errors)| (Some(*class), errors));
    for (class, errors) in std::iter::once((None, &judgement.whole)).chain(classes) {
        let of_class = |i: &usize| class.is_none_or(|class| set.class(*i) == class);
        let samples: Vec<usize> = (0..set.len()).filter(of_class).collect();
        let pick = |from: &[f32]| samples.iter().map(|&i| from[i]).collect::<Vec<_>>();
        rows.push(Row {
            set: name.to_owned(),
            class,
            predictor: predictor.to_owned(),
            spp,
            microseconds,
            samples: errors.score.count(),
            rmse: errors.score.rmse(),
            bias: errors.score.bias(),
            p95: errors.absolute.p95,
            delta_e: mean_delta_e(&pick(predicted), &pick(set.radiance()), viewing),
        });
    }
    Ok(())
}
