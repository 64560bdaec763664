//! Spectra of halftones of an even grey: by mask, by error diffusion, and white noise beside them.

use pellucid_core::Control;
use pellucid_core::random::{Domain, uniform};
use pellucid_halftone::{BlueNoiseMask, Spread, Thresholds, diffuse_errors};
use pellucid_voxel::Pitch;

const SIZE: [usize; 3] = [24, 24, 24];

fn voxels() -> impl Iterator<Item = [usize; 3]> {
    (0..SIZE[2]).flat_map(|z| (0..SIZE[1]).flat_map(move |y| (0..SIZE[0]).map(move |x| [x, y, z])))
}

/// Mean power of a pattern over all waves of a length (periods an edge), white noise of the same density having 1.
fn power(dark: &[bool], waves: std::ops::Range<i32>) -> f64 {
    let density = dark.iter().filter(|d| **d).count() as f64 / dark.len() as f64;
    let variance = dark.len() as f64 * density * (1.0 - density);
    let (mut sum, mut count) = (0.0, 0.0);
    for [kx, ky, kz] in waves.clone().flat_map(|k| {
        // Along the axes and two of the diagonals.
        [[k, 0, 0], [0, k, 0], [0, 0, k], [k, k, 0], [k, -k, k]]
    }) {
        let (mut re, mut im) = (0.0, 0.0);
        for (v, _) in voxels().zip(dark).filter(|(_, d)| **d) {
            let turns: f64 = [kx, ky, kz]
                .iter()
                .zip(v)
                .zip(SIZE)
                .map(|((k, v), n)| f64::from(*k) * v as f64 / n as f64)
                .sum();
            let phase = std::f64::consts::TAU * turns;
            re += phase.cos();
            im += phase.sin();
        }
        sum += (re * re + im * im) / variance;
        count += 1.0;
    }
    sum / count
}

fn mask() -> BlueNoiseMask {
    let pitch = Pitch::new([0.04; 3]).unwrap();
    BlueNoiseMask::with_size([24; 3], pitch, 1, &Control::none()).unwrap()
}

fn masked(mask: &BlueNoiseMask, level: f32) -> Vec<bool> {
    let mut row = [0];
    Thresholds::write(&[level, 1.0 - level], &mut row);
    voxels().map(|v| Thresholds::choose(&row, mask.threshold(v.map(|v| v as u32))) == 0).collect()
}

fn diffused(level: f32) -> Vec<bool> {
    let grey = |_: [u32; 3], fractions: &mut [f32]| {
        fractions.copy_from_slice(&[level, 1.0 - level]);
        true
    };
    // The first layers wait for errors to build up; the pattern above them is what counts.
    let wait = 96;
    let chosen =
        diffuse_errors([24, 24, wait + 24], 2, &Spread::layers(), 7, grey, &Control::none()).unwrap();
    chosen[wait as usize * 576..].iter().map(|&c| c == 0).collect()
}

#[test]
fn both_halftones_are_quiet_at_low_frequencies_and_keep_the_grey() {
    let mask = mask();
    for level in [0.1f32, 0.3, 0.45] {
        let white: Vec<bool> =
            (0..13_824).map(|i| uniform(2, Domain::new("white"), i, 0) < f64::from(level)).collect();
        assert!((0.3..3.0).contains(&power(&white, 1..4)), "{}", power(&white, 1..4));
        for (name, dark, quiet) in [("mask", masked(&mask, level), 0.1), ("diffusion", diffused(level), 0.35)]
        {
            let density = dark.iter().filter(|d| **d).count() as f32 / dark.len() as f32;
            assert!((density - level).abs() < 0.01, "{name} {level}: {density}");
            let low = power(&dark, 1..4);
            assert!(low < quiet, "{name} {level}: {low}");
            assert!(power(&dark, 9..12) > 4.0 * low, "{name} {level}: the noise lies above");
        }
    }
}

#[test]
fn diffusion_leaves_air_alone_and_keeps_three_colours_apart() {
    let size = [24, 20, 16];
    let mixture = |v: [u32; 3], fractions: &mut [f32]| {
        fractions.copy_from_slice(if v[0] < 12 { &[0.5, 0.2, 0.3] } else { &[0.0, 0.1, 0.9] });
        v[1] >= 4
    };
    let chosen = diffuse_errors(size, 3, &Spread::layers(), 7, mixture, &Control::none()).unwrap();
    let mut counts = [[0u32; 3]; 2];
    for (i, &c) in chosen.iter().enumerate() {
        let [x, y] = [i % 24, i / 24 % 20];
        assert_eq!(c == u8::MAX, y < 4);
        if y >= 4 {
            counts[x / 12][usize::from(c)] += 1;
        }
    }
    let half = 12.0 * 16.0 * 16.0;
    for (counts, wanted) in counts.iter().zip([[0.5, 0.2, 0.3], [0.0, 0.1, 0.9]]) {
        for (&count, wanted) in counts.iter().zip(wanted) {
            assert!((f64::from(count) / half - wanted).abs() < 0.02, "{counts:?}");
        }
    }
}

#[test]
fn every_spread_keeps_the_grey_and_is_quieter_than_white_noise() {
    for (name, spread) in [
        ("layer", Spread::layer()),
        ("layers", Spread::layers()),
        ("pitch", Spread::of_pitch(Pitch::new([0.04, 0.08, 0.03]).unwrap())),
    ] {
        let shares: f32 = spread.steps().iter().map(|s| s.1).sum();
        assert!((shares - 1.0).abs() < 1e-5, "{name}: {shares}");
        assert!(
            spread.steps().iter().all(|([x, y, z], _)| (z, y, x) > (&0, &0, &0)),
            "{name}: later ones only"
        );
        for level in [0.1f32, 0.45] {
            let grey = |_: [u32; 3], fractions: &mut [f32]| {
                fractions.copy_from_slice(&[level, 1.0 - level]);
                true
            };
            let chosen = diffuse_errors([24, 24, 120], 2, &spread, 7, grey, &Control::none()).unwrap();
            let dark: Vec<bool> = chosen[96 * 576..].iter().map(|&c| c == 0).collect();
            let density = dark.iter().filter(|d| **d).count() as f32 / dark.len() as f32;
            assert!((density - level).abs() < 0.012, "{name} {level}: {density}");
            assert!(power(&dark, 1..4) < 0.7, "{name} {level}: {}", power(&dark, 1..4));
        }
    }
}
