//! Radiances of voxel cubes against an independent renderer and the analytic half-space.

use pellucid_trace::{Boundary, InstructionSet, TraceError, TraceOptions, Tracer, Volume};
use pellucid_voxel::{
    Control, Frame, LabelGrid, Material, MaterialTable, Pitch, Surface, SurfaceOptions, Tile,
};

fn cube(mm: f64, label: u8) -> (LabelGrid, Surface) {
    let pitch = Pitch::j750();
    let frame = Frame::new([0.0; 3], pitch, pitch.mm().map(|p| (mm / p).round() as u32)).unwrap();
    let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(label));
    let surface = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()).unwrap();
    (grid, surface)
}

fn top_centre(surface: &Surface) -> u32 {
    let s = surface.frame().size();
    surface.index_of([s[0] / 2, s[1] / 2, s[2] - 1]).unwrap()
}

fn estimate(
    grid: &LabelGrid,
    surface: &Surface,
    materials: &MaterialTable,
    options: TraceOptions,
) -> Vec<(f64, f64)> {
    let control = Control::none();
    let volume = Volume::new(grid, surface, &control).unwrap();
    let tracer = Tracer::new(&volume, materials, options).unwrap();
    let n = materials.channels();
    let (mut l, mut e) = (vec![0.0; n], vec![0.0; n]);
    tracer.radiance_with_error(&[top_centre(surface)], 0, &mut l, &mut e, &control).unwrap();
    l.iter().zip(&e).map(|(&l, &e)| (f64::from(l), f64::from(e))).collect()
}

/// Mitsuba 3.9.1's radiances at the face centre of 10 mm cubes, value and standard error.
#[test]
fn print_materials_agree_with_mitsuba() {
    let white_matched = [(0.9381, 0.00052), (0.96706, 0.00035), (0.88888, 0.0008)];
    let white_dielectric = [(0.88473, 0.00062), (0.93676, 0.00051), (0.79638, 0.00098)];
    let yellow_dielectric = [(0.86335, 0.00055), (0.70276, 0.00058), (0.00322, 0.00014)];
    let cases = [
        (5, Boundary::Matched, white_matched),
        (5, Boundary::default(), white_dielectric),
        (3, Boundary::default(), yellow_dielectric),
    ];
    for (label, boundary, expected) in cases {
        let (grid, surface) = cube(10.0, label);
        let options = TraceOptions { spp: 100_000, seed: 11, boundary, ..TraceOptions::default() };
        let got = estimate(&grid, &surface, &MaterialTable::cmykw(), options);
        for ((value, error), (reference, sigma)) in got.into_iter().zip(expected) {
            let z = (value - reference) / error.hypot(sigma);
            assert!(z.abs() < 3.5, "label {label}, {boundary:?}: {value} for {reference}, z = {z:.2}");
        }
    }
}

/// Chandrasekhar's half-space with isotropic scattering: L = 1 - H(1) sqrt(1 - albedo).
#[test]
fn isotropic_half_space_agrees_with_chandrasekhar() {
    let rows = [(0.1, 0.01639034), (0.5, 0.11522588), (0.9, 0.41494747), (0.98, 0.67108374)];
    for (albedo, exact) in rows {
        let (grid, surface) = cube(10.0, 1);
        // 500 mean free paths thick.
        let material = Material::from_albedo("m", &[albedo], &[50.0], 0.0);
        let table = MaterialTable::new(vec!["x".into()], vec![material]).unwrap();
        let options = TraceOptions { spp: 200_000, boundary: Boundary::Matched, ..TraceOptions::default() };
        let (value, error) = estimate(&grid, &surface, &table, options)[0];
        assert!((value - exact).abs() < 3.5 * error, "albedo {albedo}: {value} +- {error} for {exact}");
    }
}

#[test]
fn every_instruction_set_gives_the_same_bytes() {
    let (mut grid, surface) = cube(2.0, 5);
    for i in 0..20_000u32 {
        let s = grid.size();
        let v = [i * 7 % s[0], i * 13 % s[1], i * 29 % s[2]];
        grid.set(v, 1 + (i % 5) as u8);
    }
    for boundary in [Boundary::Matched, Boundary::default()] {
        let results: Vec<_> = InstructionSet::available()
            .map(|set| {
                let options = TraceOptions {
                    spp: 2000,
                    boundary,
                    instruction_set: Some(set),
                    ..TraceOptions::default()
                };
                estimate(&grid, &surface, &MaterialTable::cmykw(), options)
            })
            .collect();
        assert!(results.iter().all(|r| *r == results[0]), "{results:?}");
    }
}

#[test]
fn a_set_is_taken_as_asked_and_one_that_is_lacking_is_refused() {
    let (grid, surface) = cube(1.0, 5);
    let volume = Volume::new(&grid, &surface, &Control::none()).unwrap();
    let materials = MaterialTable::cmykw();
    for set in InstructionSet::ALL {
        let options = TraceOptions { instruction_set: Some(set), ..TraceOptions::default() };
        let tracer = Tracer::new(&volume, &materials, options);
        if set > InstructionSet::detect() {
            assert!(matches!(tracer, Err(TraceError::Unsupported(_))), "{set}");
        } else {
            // The kernel has no form of its own for bf16 products.
            assert_eq!(tracer.unwrap().instruction_set(), set.min(InstructionSet::Avx512));
        }
    }
    let tracer = Tracer::new(&volume, &materials, TraceOptions::default()).unwrap();
    assert!(tracer.instruction_set() <= InstructionSet::chosen());
}
