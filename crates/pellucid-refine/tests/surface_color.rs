//! Surface colours alone: what a printer of textured models is asked for.

mod common;

use common::{Inks, Slab};
use pellucid_refine::{InkModel, RefineSettings, Refinement, Strategy, SurfaceColor};
use pellucid_voxel::Control;

const ORANGE: [f32; 3] = [0.8, 0.5, 0.4];
const BLUE: [f32; 3] = [0.4, 0.6, 0.9];
/// No ink takes so much.
const OUT_OF_REACH: [f32; 3] = [0.02, 0.9, 0.01];

fn settings() -> RefineSettings {
    RefineSettings { iterations: Some(8), coloured_depth_mm: 0.6, seed: 5, ..RefineSettings::default() }
}

fn slab() -> Slab {
    Slab::small().towards(|v| match v[0] {
        0..18 => ORANGE,
        18..36 => BLUE,
        _ => OUT_OF_REACH,
    })
}

#[test]
fn the_error_falls_and_every_colour_asked_for_is_printable() {
    let slab = slab();
    let control = Control::none();
    let mut bound = slab.blur();
    let mut labels = slab.solid.clone();
    let mut refinement =
        Refinement::new(slab.problem(), SurfaceColor::default(), settings(), &control).unwrap();
    assert!(refinement.best_state().is_none());
    while !refinement.is_finished() {
        refinement.step(&mut labels, &mut bound, &control).unwrap();
    }
    let means: Vec<f64> = refinement.report().iterations.iter().map(|i| i.smoothed.mean).collect();
    let best = means[refinement.report().best as usize];
    assert!(best < 0.7 * means[0], "{means:?}");

    let colors = SurfaceColor::colors(refinement.setup(), refinement.best_state().unwrap());
    let first = SurfaceColor::colors(refinement.setup(), &SurfaceColor::default().start(refinement.setup()));
    let mut moved = 0;
    for ((color, first), target) in colors.iter().zip(&first).zip(&slab.target) {
        // A printer gives what is asked for, and the texture as it was is asked for at first.
        let mut fractions = [0.0; 4];
        let printed = Inks.fractions(*color, &mut fractions);
        assert!((0..3).all(|c| (printed[c] - color[c]).abs() < 1e-4 && (0.0..=1.0).contains(&color[c])));
        let as_it_was = Inks.fractions(*target, &mut fractions);
        assert!((0..3).all(|c| (first[c] - as_it_was[c]).abs() < 1e-5), "{first:?} {as_it_was:?}");
        moved += usize::from((0..3).any(|c| (color[c] - first[c]).abs() > 0.02));
    }
    assert!(moved > colors.len() / 4, "{moved} of {}", colors.len());
}

#[test]
fn each_column_is_one_mixture_and_a_saved_state_goes_on_the_same() {
    let slab = slab();
    let control = Control::none();
    let run = |stop: u32| {
        let mut bound = slab.blur();
        let mut labels = slab.solid.clone();
        let mut refinement =
            Refinement::new(slab.problem(), SurfaceColor::default(), settings(), &control).unwrap();
        while refinement.iteration() < stop && !refinement.is_finished() {
            refinement.step(&mut labels, &mut bound, &control).unwrap();
        }
        if !refinement.is_finished() {
            let saved = refinement.save();
            let strategy = SurfaceColor::default();
            refinement = Refinement::resume(slab.problem(), strategy, settings(), saved, &control).unwrap();
            (bound, labels) = (slab.blur(), slab.solid.clone());
            while !refinement.is_finished() {
                refinement.step(&mut labels, &mut bound, &control).unwrap();
            }
        }
        refinement.finish(&mut labels, &control).unwrap();
        labels
    };
    let labels = run(u32::MAX);
    assert_eq!(labels, run(3));
    // In the middle of the orange half the share of ink is the same at the top as below it.
    let share = |layers: std::ops::Range<u32>| {
        let (mut inked, mut all) = (0.0, 0.0);
        for z in layers {
            for y in 4..16 {
                for x in 6..14 {
                    inked += f64::from(u8::from(labels.get([x, y, z]) < 4));
                    all += 1.0;
                }
            }
        }
        inked / all
    };
    let (top, below) = (share(56..60), share(50..54));
    assert!((top - below).abs() < 0.06, "{top} {below}");
}

#[test]
fn settings_out_of_range_are_told() {
    let slab = slab();
    for strategy in [
        SurfaceColor { gain: 0.0, ..SurfaceColor::default() },
        SurfaceColor { gain: f32::NAN, ..SurfaceColor::default() },
        SurfaceColor { gain_decay: -1.0, ..SurfaceColor::default() },
    ] {
        let error = Refinement::new(slab.problem(), strategy, settings(), &Control::none()).err().unwrap();
        assert!(error.to_string().contains("gain"), "{error}");
    }
}
