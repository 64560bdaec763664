//! Values are a function of object, labels, point and draw alone.

use super::{Case, DRAW, Trial, Violation};
use crate::{Draw, Pass, Predictor};

/// Pairs of draws that [`effort`] compares.
const PAIRS: u32 = 8;

/// A prediction may be repeated: on the same bound predictor, after another one, and on one bound anew.
///
/// # Errors
/// [`Violation`] where bytes differ.
pub fn repetition(predictor: &dyn Predictor, case: &Case) -> Result<(), Violation> {
    let trial = Trial { check: "repetition", predictor, case };
    let bound = trial.fresh(&case.labels)?;
    let (first, seen) = trial.predict(&*bound, &case.points, DRAW)?;
    trial.same("again", &first, &trial.values(&*bound)?)?;
    trial.predict(&*bound, &case.points[..1], Draw::new(99, Pass::Loop(1)))?;
    let (last, again) = trial.predict(&*bound, &case.points, DRAW)?;
    trial.same("after another draw", &first, &last)?;
    trial.ensure(seen.learned == again.learned, "the pass learned something else the second time")?;
    let anew = trial.fresh(&case.labels)?;
    trial.same("bound anew", &first, &trial.values(&*anew)?)
}

/// Points may be asked for in parts, down to single ones, and every part learns the same.
///
/// # Errors
/// [`Violation`] where bytes differ.
pub fn shards(predictor: &dyn Predictor, case: &Case) -> Result<(), Violation> {
    let trial = Trial { check: "shards", predictor, case };
    let bound = trial.fresh(&case.labels)?;
    let all = case.object.points();
    let (whole, seen) = trial.predict(&*bound, &all, DRAW)?;
    let channels = case.object.channels();
    let cut = all.len() / 3;
    let parts = [0..7, 7..cut, cut..cut + 1, cut + 1..all.len(), all.len()..all.len()];
    for (i, part) in parts.into_iter().enumerate() {
        // A machine of its own for every other part.
        let own = if i % 2 == 0 { Some(trial.fresh(&case.labels)?) } else { None };
        let bound = own.as_ref().unwrap_or(&bound);
        let (values, part_seen) = trial.predict(&**bound, &all[part.clone()], DRAW)?;
        let expected = &whole[part.start * channels..part.end * channels];
        trial.same(&format!("points {part:?} by themselves"), expected, &values)?;
        trial.ensure(part_seen.learned == seen.learned, format!("points {part:?} learned something else"))?;
    }
    Ok(())
}

/// Values do not depend on the number of threads.
///
/// # Errors
/// [`Violation`] where bytes differ, or no threads could be had.
pub fn threads(predictor: &dyn Predictor, case: &Case) -> Result<(), Violation> {
    let trial = Trial { check: "threads", predictor, case };
    let all = case.object.points();
    let run = |threads: usize| {
        let pool = pool(&trial, threads)?;
        pool.install(|| trial.predict(&*trial.fresh(&case.labels)?, &all, DRAW))
    };
    let ((one, seen_one), (three, seen_three)) = (run(1)?, run(3)?);
    trial.same("one thread and three", &one, &three)?;
    trial.ensure(seen_one.learned == seen_three.learned, "three threads learned something else than one")
}

pub(super) fn pool(trial: &Trial<'_>, threads: usize) -> Result<rayon::ThreadPool, Violation> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map_err(|error| trial.violation(format!("{threads} threads: {error}")))
}

/// Points may come in any order and more than once.
///
/// # Errors
/// [`Violation`] where bytes differ.
pub fn order(predictor: &dyn Predictor, case: &Case) -> Result<(), Violation> {
    let trial = Trial { check: "order", predictor, case };
    let bound = trial.fresh(&case.labels)?;
    let channels = case.object.channels();
    let expected = trial.values(&*bound)?;
    let n = case.points.len();
    // Backwards, by a stride that visits every point once or more, and one of them thrice.
    let orders: [(&str, Vec<usize>); 3] = [
        ("backwards", (0..n).rev().collect()),
        ("by strides", (0..n).map(|i| i * 7 % n).collect()),
        ("repeated", vec![3, n - 1, 3, 0, 3]),
    ];
    for (name, order) in orders {
        let points: Vec<u32> = order.iter().map(|&i| case.points[i]).collect();
        let (values, _) = trial.predict(&*bound, &points, DRAW)?;
        let expected: Vec<f32> =
            order.iter().flat_map(|&i| expected[i * channels..][..channels].to_vec()).collect();
        trial.same(name, &expected, &values)?;
    }
    Ok(())
}

/// Other seeds and passes give other values where errors are random, and the same where not.
///
/// # Errors
/// [`Violation`] otherwise.
pub fn draws(predictor: &dyn Predictor, case: &Case) -> Result<(), Violation> {
    let trial = Trial { check: "draws", predictor, case };
    let random = trial.worked("supports", predictor.supports(&case.object))?.random;
    let bound = trial.fresh(&case.labels)?;
    let draws = [
        Draw::new(1, Pass::Loop(0)),
        Draw::new(1 << 40 | 1, Pass::Loop(0)),
        Draw::new(1, Pass::Loop(1)),
        Draw::new(1, Pass::Judge(0)),
        Draw::new(1, Pass::Judge(1)),
        Draw::new(1, Pass::Proof),
    ];
    let values = draws
        .iter()
        .map(|draw| Ok(trial.predict(&*bound, &case.points, *draw)?.0))
        .collect::<Result<Vec<_>, Violation>>()?;
    for (i, a) in values.iter().enumerate() {
        for (j, b) in values.iter().enumerate().skip(i + 1) {
            let (a_draw, b_draw) = (draws[i], draws[j]);
            trial.ensure(
                (a == b) != random,
                if random {
                    format!("{a_draw:?} and {b_draw:?} gave the same values")
                } else {
                    format!("{a_draw:?} and {b_draw:?} gave other values, though errors are not random")
                },
            )?;
        }
    }
    Ok(())
}

/// More effort makes draws differ less, or changes nothing where errors are not random.
///
/// # Errors
/// [`Violation`] otherwise.
pub fn effort(predictor: &dyn Predictor, case: &Case) -> Result<(), Violation> {
    let trial = Trial { check: "effort", predictor, case };
    let random = trial.worked("supports", predictor.supports(&case.object))?.random;
    let bound = trial.fresh(&case.labels)?;
    let values = |part: u32, effort: u32| -> Result<Vec<f32>, Violation> {
        let draw = Draw::new(3, Pass::Judge(part)).with_effort(effort);
        Ok(trial.predict(&*bound, &case.points, draw)?.0)
    };
    if !random {
        return trial.same("values of one effort and of another", &values(0, 1)?, &values(0, 8)?);
    }
    // The mean square by which two draws differ, over some pairs: a predictor may have few points to tell it from.
    let spread = |effort: u32| -> Result<f64, Violation> {
        let mut sum = 0.0;
        for pair in 0..PAIRS {
            let (a, b) = (values(2 * pair, effort)?, values(2 * pair + 1, effort)?);
            sum += a.iter().zip(&b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
        }
        Ok(sum)
    };
    let (little, much) = (spread(1)?, spread(8)?);
    trial.ensure(much < 0.8 * little, format!("the spread of draws went from {little:.3e} to {much:.3e}"))
}
