//! Predictors measured on an object.

use std::sync::Arc;
use std::time::Instant;

use pellucid::color::Viewing;
use pellucid::color::spectrum::Illuminant;
use pellucid::core::NoisyScore;
use pellucid::predict::{
    BoundPredictor, Changed, Corrected, Correction, Draw, MonteCarlo, Network, Pass, Predictor, predict_all,
};
use pellucid::trace::{AssistOptions, Boundary, ErrorTarget, TraceOptions, Tracer, Volume};
use pellucid::voxel::Control;
use pellucid_benches::appearance::{Error, mean_delta_e};
use pellucid_benches::judged::Judged;
use pellucid_benches::study::stopwatch::{seconds, time};
use serde::{Deserialize, Serialize};

use super::objects::{POINTS, Subject};

const SEED: u64 = 5;
/// Passes of a loop before a corrected network is judged: its memory has filled by then.
const PASSES: u32 = 6;
/// Surface voxels above which a loop's whole pass is not timed.
const MOST_TIMED: usize = 600_000;

/// A predictor on an object.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    /// The object's name.
    pub object: String,
    /// Its class.
    pub class: String,
    /// Predictors that differ by effort alone.
    pub family: String,
    /// The predictor's name.
    pub predictor: String,
    /// Processor time a point and channel of neighbouring points, all included but what is done once an object.
    pub microseconds: f64,
    /// Seconds on the clock for all surface points on all cores, of those that a loop can use.
    pub pass_seconds: Option<f64>,
    /// Root mean square error.
    pub rmse: f64,
    /// Mean error.
    pub bias: f64,
    /// 95 % of the differences to the reference, its noise included, are below this.
    pub p95: f64,
    /// Mean colour difference, the reference's noise included.
    pub delta_e: f64,
}

/// What a predictor says of judged points, and in what time.
struct Found {
    /// Where in the reference each value belongs.
    at: Vec<usize>,
    values: Vec<f32>,
    microseconds: f64,
    pass_seconds: Option<f64>,
}

/// A row for every predictor.
pub fn measure(subject: &Subject, object: &Judged, control: &Control<'_>) -> Result<Vec<Row>, Error> {
    let index = object.object.refractive_index();
    let viewing = Viewing::of_print(object.object.materials(), "white", index, Illuminant::D65)?;
    let mut rows = Vec::new();
    let mut add = |family: &str, effort: String, found: Found| {
        let row = row(subject, object, &viewing, [family, &effort], &found);
        println!(
            "{}, {}: rmse {:.4}, bias {:+.4}, dE {:.2}, {:.2} us",
            row.object, row.predictor, row.rmse, row.bias, row.delta_e, row.microseconds
        );
        rows.push(row);
    };
    let volume = Volume::new(&object.labels, object.object.surface(), control)?;
    let traced = Traced { object, volume: &volume, near: object.near(POINTS[0]) };
    for spp in (0..=10).map(|k| 1 << k) {
        add("paths", spp.to_string(), traced.plain(spp, control)?);
    }
    for std_error in [0.05, 0.02, 0.01, 0.005] {
        add("adaptive paths", format!("to {std_error}"), traced.adaptive(std_error, control)?);
    }
    for spp in (0..=6).map(|k| 1 << k) {
        add("assisted paths", spp.to_string(), traced.assisted(spp, control)?);
    }
    let network = Network::shipped()?;
    add("network", "unshared".into(), alone(object, &network.clone().with_sharing(None)?, control)?);
    add("network", "shared".into(), whole(object, &network, 1, control)?);
    for spp in [2, 8, 32] {
        let both = Corrected::new(network.clone(), MonteCarlo::new(spp)?, Correction::default())?;
        add("corrected network", format!("{spp} paths, first pass"), whole(object, &both, 1, control)?);
        if spp == 8 {
            add(
                "corrected network",
                format!("{spp} paths, in a loop"),
                whole(object, &both, PASSES, control)?,
            );
        }
    }
    Ok(rows)
}

fn row(subject: &Subject, object: &Judged, viewing: &Viewing, name: [&str; 2], found: &Found) -> Row {
    let mut score = NoisyScore::default();
    let reference: Vec<f32> = found.at.iter().map(|&i| object.radiance[i]).collect();
    let mut differences = Vec::with_capacity(reference.len());
    for (&i, (value, reference)) in found.at.iter().zip(found.values.iter().zip(&reference)) {
        score.add_difference(f64::from(value - reference), f64::from(object.std_error[i]).powi(2));
        differences.push((value - reference).abs());
    }
    Row {
        object: subject.name.clone(),
        class: subject.class.into(),
        family: name[0].into(),
        predictor: name.join(", "),
        microseconds: found.microseconds,
        pass_seconds: found.pass_seconds,
        rmse: score.rmse(),
        bias: score.bias(),
        p95: pellucid::color::ErrorStats::of(differences).p95,
        delta_e: mean_delta_e(&found.values, &reference, viewing),
    }
}

/// Paths on an object.
struct Traced<'a> {
    object: &'a Judged,
    volume: &'a Volume,
    near: Vec<u32>,
}

impl Traced<'_> {
    fn tracer(&self, spp: u32) -> Result<Tracer<'_>, Error> {
        let boundary = Boundary::with_index(self.object.object.refractive_index())?;
        let options = TraceOptions { spp, seed: SEED, boundary, ..TraceOptions::default() };
        Ok(Tracer::new(self.volume, self.object.object.materials(), options)?)
    }

    /// Neighbouring points, fewer of them the more is done at each.
    fn some(&self, effort: usize) -> &[u32] {
        &self.near[..(self.near.len() / effort).max(64).min(self.near.len())]
    }

    fn found(&self, values: Vec<f32>, microseconds: f64, pass_seconds: Option<f64>) -> Found {
        Found { at: (0..values.len()).collect(), values, microseconds, pass_seconds }
    }

    fn plain(&self, spp: u32, control: &Control<'_>) -> Result<Found, Error> {
        let tracer = self.tracer(spp)?;
        let mut values = vec![0.0; self.object.radiance.len()];
        tracer.radiance(&self.object.points, 7, &mut values, control)?;
        let some = self.some(spp as usize);
        let mut out = vec![0.0; some.len() * tracer.channels()];
        let (_, spent) = time(|| tracer.radiance(some, 7, &mut out, control))?;
        let pass = match (4..=32).contains(&spp) {
            true => pass_seconds(self.object, &MonteCarlo::new(spp)?, control)?,
            false => None,
        };
        Ok(self.found(values, 1e6 * spent / out.len() as f64, pass))
    }

    fn adaptive(&self, std_error: f32, control: &Control<'_>) -> Result<Found, Error> {
        let tracer = self.tracer(1)?;
        let target = ErrorTarget { std_error, max_spp: 1 << 16 };
        let mut values = vec![0.0; self.object.radiance.len()];
        let mut errors = values.clone();
        let (_, spent) =
            time(|| tracer.radiance_to(&self.object.points, 7, target, &mut values, &mut errors, control))?;
        let microseconds = 1e6 * spent / values.len() as f64;
        Ok(self.found(values, microseconds, None))
    }

    fn assisted(&self, spp: u32, control: &Control<'_>) -> Result<Found, Error> {
        let tracer = self.tracer(spp)?;
        let options = AssistOptions::default();
        let mut all = vec![0.0; self.near.len() * tracer.channels()];
        let (_, spent) = time(|| tracer.radiance_assisted(&self.near, 7, &options, &mut all, control))?;
        let (at, values) = self.object.within(&self.near, &all);
        Ok(Found { at, values, microseconds: 1e6 * spent / all.len() as f64, pass_seconds: None })
    }
}

/// A predictor that is asked for the judged points alone.
fn alone(object: &Judged, predictor: &dyn Predictor, control: &Control<'_>) -> Result<Found, Error> {
    let bound = bound(object, predictor, control)?;
    let draw = Draw::new(SEED, Pass::Loop(0));
    let mut values = vec![0.0; object.radiance.len()];
    let (_, spent) = time(|| bound.predict(&object.points, draw, &mut values, control))?;
    let microseconds = 1e6 * spent / values.len() as f64;
    Ok(Found { at: (0..values.len()).collect(), values, microseconds, pass_seconds: None })
}

/// A predictor whose points share, asked for all, in the last of some passes.
fn whole(
    object: &Judged,
    predictor: &dyn Predictor,
    passes: u32,
    control: &Control<'_>,
) -> Result<Found, Error> {
    let mut bound = bound(object, predictor, control)?;
    for pass in 0..passes - 1 {
        let draw = Draw::new(SEED, Pass::Loop(pass));
        let (_, seen) = predict_all(&*bound, &object.object, draw, control)?;
        bound.absorb(&seen.learned)?;
    }
    let draw = Draw::new(SEED, Pass::Loop(passes - 1));
    let start = seconds();
    // Nothing changed, but outputs that were kept are forgotten.
    bound.update(&object.labels, Changed::Tiles(&[]), control)?;
    let (all, _) = predict_all(&*bound, &object.object, draw, control)?;
    let spent = seconds() - start;
    let (at, values) = object.within(&object.object.points(), &all);
    let pass_seconds = pass_seconds(object, predictor, control)?;
    Ok(Found { at, values, microseconds: 1e6 * spent / all.len() as f64, pass_seconds })
}

fn bound(
    object: &Judged,
    predictor: &dyn Predictor,
    control: &Control<'_>,
) -> Result<Box<dyn BoundPredictor>, Error> {
    let mut bound = predictor.bind(Arc::clone(&object.object))?;
    bound.update(&object.labels, Changed::Unknown, control)?;
    Ok(bound)
}

/// Seconds on the clock of one pass of a loop over all points, on all cores, for objects that are not too large.
pub fn pass_seconds(
    object: &Judged,
    predictor: &dyn Predictor,
    control: &Control<'_>,
) -> Result<Option<f64>, Error> {
    if object.object.surface().len() > MOST_TIMED {
        return Ok(None);
    }
    let mut bound = bound(object, predictor, control)?;
    let pool = rayon::ThreadPoolBuilder::new().build()?;
    pool.install(|| {
        let start = Instant::now();
        bound.update(&object.labels, Changed::Tiles(&[]), control)?;
        predict_all(&*bound, &object.object, Draw::new(SEED, Pass::Loop(0)), control)?;
        Ok(Some(start.elapsed().as_secs_f64()))
    })
}
