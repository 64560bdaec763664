//! Adaptive estimates reach their target and keep their stated bias.

mod common;

use common::{Object, dielectric, hash};
use pellucid_trace::{ErrorTarget, TraceOptions, Tracer};
use pellucid_voxel::{Control, MaterialTable, Pitch};

#[test]
fn target_is_reached_without_bias() {
    let object = Object::new(Pitch::j750(), [60, 30, 90], |v| 1 + (hash(v.map(|x| x / 5)) % 5) as u8);
    let points: Vec<u32> = (0..object.surface.len() as u32).step_by(11).collect();
    let n = points.len() * 3;
    let materials = MaterialTable::cmykw();
    let control = Control::none();
    let target = ErrorTarget { std_error: 0.02, max_spp: 1 << 14 };
    let tracer = Tracer::new(&object.volume, &materials, dielectric(2000)).unwrap();
    let mut reference = vec![0.0; n];
    tracer.radiance(&points, 9, &mut reference, &control).unwrap();
    let (mut bias, mut missed, mut paths, mut count) = (0.0, 0, 0, 0);
    for iteration in 0..4 {
        let (mut l, mut e) = (vec![0.0; n], vec![0.0; n]);
        paths += tracer.radiance_to(&points, iteration, target, &mut l, &mut e, &control).unwrap();
        for i in 0..n {
            bias += f64::from(l[i] - reference[i]);
            missed += usize::from((l[i] - reference[i]).abs() > 3.0 * 0.023);
            count += 1;
        }
    }
    let bias = bias / f64::from(count as u32);
    // Four times the mean's own noise, 0.02 / sqrt(4 x 3 x points), and the reference's.
    let noise = 0.02 / f64::from(count as u32).sqrt() + 0.01 / (n as f64).sqrt();
    assert!(bias.abs() < 4.0 * noise, "bias {bias}, noise {noise}");
    assert!(missed < count / 100, "{missed} of {count} outside three errors");
    // A fixed number for the worst case, variance 1/4, would be 625 a point.
    assert!((paths / count as u64) < 500, "{} paths a point", paths / count as u64);
    let bad = ErrorTarget { std_error: 0.0, max_spp: 64 };
    let options = TraceOptions::default();
    let tracer = Tracer::new(&object.volume, &materials, options).unwrap();
    assert!(tracer.radiance_to(&points, 0, bad, &mut vec![0.0; n], &mut vec![0.0; n], &control).is_err());
}
