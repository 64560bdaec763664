//! 31 bands beside R, G, B: time, and errors against many paths.

use std::path::Path;
use std::sync::Arc;

use pellucid::color::Viewing;
use pellucid::core::NoisyScore;
use pellucid::dataset::{Recipe, Sampler};
use pellucid::predict::{Changed, Draw, MonteCarlo, Network, Object, Pass, Predictor};
use pellucid::trace::{Boundary, TraceOptions, Tracer, Volume};
use pellucid::voxel::{Control, LabelGrid, Surface, SurfaceOptions, near_order};
use pellucid_benches::appearance::mean_delta_e;
use pellucid_benches::study::stopwatch;

use super::{Error, LIGHTS, Subject, halftone, table};

const INDEX: f64 = 1.5;
/// Paths a point and band that are timed and judged.
const PATHS: u32 = 16;
/// Paths of the reference.
const REFERENCE: u32 = 512;

/// A way of predicting an object.
pub struct Cost {
    pub object: String,
    pub points: usize,
    pub predictor: String,
    /// Processor time a point, all channels together.
    pub microseconds: f64,
    /// The same over that of R, G, B.
    pub over_rgb: f64,
    /// Mean over bands of the root mean square error.
    pub rmse: f64,
    /// Mean CIEDE2000 under each of [`LIGHTS`]; R, G, B have one look.
    pub delta_e: Vec<f64>,
}

/// Errors of a predictor on held-out volumes.
pub struct Bands {
    pub predictor: String,
    /// By channel: its name and the root mean square error.
    pub rmse: Vec<(String, f64)>,
}

/// A predictor under its name in tables.
type Named = (String, Arc<dyn Predictor>);

/// The predictors that are judged.
fn candidates() -> Result<Vec<Named>, Error> {
    let paths = |bands: u32| MonteCarlo::new(PATHS).and_then(|p| p.with_shared_bands(bands));
    let mut all: Vec<Named> = vec![(format!("{PATHS} paths"), Arc::new(paths(1)?))];
    for bands in [2, 3, 4] {
        all.push((format!("{PATHS} paths, {bands} bands share each"), Arc::new(paths(bands)?)));
    }
    // As many walks as four bands that share have.
    all.push((format!("{} paths", PATHS / 4), Arc::new(MonteCarlo::new(PATHS / 4)?.with_shared_bands(1)?)));
    all.push(("network".to_owned(), Arc::new(Network::shipped()?)));
    Ok(all)
}

/// Radiances of some points by many paths of each band, and their standard errors.
fn reference(labels: &LabelGrid, object: &Object, points: &[u32]) -> Result<(Vec<f32>, Vec<f32>), Error> {
    let control = Control::none();
    let volume = Volume::new(labels, object.surface(), &control)?;
    let boundary = Boundary::with_index(INDEX)?;
    let options = TraceOptions { spp: REFERENCE, seed: 1, boundary, ..TraceOptions::default() };
    let tracer = Tracer::new(&volume, object.materials(), options)?;
    let mut radiance = vec![0.0; points.len() * object.channels()];
    let mut error = radiance.clone();
    tracer.radiance_with_error(points, 9, &mut radiance, &mut error, &control)?;
    Ok((radiance, error))
}

/// Root mean square error by channel, the reference's noise taken out.
fn rmse(predicted: &[f32], reference: &(Vec<f32>, Vec<f32>), channels: usize) -> Vec<f64> {
    let of = |c: usize| {
        let mut score = NoisyScore::default();
        for i in (c..predicted.len()).step_by(channels) {
            let variance = f64::from(reference.1[i]).powi(2);
            score.add_difference(f64::from(predicted[i] - reference.0[i]), variance);
        }
        score.rmse()
    };
    (0..channels).map(of).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Times and errors of every predictor on the unrefined halftone of a model, over R, G, B and over bands.
pub fn costs(subject: &Subject, full: bool) -> Result<Vec<Cost>, Error> {
    let mut found = Vec::new();
    let mut rgb_time = f64::NAN;
    for file in ["cmykw.json", "cmykw-spectral.json"] {
        let materials = table(file)?;
        let (labels, aimed) = halftone(subject, materials)?;
        let object = &aimed.object;
        let channels = object.channels();
        let order = near_order(object.surface().voxels());
        let wanted = if full { 2000 } else { 300 };
        let judged: Vec<u32> = order.iter().copied().step_by((order.len() / wanted).max(1)).collect();
        let truth = reference(&labels, object, &judged)?;
        let viewings = viewings(object, channels)?;
        for (name, predictor) in candidates()? {
            if channels == 3 && name.contains("share") {
                continue;
            }
            let mut bound = predictor.bind(object.clone())?;
            bound.update(&labels, Changed::Unknown, &Control::none())?;
            // Whole neighbourhoods, as a job asks for them.
            let timed = &order[..order.len().min(if full { 100_000 } else { 10_000 })];
            let mut out = vec![0.0; timed.len() * channels];
            let start = stopwatch::seconds();
            bound.predict(timed, Draw::new(3, Pass::Trial), &mut out, &Control::none())?;
            let microseconds = 1e6 * (stopwatch::seconds() - start) / timed.len() as f64;
            let mut out = vec![0.0; judged.len() * channels];
            bound.predict(&judged, Draw::new(3, Pass::Trial), &mut out, &Control::none())?;
            if channels == 3 && name == format!("{PATHS} paths") {
                rgb_time = microseconds;
            }
            let kind = if channels == 3 { "R, G, B" } else { "31 bands" };
            println!("{}: {kind}, {name}: {microseconds:.1} µs a point", subject.name);
            found.push(Cost {
                object: subject.name.clone(),
                points: object.surface().len(),
                predictor: format!("{kind}: {name}"),
                microseconds,
                over_rgb: microseconds / rgb_time,
                rmse: mean(&rmse(&out, &truth, channels)),
                delta_e: viewings.iter().map(|v| mean_delta_e(&out, &truth.0, v)).collect(),
            });
        }
    }
    Ok(found)
}

/// How an object is looked at: R, G, B once, bands under every light.
pub fn viewings(object: &Object, channels: usize) -> Result<Vec<Viewing>, Error> {
    let lights = &LIGHTS[..if channels == 3 { 1 } else { LIGHTS.len() }];
    let each = lights.iter().map(|&light| Viewing::of_print(object.materials(), "white", INDEX, light));
    Ok(each.collect::<Result<_, _>>()?)
}

/// Errors by channel on volumes of the test set, which no network was trained on.
pub fn held_out(volumes: u32) -> Result<Vec<Bands>, Error> {
    let recipe = concat!(env!("CARGO_MANIFEST_DIR"), "/../datasets/recipes/default.json");
    let recipe = Recipe::read(Path::new(recipe))?;
    let control = Control::none();
    let mut found = Vec::new();
    for file in ["cmykw.json", "cmykw-spectral.json"] {
        let materials = table(file)?;
        let channels = materials.channels();
        let boundary = Boundary::with_index(INDEX)?;
        let sampler = Sampler::new(&recipe, "test", &materials, boundary)?;
        let candidates = candidates()?;
        let mut predicted: Vec<Vec<f32>> = vec![Vec::new(); candidates.len()];
        let mut truth = (Vec::new(), Vec::new());
        for volume in 0..volumes {
            let labels = sampler.grid(volume)?;
            let surface = Surface::extract(&labels, &SurfaceOptions::default(), &control)?;
            let object = Arc::new(Object::new(surface, materials.clone(), INDEX)?);
            let count = object.surface().len();
            let points: Vec<u32> = (0..count as u32).step_by((count / 64).max(1)).collect();
            let (radiance, error) = reference(&labels, &object, &points)?;
            truth.0.extend(radiance);
            truth.1.extend(error);
            for ((_, predictor), predicted) in candidates.iter().zip(&mut predicted) {
                let mut bound = predictor.bind(object.clone())?;
                bound.update(&labels, Changed::Unknown, &control)?;
                let mut out = vec![0.0; points.len() * channels];
                bound.predict(&points, Draw::new(5, Pass::Trial), &mut out, &control)?;
                predicted.extend(out);
            }
        }
        let names = materials.channel_names();
        for ((name, _), predicted) in candidates.iter().zip(&predicted) {
            if channels == 3 && name.contains("share") {
                continue;
            }
            let kind = if channels == 3 { "R, G, B" } else { "31 bands" };
            let rmse = names.iter().cloned().zip(rmse(predicted, &truth, channels)).collect();
            found.push(Bands { predictor: format!("{kind}: {name}"), rmse });
        }
    }
    Ok(found)
}
