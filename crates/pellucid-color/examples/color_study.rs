//! Accuracy and cost of the colour tables on this machine:
//! `cargo run --release -p pellucid-color --example color_study`

use std::hint::black_box;
use std::time::Instant;

use pellucid_color::delta_e::{delta_e_2000_of, delta_e_2000_of_linear_rgb};
use pellucid_color::gamut::{DEFAULT_THICKNESSES_MM, Gamut, Mapped, ThicknessGamut};
use pellucid_color::mixture::inverse::Inverse;
use pellucid_color::mixture::table::DEFAULT_NODES;
use pellucid_color::plane_parallel::Solver;
use pellucid_color::space::{lab_of_linear_rgb, srgb_decode};
use pellucid_color::{ColorError, ErrorStats, Lab, MatchOptions, MixtureModel, Oklab, delta_e_2000};
use pellucid_voxel::{Control, MaterialTable};

fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}

fn main() -> Result<(), ColorError> {
    let t = Instant::now();
    let solver = Solver::new(1.5)?;
    let half_space = solver.half_space(0.999, 0.4)?;
    println!("one half-space: {half_space:.9} in {:.2} ms with the solver's set-up", milliseconds(t));

    let colours: Vec<[f32; 3]> = (0..1_000_000u32)
        .map(|i| {
            [1, 2, 3].map(|k| (i.wrapping_mul(2_654_435_761_u32.wrapping_mul(k)) >> 8) as f32 / 16_777_216.0)
        })
        .collect();
    differences(&colours);

    let t = Instant::now();
    let model = MixtureModel::new(&MaterialTable::cmykw(), "white", 1.5)?;
    println!("mixture model: {:.0} ms; media white {:.4?}", milliseconds(t), model.media_white());
    let inverse = Inverse::new(&model, MatchOptions::default());
    for nodes in [17, DEFAULT_NODES, 49] {
        table(nodes, &inverse, &colours)?;
    }
    let t = Instant::now();
    for rgb in &colours[..20_000] {
        black_box(inverse.find(rgb.map(f64::from)));
    }
    println!("exact inverse: {:.1} µs", milliseconds(t) / 20.0);
    outside_the_gamut(&inverse);
    thin_parts(&model)
}

/// What conversions and differences cost.
fn differences(colours: &[[f32; 3]]) {
    let count = colours.len();
    let mut lab = vec![[0.0; 3]; count];
    let t = Instant::now();
    lab_of_linear_rgb(colours, &mut lab);
    println!("1 M linear RGB to Lab: {:.0} ms", milliseconds(t));
    let shifted: Vec<[f32; 3]> = lab.iter().map(|v| [v[0] + 1.0, v[1] - 2.0, v[2] + 0.5]).collect();
    let mut difference = vec![0.0; count];
    let t = Instant::now();
    delta_e_2000_of(&lab, &shifted, &mut difference);
    println!("1 M CIEDE2000 of Lab pairs: {:.0} ms", milliseconds(t));
    let reversed: Vec<[f32; 3]> = colours.iter().rev().copied().collect();
    let t = Instant::now();
    delta_e_2000_of_linear_rgb(colours, &reversed, &mut difference);
    println!("1 M CIEDE2000 of linear RGB pairs: {:.0} ms", milliseconds(t));
}

/// Accuracy and cost of the tabulated inverse.
fn table(nodes: usize, inverse: &Inverse<'_>, colours: &[[f32; 3]]) -> Result<(), ColorError> {
    let t = Instant::now();
    let gamut = Gamut::build(
        MixtureModel::new(&MaterialTable::cmykw(), "white", 1.5)?,
        MatchOptions::default(),
        nodes,
        &Control::none(),
    )?;
    let built = milliseconds(t);
    let mut errors = Vec::new();
    for rgb in &colours[..20_000] {
        let wanted = inverse.find(rgb.map(|v| f64::from(v).powi(2)));
        if wanted.delta_e < 0.01 {
            let reached = gamut.model().relative_rgb(&gamut.fractions(wanted.rgb.map(|v| v as f32)));
            errors.push(delta_e_2000(Lab::from_linear_rgb(wanted.rgb), Lab::from_linear_rgb(reached)) as f32);
        }
    }
    println!("table of {nodes} nodes: {built:.0} ms; round trip {:.3?}", ErrorStats::of(errors));
    if nodes == DEFAULT_NODES {
        let t = Instant::now();
        for rgb in colours {
            black_box(gamut.fractions(*rgb));
        }
        println!("look-up: {:.0} ns", milliseconds(t));
        let mut out = vec![Mapped { rgb: [0.0; 3], delta_e: 0.0 }; colours.len()];
        let t = Instant::now();
        gamut.map_all(colours, &mut out);
        println!("mapping with colour and CIEDE2000, all threads: {:.0} ns", milliseconds(t));
    }
    Ok(())
}

/// How far colours that cannot be printed are moved.
fn outside_the_gamut(inverse: &Inverse<'_>) {
    let (mut outside, mut turned) = (Vec::new(), Vec::new());
    for i in 0..1000 {
        let rgb = [i % 10, i / 10 % 10, i / 100].map(|v| srgb_decode(f64::from(v) / 9.0));
        let found = inverse.find(rgb);
        if found.delta_e > 0.5 {
            outside.push(found.delta_e as f32);
            let (a, b) = (Oklab::from_linear_rgb(rgb), Oklab::from_linear_rgb(found.rgb));
            if a.chroma() > 0.04 && b.chroma() > 0.02 {
                let turn = (a.hue() - b.hue()).abs();
                turned.push(turn.min(360.0 - turn) as f32);
            }
        }
    }
    println!("sRGB cube outside the gamut: {:.1} %", outside.len() as f64 / 10.0);
    println!("  distance {:.2?}", ErrorStats::of(outside));
    println!("  hue turned by degrees {:.2?}", ErrorStats::of(turned));
}

/// What thin parts can show.
fn thin_parts(model: &MixtureModel) -> Result<(), ColorError> {
    let t = Instant::now();
    let thin =
        ThicknessGamut::build(model, &DEFAULT_THICKNESSES_MM, MatchOptions::default(), 17, &Control::none())?;
    println!("gamuts of {} thicknesses, 17 nodes: {:.0} ms", DEFAULT_THICKNESSES_MM.len(), milliseconds(t));
    for mm in [0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 1e3] {
        let black = Lab::from_linear_rgb(thin.map([0.0; 3], mm).rgb.map(f64::from)).l;
        let red = Lab::from_linear_rgb(thin.map([1.0, 0.0, 0.0], mm).rgb.map(f64::from)).chroma();
        println!("  {mm} mm: white {:.3?}, darkest L* {black:.1}, red's chroma {red:.1}", thin.white(mm));
    }
    Ok(())
}
