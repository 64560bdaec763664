//! CIEDE2000 of many colours.

use pellucid_color::space::lab_of_linear_rgb;
use pellucid_color::{Lab, delta_e_2000};
use rayon::prelude::*;

/// CIEDE2000 by which a target must be moved to count as out of gamut.
const OUT_OF_GAMUT: f32 = 1.0;
/// Colours that one task handles.
const CHUNK: usize = 1024;

/// `[L*, a*, b*]` of media-relative linear RGB, the print's white being L* = 100.
pub(crate) fn lab_of(rgb: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let mut lab = vec![[0.0; 3]; rgb.len()];
    lab.par_chunks_mut(CHUNK).zip(rgb.par_chunks(CHUNK)).for_each(|(lab, rgb)| lab_of_linear_rgb(rgb, lab));
    lab
}

/// CIEDE2000 of pairs of `[L*, a*, b*]`.
pub(crate) fn differences(a: &[[f32; 3]], b: &[[f32; 3]]) -> Vec<f32> {
    let lab = |v: &[f32; 3]| Lab { l: v[0].into(), a: v[1].into(), b: v[2].into() };
    let pairs = a.par_iter().zip(b).with_min_len(CHUNK);
    pairs.map(|(a, b)| delta_e_2000(lab(a), lab(b)) as f32).collect()
}

/// Share of targets, `[L*, a*, b*]`, that had to be moved to be printable.
pub(crate) fn out_of_gamut(target: &[[f32; 3]], printable_target: &[[f32; 3]]) -> f64 {
    let moved = differences(target, printable_target);
    moved.iter().filter(|&&d| d > OUT_OF_GAMUT).count() as f64 / moved.len().max(1) as f64
}
