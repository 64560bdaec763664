//! A gradient is a function of object, labels, points, draw and weights, and linear in the weights.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};

use pellucid_voxel::{AIR, Control};

use super::values::pool;
use super::{Bound, Case, DRAW, Trial, Violation};
use crate::{BoundPredictor, Draw, MaterialGradient, Pass, PredictError, Predictor};

/// What a gradient may differ by where rounding is all that differs, as a part of its largest value: in f32, and where a
/// predictor's identity says that its precision is bf16, whose products are rounded to 8 bits.
const ROUNDING: f64 = 1e-4;
const ROUNDING_BF16: f64 = 1e-2;

fn rounding(predictor: &dyn Predictor) -> f64 {
    let identity = predictor.identity();
    let bf16 = identity.settings.get("precision").is_some_and(|precision| precision == "bf16");
    if bf16 { ROUNDING_BF16 } else { ROUNDING }
}

/// What was added, in order, and its sums.
#[derive(Default)]
struct Collected {
    calls: Vec<([u32; 3], u8, u32)>,
    sums: BTreeMap<([u32; 3], u8), f64>,
    region: Option<[[u32; 3]; 2]>,
}

impl MaterialGradient for Collected {
    fn add(&mut self, voxel: [u32; 3], label: u8, derivative: f32) {
        self.calls.push((voxel, label, derivative.to_bits()));
        *self.sums.entry((voxel, label)).or_default() += f64::from(derivative);
    }

    fn region(&self) -> Option<[[u32; 3]; 2]> {
        self.region
    }
}

impl Collected {
    fn at(&self, at: &([u32; 3], u8)) -> f64 {
        self.sums.get(at).copied().unwrap_or(0.0)
    }

    /// A sum that tells voxels and materials apart.
    fn functional(&self) -> f64 {
        let weight = |&(v, label): &([u32; 3], u8)| {
            let hash = v.iter().fold(u64::from(label) * 37, |h, &c| h * 7919 + u64::from(c)) % 1009;
            0.5 + hash as f64 / 1009.0
        };
        self.sums.iter().map(|(at, d)| weight(at) * d).sum()
    }

    fn largest(&self) -> f64 {
        self.sums.values().fold(0.0, |most, v| most.max(v.abs()))
    }
}

/// A predictor that says it has a gradient gives the same calls for any number of threads and again, finite, for solid
/// voxels of the region and materials of the table; sums that follow the weights linearly and add up over parts of the
/// points (on average over draws where it has random error); differ less between draws with more effort, if they differ;
/// stops when told; and refuses what does not fit. One that says it has none says so when asked. That the gradient is that
/// of the prediction is for tests of one's own to show.
///
/// # Errors
/// [`Violation`] otherwise.
pub fn gradients(predictor: &dyn Predictor, case: &Case) -> Result<(), Violation> {
    let trial = Trial { check: "gradients", predictor, case };
    let d_radiance = weights(case, 1);
    let bound = trial.fresh(&case.labels)?;
    let capabilities = trial.worked("supports", predictor.supports(&case.object))?;
    if !capabilities.gradient {
        let result =
            bound.pullback(&case.points, DRAW, &d_radiance, &mut Collected::default(), &Control::none());
        return trial.ensure(
            matches!(result, Err(PredictError::Unsupported(_))),
            format!("a gradient that it says it has not gave {result:?}"),
        );
    }
    let pull = |bound: &dyn BoundPredictor, points: &[u32], d_radiance: &[f32], region| {
        pulled(&trial, bound, DRAW, points, d_radiance, region)
    };
    let whole = pull(&*bound, &case.points, &d_radiance, None)?;
    well_formed(&trial, &whole)?;
    let again = pull(&*bound, &case.points, &d_radiance, None)?;
    trial.ensure(whole.calls == again.calls, "a repeated gradient has other bytes")?;
    for threads in [1, 3] {
        let other = pool(&trial, threads)?
            .install(|| pull(&*trial.fresh(&case.labels)?, &case.points, &d_radiance, None))?;
        trial.ensure(whole.calls == other.calls, format!("{threads} threads give other bytes"))?;
    }

    if let Err(violation) = linear(&trial, &bound, &whole) {
        if !capabilities.random {
            return Err(violation);
        }
        linear_on_average(&trial, &bound)?;
    }
    effort(&trial, &bound, &d_radiance)?;

    let size = case.labels.size();
    let region = [size.map(|s| s / 4), size.map(|s| s / 4 * 3)];
    let inside = |v: &[u32; 3]| (0..3).all(|a| (region[0][a]..region[1][a]).contains(&v[a]));
    let part = pull(&*bound, &case.points, &d_radiance, Some(region))?;
    trial.ensure(part.sums.keys().all(|(v, _)| inside(v)), "it adds what lies outside the region")?;
    close(&trial, "of a region", &whole, |at| if inside(&at.0) { part.at(at) } else { whole.at(at) })?;
    stops(&trial, &bound, &d_radiance)?;
    refuses(&trial, &bound, &d_radiance)?;
    let last = pull(&*bound, &case.points, &d_radiance, None)?;
    trial.ensure(whole.calls == last.calls, "cancelled and refused gradients leave a trace")
}

fn pulled(
    trial: &Trial<'_>,
    bound: &dyn BoundPredictor,
    draw: Draw,
    points: &[u32],
    d_radiance: &[f32],
    region: Option<[[u32; 3]; 2]>,
) -> Result<Collected, Violation> {
    let mut found = Collected { region, ..Collected::default() };
    let result = bound.pullback(points, draw, d_radiance, &mut found, &Control::none());
    trial.worked("pullback", result).map(|()| found)
}

fn mixed(a: &[f32], b: &[f32]) -> Vec<f32> {
    a.iter().zip(b).map(|(a, b)| 0.5 * a - 2.0 * b).collect()
}

/// Sums of weights give the sums of gradients, and parts of the points that of the whole, but for rounding.
fn linear(trial: &Trial<'_>, bound: &Bound, whole: &Collected) -> Result<(), Violation> {
    let case = trial.case;
    let (first, second) = (weights(case, 1), weights(case, 2));
    let pull = |points: &[u32], weights: &[f32]| pulled(trial, &**bound, DRAW, points, weights, None);
    let of_second = pull(&case.points, &second)?;
    let of_mixed = pull(&case.points, &mixed(&first, &second))?;
    close(trial, "of mixed weights", &of_mixed, |at| 0.5 * whole.at(at) - 2.0 * of_second.at(at))?;
    let (half, channels) = (case.points.len() / 2, case.object.channels());
    let start = pull(&case.points[..half], &first[..half * channels])?;
    let rest = pull(&case.points[half..], &first[half * channels..])?;
    close(trial, "of two parts of the points", whole, |at| start.at(at) + rest.at(at))
}

/// As [`linear`], on average over draws; minus two times the weights give minus two times the gradient exactly.
fn linear_on_average(trial: &Trial<'_>, bound: &Bound) -> Result<(), Violation> {
    const DRAWS: u32 = 16;
    let case = trial.case;
    let (first, second) = (weights(case, 1), weights(case, 2));
    let both = mixed(&first, &second);
    let turned: Vec<f32> = first.iter().map(|w| -2.0 * w).collect();
    let (half, channels) = (case.points.len() / 2, case.object.channels());
    let mut errors: [Vec<f64>; 2] = Default::default();
    let mut size = 0.0f64;
    for pass in 0..DRAWS {
        let draw = Draw::new(DRAW.seed, Pass::Loop(pass));
        let pull = |points: &[u32], weights: &[f32]| pulled(trial, &**bound, draw, points, weights, None);
        let of_first = pull(&case.points, &first)?;
        let of_turned = pull(&case.points, &turned)?;
        let exact = of_first.calls.iter().map(|&(v, l, d)| (v, l, (-2.0 * f32::from_bits(d)).to_bits()));
        trial.ensure(
            exact.eq(of_turned.calls.iter().copied()),
            "minus two times the weights do not give minus two times the gradient",
        )?;
        let of_second = pull(&case.points, &second)?.functional();
        let of_both = pull(&case.points, &both)?.functional();
        let start = pull(&case.points[..half], &first[..half * channels])?.functional();
        let rest = pull(&case.points[half..], &first[half * channels..])?.functional();
        size = size.max(of_first.sums.values().map(|d| d.abs()).sum());
        let of_first = of_first.functional();
        errors[0].push(of_both - (0.5 * of_first - 2.0 * of_second));
        errors[1].push(of_first - (start + rest));
    }
    for (what, errors) in ["mixed weights", "two parts of the points"].into_iter().zip(errors) {
        let mean = errors.iter().sum::<f64>() / f64::from(DRAWS);
        let variance = errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / f64::from(DRAWS - 1);
        let error = (variance / f64::from(DRAWS)).sqrt();
        trial.ensure(
            mean.abs() <= 6.0 * error + rounding(trial.predictor) * size,
            format!("the gradient of {what} is off by {mean} on average, with a standard error of {error}"),
        )?;
    }
    Ok(())
}

/// More effort makes the gradients of two draws differ less, where they differ: an eighth of the variance is due, all of it
/// is what a predictor that takes no notice has, to the bit. Few draws of rare contributions leave wide room between.
fn effort(trial: &Trial<'_>, bound: &Bound, d_radiance: &[f32]) -> Result<(), Violation> {
    const PAIRS: u32 = 4;
    let pull = |pass: u32, effort: u32| {
        let draw = Draw::new(DRAW.seed, Pass::Gradient(pass)).with_effort(effort);
        pulled(trial, &**bound, draw, &trial.case.points, d_radiance, None)
    };
    let spread = |effort: u32| -> Result<f64, Violation> {
        let mut sum = 0.0;
        for pair in 0..PAIRS {
            let (a, b) = (pull(2 * pair, effort)?, pull(2 * pair + 1, effort)?);
            let both = a.sums.keys().chain(b.sums.keys().filter(|at| !a.sums.contains_key(at)));
            sum += both.map(|at| (a.at(at) - b.at(at)).powi(2)).sum::<f64>();
        }
        Ok(sum)
    };
    let little = spread(1)?;
    if little == 0.0 {
        return Ok(());
    }
    let much = spread(8)?;
    let what =
        format!("the spread of gradients went from {little:.3e} to {much:.3e} by eight times the effort");
    trial.ensure(much < 0.8 * little, what)
}

/// Weights that differ from point to point and channel to channel.
fn weights(case: &Case, seed: usize) -> Vec<f32> {
    let count = case.points.len() * case.object.channels();
    (0..count).map(|i| ((i * 7919 + seed * 104_729) % 1009) as f32 / 504.5 - 1.0).collect()
}

fn well_formed(trial: &Trial<'_>, found: &Collected) -> Result<(), Violation> {
    let case = trial.case;
    for &(voxel, label, bits) in &found.calls {
        let solid = case.labels.get(voxel) != AIR && case.object.materials().get(label).is_some();
        trial.ensure(solid, format!("it adds to material {label} in {voxel:?}"))?;
        trial.ensure(f32::from_bits(bits).is_finite(), format!("it adds no number in {voxel:?}"))?;
    }
    trial.ensure(found.largest() > 0.0, "nothing depends on the labels")
}

fn close(
    trial: &Trial<'_>,
    what: &str,
    found: &Collected,
    expected: impl Fn(&([u32; 3], u8)) -> f64,
) -> Result<(), Violation> {
    let tolerance = rounding(trial.predictor) * found.largest();
    for (at, value) in &found.sums {
        let expected = expected(at);
        trial.ensure(
            (value - expected).abs() <= tolerance,
            format!("the gradient {what} is {value} at {at:?}, not {expected}"),
        )?;
    }
    Ok(())
}

fn stops(trial: &Trial<'_>, bound: &Bound, d_radiance: &[f32]) -> Result<(), Violation> {
    // Where it is stopped depends on the order of work; one thread has one order.
    let points = &trial.case.points;
    for share in [0, u64::MAX, 2] {
        let stop = AtomicBool::new(share == 0);
        let report = |done: u64, total: u64| {
            if done < total && done.saturating_mul(share) >= total {
                stop.store(true, Ordering::Relaxed);
            }
        };
        let control = Control::none().with_cancel(&stop).with_progress(&report);
        let result = bound.pullback(points, DRAW, d_radiance, &mut Collected::default(), &control);
        let asked = stop.load(Ordering::Relaxed);
        trial.ensure(
            !asked || matches!(result, Err(PredictError::Cancelled)),
            format!("a gradient that was cancelled gave {result:?}"),
        )?;
    }
    Ok(())
}

fn refuses(trial: &Trial<'_>, bound: &Bound, d_radiance: &[f32]) -> Result<(), Violation> {
    let past = trial.case.object.surface().len() as u32;
    let channels = trial.case.object.channels();
    let early = trial.bind()?;
    let cases: [(&str, &Bound, &[u32], &[f32]); 3] = [
        ("before an update", &early, &[0], &d_radiance[..channels]),
        ("of weights of another length", bound, &[0], &d_radiance[..channels + 1]),
        ("at a point past the surface", bound, &[past], &d_radiance[..channels]),
    ];
    for (what, bound, points, d_radiance) in cases {
        let mut found = Collected::default();
        let result = bound.pullback(points, DRAW, d_radiance, &mut found, &Control::none());
        trial.ensure(
            matches!(result, Err(PredictError::Invalid(_))) && found.calls.is_empty(),
            format!("a gradient {what} gave {result:?}"),
        )?;
    }
    Ok(())
}
