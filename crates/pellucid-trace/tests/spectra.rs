//! Channels that repeat, bands that share paths, and phase functions by channel.

mod common;

use common::Object;
use pellucid_trace::{InstructionSet, TraceOptions, Tracer};
use pellucid_voxel::{Anisotropy, Channels, Control, Material, MaterialTable, Pitch};

/// A block of 1.2 mm whose voxels are drawn from three materials.
fn block() -> Object {
    Object::new(Pitch::new([0.06; 3]).unwrap(), [20, 20, 20], |v| 1 + (common::hash(v) % 3) as u8)
}

/// Three inks over bands: a bright one, one whose absorption rises steeply, a dark one.
fn inks(count: u32) -> MaterialTable {
    let over = |of: &dyn Fn(f32) -> f32| (0..count).map(|k| of(k as f32)).collect::<Vec<f32>>();
    let ink = |name: &str, s: Vec<f32>, a: Vec<f32>| Material {
        name: name.into(),
        sigma_s: s,
        sigma_a: a,
        g: 0.4.into(),
    };
    let materials = vec![
        ink("white", over(&|k| 20.0 * 0.9f32.powf(k)), over(&|k| 0.01 + 0.001 * k)),
        ink("yellow", over(&|k| 3.0 + 0.1 * k), over(&|k| 12.0 * 0.5f32.powf(k))),
        ink("black", over(&|_| 2.0), over(&|k| 4.0 - 0.1 * k)),
    ];
    MaterialTable::over(Channels::Bands { start_nm: 450.0, step_nm: 10.0, count }, materials).unwrap()
}

fn radiance(
    object: &Object,
    table: &MaterialTable,
    options: TraceOptions,
    pass: u32,
    points: &[u32],
) -> Vec<f32> {
    let tracer = Tracer::new(&object.volume, table, options).unwrap();
    let mut out = vec![0.0; points.len() * table.channels()];
    tracer.radiance(points, pass, &mut out, &Control::none()).unwrap();
    out
}

#[test]
fn a_flat_spectrum_is_one_channel_bit_for_bit() {
    let object = block();
    let points: Vec<u32> = (0..200).collect();
    let one = [(8.0, 0.1), (3.0, 2.0), (1.0, 4.0)];
    let table = |count: u32| {
        let flat = |v: f32| vec![v; count as usize];
        let materials = one.iter().enumerate().map(|(i, &(s, a))| Material {
            name: format!("m{i}"),
            sigma_s: flat(s),
            sigma_a: flat(a),
            g: Anisotropy::PerChannel(flat(0.4)),
        });
        let bands = Channels::Bands { start_nm: 400.0, step_nm: 10.0, count };
        MaterialTable::over(bands, materials.collect()).unwrap()
    };
    let options = common::dielectric(8);
    let single = radiance(&object, &table(1), options, 3, &points);
    let flat = radiance(&object, &table(31), options, 3, &points);
    for (row, value) in flat.chunks_exact(31).zip(single) {
        assert!(row.iter().all(|v| v.to_bits() == value.to_bits()));
    }
}

#[test]
fn phase_functions_may_differ_by_channel() {
    let object = block();
    let points: Vec<u32> = (0..64).collect();
    let named = Channels::Named(["a", "b", "c"].map(str::to_owned).to_vec());
    let table = |g: Anisotropy| {
        let materials =
            [(8.0, 0.1), (3.0, 2.0), (1.0, 4.0)].iter().enumerate().map(|(i, &(s, a))| Material {
                name: format!("m{i}"),
                sigma_s: vec![s, 1.5 * s, s],
                sigma_a: vec![a, a, 0.5 * a],
                g: g.clone(),
            });
        MaterialTable::over(named.clone(), materials.collect()).unwrap()
    };
    let cosines = vec![0.2, 0.7, -0.3];
    let options = common::dielectric(8);
    let by_channel = radiance(&object, &table(Anisotropy::PerChannel(cosines.clone())), options, 0, &points);
    for (c, &g) in cosines.iter().enumerate() {
        let all = radiance(&object, &table(g.into()), options, 0, &points);
        let of = |values: &[f32]| values.iter().skip(c).step_by(3).copied().collect::<Vec<_>>();
        assert_eq!(of(&by_channel), of(&all));
    }
}

/// Mean over many passes of few shared paths is the mean of many own paths, in every band.
#[test]
fn shared_paths_are_unbiased() {
    let object = block();
    let points: Vec<u32> = (0..object.surface.len() as u32).step_by(211).collect();
    let table = inks(8);
    let alone = TraceOptions { shared_bands: 1, ..common::dielectric(16384) };
    let reference = object.radiance(&table, alone, &points);
    for (spp, bands) in [(8, 4), (6, 3), (5, 2)] {
        let passes = 700;
        let options = TraceOptions { seed: 11, shared_bands: bands, ..common::dielectric(spp) };
        let (mut sums, mut squares) = (vec![0.0f64; reference.len()], vec![0.0f64; reference.len()]);
        for pass in 0..passes {
            for (i, v) in radiance(&object, &table, options, pass, &points).iter().enumerate() {
                sums[i] += f64::from(*v);
                squares[i] += f64::from(*v).powi(2);
            }
        }
        let n = f64::from(passes);
        let mut worst = 0.0f64;
        let mut total = 0.0;
        for (i, (value, error)) in reference.iter().enumerate() {
            let mean = sums[i] / n;
            let own = ((squares[i] / n - mean * mean) / (n - 1.0)).sqrt();
            let z = (mean - value) / own.hypot(*error);
            worst = worst.max(z.abs());
            total += z;
        }
        // Bands of a point are correlated: the sum of z has at most so much spread.
        let mean = total / reference.len() as f64;
        assert!(worst < 4.5, "{spp} paths, {bands} bands: z {worst}");
        assert!(mean.abs() < 4.0 / (points.len() as f64).sqrt(), "{spp} paths, {bands} bands: mean z {mean}");
    }
}

#[test]
fn sharing_does_not_depend_on_instructions_or_neighbours() {
    let object = block();
    let table = inks(7);
    let points: Vec<u32> = (0..300).collect();
    let options = common::dielectric(9);
    let all = radiance(&object, &table, options, 1, &points);
    for set in InstructionSet::ALL.into_iter().filter(|set| set.require().is_ok()) {
        let options = TraceOptions { instruction_set: Some(set), ..options };
        assert_eq!(radiance(&object, &table, options, 1, &points), all, "{set:?}");
    }
    let some = radiance(&object, &table, options, 1, &points[40..57]);
    assert_eq!(some, all[40 * 7..57 * 7]);
}

/// Where bands hardly differ, a shared path is worth as much as a band's own: the same number of walks gives less noise.
#[test]
fn close_bands_gain_from_sharing() {
    let object = block();
    let points: Vec<u32> = (0..object.surface.len() as u32).step_by(97).collect();
    let close = |v: f32| (0..4).map(|k| v * (1.0 + 0.002 * k as f32)).collect::<Vec<f32>>();
    let materials = [(8.0, 0.1), (3.0, 2.0), (1.0, 4.0)].iter().enumerate().map(|(i, &(s, a))| Material {
        name: format!("m{i}"),
        sigma_s: close(s),
        sigma_a: close(a),
        g: 0.4.into(),
    });
    let bands = Channels::Bands { start_nm: 500.0, step_nm: 10.0, count: 4 };
    let table = MaterialTable::over(bands, materials.collect()).unwrap();
    let variance = |shared_bands: u32, spp: u32| {
        let options = TraceOptions { shared_bands, ..common::dielectric(spp) };
        let (a, b) =
            (radiance(&object, &table, options, 0, &points), radiance(&object, &table, options, 1, &points));
        a.iter().zip(&b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>()
    };
    // 16 shared are 4 walks a band.
    assert!(variance(4, 16) < 0.5 * variance(1, 4));
}
