//! The loop against small predictors.

mod common;

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use common::{Blur, CYAN, Inks, MEDIA_WHITE, Slab, Told, WHITE};
use pellucid_core::chain;
use pellucid_predict::{BoundPredictor, Changed, Draw, Pass};
use pellucid_refine::{
    Cell, IterationReport, Mixtures, Moved, Planned, RefineError, RefineSettings, Refined, Refinement, Saved,
    Seen, Setup, Strategy, SurfaceFirst, SurfaceSmoother, refine,
};
use pellucid_voxel::{Control, LabelGrid, Pitch};

fn settings(iterations: u32) -> RefineSettings {
    RefineSettings {
        iterations: Some(iterations),
        coloured_depth_mm: 0.6,
        seed: 5,
        ..RefineSettings::default()
    }
}

/// Corrections to the extrusion alone, which the mock judges by its depth of 0.2 mm.
fn extruding() -> SurfaceFirst {
    SurfaceFirst { gain: 1.0, base_mm: 0.6, veil_mm: 0.0, ..SurfaceFirst::default() }
}

/// Left and right halves of different colours.
fn halves(left: [f32; 3], right: [f32; 3]) -> impl Fn([u32; 3]) -> [f32; 3] {
    move |v| if v[0] < 20 { left } else { right }
}

const ORANGE: [f32; 3] = [0.8, 0.5, 0.4];
const BLUE: [f32; 3] = [0.4, 0.6, 0.9];

fn run(
    slab: &Slab,
    strategy: SurfaceFirst,
    settings: RefineSettings,
    bound: &mut Blur,
) -> (LabelGrid, Refined) {
    let mut labels = slab.solid.clone();
    let refined = refine(&mut labels, slab.problem(), strategy, settings, bound, &Control::none()).unwrap();
    (labels, refined)
}

/// Errors of iterations without what depends on time or on the labels that were handed in.
fn errors(reports: &[IterationReport]) -> Vec<[f64; 3]> {
    reports.iter().map(|i| [i.target.mean, i.printable_target.p95, i.smoothed.mean]).collect()
}

#[test]
fn noise_does_not_shift_dark_colours() {
    let dark = [0.2, 1.0, 1.0];
    let slab = Slab::small().towards(|_| dark);
    let shown = |few_paths: bool| {
        let (labels, _) = run(&slab, extruding(), settings(8), &mut Blur { few_paths, ..slab.blur() });
        let top: Vec<u32> = (0..slab.object.surface().len() as u32)
            .filter(|&p| {
                let [x, y, z] = slab.object.surface().voxels()[p as usize];
                z == 59 && (8..32).contains(&x) && (4..16).contains(&y)
            })
            .collect();
        let mut out = vec![0.0; top.len() * 3];
        let mut bound = slab.blur();
        bound.update(&labels, Changed::Unknown, &Control::none()).unwrap();
        bound.predict(&top, Draw::new(0, Pass::Loop(0)), &mut out, &Control::none()).unwrap();
        out.iter().step_by(3).sum::<f32>() / top.len() as f32 / MEDIA_WHITE[0] as f32
    };
    let (clean, noisy) = (shown(false), shown(true));
    // A loop that took roots of single values would see a quarter of the light (0.63 cubed) and settle near four
    // times the target; what eight steps leave of it and the noise of 25 averaged values stay within a fifth.
    assert!((clean - 0.2).abs() < 0.03, "{clean}");
    assert!((noisy - 0.2).abs() < 0.04, "{noisy}, without noise {clean}");
}

#[test]
fn error_falls_in_every_channel_and_the_best_iterate_is_kept() {
    let slab = Slab::small().towards(halves(ORANGE, BLUE));
    let (labels, refined) = run(&slab, extruding(), settings(8), &mut slab.blur());
    let report = &refined.report;
    let means: Vec<f64> = report.iterations.iter().map(|i| i.smoothed.mean).collect();
    assert_eq!(means.len(), 9);
    let least = means.iter().copied().fold(f64::INFINITY, f64::min);
    assert_eq!(means[report.best as usize], least);
    assert!(least < 0.7 * means[0], "{means:?}");
    assert!(refined.unrefined != labels);
    let inked: u64 = refined.unrefined.histogram()[1..4].iter().sum();
    assert_eq!(report.iterations[0].label_flips, inked);
    // Orange lacks blue, so yellow lies on the left; cyan on the right.
    let counts = |label: u8, x: std::ops::Range<u32>| {
        let voxels = x.flat_map(|x| (0..20).flat_map(move |y| (0..60).map(move |z| [x, y, z])));
        voxels.filter(|&v| labels.get(v) == label).count()
    };
    assert!(counts(3, 0..16) > 4 * counts(3, 24..40), "{}", counts(3, 0..16));
    assert!(counts(CYAN, 24..40) > 2 * counts(CYAN, 0..16));
}

#[test]
fn zero_iterations_leave_the_extruded_halftone() {
    let slab = Slab::small().towards(|_| [0.55, 1.0, 1.0]);
    let (labels, refined) = run(&slab, SurfaceFirst::default(), settings(0), &mut slab.blur());
    assert!(labels == refined.unrefined);
    let [sx, sy, sz] = labels.size();
    let voxels = (0..sz).flat_map(|z| (0..sy).flat_map(move |y| (0..sx).map(move |x| [x, y, z])));
    let within = voxels.filter(|&v| slab.nearest.distance_mm(v).is_some_and(|d| d < 0.6)).count();
    let share = labels.histogram()[usize::from(CYAN)] as f64 / within as f64;
    assert!((share - 0.5).abs() < 0.01, "{share}");
}

#[test]
fn labels_do_not_depend_on_threads() {
    let slab = Slab::small().towards(halves(ORANGE, BLUE));
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| run(&slab, SurfaceFirst::default(), settings(3), &mut slab.blur()).0)
    };
    assert!(with(1) == with(3));
    let other = RefineSettings { seed: 6, ..settings(3) };
    assert!(run(&slab, SurfaceFirst::default(), other, &mut slab.blur()).0 != with(1));
}

#[test]
fn targets_out_of_reach_do_not_wind_up() {
    // Beside a dark half, white cannot be reached near the edge; away from it nothing may be disturbed.
    let slab = Slab::small().towards(halves([0.3; 3], [1.0; 3]));
    let (labels, _) = run(&slab, SurfaceFirst::default(), settings(12), &mut slab.blur());
    let far = (32..38).flat_map(|x| (20..40).map(move |z| [x, 10, z]));
    assert_eq!(far.filter(|&v| labels.get(v) != WHITE).count(), 0, "white stays white where it is in reach");
}

#[test]
fn the_predictor_is_told_exactly_which_tiles_changed() {
    let slab = Slab::small().towards(halves(ORANGE, BLUE));
    let mut bound = slab.blur();
    let (_, refined) = run(&slab, SurfaceFirst::default(), settings(4), &mut bound);
    assert_eq!(bound.told.len(), 5);
    assert_eq!(bound.told[0], Told::Unknown);
    for (told, report) in bound.told[1..].iter().zip(&refined.report.iterations[1..]) {
        let Told::Tiles(told, truth) = told else { panic!("{told:?}") };
        assert_eq!(told, truth);
        assert_eq!(told.len() as u64, report.changed_tiles);
        assert!(!told.is_empty());
    }
}

#[test]
fn one_and_many_channels_refine_through_their_viewing() {
    for channels in [1, 31] {
        let pitch = Pitch::new([0.05, 0.05, 0.03]).unwrap();
        let grey = channels == 1;
        let slab = Slab::new(pitch, [40, 20, 60], channels, 0.6);
        let slab = slab.towards(if grey { halves([0.5; 3], [0.8; 3]) } else { halves(ORANGE, BLUE) });
        let (labels, refined) = run(&slab, extruding(), settings(6), &mut slab.blur());
        let means: Vec<f64> = refined.report.iterations.iter().map(|i| i.smoothed.mean).collect();
        let best = means[refined.report.best as usize];
        assert!(best < 0.8 * means[0], "{channels} channels: {means:?}");
        if !grey {
            // The 31 bands hold the same light as three channels do, but for rounding.
            let three = Slab::small().towards(halves(ORANGE, BLUE));
            let (_, same) = run(&three, extruding(), settings(6), &mut three.blur());
            assert!((same.report.iterations[0].smoothed.mean - means[0]).abs() < 1e-3);
            assert!(labels.histogram()[3] > 0);
        }
    }
    let slab = Slab::small().towards(|_| ORANGE);
    let viewing = common::viewing(31);
    let problem = pellucid_refine::Problem { viewing: &viewing, ..slab.problem() };
    let error = refine(
        &mut slab.solid.clone(),
        problem,
        SurfaceFirst::default(),
        settings(1),
        &mut slab.blur(),
        &Control::none(),
    );
    let error = error.unwrap_err().to_string();
    assert!(error.contains("viewing: 31 channels; the materials have 3"), "{error}");
}

#[test]
fn a_job_resumed_after_any_step_ends_as_one_that_was_not() {
    let slab = Slab::small().towards(halves(ORANGE, BLUE));
    let learning = || Blur { learns: true, ..slab.blur() };
    let control = Control::none();
    let (labels, whole) = run(&slab, extruding(), settings(5), &mut learning());
    let forgetful = run(&slab, extruding(), settings(5), &mut slab.blur());
    assert!(forgetful.0 != labels, "what was learned matters");
    for stop in 0..=6 {
        let mut first = slab.solid.clone();
        let mut bound = learning();
        let new = Refinement::new(slab.problem(), extruding(), settings(5), &control);
        let mut refinement = new.unwrap();
        for _ in 0..stop {
            refinement.step(&mut first, &mut bound, &control).unwrap();
        }
        let saved = refinement.save();
        drop((refinement, first, bound));
        let bytes = saved.to_bytes().unwrap();
        let read = Saved::from_bytes(&bytes).unwrap();
        assert!(read == saved, "every bit comes back");

        let mut second = slab.solid.clone();
        let mut bound = learning();
        let resumed = Refinement::resume(slab.problem(), extruding(), settings(5), read, &control);
        let mut refinement = resumed.unwrap();
        assert_eq!(refinement.iteration(), stop);
        while !refinement.is_finished() {
            refinement.step(&mut second, &mut bound, &control).unwrap();
        }
        let refined = refinement.finish(&mut second, &control).unwrap();
        assert!(second == labels && refined.unrefined == whole.unrefined, "stopped after {stop}");
        assert_eq!(errors(&refined.report.iterations), errors(&whole.report.iterations));
        assert_eq!(refined.report.best, whole.report.best);
    }
}

#[test]
fn a_checkpoint_is_compact_and_refused_when_it_does_not_fit() {
    let slab = Slab::small().towards(halves(ORANGE, BLUE));
    let control = Control::none();
    let mut labels = slab.solid.clone();
    let new = |strategy, settings| Refinement::new(slab.problem(), strategy, settings, &control).unwrap();
    let mut refinement = new(SurfaceFirst::default(), settings(3));
    refinement.step(&mut labels, &mut slab.blur(), &control).unwrap();
    let saved = refinement.save();
    let bytes = saved.to_bytes().unwrap();
    // Two states of 12 bytes a voxel, in base64.
    assert!(bytes.len() < slab.target.len() * 32 + 4000, "{} bytes", bytes.len());

    let refused = |saved: Saved<_>, strategy: SurfaceFirst, settings: RefineSettings, slab: &Slab| {
        match Refinement::resume(slab.problem(), strategy, settings, saved, &control) {
            Ok(_) => panic!("was taken"),
            Err(error) => error.to_string(),
        }
    };
    let other = SurfaceFirst { gain: 1.0, ..SurfaceFirst::default() };
    assert!(refused(saved.clone(), other, settings(3), &slab).contains("\"gain\": 1.0"));
    let text = refused(saved.clone(), SurfaceFirst::default(), settings(4), &slab);
    assert!(text.contains("iterations: Some(3)") && text.contains("iterations: Some(4)"), "{text}");
    let target = Slab::small().towards(halves(BLUE, ORANGE));
    assert!(refused(saved.clone(), SurfaceFirst::default(), settings(3), &target).contains("other targets"));
    let mut lit = Slab::small().towards(halves(ORANGE, BLUE));
    lit.viewing = pellucid_color::Viewing::rgb(pellucid_color::MediaWhite::new([0.7, 0.8, 0.61]).unwrap());
    assert!(refused(saved.clone(), SurfaceFirst::default(), settings(3), &lit).contains("viewing"));
    let size = Slab::new(Pitch::new([0.05; 3]).unwrap(), [40, 20, 60], 3, 0.6).towards(|_| BLUE);
    assert!(refused(saved.clone(), SurfaceFirst::default(), settings(3), &size).contains("another object"));
    let damages: [fn(&mut Saved<pellucid_refine::SurfaceFirstState>); 4] = [
        |s| s.state.residual.truncate(5),
        |s| s.state.residual[3][1] = f32::NAN,
        |s| s.iteration = 3,
        |s| s.report.best = 7,
    ];
    for damage in damages {
        let mut damaged = saved.clone();
        damage(&mut damaged);
        let text = refused(damaged, SurfaceFirst::default(), settings(3), &slab);
        assert!(text.starts_with("invalid checkpoint: "), "{text}");
    }

    type Read = Result<Saved<pellucid_refine::SurfaceFirstState>, RefineError>;
    let read = |bytes: &[u8]| -> Read { Saved::from_bytes(bytes) };
    for cut in [0, 10, 30, bytes.len() / 2, bytes.len() - 1] {
        assert!(matches!(read(&bytes[..cut]), Err(RefineError::Invalid(_))), "{cut}");
    }
    let mut flipped = bytes.clone();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 1;
    assert!(read(&flipped).unwrap_err().to_string().contains("damaged"));
    let later = [b"pellucid refinement 2".as_slice(), &bytes[21..]].concat();
    assert!(matches!(read(&later), Err(RefineError::Unsupported(_))));
}

#[test]
fn a_step_that_failed_can_be_repeated_with_the_same_result() {
    let slab = Slab::small().towards(halves(ORANGE, BLUE));
    let control = Control::none();
    let learning = || Blur { learns: true, ..slab.blur() };
    let (labels, whole) = run(&slab, SurfaceFirst::default(), settings(4), &mut learning());
    let mut grid = slab.solid.clone();
    let mut bound = learning();
    let new = Refinement::new(slab.problem(), SurfaceFirst::default(), settings(4), &control);
    let mut refinement = new.unwrap();
    while !refinement.is_finished() {
        let before = refinement.save();
        bound.fails_in = Some(refinement.iteration());
        let error = refinement.step(&mut grid, &mut bound, &control).unwrap_err();
        let expected =
            format!("prediction in iteration {}: predictor blur failed: planted", before.iteration);
        assert_eq!(chain(&error), expected);
        assert!(refinement.save() == before, "nothing was lost");
        bound.fails_in = None;

        // Cancelled in the midst of the prediction.
        let stop = AtomicBool::new(false);
        let reported = AtomicU32::new(0);
        let progress = |_: u64, _: u64| {
            if reported.fetch_add(1, Ordering::Relaxed) == 3 {
                stop.store(true, Ordering::Relaxed);
            }
        };
        let cancelling = Control::none().with_cancel(&stop).with_progress(&progress);
        let error = refinement.step(&mut grid, &mut bound, &cancelling).unwrap_err();
        assert!(matches!(error, RefineError::Cancelled));
        assert_eq!(reported.load(Ordering::Relaxed), 4, "stopped at once");
        assert!(refinement.save() == before);

        refinement.step(&mut grid, &mut bound, &control).unwrap();
        assert_eq!(*bound.told.last().unwrap(), Told::Unknown, "tiles are not known after a failure");
    }
    let asked = bound.asked.lock().unwrap().clone();
    assert_eq!(asked, (0..5).flat_map(|i| [i; 3]).collect::<Vec<_>>());
    let refined = refinement.finish(&mut grid, &control).unwrap();
    assert!(grid == labels && refined.unrefined == whole.unrefined);
    assert_eq!(errors(&refined.report.iterations), errors(&whole.report.iterations));
}

/// [`SurfaceFirst`] that sets a flag after some voxels were halftoned.
struct Interrupted<'a> {
    inner: SurfaceFirst,
    left: &'a AtomicU32,
    stop: &'a AtomicBool,
}

struct InterruptedMixtures<'s> {
    inner: Box<dyn Mixtures + 's>,
    left: &'s AtomicU32,
    stop: &'s AtomicBool,
}

impl Mixtures for InterruptedMixtures<'_> {
    fn thresholds<'r>(&'r self, cell: &Cell, scratch: &'r mut [u16]) -> &'r [u16] {
        if self.left.load(Ordering::Relaxed) > 0 && self.left.fetch_sub(1, Ordering::Relaxed) == 1 {
            self.stop.store(true, Ordering::Relaxed);
        }
        self.inner.thresholds(cell, scratch)
    }
}

impl Strategy for Interrupted<'_> {
    type State = <SurfaceFirst as Strategy>::State;
    type Tools = ();
    type Step = <SurfaceFirst as Strategy>::Step;
    fn name(&self) -> &str {
        "interrupted"
    }
    fn settings(&self) -> Vec<(&'static str, f64)> {
        self.inner.settings()
    }
    fn iterations(&self) -> u32 {
        self.inner.iterations()
    }
    fn check(&self) -> Result<(), RefineError> {
        self.inner.check()
    }
    fn start(&self, setup: &Setup<'_>) -> Self::State {
        self.inner.start(setup)
    }
    fn check_state(&self, setup: &Setup<'_>, state: &Self::State) -> Result<(), RefineError> {
        self.inner.check_state(setup, state)
    }
    fn mixtures<'s>(
        &'s self,
        setup: &'s Setup<'_>,
        state: &'s Self::State,
        control: &Control<'_>,
    ) -> Result<Planned<'s>, RefineError> {
        let Planned { mixtures, overflow } = self.inner.mixtures(setup, state, control)?;
        let mixtures = InterruptedMixtures { inner: mixtures, left: self.left, stop: self.stop };
        Ok(Planned { mixtures: Box::new(mixtures), overflow })
    }
    fn tools(&self, _: &Setup<'_>, _: &SurfaceSmoother, _: &Control<'_>) -> Result<(), RefineError> {
        Ok(())
    }
    fn plan(
        &self,
        setup: &Setup<'_>,
        (): &(),
        state: &Self::State,
        seen: &Seen<'_>,
        control: &Control<'_>,
    ) -> Result<Self::Step, RefineError> {
        self.inner.plan(setup, &(), state, seen, control)
    }
    fn take(&self, setup: &Setup<'_>, (): &(), state: &mut Self::State, step: Self::Step) -> Moved {
        self.inner.take(setup, &(), state, step)
    }
}

#[test]
fn cancelled_within_the_halftone_labels_are_a_mixture_of_two_iterates() {
    let slab = Slab::small().towards(halves(ORANGE, BLUE));
    let control = Control::none();
    let (before, after) = {
        let mut labels = slab.solid.clone();
        let new = Refinement::new(slab.problem(), SurfaceFirst::default(), settings(3), &control);
        let (mut refinement, mut bound) = (new.unwrap(), slab.blur());
        refinement.step(&mut labels, &mut bound, &control).unwrap();
        let before = labels.clone();
        refinement.step(&mut labels, &mut bound, &control).unwrap();
        (before, labels)
    };
    let (left, stop) = (AtomicU32::new(0), AtomicBool::new(false));
    let strategy = Interrupted { inner: SurfaceFirst::default(), left: &left, stop: &stop };
    let cancelling = Control::none().with_cancel(&stop);
    let mut refinement = Refinement::new(slab.problem(), strategy, settings(3), &control).unwrap();
    let (mut labels, mut bound) = (slab.solid.clone(), slab.blur());
    refinement.step(&mut labels, &mut bound, &cancelling).unwrap();
    left.store(6000, Ordering::Relaxed);
    let error = refinement.step(&mut labels, &mut bound, &cancelling).unwrap_err();
    assert!(matches!(error, RefineError::Cancelled));
    assert!(labels != before && labels != after, "neither of the two");
    let tile = |grid: &LabelGrid, t: usize| -> Vec<u8> {
        (0..4096).map(|i| grid.tiles()[t].label(i % 16, i / 16 % 16, i / 256)).collect()
    };
    for t in 0..labels.tiles().len() {
        let found = tile(&labels, t);
        assert!(found == tile(&before, t) || found == tile(&after, t), "tile {t} is of one of the two");
    }
    stop.store(false, Ordering::Relaxed);
    refinement.step(&mut labels, &mut bound, &cancelling).unwrap();
    assert!(labels == after, "the step repeated");
}

#[test]
fn a_flag_that_is_set_stops_everything() {
    let stop = AtomicBool::new(true);
    let control = Control::none().with_cancel(&stop);
    let slab = Slab::small().towards(|_| ORANGE);
    let new = Refinement::new(slab.problem(), SurfaceFirst::default(), settings(1), &control);
    assert!(matches!(new.err(), Some(RefineError::Cancelled)));
}

#[test]
fn finishing_early_keeps_the_best_so_far_and_steps_past_the_end_are_refused() {
    let slab = Slab::small().towards(halves(ORANGE, BLUE));
    let control = Control::none();
    let new = || Refinement::new(slab.problem(), extruding(), settings(2), &control).unwrap();
    let mut labels = slab.solid.clone();
    assert!(new().finish(&mut labels, &control).is_err());
    let (mut refinement, mut bound) = (new(), slab.blur());
    refinement.step(&mut labels, &mut bound, &control).unwrap();
    refinement.step(&mut labels, &mut bound, &control).unwrap();
    let second = labels.clone();
    let refined = refinement.finish(&mut labels, &control).unwrap();
    assert_eq!(refined.report.best, 1);
    assert!(labels == second);
    let mut refinement = new();
    for _ in 0..3 {
        refinement.step(&mut labels, &mut bound, &control).unwrap();
    }
    let error = refinement.step(&mut labels, &mut bound, &control).unwrap_err().to_string();
    assert!(error.contains("all iterations are done"), "{error}");
}

#[test]
fn inputs_that_do_not_fit_are_named() {
    let slab = Slab::small().towards(|_| ORANGE);
    let refused = |problem, strategy: SurfaceFirst, settings: RefineSettings| match Refinement::new(
        problem,
        strategy,
        settings,
        &Control::none(),
    ) {
        Ok(_) => panic!("was taken"),
        Err(error) => error.to_string(),
    };
    let default = SurfaceFirst::default;
    let deep = RefineSettings { coloured_depth_mm: 1.5, ..settings(1) };
    assert!(refused(slab.problem(), default(), deep).contains("nearest"));
    let base = SurfaceFirst { base_mm: f64::NAN, ..default() };
    assert!(refused(slab.problem(), base, settings(1)).contains("base_mm"));
    // Wider ones took tens of thousands of passes.
    let wide = RefineSettings { residual_blur_mm: 1.001, ..settings(1) };
    assert!(refused(slab.problem(), default(), wide).contains("residual_blur_mm: must be 0 to 1 mm"));
    let broken = Slab::small().towards(|v| [0.5, if v == [0; 3] { f32::NAN } else { 0.5 }, 0.5]);
    assert!(refused(broken.problem(), default(), settings(1)).contains("target"));
    struct Twice;
    impl pellucid_refine::InkModel for Twice {
        fn labels(&self) -> &[u8] {
            &[1, 1, 5]
        }
        fn fractions(&self, rgb: [f32; 3], fractions: &mut [f32]) -> [f32; 3] {
            Inks.fractions(rgb, fractions)
        }
        fn color(&self, fractions: &[f32]) -> [f32; 3] {
            Inks.color(fractions)
        }
    }
    let problem = pellucid_refine::Problem { ink: &Twice, ..slab.problem() };
    assert!(refused(problem, default(), settings(1)).contains("ink model"));
}
