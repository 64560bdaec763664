//! A chart is made, "printed" and measured by tracing paths in its own voxels, and fitted.

use pellucid::calibration::{Chart, ChartSettings};
use pellucid::color::calibration::{Calibration, FitOptions, Geometry, Measurements, ReadOptions, fit};
use pellucid::color::delta_e_2000;
use pellucid::color::plane_parallel::{Layer, Solver};
use pellucid::color::{Lab, Xyz};
use pellucid::core::Control;
use pellucid::core::random::{Domain, uniform};
use pellucid::slice::PrintTarget;
use pellucid::trace::{TraceOptions, Tracer, Volume};
use pellucid::voxel::{LabelGrid, Material, MaterialTable, Surface, SurfaceOptions};

/// What the printer's resins do, which the fit must find. None of them is the default.
fn truth() -> MaterialTable {
    let rows = [
        ("cyan", [0.06, 0.75, 0.97], [8.0, 5.0, 7.0]),
        ("magenta", [0.97, 0.12, 0.88], [2.8, 3.5, 9.0]),
        ("yellow", [0.995, 0.99, 0.2], [2.5, 4.0, 17.0]),
        ("black", [0.3, 0.32, 0.35], [6.0, 6.5, 7.5]),
        ("white", [0.9985, 0.999, 0.9985], [7.0, 10.0, 20.0]),
    ];
    let materials = rows.iter().map(|(name, a, t)| Material::from_albedo(name, a, t, 0.4)).collect();
    MaterialTable::new(["R", "G", "B"].map(str::to_owned).to_vec(), materials).unwrap()
}

/// A normal deviate of an address.
fn normal(item: u64, sample: u64) -> f64 {
    const NOISE: Domain = Domain::new("chart noise");
    let (u, v) = (uniform(1, NOISE, item, 2 * sample), uniform(1, NOISE, item, 2 * sample + 1));
    (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// Radiance of every patch, by channel: the mean over `points` in its middle, `spp` paths each.
fn readings(chart: &Chart, grid: &LabelGrid, points: usize, spp: u32) -> Vec<[f64; 3]> {
    let control = Control::none();
    let surface = Surface::extract(grid, &SurfaceOptions::default(), &control).unwrap();
    let volume = Volume::new(grid, &surface, &control).unwrap();
    let table = truth();
    let ordered = chart.materials().materials().iter().map(|m| {
        let label = table.label_of(&m.name).unwrap();
        table.get(label).unwrap().clone()
    });
    let table = MaterialTable::over(table.spectrum().clone(), ordered.collect()).unwrap();
    let tracer = Tracer::new(&volume, &table, TraceOptions { spp, seed: 3, ..Default::default() }).unwrap();
    let [_, height, depth] = grid.size();
    let mm = grid.frame().pitch().mm();
    let mut read = Vec::new();
    for patch in chart.patches() {
        let [x, y] = patch.center_mm;
        let side = (points as f64).sqrt().round() as usize;
        let step = 1.5 / side as f64;
        let chosen: Vec<u32> = (0..side * side)
            .map(|i| {
                let off = [i % side, i / side].map(|k| (k as f64 - 0.5 * (side - 1) as f64) * step);
                let column = ((x + off[0]) / mm[0]) as u32;
                let row = height - 1 - ((y + off[1]) / mm[1]) as u32;
                surface.index_of([column, row, depth - 1]).unwrap()
            })
            .collect();
        let mut radiance = vec![0.0f32; 3 * chosen.len()];
        tracer.radiance(&chosen, 0, &mut radiance, &control).unwrap();
        let mean = |c: usize| {
            let values = radiance.iter().skip(c).step_by(3);
            values.map(|v| f64::from(*v)).sum::<f64>() / chosen.len() as f64
        };
        read.push([0, 1, 2].map(mean));
    }
    read
}

/// What an instrument of 45°:0° geometry says of a radiance, in L*a*b* under D50.
fn instrument(radiance: [f64; 3]) -> Lab {
    let whole = Geometry::FortyFive.radiance(1.0, 1.5).unwrap();
    Xyz::from_linear_rgb(radiance.map(|v| v / whole)).adapt(Xyz::D65, Xyz::D50).to_lab(Xyz::D50)
}

/// The chart's table with colours filled in, with 1 % of noise.
fn filled(chart: &Chart, readings: &[[f64; 3]]) -> String {
    let mut text = String::new();
    for (i, line) in chart.table().replace(",,,", "").lines().enumerate() {
        match i.checked_sub(1) {
            None => text += line,
            Some(i) => {
                let noisy = [0, 1, 2].map(|c| readings[i][c] * (1.0 + 0.01 * normal(i as u64, c as u64)));
                let Lab { l, a, b } = instrument(noisy);
                text += &format!("{line},{l:.2},{a:.2},{b:.2}");
            }
        }
        text.push('\n');
    }
    text
}

fn fitted(text: &str) -> Calibration {
    let measurements = Measurements::parse(text, &ReadOptions::default()).unwrap();
    fit(&measurements, &FitOptions::default(), &Control::none()).unwrap()
}

/// Exact colour of a layer of a mixture over thick white.
fn color(table: &MaterialTable, mixture: &[(&str, f64)], mm: f64) -> Lab {
    let solver = Solver::with_directions(1.5, 24).unwrap();
    let rgb = [0, 1, 2].map(|c| {
        let layer = |parts: &[(&str, f64)], thickness_mm| {
            let mut layer = Layer { sigma_s: 0.0, sigma_a: 0.0, g: 0.4, thickness_mm };
            for (name, share) in parts {
                let material = table.get(table.label_of(name).unwrap()).unwrap();
                layer.sigma_s += share * f64::from(material.sigma_s[c]);
                layer.sigma_a += share * f64::from(material.sigma_a[c]);
            }
            layer
        };
        let stack = [layer(mixture, mm), layer(&[("white", 1.0)], f64::INFINITY)];
        solver.radiance_normal(&stack).unwrap()
    });
    Lab::from_linear_rgb(rgb)
}

/// How much 5 % of a coefficient change any layer or tint that prints have.
fn shows(table: &MaterialTable, name: &str, which: usize, channel: usize) -> f64 {
    let mut materials = table.materials().to_vec();
    let own = materials.iter_mut().find(|m| m.name == name).unwrap();
    let values = if which == 0 { &mut own.sigma_s } else { &mut own.sigma_a };
    values[channel] *= 1.05;
    let moved = MaterialTable::over(table.spectrum().clone(), materials).unwrap();
    let tint = [(name, 0.1), ("white", 0.9)];
    let stacks: [(&[(&str, f64)], f64); 3] = [(&[(name, 1.0)], 0.108), (&[(name, 1.0)], 0.54), (&tint, 0.54)];
    let tints = if name == "white" { 2 } else { 3 };
    let changes = stacks[..tints]
        .iter()
        .map(|(mixture, mm)| delta_e_2000(color(table, mixture, *mm), color(&moved, mixture, *mm)));
    changes.fold(0.0, f64::max)
}

fn judge(calibration: &Calibration) {
    let truth = truth();
    for fit in &calibration.fits {
        let exact = truth.get(truth.label_of(&fit.name).unwrap()).unwrap();
        for (which, found, exact) in [(0, &fit.sigma_s, &exact.sigma_s), (1, &fit.sigma_a, &exact.sigma_a)] {
            for c in 0..3 {
                let off = found[c].value / f64::from(exact[c]) - 1.0;
                let (shown, name) = (shows(&truth, &fit.name, which, c), ["sigma_s", "sigma_a"][which]);
                println!(
                    "{} {name} {c}: {:.4} per mm, off {:+.1} %, stated {:.1} %; 5 % show dE {shown:.2}",
                    fit.name,
                    found[c].value,
                    100.0 * off,
                    100.0 * found[c].relative_error
                );
                assert!(shown < 0.25 || off.abs() < 0.05, "{} {name} {c}: off by {off}", fit.name);
            }
        }
    }
    let held_out: [&[(&str, f64)]; 6] = [
        &[("cyan", 0.2), ("white", 0.8)],
        &[("magenta", 0.5), ("yellow", 0.5)],
        &[("cyan", 0.4), ("magenta", 0.4), ("white", 0.2)],
        &[("yellow", 0.25), ("white", 0.75)],
        &[("cyan", 0.2), ("yellow", 0.3), ("black", 0.05), ("white", 0.45)],
        &[("black", 0.1), ("white", 0.9)],
    ];
    for mixture in held_out {
        let off = delta_e_2000(color(&truth, mixture, 0.4), color(&calibration.materials, mixture, 0.4));
        println!("{mixture:?}: dE {off:.2}");
        assert!(off < 1.0, "{mixture:?}: dE {off}");
    }
    let (fitted, checked) = (calibration.delta_e(false), calibration.delta_e(true));
    println!("patches that were fitted: mean dE {:.2}, most {:.2}", fitted.0, fitted.1);
    println!("patches that check: mean dE {:.2}, most {:.2}", checked.0, checked.1);
}

#[test]
fn a_chart_that_paths_measured_gives_the_materials_back() {
    // Wide voxels: layers are what is measured. The printer's own pitch is below.
    let coarse = r#"{"name": "coarse", "pitch_mm": [0.25, 0.25, 0.027], "build_space_mm": [400, 400, 200],
        "max_materials": 6, "min_layers": 1, "row_order": "highest_y_first", "background": [0, 0, 0, 0], "palette": {"cyan": [0, 90, 158, 255], "magenta": [166, 33, 98, 255],
        "yellow": [200, 189, 3, 255], "black": [26, 26, 29, 255], "white": [240, 240, 240, 255]}}"#;
    let chart = Chart::new(&PrintTarget::from_json(coarse).unwrap(), &ChartSettings::default()).unwrap();
    let grid = chart.grid(&Control::none()).unwrap();
    let calibration = fitted(&filled(&chart, &readings(&chart, &grid, 16, 6000)));
    judge(&calibration);
}

/// Minutes and gigabytes: the chart as it is printed, mixtures halftoned.
#[test]
#[ignore = "minutes; prints what a fit of a chart of the J750 finds"]
fn the_printers_own_chart_gives_the_materials_back() {
    let chart = Chart::new(&PrintTarget::j750(), &ChartSettings::default()).unwrap();
    let grid = chart.grid(&Control::none()).unwrap();
    let table = filled(&chart, &readings(&chart, &grid, 100, 1000));
    std::fs::write(concat!(env!("CARGO_TARGET_TMPDIR"), "/measured.csv"), &table).unwrap();
    let calibration = fitted(&table);
    judge(&calibration);
    for patch in calibration.patches.iter().filter(|p| p.check) {
        println!("{} {}: dE {:.2}", patch.id, patch.stack, patch.delta_e);
    }
}
