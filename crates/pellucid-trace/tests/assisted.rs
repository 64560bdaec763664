//! The assisted estimate's gain and its bias.

mod common;

use common::{Object, dielectric, hash};
use pellucid_trace::{AssistOptions, Estimates, InstructionSet, TraceOptions, Tracer};
use pellucid_voxel::{Control, MaterialTable, Pitch};

/// A slab with a halftone that varies over the surface and white below.
fn halftone() -> Object {
    let mm = Pitch::j750().mm();
    Object::new(Pitch::j750(), [150, 75, 60], |v| {
        let (x, y) = (f64::from(v[0]) * mm[0], f64::from(v[1]) * mm[1]);
        let white = 0.55 + 0.4 * (2.1 * x).sin() * (1.7 * y).cos() + 0.2 * (9.0 * x + 4.0 * y).sin();
        let h = hash(v);
        if v[2] < 22 || (h % 1000) as f64 <= 1000.0 * white { 5 } else { 1 + (h / 1000 % 4) as u8 }
    })
}

#[test]
fn error_is_a_third_of_plain_tracing_and_converges() {
    let object = halftone();
    // Half of the middle of the top face.
    let points: Vec<u32> = (0..object.surface.len() as u32)
        .filter(|&p| {
            let v = object.surface.voxels()[p as usize];
            v[2] == 59 && (10..80).contains(&v[0]) && (5..70).contains(&v[1])
        })
        .collect();
    let materials = MaterialTable::cmykw();
    let control = Control::none();
    let n = points.len() * 3;
    let mut reference = vec![0.0; n];
    let tracer = |spp| Tracer::new(&object.volume, &materials, dielectric(spp)).unwrap();
    tracer(1024).radiance(&points, 1, &mut reference, &control).unwrap();
    let error = |l: &[f32]| {
        let square: f64 = l.iter().zip(&reference).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        let bias: f64 = l.iter().zip(&reference).map(|(a, b)| f64::from(a - b)).sum();
        ((square / n as f64).sqrt(), bias / n as f64)
    };
    let options = AssistOptions::default();
    let mut last = f64::INFINITY;
    // The portable form gives the same bits in ten times the time.
    let rounds = if InstructionSet::chosen() == InstructionSet::Portable { 2 } else { 3 };
    for spp in [16, 128, 512].into_iter().take(rounds) {
        let (mut plain, mut assisted) = (vec![0.0; n], vec![0.0; n]);
        tracer(spp).radiance(&points, 0, &mut plain, &control).unwrap();
        tracer(spp).radiance_assisted(&points, 0, &options, &mut assisted, &control).unwrap();
        let ((plain, _), (assisted, bias)) = (error(&plain), error(&assisted));
        if spp == 16 {
            assert!(assisted < plain / 3.0 && assisted < 0.03, "{assisted} against {plain}");
        }
        assert!(assisted < 1.02 * plain && assisted < last, "{spp} paths: {assisted} against {plain}");
        assert!(bias.abs() < 0.002, "{spp} paths: mean error {bias}");
        last = assisted;
    }
}

#[test]
fn halves_that_are_there_already_lose_their_noise_without_more_paths() {
    let object = halftone();
    let points: Vec<u32> = (0..object.surface.len() as u32).step_by(3).collect();
    let (materials, control) = (MaterialTable::cmykw(), Control::none());
    let tracer = |spp| Tracer::new(&object.volume, &materials, dielectric(spp)).unwrap();
    let traced = |spp, pass| {
        let mut l = vec![0.0; points.len() * 3];
        tracer(spp).radiance(&points, pass, &mut l, &control).unwrap();
        // Colours: in another order than the channels, and scaled.
        l.chunks_exact(3).flat_map(|l| [l[2] * 1.2, l[0] * 1.1]).collect::<Vec<f32>>()
    };
    let (a, b, reference) = (traced(4, 0), traced(4, 1), traced(96, 2));
    let options = AssistOptions::default();
    let assist = |features_of: &[usize], guess, out: &mut [f32]| {
        let estimates = Estimates { features_of, halves: [&a, &b], guess };
        tracer(1).assist(&points, &estimates, &options, out, &control)
    };
    let rms = |l: &mut dyn Iterator<Item = f32>| {
        (l.zip(&reference).map(|(l, r)| f64::from(l - r).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
    };
    let plain = rms(&mut a.iter().zip(&b).map(|(a, b)| 0.5 * (a + b)));
    // The reference of 96 paths has noise of its own, which both differences hold.
    let noise = plain * plain * 8.0 / 104.0;
    let mut assisted = vec![0.0; a.len()];
    assist(&[2, 0], None, &mut assisted).unwrap();
    let error = (rms(&mut assisted.iter().copied()).powi(2) - noise).sqrt();
    assert!(error < plain / 3.0, "{error} against {plain}");

    // The reference with a slow error, of which little is left.
    let slow = |i: usize| {
        let x = f64::from(object.surface.voxels()[points[i / 2] as usize][0]) * Pitch::j750().mm()[0];
        0.05 + 0.03 * (1.3 * x).sin() as f32
    };
    let guess: Vec<f32> = reference.iter().enumerate().map(|(i, l)| l + slow(i)).collect();
    let of_guess = rms(&mut guess.iter().copied());
    assist(&[2, 0], Some(&guess), &mut assisted).unwrap();
    let mended = rms(&mut assisted.iter().copied());
    assert!(mended < 0.8 * error && mended < 0.6 * of_guess, "{mended} against {error}, {of_guess}");

    assert!(assist(&[3], None, &mut assisted).is_err());
    assert!(assist(&[2], None, &mut assisted).is_err());
    assert!(assist(&[2, 0], Some(&guess[1..]), &mut assisted).is_err());
}

#[test]
fn few_points_and_bad_options() {
    let object = halftone();
    let materials = MaterialTable::cmykw();
    let control = Control::none();
    let tracer =
        Tracer::new(&object.volume, &materials, TraceOptions { spp: 64, ..Default::default() }).unwrap();
    for points in [vec![], vec![3], vec![3, 900, 4000]] {
        let mut l = vec![-1.0; points.len() * 3];
        tracer.radiance_assisted(&points, 0, &AssistOptions::default(), &mut l, &control).unwrap();
        assert!(l.iter().all(|v| (0.0..=1.0).contains(v)), "{l:?}");
    }
    for bad in [
        AssistOptions { patch_mm: 0.0, ..Default::default() },
        AssistOptions { ridge: f64::NAN, ..Default::default() },
    ] {
        assert!(tracer.radiance_assisted(&[1], 0, &bad, &mut [0.0; 3], &control).is_err());
    }
}

#[test]
fn same_bytes_for_any_thread_count() {
    let object = halftone();
    let materials = MaterialTable::cmykw();
    let points: Vec<u32> = (0..4000).collect();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut l = vec![0.0; points.len() * 3];
            let tracer = Tracer::new(&object.volume, &materials, dielectric(8)).unwrap();
            let options = AssistOptions::default();
            tracer.radiance_assisted(&points, 2, &options, &mut l, &Control::none()).unwrap();
            l
        })
    };
    assert_eq!(run(1), run(3));
}
