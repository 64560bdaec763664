//! What the paper found, and whether these runs do. Every word that judges is chosen by this run's numbers.

use pellucid_benches::slab::loss::LossKind;
use pellucid_benches::slab::rule::Rule;

use super::models::{ModelPoint, ModelRun};
use super::runs::{HEURISTICS, NEAR_MM, Point, Run, Start, descent_name};

/// How near counts as there.
const NEAR: f64 = 1.05;
/// Change of an error that counts as one.
const CHANGE: f64 = 0.1;
/// How many times as many iterations count as many more.
const MANY: f64 = 2.0;

fn confirmed(holds: bool) -> &'static str {
    if holds { "confirmed" } else { "not confirmed" }
}

/// The first judged iterate whose error is at most `bound`.
pub fn first_within(points: &[Point], error: impl Fn(&Point) -> f64, bound: f64) -> Option<&Point> {
    points.iter().find(|p| error(p) <= bound)
}

/// The first judged iterate within 5 % of the run's least error.
pub fn settled(run: &Run, error: impl Fn(&Point) -> f64 + Copy) -> Option<&Point> {
    let least = run.points.iter().map(error).fold(f64::INFINITY, f64::min);
    first_within(&run.points, error, NEAR * least)
}

/// The first judged iterate that is as good as the heuristic at its end, or 5 % worse.
pub fn matches<'a>(run: &'a Run, heuristic: &Run) -> Option<&'a Point> {
    let end = heuristic.points.last()?;
    first_within(&run.points, |p| p.delta_e, NEAR * end.delta_e)
}

/// Runs by what they are.
struct Runs<'a>(&'a [Run]);

impl<'a> Runs<'a> {
    fn heuristic(&self) -> Option<&'a Run> {
        self.0.iter().find(|r| r.method == HEURISTICS[0])
    }

    fn descent(&self, rule: Rule, loss: LossKind, start: Start) -> Option<&'a Run> {
        let method = descent_name(rule, loss);
        self.0.iter().find(|r| r.method == method && r.start == start.name())
    }

    fn descents(&self) -> impl Iterator<Item = &'a Run> {
        self.0.iter().filter(|r| !HEURISTICS.contains(&r.method.as_str()))
    }
}

/// Bullets on the slab.
pub fn slabs(runs: &[Run]) -> String {
    let runs = Runs(runs);
    let all = [
        iterations(&runs),
        start(&runs),
        from_heuristic(&runs),
        crispness(&runs),
        measure(&runs),
        depth(&runs),
    ];
    all.into_iter().flatten().map(|text| format!("- {text}\n")).collect()
}

fn iterations(runs: &Runs<'_>) -> Option<String> {
    let heuristic = runs.heuristic()?;
    let own = settled(heuristic, |p| p.delta_e)?;
    let sgd = runs.descent(Rule::Sgd, LossKind::Mse, Start::Grey)?;
    let sgd_own = settled(sgd, |p| p.delta_e)?;
    let adam = settled(runs.descent(Rule::Adam, LossKind::Mse, Start::Grey)?, |p| p.delta_e)?;
    let ratio = f64::from(sgd_own.iteration) / f64::from(own.iteration.max(1));
    let paths = f64::from(sgd_own.paths) / f64::from(own.paths.max(1));
    let unsettled = if sgd_own.iteration == sgd.last.iteration { ", its last, and still falls" } else { "" };
    let others = || runs.descents().filter(|r| r.start != Start::Heuristic.name());
    let reached: Vec<(&Run, &Point)> =
        others().filter_map(|r| matches(r, heuristic).map(|p| (r, p))).collect();
    let first = reached.iter().min_by_key(|(_, p)| p.iteration).map_or(String::new(), |(run, p)| {
        format!(", first {} from {} after {} iterations", run.method, run.start, p.iteration)
    });
    Some(format!(
        "**24 against 300 iterations: {}.** In the paper the heuristic has converged after 24 iterations, and descent on \
         MSE from grey matches it after 300. Here the heuristic comes within 5 % of its least dE2000 after {}, SGD on MSE \
         from grey of its own after {}{unsettled}; Adam after {}: {ratio:.1} times as many for SGD, {paths:.2} times as many paths. Of \
         {} descents from other starts than the heuristic's result {} come within 5 % of the heuristic's last \
         dE2000{first}.",
        confirmed(ratio >= MANY),
        own.iteration,
        sgd_own.iteration,
        adam.iteration,
        others().count(),
        reached.len(),
    ))
}

fn start(runs: &Runs<'_>) -> Option<String> {
    let spread = |rule: Rule, loss: LossKind| -> Option<f64> {
        let ends: Vec<f64> = [Start::Grey, Start::Extruded, Start::Random]
            .into_iter()
            .map(|start| runs.descent(rule, loss, start).map(|r| r.last.delta_e))
            .collect::<Option<_>>()?;
        let (least, most) = ends.iter().fold((f64::INFINITY, 0.0f64), |(a, b), &v| (a.min(v), b.max(v)));
        Some(most / least - 1.0)
    };
    let mut each = Vec::new();
    for loss in LossKind::ALL {
        for rule in Rule::ALL {
            each.push(format!("{:.0} % with {}", 100.0 * spread(rule, loss)?, descent_name(rule, loss)));
        }
    }
    let grey = runs.descent(Rule::Sgd, LossKind::Mse, Start::Grey)?;
    let extruded = runs.descent(Rule::Sgd, LossKind::Mse, Start::Extruded)?;
    let (a, b) = (grey.last.sharpness?, extruded.last.sharpness?);
    Some(format!(
        "**The start decides what descent finds: {}.** After {} iterations from grey, the extruded texture and random \
         albedos dE2000s differ by {}. **From the heuristic's own start, the extruded texture, descent leaves details washed out that it \
         finds from grey: {}.** SGD on MSE ends with sharpness {a:.2} from grey and {b:.2} from the texture.",
        confirmed(spread(Rule::Sgd, LossKind::Mse)? > CHANGE),
        grey.last.iteration,
        each.join(", "),
        confirmed(b < a * (1.0 - CHANGE)),
    ))
}

fn from_heuristic(runs: &Runs<'_>) -> Option<String> {
    let heuristic = runs.heuristic()?;
    let mut each = Vec::new();
    for loss in LossKind::ALL {
        for rule in Rule::ALL {
            let run = runs.descent(rule, loss, Start::Heuristic)?;
            let change = 100.0 * (run.last.delta_e / heuristic.last.delta_e - 1.0);
            each.push(format!("{} to {:.2} ({change:+.0} %)", run.method, run.last.delta_e));
        }
    }
    let sgd = runs.descent(Rule::Sgd, LossKind::Mse, Start::Heuristic)?;
    let moved = (sgd.last.delta_e / heuristic.last.delta_e - 1.0).abs();
    Some(format!(
        "**From the heuristic's result descent moves only slightly: {}.** It takes dE2000 {:.2} by {}.",
        confirmed(moved < CHANGE),
        heuristic.last.delta_e,
        each.join(", "),
    ))
}

fn crispness(runs: &Runs<'_>) -> Option<String> {
    let heuristic = runs.heuristic()?.last.sharpness?;
    let alone = &runs.0.iter().find(|r| r.method == HEURISTICS[1])?.last;
    let of = |loss: LossKind| -> Option<[f64; 2]> {
        let starts = [Start::Grey, Start::Extruded, Start::Random];
        let all = Rule::ALL.into_iter().flat_map(|rule| starts.map(|start| (rule, start)));
        let slopes: Vec<f64> = all
            .map(|(rule, start)| runs.descent(rule, loss, start)?.last.sharpness)
            .collect::<Option<_>>()?;
        Some(slopes.iter().fold([f64::INFINITY, 0.0f64], |[a, b], &v| [a.min(v), b.max(v)]))
    };
    let ([a, b], [c, d]) = (of(LossKind::Mse)?, of(LossKind::Perceptual)?);
    Some(format!(
        "**Descent is less crisp than the heuristic: {}.** The heuristic shows {heuristic:.2} of the target's local \
         contrast at 0.1 mm, unsmoothed {:.2} with dE2000 {:.2}; descents on MSE {a:.2} to {b:.2}, on the perceptual loss \
         {c:.2} to {d:.2}; 1 is all of it.",
        confirmed(b < heuristic && d < heuristic),
        alone.sharpness?,
        alone.delta_e,
    ))
}

fn measure(runs: &Runs<'_>) -> Option<String> {
    let [mse, seen] =
        LossKind::ALL.map(|loss| runs.descent(Rule::Adam, loss, Start::Grey).map(|run| &run.last));
    let (mse, seen) = (mse?, seen?);
    Some(format!(
        "**MSE does not tell what is perceived: {}.** Adam from grey on MSE ends with RMSE {:.3} and dE2000 {:.2}, on the \
         perceptual loss with {:.3} and {:.2}.",
        confirmed(mse.rmse < seen.rmse && mse.delta_e > seen.delta_e),
        mse.rmse,
        mse.delta_e,
        seen.rmse,
        seen.delta_e,
    ))
}

fn depth(runs: &Runs<'_>) -> Option<String> {
    let heuristic = runs.heuristic()?.near_surface;
    let others = runs.descents().filter(|r| r.start != Start::Heuristic.name()).map(|r| r.near_surface);
    let (least, most) = others.fold((f64::INFINITY, 0.0f64), |(a, b), v| (a.min(v), b.max(v)));
    Some(format!(
        "**The heuristic keeps what absorbs near the surface, and descent finds other volumes by its start: {}.** Of all \
         absorption beyond white's {:.0} % lies within {NEAR_MM} mm with the heuristic, {:.0} to {:.0} % with descents from \
         other starts than its result.",
        confirmed(heuristic > most && most - least > CHANGE),
        100.0 * heuristic,
        100.0 * least,
        100.0 * most,
    ))
}

/// The first iterate of a model within 5 % of its least error.
pub fn model_settled(run: &ModelRun) -> Option<&ModelPoint> {
    let least = run.points.iter().map(|p| p.delta_e).fold(f64::INFINITY, f64::min);
    run.points.iter().find(|p| p.delta_e <= NEAR * least)
}

/// Bullets on the models: each against the first way, the heuristic.
pub fn models(runs: &[ModelRun]) -> String {
    let mut out = String::new();
    let mut heuristic: Option<&ModelRun> = None;
    for run in runs {
        let Some(first) = heuristic.filter(|h| h.model == run.model) else {
            heuristic = Some(run);
            continue;
        };
        let (Some(own), Some(others)) = (model_settled(first), model_settled(run)) else { continue };
        let word = |lower: bool| if lower { "lower" } else { "not lower" };
        out += &format!(
            "- {}, {} against surface-first: dE2000 {} ({:+.0} %), RMSE {} ({:+.0} %), sharpness {}; within 5 % of its own \
             best after {} iterations against {}, and {:.0} s against {:.0}.\n",
            run.model,
            run.method,
            word(run.delta_e < first.delta_e),
            100.0 * (run.delta_e / first.delta_e - 1.0),
            word(run.rmse < first.rmse),
            100.0 * (run.rmse / first.rmse - 1.0),
            word(run.sharpness < first.sharpness),
            others.iteration,
            own.iteration,
            others.seconds,
            own.seconds,
        );
    }
    out
}
