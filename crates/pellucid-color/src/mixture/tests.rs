use std::sync::atomic::AtomicBool;

use pellucid_voxel::{Channels, Control, Material, MaterialTable};

use super::inverse::{Inverse, MatchOptions, fraction_grid};
use super::table::MixtureTable;
use super::*;
use crate::delta_e::delta_e_2000;
use crate::space::Lab;
use crate::spectrum::BANDS;
use pellucid_core::ErrorStats;

fn model() -> MixtureModel {
    MixtureModel::new(&MaterialTable::cmykw(), "white", 1.5).unwrap()
}

/// Materials that differ in g, two of them nearly alike in hue.
fn varied_table() -> MaterialTable {
    let mut materials = MaterialTable::cmykw().materials().to_vec();
    for (material, g) in materials.iter_mut().zip([0.1, 0.4, 0.55, 0.0, 0.3]) {
        material.g = g.into();
    }
    materials.push(Material::from_albedo("light cyan", &[0.6, 0.95, 0.99], &[7.0, 6.0, 8.0], 0.5));
    MaterialTable::new(["R", "G", "B"].map(str::to_owned).to_vec(), materials).unwrap()
}

/// Pseudo-random numbers in [0, 1).
fn random_numbers() -> impl FnMut() -> f64 {
    let mut state = 1_u64;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / (1_u64 << 31) as f64
    }
}

/// Mixtures from nearly white to dark, none with a zero fraction.
fn inner_mixtures(count: usize, materials: usize, white: usize) -> Vec<Fractions> {
    let mut random = random_numbers();
    (0..count)
        .map(|_| {
            let mut x = [0.0; MAX_MATERIALS];
            for (i, x) in x.iter_mut().enumerate().take(materials) {
                *x = if i == white { random().powi(2) * 3.0 } else { random().powi(3) } + 1e-6;
            }
            Fractions::from_f64(&x, materials)
        })
        .collect()
}

/// Mixtures with zero fractions: most of them on the gamut's surface.
fn grid_mixtures(steps: usize) -> Vec<Fractions> {
    fraction_grid(5, 4, steps).iter().map(|x| Fractions::from_f64(x, 5)).collect()
}

fn difference(a: [f64; 3], b: [f64; 3]) -> f32 {
    delta_e_2000(Lab::from_linear_rgb(a), Lab::from_linear_rgb(b)) as f32
}

#[test]
fn pure_materials_are_their_half_spaces() {
    let table = MaterialTable::cmykw();
    let (model, solver) = (model(), Solver::new(1.5).unwrap());
    for i in 0..5 {
        let mut radiance = [0.0; 3];
        model.radiance(&Fractions::pure(i, 5), &mut radiance);
        for channel in 0..3 {
            let exact = solver.half_space(f64::from(table.albedo(i as u8 + 1, channel)), 0.4).unwrap();
            assert!((radiance[channel] - exact).abs() < 5e-6, "{i} {channel}: {} {exact}", radiance[channel]);
        }
    }
    assert_eq!(model.linear_rgb(&Fractions::pure(4, 5)), model.media_white());
}

#[test]
fn slabs_and_skins_agree_with_the_solver() {
    let (model, solver) =
        (MixtureModel::new(&varied_table(), "white", 1.5).unwrap(), Solver::new(1.5).unwrap());
    let slab = model.with_thickness(0.4).unwrap();
    for mixture in inner_mixtures(20, 6, 4) {
        let (mut sigma_s, mut sigma_a, mut forward) = (0.0, 0.0, 0.0);
        for (material, f) in varied_table().materials().iter().zip(mixture.iter()) {
            let f = f64::from(*f);
            sigma_s += f * f64::from(material.sigma_s[1]);
            sigma_a += f * f64::from(material.sigma_a[1]);
            forward += f * f64::from(material.sigma_s[1]) * f64::from(material.g.at(1));
        }
        let layer = |thickness_mm| Layer { sigma_s, sigma_a, g: forward / sigma_s, thickness_mm };
        let green = |model: &MixtureModel| model.linear_rgb(&mixture)[1];
        let exact = solver.radiance_normal(&[layer(f64::INFINITY)]).unwrap();
        assert!((green(&model) - exact).abs() < 1e-4, "{} {exact}", green(&model));
        let exact = solver.radiance_normal(&[layer(0.4)]).unwrap();
        assert!((green(&slab) - exact).abs() < 3e-4, "{} {exact}", green(&slab));
        // A skin of the mixture on the mixture is the mixture; a thin one on white is lighter.
        let own = model.linear_rgb_over(&solver, &mixture, 0.2, &mixture).unwrap()[1];
        assert!((own - green(&model)).abs() < 1e-4);
        let on_white = model.linear_rgb_over(&solver, &mixture, 0.05, &Fractions::pure(4, 6)).unwrap()[1];
        assert!(on_white > own);
    }
}

#[test]
fn derivatives_are_right() {
    let thick = model();
    let thin = thick.with_thickness(0.3).unwrap();
    let varied = MixtureModel::new(&varied_table(), "white", 1.5).unwrap();
    for model in [&thick, &thin, &varied, &varied.with_thickness(0.5).unwrap()] {
        for mixture in inner_mixtures(50, model.materials(), 4) {
            let x = model.widen(&mixture);
            let mut slope = [[0.0; MAX_MATERIALS]; 3];
            model.rgb_of(&x, Some(&mut slope));
            for i in 0..model.materials() {
                let step = 1e-6 * (x[i] + 1e-3);
                let shifted = |sign: f64| {
                    let mut x = x;
                    x[i] += sign * step;
                    model.rgb_of(&x, None)
                };
                let (up, down) = (shifted(1.0), shifted(-1.0));
                for k in 0..3 {
                    let exact = (up[k] - down[k]) / (2.0 * step);
                    assert!(
                        (slope[k][i] - exact).abs() < 1e-5 * (1.0 + exact.abs()),
                        "{} {exact}",
                        slope[k][i]
                    );
                }
            }
        }
    }
}

#[test]
fn inverse_is_exact_in_gamut() {
    let default = model();
    let varied = MixtureModel::new(&varied_table(), "white", 1.0).unwrap();
    let thin = default.with_thickness(0.4).unwrap();
    for (model, mixtures) in [
        (&default, inner_mixtures(500, 5, 4)),
        (&default, grid_mixtures(6)),
        (&varied, inner_mixtures(500, 6, 4)),
        (&thin, inner_mixtures(500, 5, 4)),
    ] {
        let inverse = Inverse::new(model, MatchOptions::default());
        let errors: Vec<f32> =
            mixtures.iter().map(|mixture| inverse.find(model.relative_rgb(mixture)).delta_e as f32).collect();
        let stats = ErrorStats::of(errors);
        assert!(stats.mean < 0.01 && stats.max < 0.05, "{stats:?}");
    }
}

#[test]
fn table_round_trip_is_close_in_gamut() {
    let model = model();
    let table = MixtureTable::build(&model, MatchOptions::default(), 33, &Control::none()).unwrap();
    for mixtures in [inner_mixtures(5000, 5, 4), grid_mixtures(9)] {
        let mut errors = Vec::new();
        for mixture in &mixtures {
            let rgb = model.relative_rgb(mixture);
            let found = table.fractions(rgb.map(|v| v as f32));
            assert!(
                (found.iter().sum::<f32>() - 1.0).abs() < 1e-5 && found.iter().all(|f| *f >= 0.0),
                "{found:?}"
            );
            errors.push(difference(rgb, model.relative_rgb(&found)));
        }
        let stats = ErrorStats::of(errors);
        assert!(stats.mean < 0.15 && stats.p95 < 0.5 && stats.max < 2.0, "{stats:?}");
    }
    // Odd input still gives a mixture.
    for rgb in [[f32::NAN; 3], [-1.0, f32::INFINITY, 0.5], [f32::MAX; 3], [0.0; 3], [f32::NEG_INFINITY; 3]] {
        let found = table.fractions(rgb);
        assert!((found.iter().sum::<f32>() - 1.0).abs() < 1e-5, "{rgb:?} {found:?}");
    }
    assert!(table.fractions([1.0; 3])[4] > 0.995);
    assert!(table.fractions([0.0; 3])[3] > 0.95);
}

#[test]
fn neighbouring_colours_have_neighbouring_mixtures() {
    let model = model();
    let inverse = Inverse::new(&model, MatchOptions::default());
    let mut random = random_numbers();
    for _ in 0..20 {
        // Along a line through the colour cube in cube-root steps, in and out of the gamut: the
        // largest change of a fraction shrinks with the step, so there is no jump.
        let ends: [[f64; 2]; 3] = std::array::from_fn(|_| [random(), random()]);
        let largest = |steps: usize| {
            let at = |i: usize| {
                let t = i as f64 / steps as f64;
                inverse.find(ends.map(|[a, b]| (a + (b - a) * t).powi(3))).fractions
            };
            let all: Vec<Fractions> = (0..=steps).map(at).collect();
            let change = |pair: &[Fractions]| {
                pair[0].iter().zip(pair[1].iter()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
            };
            all.windows(2).map(change).fold(0.0, f32::max)
        };
        let (coarse, fine) = (largest(300), largest(2400));
        assert!(coarse < 0.1, "{ends:?}: {coarse}");
        assert!(fine < 0.25 * coarse + 1e-4, "{ends:?}: {coarse} {fine}");
    }
}

#[test]
fn table_does_not_depend_on_threads() {
    let model = model();
    let build = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| MixtureTable::build(&model, MatchOptions::default(), 9, &Control::none()).unwrap())
    };
    let (one, three) = (build(1), build(3));
    let mut random = random_numbers();
    for _ in 0..500 {
        let rgb = [random() as f32, random() as f32, random() as f32];
        assert_eq!(one.fractions(rgb), three.fractions(rgb));
    }
}

#[test]
fn spectral_table_agrees_with_its_bands() {
    // Channels that repeat the RGB coefficients over bands: the model must mix per band and
    // weigh the bands, and white stays white.
    let rgb = MaterialTable::cmykw();
    let band_of = |band: usize| match band {
        0..=9 => 2,
        10..=18 => 1,
        _ => 0,
    };
    let materials = rgb
        .materials()
        .iter()
        .map(|m| Material {
            name: m.name.clone(),
            sigma_s: (0..BANDS).map(|band| m.sigma_s[band_of(band)]).collect(),
            sigma_a: (0..BANDS).map(|band| m.sigma_a[band_of(band)]).collect(),
            g: m.g.clone(),
        })
        .collect();
    let names = (0..BANDS).map(|band| format!("{} nm", crate::spectrum::wavelength_nm(band))).collect();
    let model31 = MixtureModel::new(&MaterialTable::new(names, materials).unwrap(), "white", 1.5).unwrap();
    let model3 = model();
    for mixture in inner_mixtures(20, 5, 4) {
        let mut bands = [0.0; BANDS];
        model31.radiance(&mixture, &mut bands);
        let mut channels = [0.0; 3];
        model3.radiance(&mixture, &mut channels);
        for band in 0..BANDS {
            assert!((bands[band] - channels[band_of(band)]).abs() < 1e-12);
        }
        let exact = crate::spectrum::spectrum_to_linear_rgb(&bands, Illuminant::D65).unwrap();
        for (a, b) in model31.linear_rgb(&mixture).iter().zip(exact) {
            assert!((a - b).abs() < 1e-12);
        }
        let found = Inverse::new(&model31, MatchOptions::default()).find(model31.relative_rgb(&mixture));
        assert!(found.delta_e < 0.05, "{found:?}");
    }
}

/// A white and an absorbing ink over any channels.
fn two_inks(channels: &Channels) -> MaterialTable {
    let ink = |name: &str, absorbed: f32| Material {
        name: name.into(),
        sigma_s: (0..channels.count()).map(|c| 5.0 + c as f32 / 8.0).collect(),
        sigma_a: (0..channels.count()).map(|c| absorbed / (1.0 + c as f32 / 4.0)).collect(),
        g: 0.4.into(),
    };
    MaterialTable::over(channels.clone(), vec![ink("ink", 3.0), ink("white", 0.01)]).unwrap()
}

#[test]
fn any_channels_have_a_model_and_a_viewing() {
    let names = |count: usize| Channels::Named((0..count).map(|i| format!("c{i}")).collect());
    for channels in [
        Channels::Rgb,
        names(1),
        names(7),
        names(256),
        Channels::Bands { start_nm: 420.0, step_nm: 65.0, count: 5 },
        Channels::Bands { start_nm: 400.0, step_nm: 10.0, count: 31 },
        Channels::Bands { start_nm: 780.0, step_nm: -5.0, count: 81 },
    ] {
        let table = two_inks(&channels);
        let (thick, solver) = (MixtureModel::new(&table, "white", 1.5).unwrap(), Solver::new(1.5).unwrap());
        let white = thick.white_radiance();
        for (a, b) in white.iter().zip(solver.thick_block(&table.materials()[1]).unwrap()) {
            assert!((a - b).abs() < 1e-5, "{a} {b}");
        }
        let viewing = thick.viewing();
        let exact = Viewing::of_print(&table, "white", 1.5, Illuminant::D65).unwrap();
        let mut radiance = vec![0.0; channels.count()];
        for mixture in [[0.3, 0.7], [0.0, 1.0], [1.0, 0.0]] {
            thick.radiance(&mixture, &mut radiance);
            let narrow: Vec<f32> = radiance.iter().map(|&v| v as f32).collect();
            let rgb = thick.relative_rgb(&mixture);
            for (seen, c) in
                [&viewing, &exact].iter().flat_map(|v| v.relative_rgb(&narrow).into_iter().zip(rgb))
            {
                assert!((f64::from(seen) - c).abs() < 1e-4, "{seen} {c} of {channels:?}");
            }
            if matches!(channels, Channels::Named(_)) {
                assert!(rgb[0] == rgb[1] && rgb[1] == rgb[2]);
            }
        }
    }
}

#[test]
fn refuses_bad_tables_by_name() {
    let error = |table: &MaterialTable, white: &str| match MixtureModel::new(table, white, 1.5) {
        Err(error) => error.to_string(),
        Ok(_) => panic!("accepted"),
    };
    let table = MaterialTable::cmykw();
    assert!(error(&table, "ivory").contains("ivory"));
    let with = |materials: Vec<Material>, channels: usize| {
        MaterialTable::new((0..channels).map(|i| i.to_string()).collect(), materials).unwrap()
    };
    let one = table.materials()[4..].to_vec();
    assert!(error(&with(one, 3), "white").contains("at least 2"));
    let mut many = table.materials().to_vec();
    for i in 0..4 {
        many.push(Material { name: format!("extra {i}"), ..many[0].clone() });
    }
    assert!(error(&with(many, 3), "white").contains("9 materials"));
    let two = |sigma: f32| {
        ["white", "clear"]
            .map(|name| Material {
                name: name.into(),
                sigma_s: vec![if name == "clear" { sigma } else { 1.0 }; 2],
                sigma_a: vec![0.0; 2],
                g: 0.0.into(),
            })
            .to_vec()
    };
    let rows = [vec![1.0, 0.0], vec![0.0, 1.0], vec![0.5, 0.5]];
    let clear = MixtureModel::with_weights(&with(two(0.0), 2), "white", 1.5, rows);
    assert!(clear.is_err_and(|e| e.to_string().contains("clear")));
    assert!(MixtureModel::new(&table, "white", 0.5).is_err());
    assert!(model().with_thickness(0.0).is_err());
    assert!(MixtureTable::build(&model(), MatchOptions::default(), 1, &Control::none()).is_err());
    let stop = AtomicBool::new(true);
    let cancelled =
        MixtureTable::build(&model(), MatchOptions::default(), 5, &Control::none().with_cancel(&stop));
    assert!(matches!(cancelled, Err(ColorError::Cancelled)));
}
