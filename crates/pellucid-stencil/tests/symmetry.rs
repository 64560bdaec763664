//! What a mirrored, shifted, scaled or shrunk volume does to its descriptors.

mod common;

use common::*;
use pellucid_stencil::{Features, OCTANTS, StencilSpec};
use pellucid_voxel::{Material, MaterialTable};
use proptest::prelude::*;

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|v| v.to_bits()).collect()
}

fn case() -> impl Strategy<Value = (u8, u8, [u32; 3], u64, [u32; 3])> {
    let labels = prop_oneof![3 => Just(5u8), 1 => Just(7)];
    (any::<u8>(), labels, [1u32..60, 1u32..60, 1u32..60], any::<u64>(), any::<[u32; 3]>()).prop_map(
        |(kind, labels, size, seed, pick)| {
            (kind, labels, size, seed, std::array::from_fn(|a| pick[a] % size[a]))
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn a_mirrored_volume_gives_the_mirrored_descriptor(
        (kind, labels, size, seed, point) in case(),
        axes in 0usize..8,
        levels in 1usize..=9,
        with_occupancy: bool,
    ) {
        let spec = StencilSpec::new([5, 3, 9], levels).unwrap();
        let features = if with_occupancy { Features::WithOccupancy } else { Features::ScatterAbsorb };
        let table = table_of(labels.into(), 2, seed, 1.0);
        let flip = |v: [u32; 3]| {
            std::array::from_fn(|a| if axes >> a & 1 == 1 { size[a] - 1 - v[a] } else { v[a] })
        };
        let volume = test_grid(kind, labels, size, seed);
        let mirrored = grid_of(size, |v| label_at(kind, labels, size, flip(v), seed));
        let extract = |grid: &_, point| {
            descriptors_of(spec, grid, &sat_of(grid, labels.into()), &table, features, &[point])
        };
        let mut original = extract(&volume, point);
        let image = extract(&mirrored, flip(point));

        // The eight octants change places and keep their content.
        let f = features.len();
        let octant = spec.octant_cells().iter().product::<usize>() * f;
        let views = |descriptor: &[f32]| {
            let mut views = vec![0.0; descriptor.len() / (spec.cells_per_level() * f) * OCTANTS * octant];
            spec.octant_views(f, descriptor, &mut views);
            views
        };
        for (a, b) in views(&original).chunks_exact(OCTANTS * octant).zip(views(&image).chunks_exact(OCTANTS * octant)) {
            for o in 0..OCTANTS {
                let there = o ^ axes;
                prop_assert_eq!(bits(&b[o * octant..(o + 1) * octant]), bits(&a[there * octant..(there + 1) * octant]));
            }
        }
        spec.mirror(f, axes, &mut original);
        prop_assert_eq!(bits(&image), bits(&original));
    }

    #[test]
    fn shifting_volume_and_point_together_changes_nothing(
        (kind, labels, size, seed, point) in case(),
        shift in [0u32..40, 0u32..40, 0u32..40],
        margin in [0u32..20, 0u32..20, 0u32..20],
        levels in 1usize..=9,
    ) {
        let spec = StencilSpec::new([5, 3, 9], levels).unwrap();
        let volume = test_grid(kind, labels, size, seed);
        let wide = std::array::from_fn(|a| size[a] + shift[a] + margin[a]);
        let shifted = grid_of(wide, |v| {
            let inside = (0..3).all(|a| v[a] >= shift[a] && v[a] - shift[a] < size[a]);
            if inside { label_at(kind, labels, size, std::array::from_fn(|a| v[a] - shift[a]), seed) } else { 0 }
        });
        let moved = std::array::from_fn(|a| point[a] + shift[a]);
        prop_assert_eq!(
            counts_of(spec, &volume, &sat_of(&volume, labels.into()), &[point]),
            counts_of(spec, &shifted, &sat_of(&shifted, labels.into()), &[moved])
        );
    }

    #[test]
    fn scaling_the_coefficients_scales_the_descriptor(
        (kind, labels, size, seed, point) in case(),
        exponent in -20i32..20,
        factor in 0.001f32..1000.0,
    ) {
        let spec = StencilSpec::new([5, 3, 9], 6).unwrap();
        let grid = test_grid(kind, labels, size, seed);
        let sat = sat_of(&grid, labels.into());
        let table = table_of(labels.into(), 2, seed, 1.0);
        let scaled = |c: f32| {
            let materials = table.materials().iter().map(|m| Material {
                sigma_s: m.sigma_s.iter().map(|s| s * c).collect(),
                sigma_a: m.sigma_a.iter().map(|s| s * c).collect(),
                ..m.clone()
            });
            MaterialTable::new(table.channel_names().to_vec(), materials.collect()).unwrap()
        };
        let extract = |table: &MaterialTable| descriptors_of(spec, &grid, &sat, table, Features::ScatterAbsorb, &[point]);
        let base = extract(&table);
        // A power of two changes the exponents alone.
        let power = f32::powi(2.0, exponent);
        let expected: Vec<f32> = base.iter().map(|v| v * power).collect();
        prop_assert_eq!(bits(&extract(&scaled(power))), bits(&expected));
        // Else each coefficient, each value and the expectation are rounded once.
        for (value, base) in extract(&scaled(factor)).iter().zip(&base) {
            let expected = f64::from(*base) * f64::from(factor);
            prop_assert!((f64::from(*value) - expected).abs() <= 2.1 * f64::from(f32::EPSILON) * expected);
        }
    }

    #[test]
    fn a_level_is_the_level_before_of_the_shrunk_volume(
        size in [1u32..10, 1u32..10, 1u32..10],
        pick: [u32; 3],
        seed: u64,
        more in 2usize..=9,
        dotted: bool,
    ) {
        // Shrunk twice about the point's voxel centre: a shrunk voxel averages one whole voxel and
        // half of both neighbours on every axis. Each gets a label and exact mean coefficients of
        // its own. Levels past the second cut shrunk voxels in half, which loses nothing where both
        // halves are alike: in volumes of dots an even number of voxels from the point.
        let levels = if dotted { more } else { 2 };
        let point: [u32; 3] = std::array::from_fn(|a| pick[a] % size[a]);
        let labels = 4;
        let grid = grid_of(size, |v| {
            let dot = (0..3).all(|a| v[a].abs_diff(point[a]) % 2 == 0);
            if dot || !dotted { label_at(1, labels, size, v, seed) } else { 0 }
        });
        let coefficient = |label: u8, k: u64| {
            if label == 0 { 0.0 } else { (hash([label.into(), k as i64, 0], seed) % 64) as f32 }
        };
        let material = |name: String, s: f32, a: f32| Material { name, sigma_s: vec![s], sigma_a: vec![a], g: 0.0.into() };
        let channel = vec!["c".to_owned()];
        let table = MaterialTable::new(
            channel.clone(),
            (1..=labels).map(|l| material(format!("m{l}"), coefficient(l, 0), coefficient(l, 1))).collect(),
        ).unwrap();
        let centre = point.map(|p| p / 2 + 1);
        let small: [u32; 3] = std::array::from_fn(|a| centre[a] + (size[a] - point[a]) / 2 + 1);
        prop_assert!(small.iter().product::<u32>() <= 255);
        let index = |v: [u32; 3]| ((v[2] * small[1] + v[1]) * small[0] + v[0]) as u8;
        let mut materials = Vec::new();
        for z in 0..small[2] {
            for y in 0..small[1] {
                for x in 0..small[0] {
                    let (v, mut mean) = ([x, y, z], [0.0f32; 2]);
                    for step in 0..27i64 {
                        let d = [step % 3 - 1, step / 3 % 3 - 1, step / 9 - 1];
                        let at = std::array::from_fn(|a| i64::from(point[a]) + 2 * (i64::from(v[a]) - i64::from(centre[a])) + d[a]);
                        let weight: f32 = d.iter().map(|d| if *d == 0 { 0.5 } else { 0.25 }).product();
                        for (k, mean) in mean.iter_mut().enumerate() {
                            *mean += weight * coefficient(grid.at(at), k as u64);
                        }
                    }
                    materials.push(material(format!("v{}", materials.len()), mean[0], mean[1]));
                }
            }
        }
        let count = materials.len();
        let shrunk_table = MaterialTable::new(channel, materials).unwrap();
        let shrunk = grid_of(small, |v| index(v) + 1);
        let spec = StencilSpec::new([5, 3, 9], levels).unwrap();
        let fewer = StencilSpec::new([5, 3, 9], levels - 1).unwrap();
        let whole = descriptors_of(spec, &grid, &sat_of(&grid, labels.into()), &table, Features::ScatterAbsorb, &[point]);
        let half = descriptors_of(fewer, &shrunk, &sat_of(&shrunk, count), &shrunk_table, Features::ScatterAbsorb, &[centre]);
        prop_assert_eq!(bits(&whole[spec.cells_per_level() * 2..]), bits(&half));
    }

    #[test]
    fn cells_hold_what_lies_in_the_box((kind, labels, size, seed, point) in case()) {
        let spec = StencilSpec::paper();
        let grid = test_grid(kind, labels, size, seed);
        let sat = sat_of(&grid, labels.into());
        let counts = counts_of(spec, &grid, &sat, &[point]);
        let m = usize::from(labels);
        let mut inside = vec![0u64; m];
        for (level, counts) in counts.chunks_exact(spec.cells_per_level() * m).enumerate() {
            let mut sums = vec![0u64; m];
            counts.chunks_exact(m).for_each(|c| sums.iter_mut().zip(c).for_each(|(s, &n)| *s += u64::from(n)));
            // In eighths: the box moved by half a voxel either way on each axis.
            let mut expected = vec![0u64; m];
            for step in 0..8 {
                let half = |a: usize| i64::from(spec.cell_edge(level)) * spec.cells()[a] as i64 / 2;
                let up = |a: usize| if level == 0 { 0 } else { i64::from(step >> a & 1) };
                let low: [i64; 3] = std::array::from_fn(|a| i64::from(point[a]) - half(a) + up(a));
                let extent = |a: usize| i64::from(spec.cell_edge(level)) * spec.cells()[a] as i64;
                let high = std::array::from_fn(|a| low[a] + extent(a));
                sat.counts(low, high, &mut inside);
                expected.iter_mut().zip(&inside).for_each(|(e, n)| *e += n);
            }
            prop_assert_eq!(sums, expected);
        }
    }
}
