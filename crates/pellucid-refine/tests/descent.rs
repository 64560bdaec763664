//! Descent on a small slab whose predictor sees sideways.

mod common;

use common::{Blur, Slab};
use pellucid_color::{MediaWhite, Viewing};
use pellucid_predict::{BoundPredictor, Changed, Diagnostics, Draw, PredictError};
use pellucid_refine::{
    Aim, Descent, DescentState, Problem, RefineError, RefineReport, RefineSettings, Refinement, Saved,
    StepRule, Strategy, SurfaceFirst, refine,
};
use pellucid_voxel::{Control, LabelGrid};

const BLUE: [f32; 3] = [0.3, 0.35, 0.8];
const YELLOW: [f32; 3] = [0.9, 0.8, 0.45];

fn settings(iterations: u32) -> RefineSettings {
    RefineSettings {
        iterations: Some(iterations),
        coloured_depth_mm: 0.6,
        residual_blur_mm: 0.06,
        ..RefineSettings::default()
    }
}

/// Yellow between blue lines, which take its red and green away.
fn keys() -> Slab {
    Slab::small().towards(|[x, ..]| if x / 4 % 2 == 0 { YELLOW } else { BLUE })
}

fn run(strategy: impl Strategy, iterations: u32) -> (RefineReport, LabelGrid) {
    let slab = keys();
    let (mut labels, mut bound) = (slab.solid.clone(), slab.blur());
    let refined =
        refine(&mut labels, slab.problem(), strategy, settings(iterations), &mut bound, &Control::none())
            .unwrap();
    (refined.report, labels)
}

fn descent() -> Descent {
    Descent { opening_steps: 3, ..Descent::default() }
}

#[test]
fn what_neighbours_are_to_blame_for_is_cured() {
    let (heuristic, _) = run(SurfaceFirst::default(), 16);
    let (report, _) = run(descent(), 40);
    let least = |report: &RefineReport| report.best_iteration().unwrap().smoothed.mean;
    // 0.59 when written; a step that no longer follows the derivative stays near 1.
    assert!(least(&report) < 0.8 * least(&heuristic), "{} {}", least(&report), least(&heuristic));
    // The opening is the heuristic, and from there on the loss falls.
    for (a, b) in report.iterations.iter().zip(&heuristic.iterations).take(4) {
        assert_eq!((a.smoothed, a.label_flips), (b.smoothed, b.label_flips));
    }
    let losses: Vec<f64> = report.iterations.iter().filter_map(|i| i.loss).collect();
    assert!(losses.len() + 4 >= report.iterations.len() && losses.iter().all(|l| l.is_finite()));
    let least = losses.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(least < 0.7 * losses[0], "{losses:?}");
    assert!(report.iterations.iter().filter_map(|i| i.step).all(|s| s > 0.0 && s < 0.25));
}

#[test]
fn it_stops_by_itself_when_nothing_is_gained() {
    let (report, _) = run(descent(), 400);
    assert!(report.settled && report.iterations.len() < 200, "{}", report.iterations.len());
    let (few, _) = run(descent(), 6);
    assert!(!few.settled && few.iterations.len() == 7);
}

#[test]
fn labels_do_not_depend_on_threads() {
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| run(descent(), 10))
    };
    let ((one, a), (three, b)) = (with(1), with(3));
    assert!(a == b);
    let of = |r: &RefineReport| r.iterations.iter().map(|i| (i.smoothed, i.loss, i.step)).collect::<Vec<_>>();
    assert_eq!(of(&one), of(&three));
}

#[test]
fn other_rules_of_steps_lower_the_loss_too() {
    for rule in [StepRule::Bound, StepRule::BarzilaiBorwein] {
        let (report, _) = run(Descent { rule, ..descent() }, 15);
        let losses: Vec<f64> = report.iterations.iter().filter_map(|i| i.loss).collect();
        let least = losses.iter().copied().fold(f64::INFINITY, f64::min);
        assert!(least < 0.8 * losses[0], "{rule:?}: {losses:?}");
    }
}

#[test]
fn a_job_resumed_after_any_step_ends_as_one_that_was_not() {
    resumed(&descent(), &[2, 4, 5, 8]);
    for rule in [StepRule::Bound, StepRule::BarzilaiBorwein] {
        resumed(&Descent { rule, ..descent() }, &[6]);
    }
}

#[test]
fn noise_of_the_prediction_is_measured_and_kept_small() {
    let slab = keys();
    let first = |noise: f64| {
        let (mut labels, mut bound) = (slab.solid.clone(), Blur { noise, ..slab.blur() });
        let descent = Descent { opening_steps: 0, ..descent() };
        let refined =
            refine(&mut labels, slab.problem(), descent, settings(12), &mut bound, &Control::none()).unwrap();
        (refined.report, bound.efforts.into_inner().unwrap())
    };
    let ((clean, usual), (noisy, more)) = (first(0.0), first(0.15));
    // Without noise it is measured once; the first labels are the same, so that the loss tells what noise adds.
    let measured = |report: &RefineReport| report.iterations.iter().map(|i| i.noise).collect::<Vec<_>>();
    assert_eq!(measured(&clean).iter().flatten().collect::<Vec<_>>(), [&0.0]);
    let loss = |report: &RefineReport| report.iterations[0].loss.unwrap();
    let (noise, added) = (noisy.iterations[0].noise.unwrap(), loss(&noisy) - loss(&clean));
    // 40 x 20 x 60 voxels have 8,800 on the surface; smoothed over some 40 of them, that is about 200 independent
    // squares in three channels, whose mean has a standard error of some 6 %.
    assert!((noise / added - 1.0).abs() < 0.25, "{noise} {added}");
    // Of the coarse steps, then of the fine ones.
    assert!(usual.is_sorted() && (usual[0], usual.last()) == (1, Some(&2)), "{usual:?}");
    assert!(more[0] == 1 && more.last().is_some_and(|&e| e > 2) && more.is_sorted(), "{more:?}");
}

fn resumed(descent: &Descent, stops: &[u32]) {
    resumed_with(descent, stops, 0.0);
    resumed_with(descent, stops, 0.1);
}

fn resumed_with(descent: &Descent, stops: &[u32], noise: f64) {
    let slab = keys();
    let noisy = || Blur { noise, ..slab.blur() };
    let (mut whole_labels, mut bound) = (slab.solid.clone(), noisy());
    let whole =
        refine(&mut whole_labels, slab.problem(), descent.clone(), settings(9), &mut bound, &Control::none())
            .unwrap()
            .report;
    let descent = || descent.clone();
    for &stop in stops {
        let (mut labels, mut bound) = (slab.solid.clone(), noisy());
        let mut first = Refinement::new(slab.problem(), descent(), settings(9), &Control::none()).unwrap();
        for _ in 0..stop {
            first.step(&mut labels, &mut bound, &Control::none()).unwrap();
        }
        let bytes = first.save().to_bytes().unwrap();
        let saved = Saved::<DescentState>::from_bytes(&bytes).unwrap();
        let mut second =
            Refinement::resume(slab.problem(), descent(), settings(9), saved, &Control::none()).unwrap();
        let (mut labels, mut bound) = (slab.solid.clone(), noisy());
        while !second.is_finished() {
            second.step(&mut labels, &mut bound, &Control::none()).unwrap();
        }
        let refined = second.finish(&mut labels, &Control::none()).unwrap();
        assert!(labels == whole_labels, "{stop}");
        assert_eq!(refined.report.best, whole.best);
    }
}

#[test]
fn a_damaged_state_and_settings_out_of_range_are_named() {
    let slab = keys();
    let (mut labels, mut bound) = (slab.solid.clone(), slab.blur());
    let mut refinement = Refinement::new(slab.problem(), descent(), settings(9), &Control::none()).unwrap();
    for _ in 0..5 {
        refinement.step(&mut labels, &mut bound, &Control::none()).unwrap();
    }
    for (field, other, text) in
        [("inks", "moves", "mixture"), ("lacks", "curvatures", "whether chroma is missing")]
    {
        let mut json: serde_json::Value = serde_json::to_value(refinement.save().state).unwrap();
        json[field] = json[other].clone();
        let mut saved = refinement.save();
        saved.state = serde_json::from_value(json).unwrap();
        let error = Refinement::resume(slab.problem(), descent(), settings(9), saved, &Control::none())
            .err()
            .unwrap();
        assert!(matches!(error, RefineError::Invalid(_)) && error.to_string().contains(text), "{error}");
    }

    for (field, strategy) in [
        ("momentum", Descent { momentum: 1.0, ..descent() }),
        ("contrast", Descent { contrast: 11.0, ..descent() }),
        ("chroma", Descent { chroma: -1.0, ..descent() }),
        ("forgiveness", Descent { forgiveness: -0.1, ..descent() }),
        ("opening_steps", Descent { opening_steps: 101, ..descent() }),
    ] {
        let error = Refinement::new(slab.problem(), strategy, settings(1), &Control::none()).err().unwrap();
        assert!(error.to_string().contains(field), "{error}");
    }
}

/// A predictor without a gradient.
struct Without(Blur);

impl BoundPredictor for Without {
    fn update(
        &mut self,
        labels: &LabelGrid,
        changed: Changed<'_>,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        self.0.update(labels, changed, control)
    }
    fn predict(
        &self,
        points: &[u32],
        draw: Draw,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<Diagnostics, PredictError> {
        self.0.predict(points, draw, out, control)
    }
}

#[test]
fn a_predictor_without_gradient_is_named() {
    let slab = keys();
    let (mut labels, mut bound) = (slab.solid.clone(), Without(slab.blur()));
    let found = refine(&mut labels, slab.problem(), descent(), settings(9), &mut bound, &Control::none());
    let error = found.err().unwrap();
    assert!(matches!(error, RefineError::Predict { .. }), "{error:?}");
}

/// What a refinement towards `further` as well ends with: labels, and the mean smoothed error in each viewing.
fn run_in(further: &[Aim<'_>], iterations: u32) -> (LabelGrid, Vec<f64>) {
    let slab = keys();
    let (mut labels, mut bound) = (slab.solid.clone(), slab.blur());
    let problem = Problem { further, ..slab.problem() };
    let settings = settings(iterations);
    let refined = refine(&mut labels, problem, descent(), settings, &mut bound, &Control::none()).unwrap();
    let best = refined.report.best_iteration().unwrap().clone();
    (labels, std::iter::once(best.smoothed.mean).chain(best.further).collect())
}

#[test]
fn the_same_aim_twice_is_that_aim() {
    let slab = keys();
    let twice = Aim { viewing: &slab.viewing, printable_target: &slab.printable };
    let (once, alone) = run_in(&[], 12);
    let (both, together) = run_in(&[twice], 12);
    assert!(once == both);
    assert_eq!(together, [alone[0], alone[0]]);
}

#[test]
fn a_further_viewing_is_heeded() {
    let slab = keys();
    // A light in which blue counts for red too, and in which everything should look a little redder.
    let rows = [vec![0.4, 0.0, 0.6], vec![0.0, 1.0, 0.0], vec![0.0, 0.0, 1.0]];
    let lamp = Viewing::from_rows(rows, MediaWhite::new([0.8; 3]).unwrap()).unwrap();
    let wanted: Vec<[f32; 3]> = slab.printable.iter().map(|&[r, g, b]| [0.5 * (r + b), g, b]).collect();
    let aim = [Aim { viewing: &lamp, printable_target: &wanted }];
    let (_, heeded) = run_in(&aim, 30);
    // The same print without heeding it: of one iteration that starts where the other ended there is no such report, so
    // the strategy that looks at its own viewing alone is asked.
    let (mut labels, mut bound) = (slab.solid.clone(), slab.blur());
    let problem = Problem { further: &aim, ..slab.problem() };
    let own =
        refine(&mut labels, problem, SurfaceFirst::default(), settings(30), &mut bound, &Control::none());
    let own = own.unwrap().report.best_iteration().unwrap().clone();
    assert!(heeded[1] < 0.8 * own.further[0], "{heeded:?} {:?}", own.further);
}

#[test]
fn aims_of_other_channels_are_refused() {
    let slab = keys();
    let five = Viewing::from_rows([0.2; 3].map(|w| vec![w; 5]), MediaWhite::new([1.0; 3]).unwrap()).unwrap();
    for aim in [
        Aim { viewing: &five, printable_target: &slab.printable },
        Aim { viewing: &slab.viewing, printable_target: &slab.printable[1..] },
    ] {
        let problem = Problem { further: &[aim], ..slab.problem() };
        let made = Refinement::new(problem, descent(), settings(3), &Control::none());
        assert!(matches!(made.err(), Some(RefineError::Invalid(_))));
    }
}
