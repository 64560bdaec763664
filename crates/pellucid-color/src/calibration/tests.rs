//! Fits to synthetic measurements: the exact model with noise. By paths instead: `tests/calibration.rs` of the workspace.

use pellucid_core::random::{Domain, uniform};
use pellucid_voxel::{Channels, Control, MaterialTable};

use super::*;
use crate::delta_e::delta_e_2000;
use crate::plane_parallel::{Layer, Solver};
use crate::space::Lab;
use crate::spectrum::Illuminant;

const INKS: [&str; 3] = ["cyan", "magenta", "yellow"];

/// White and black, and each ink over both.
fn stacks() -> Vec<String> {
    let mut stacks: Vec<String> =
        [0.108, 0.243, 0.486, 0.81].iter().map(|mm| format!("white {mm} / black")).collect();
    stacks.extend(vec!["white 4.05 / black".to_owned(); 4]);
    stacks.extend(vec!["black".to_owned(); 4]);
    let over_white = |ink: &str, mm: f64| format!("{ink} {mm} / white {:.3} / black", 0.81 - mm);
    stacks.extend([0.027, 0.054, 0.108, 0.216].map(|mm| over_white("black", mm)));
    for ink in INKS {
        stacks.extend([0.054, 0.135, 0.27, 0.54].map(|mm| over_white(ink, mm)));
        stacks.extend([0.135, 0.27, 0.81].iter().map(|mm| format!("{ink} {mm} / black")));
    }
    stacks
}

fn mixtures() -> Vec<String> {
    let mix = |parts: &str| format!("{parts} 0.54 / white 0.27 / black");
    [
        "10% cyan + 90% white",
        "50% cyan + 50% magenta",
        "50% magenta + 50% yellow",
        "30% cyan + 30% yellow + 40% white",
        "5% black + 95% white",
        "25% cyan + 25% magenta + 25% yellow + 25% white",
        "15% yellow + 85% white",
        "15% magenta + 85% white",
    ]
    .map(mix)
    .to_vec()
}

/// Two independent normal deviates of an address.
fn normal(seed: u64, item: u64, sample: u64) -> f64 {
    const NOISE: Domain = Domain::new("calibration test");
    let (u, v) = (uniform(seed, NOISE, item, 2 * sample), uniform(seed, NOISE, item, 2 * sample + 1));
    (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// Exact radiances of stacks, by channel.
fn exact(table: &MaterialTable, stack: &Stack) -> Vec<f64> {
    let solver = Solver::with_directions(1.5, 24).unwrap();
    let channel = |c: usize| {
        let layer = |layer: &StackLayer| {
            let sum = |of: fn(&pellucid_voxel::Material, usize) -> f32| {
                let part = |(name, share): &(String, f64)| {
                    share * f64::from(of(table.get(table.label_of(name).unwrap()).unwrap(), c))
                };
                layer.parts().iter().map(part).sum::<f64>()
            };
            let (sigma_s, sigma_a) = (sum(|m, c| m.sigma_s[c]), sum(|m, c| m.sigma_a[c]));
            Layer { sigma_s, sigma_a, g: 0.4, thickness_mm: layer.thickness_mm() }
        };
        solver.radiance_normal(&stack.layers().iter().map(layer).collect::<Vec<_>>()).unwrap()
    };
    (0..table.channels()).map(channel).collect()
}

fn measured(table: &MaterialTable, stacks: &[String], noise: f64, seed: u64) -> Measurements {
    let list = stacks.iter().enumerate().map(|(i, text)| {
        let stack: Stack = text.parse().unwrap();
        let mut radiance = exact(table, &stack);
        for (c, v) in radiance.iter_mut().enumerate() {
            let error = (noise * *v).hypot(0.05 * noise);
            *v += error * normal(seed, i as u64, c as u64);
        }
        Measurement { patch: Patch { id: format!("P{i}"), stack, check: text.contains('+') }, radiance }
    });
    Measurements::new(table.spectrum().clone(), list.collect()).unwrap()
}

fn refit(measurements: &Measurements) -> Result<Calibration, crate::ColorError> {
    fit(measurements, &FitOptions::default(), &Control::none())
}

/// By fitted coefficient: its true and fitted value and stated relative error.
fn coefficients(calibration: &Calibration, table: &MaterialTable) -> Vec<(String, f64, f64, f64)> {
    let mut all = Vec::new();
    for fit in &calibration.fits {
        let truth = table.get(table.label_of(&fit.name).unwrap()).unwrap();
        for (what, found, exact) in [("s", &fit.sigma_s, &truth.sigma_s), ("a", &fit.sigma_a, &truth.sigma_a)]
        {
            for (c, (f, t)) in found.iter().zip(exact).enumerate() {
                all.push((format!("{} {what}{c}", fit.name), f64::from(*t), f.value, f.relative_error));
            }
        }
    }
    all
}

#[test]
fn exact_measurements_give_the_coefficients_back() {
    let table = MaterialTable::cmykw();
    let calibration = refit(&measured(&table, &stacks(), 0.0, 0)).unwrap();
    assert_eq!(calibration.materials.len(), 5);
    assert_eq!(calibration.materials.materials()[4].name, "white");
    for (name, truth, found, error) in coefficients(&calibration, &table) {
        // What hardly shows is drawn towards the usual, within its stated error, and draws others along.
        let off = (found / truth).ln().abs();
        assert!(off < 1e-3 + 0.3 * error, "{name}: {found} of {truth}, stated error {error}");
    }
    assert!(calibration.delta_e(false).1 < 0.05, "{:?}", calibration.delta_e(false));
}

/// How much dE2000 5 % of a coefficient make, at most, in 0.1 to 0.54 mm over thick white and in mixtures with white.
fn shows(table: &MaterialTable, name: &str, what: usize, channel: usize) -> f64 {
    let mut materials = table.materials().to_vec();
    let own = materials.iter_mut().find(|m| m.name == name).unwrap();
    let values = if what == 0 { &mut own.sigma_s } else { &mut own.sigma_a };
    values[channel] *= 1.05;
    let moved = MaterialTable::over(table.spectrum().clone(), materials).unwrap();
    let rows = Illuminant::D65.rows_for(table.spectrum()).unwrap();
    let lab =
        |table: &MaterialTable, stack: &Stack| -> Lab { super::fit::lab_of(&rows, &exact(table, stack)) };
    let stacks = [
        format!("{name} 0.108 / white"),
        format!("{name} 0.54 / white"),
        format!("{name} 0.54 / black"),
        format!("10% {name} + 90% white 0.54 / white").replace("10% white + 90% white", "white"),
    ];
    let each = stacks.iter().map(|text| {
        let stack: Stack = text.parse().unwrap();
        delta_e_2000(lab(table, &stack), lab(&moved, &stack))
    });
    each.fold(0.0, f64::max)
}

#[test]
fn one_per_cent_of_noise_leaves_what_matters_within_five() {
    let table = MaterialTable::cmykw();
    let rows = Illuminant::D65.rows_for(table.spectrum()).unwrap();
    let mut all = stacks();
    all.extend(mixtures());
    let mut matters = Vec::new();
    let (mut squares, mut count) = (0.0, 0.0);
    for seed in 1..=4 {
        let calibration = refit(&measured(&table, &all, 0.01, seed)).unwrap();
        let found = coefficients(&calibration, &table);
        if matters.is_empty() {
            let shown = |k: usize| shows(&table, &calibration.fits[k / 6].name, k % 6 / 3, k % 3);
            matters = (0..found.len()).map(|k| shown(k) > 0.25).collect();
            assert_eq!(matters.iter().filter(|m| **m).count(), 19);
        }
        for ((name, truth, found, error), matters) in found.into_iter().zip(&matters) {
            let off = (found / truth).ln();
            // 5 % are two of the largest standard errors: once in a hundred they are not enough.
            assert!(!matters || off.abs() < 0.07, "seed {seed}, {name}: {found} of {truth}");
            if *matters {
                assert!(error < 0.03, "{name}: {error}");
            }
            if error < 0.3 {
                squares += (off / error).powi(2);
                count += 1.0;
            }
        }
        for mixture in mixtures() {
            let stack: Stack = mixture.parse().unwrap();
            let lab = |t: &MaterialTable| super::fit::lab_of(&rows, &exact(t, &stack));
            let off = delta_e_2000(lab(&table), lab(&calibration.materials));
            assert!(off < 1.0, "seed {seed}, {mixture}: dE {off}");
        }
    }
    // Stated errors are the true ones: z² has the mean 1 and, as errors of one material go together, a scatter of
    // about 0.2 over some hundred values.
    let mean: f64 = squares / count;
    assert!(count > 100.0 && (0.5..1.6).contains(&mean), "{mean} of {count}");
}

#[test]
fn spectra_of_other_materials_are_fitted_too() {
    let bands = Channels::Bands { start_nm: 450.0, step_nm: 100.0, count: 3 };
    let material = |name: &str, s: [f32; 3], a: [f32; 3]| pellucid_voxel::Material {
        name: name.into(),
        sigma_s: s.to_vec(),
        sigma_a: a.to_vec(),
        g: 0.4.into(),
    };
    let table = MaterialTable::over(
        bands.clone(),
        vec![
            material("cyan", [0.3, 1.0, 4.0], [0.02, 1.0, 14.0]),
            material("magenta", [6.0, 0.8, 1.1], [0.03, 2.3, 0.9]),
            material("yellow", [3.0, 3.0, 0.2], [19.0, 1.0, 0.02]),
            material("black", [0.2, 0.2, 0.3], [22.0, 15.0, 23.0]),
            material("white", [9.5, 10.0, 16.0], [0.006, 0.009, 0.014]),
        ],
    )
    .unwrap();
    let calibration = refit(&measured(&table, &stacks(), 0.01, 3)).unwrap();
    assert_eq!(calibration.materials.spectrum(), &bands);
    for (name, truth, found, error) in coefficients(&calibration, &table) {
        assert!(
            (found / truth).ln().abs() < 3.5 * error + 1e-3,
            "{name}: {found} of {truth}, stated {error}"
        );
    }
}

#[test]
fn contradictory_measurements_are_told_and_not_fitted() {
    let table = MaterialTable::cmykw();
    let good = measured(&table, &stacks(), 0.01, 5);
    let changed = |change: &dyn Fn(&mut Vec<Measurement>)| {
        let mut list = good.list().to_vec();
        change(&mut list);
        refit(&Measurements::new(Channels::Rgb, list).unwrap()).unwrap_err().to_string()
    };
    // Two patches of yellow, read in the wrong order.
    let swapped = changed(&|list| {
        let (a, b) = (list[30].radiance.clone(), list[36].radiance.clone());
        (list[30].radiance, list[36].radiance) = (b, a);
    });
    assert!(swapped.contains("contradictory") && swapped.contains("yellow"), "{swapped}");
    // The same stack twice, far apart.
    let twice = changed(&|list| list[5].radiance = vec![0.5; 3]);
    assert!(twice.contains("\"P4\" and \"P5\" contradict each other"), "{twice}");
    // Thicker ink that is lighter.
    let lighter = changed(&|list| list[21].radiance = vec![0.8; 3]);
    assert!(lighter.contains("contradictory") && lighter.contains("P21"), "{lighter}");
}

#[test]
fn too_few_measurements_are_told_and_not_fitted() {
    let table = MaterialTable::cmykw();
    let without = |remove: &dyn Fn(&str) -> bool| {
        let kept: Vec<String> = stacks().into_iter().filter(|s| !remove(s)).collect();
        refit(&measured(&table, &kept, 0.01, 6))
    };
    let told = |remove: &dyn Fn(&str) -> bool, parts: &[&str]| {
        let error = without(remove).unwrap_err().to_string();
        assert!(parts.iter().all(|part| error.contains(part)), "{error}");
    };
    told(
        &|s| s.starts_with("cyan 0.1") || s.starts_with("cyan 0.2") || s.starts_with("cyan 0.8"),
        &["too few", "cyan"],
    );
    told(&|s| s.starts_with("white"), &["too few"]);
    told(&|s| s == "black" || s.starts_with("black"), &["too few", "black"]);
    // Black that was only seen through thick white.
    told(&|s| s.contains("black") && !s.starts_with("white 4"), &["too few"]);
    assert!(without(&|s| s.starts_with("cyan 0.054")).is_ok());
    // Only over white: what thick magenta looks like is open.
    let few: Vec<String> = ["magenta 0.027", "magenta 0.054", "magenta 0.081"]
        .iter()
        .map(|ink| format!("{ink} / white 0.7 / black"))
        .chain(stacks().into_iter().filter(|s| !s.starts_with("magenta")))
        .collect();
    let error = refit(&measured(&table, &few, 0.01, 6)).map(|c| c.fits).unwrap_err().to_string();
    assert!(error.contains("too few") && error.contains("magenta"), "{error}");
}

#[test]
fn options_out_of_range_are_told() {
    let measurements = measured(&MaterialTable::cmykw(), &stacks(), 0.0, 0);
    for (options, part) in [
        (FitOptions { refractive_index: 0.5, ..FitOptions::default() }, "refractive index"),
        (FitOptions { g: 1.0, ..FitOptions::default() }, "g"),
        (FitOptions { relative_error: 0.0, ..FitOptions::default() }, "relative error"),
        (FitOptions { most_delta_e: f64::NAN, ..FitOptions::default() }, "dE"),
    ] {
        let error = fit(&measurements, &options, &Control::none()).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
    let stop = std::sync::atomic::AtomicBool::new(true);
    let error = fit(&measurements, &FitOptions::default(), &Control::none().with_cancel(&stop)).unwrap_err();
    assert_eq!(error, crate::ColorError::Cancelled);
}
