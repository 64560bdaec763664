//! The shipped spectral table is what its generator makes, and what it says of itself.

#[path = "../examples/spectral_materials/table.rs"]
mod table;

use pellucid_voxel::MaterialTable;
use table::{BANDS, RGB_BANDS, spectral_table};

fn shipped() -> MaterialTable {
    MaterialTable::from_json(include_str!("../materials/cmykw-spectral.json")).unwrap()
}

#[test]
fn the_shipped_file_is_the_generators() {
    let (made, shipped) = (spectral_table().unwrap(), shipped());
    assert_eq!(shipped.spectrum(), &BANDS);
    for (made, shipped) in made.materials().iter().zip(shipped.materials()) {
        assert_eq!((&made.name, &made.g), (&shipped.name, &shipped.g));
        // Another machine's exponential may round the last of six digits otherwise.
        for (a, b) in
            made.sigma_s.iter().chain(&made.sigma_a).zip(shipped.sigma_s.iter().chain(&shipped.sigma_a))
        {
            assert!((a - b).abs() <= 2e-5 * b, "{}: {a} {b}", made.name);
        }
    }
}

#[test]
fn means_over_thirds_of_the_spectrum_are_the_rgb_table() {
    let rgb = MaterialTable::cmykw();
    for (spectral, plain) in shipped().materials().iter().zip(rgb.materials()) {
        for (spectrum, values) in [(&spectral.sigma_s, &plain.sigma_s), (&spectral.sigma_a, &plain.sigma_a)] {
            for (range, value) in RGB_BANDS.into_iter().zip(values) {
                let count = range.len() as f32;
                let mean = spectrum[range].iter().sum::<f32>() / count;
                assert!((mean - value).abs() < 1e-5 * value, "{}: {mean} for {value}", plain.name);
            }
        }
    }
}

#[test]
fn spectra_are_smooth_and_shaped_as_the_inks_are() {
    let table = shipped();
    let of = |name: &str| table.get(table.label_of(name).unwrap()).unwrap();
    for material in table.materials() {
        for spectrum in [&material.sigma_s, &material.sigma_a] {
            assert!(spectrum.iter().all(|v| *v > 0.0));
            // The steepest edge is yellow's.
            assert!(
                spectrum.windows(2).all(|w| (w[1] / w[0]).ln().abs() < 2.0),
                "{} {spectrum:?}",
                material.name
            );
        }
    }
    let most = |spectrum: &[f32]| {
        let at = (0..spectrum.len()).max_by(|&a, &b| spectrum[a].total_cmp(&spectrum[b])).unwrap();
        400 + 10 * at
    };
    assert!(most(&of("cyan").sigma_a) >= 600 && most(&of("yellow").sigma_a) <= 470);
    assert!((510..=580).contains(&most(&of("magenta").sigma_a)));
    assert!(of("white").sigma_s.windows(2).all(|w| w[1] < w[0]));
}
