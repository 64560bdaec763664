//! Training runs from start to end on a synthetic source.

use std::ops::ControlFlow;
use std::sync::Arc;

use pellucid_core::team::{Team, Threads};
use pellucid_rpnn::train::{Batch, SampleSource, TrainSettings, Trainer};
use pellucid_rpnn::variant::{FirstFlight, INPUTS};
use pellucid_rpnn::{Precision, RpnnError, Variant};
use rand_core::Rng;
use rand_pcg::Pcg64;

/// Media of one albedo each, whose radiance is known: what a network must learn first.
struct Uniform;

impl SampleSource for Uniform {
    fn batch(
        &mut self,
        index: u64,
        batch: Batch<'_>,
    ) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        if index == 1000 {
            return Err("the well is dry".into());
        }
        batch.flights.fill(FirstFlight { masses: [0.3, 0.5, 0.15], escaped: 0.02, returned: 0.01 });
        let mut rng = Pcg64::new(u128::from(index), 77);
        let mut unit = || (rng.next_u64() >> 40) as f32 / (1 << 24) as f32;
        for (sample, radiance) in batch.stencils.chunks_exact_mut(INPUTS).zip(batch.radiance) {
            let (scattering, absorption) = (2.0 + 10.0 * unit(), 0.01 * 200f32.powf(unit()));
            for cell in sample.chunks_exact_mut(2) {
                cell.copy_from_slice(&[scattering, absorption]);
            }
            *radiance = (-(absorption / (absorption + scattering)).sqrt() * 2.0).exp();
        }
        Ok(())
    }
}

fn settings(variant: Variant, steps: u64, precision: Precision) -> TrainSettings {
    TrainSettings { variant, steps, warm_up: steps / 5, batch: 16, precision, ..Default::default() }
}

/// A member's part of every batch of [`Uniform`].
struct Part<'a>(&'a dyn Team);

impl SampleSource for Part<'_> {
    fn batch(
        &mut self,
        index: u64,
        batch: Batch<'_>,
    ) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        let whole = batch.radiance.len() * self.0.size();
        let (mut stencils, mut radiance) = (vec![0.0; whole * INPUTS], vec![0.0; whole]);
        let mut flights = vec![FirstFlight::default(); whole];
        let all = Batch { stencils: &mut stencils, flights: &mut flights, radiance: &mut radiance };
        Uniform.batch(index, all)?;
        let first = self.0.rank() * batch.radiance.len();
        batch.stencils.copy_from_slice(&stencils[first * INPUTS..][..batch.stencils.len()]);
        batch.flights.copy_from_slice(&flights[first..][..batch.radiance.len()]);
        batch.radiance.copy_from_slice(&radiance[first..][..batch.radiance.len()]);
        Ok(())
    }
}

#[test]
fn a_team_takes_the_steps_of_one_and_its_members_stay_together() {
    let settings = settings(Variant::SharedLevels, 3, Precision::F32);
    let mut alone = Trainer::new(settings.clone()).unwrap();
    let expected: Vec<_> = (0..3).map(|_| alone.step(&mut Uniform).unwrap()).collect();
    let together = || {
        Threads::run(4, |team| {
            let mut trainer =
                Trainer::new(settings.clone()).unwrap().with_team(Arc::new(team.clone())).unwrap();
            assert_eq!(trainer.samples_a_step(), 4);
            let reports: Vec<_> = (0..3).map(|_| trainer.step(&mut Part(&team)).unwrap()).collect();
            (trainer.weights().clone(), reports)
        })
    };
    let members = together();
    assert!(members.iter().all(|member| *member == members[0]) && members == together());
    // But for the order of additions.
    for (step, alone) in members[0].1.iter().zip(&expected) {
        assert!((step.loss / alone.loss - 1.0).abs() < 1e-4, "{step:?} {alone:?}");
        assert!((step.gradient_norm / alone.gradient_norm - 1.0).abs() < 1e-3, "{step:?} {alone:?}");
    }
    let uneven = Threads::run(3, |team| {
        Trainer::new(settings.clone()).unwrap().with_team(Arc::new(team)).unwrap_err().to_string()
    });
    assert!(uneven[0].contains("16 samples cannot be shared by 3"), "{uneven:?}");
}

#[test]
fn a_resumed_run_is_the_same_run() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.safetensors");
    for precision in [Precision::F32, Precision::Bf16] {
        let settings = settings(Variant::SharedLevelsAndOctants, 20, precision);
        let mut straight = Trainer::new(settings.clone()).unwrap();
        let mut first = Trainer::new(settings).unwrap();
        for i in 0..20 {
            let report = straight.step(&mut Uniform).unwrap();
            if i % 5 == 2 {
                straight.record(&report, None);
            }
        }
        for i in 0..10 {
            let report = first.step(&mut Uniform).unwrap();
            if i % 5 == 2 {
                first.record(&report, None);
            }
        }
        first.save(&path).unwrap();
        drop(first);
        let mut second = Trainer::resume(&path).unwrap();
        assert_eq!(second.steps_done(), 10);
        for i in 10..20 {
            let report = second.step(&mut Uniform).unwrap();
            if i % 5 == 2 {
                second.record(&report, None);
            }
        }
        assert!(second.finished());
        assert_eq!(second.weights(), straight.weights());
        assert_eq!(second.optimiser(), straight.optimiser());
        assert_eq!(second.curve(), straight.curve());
        straight.save(&path).unwrap();
        let a = std::fs::read(&path).unwrap();
        second.save(&path).unwrap();
        assert!(a == std::fs::read(&path).unwrap(), "the same bytes");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file stays");
}

#[test]
fn every_variant_learns() {
    for variant in Variant::ALL {
        let mut trainer = Trainer::new(settings(variant, 120, Precision::F32)).unwrap();
        let mut losses = Vec::new();
        trainer
            .run(&mut Uniform, |_, report| {
                losses.push(report.loss);
                Ok(ControlFlow::Continue(()))
            })
            .unwrap();
        let mean = |l: &[f64]| l.iter().sum::<f64>() / l.len() as f64;
        let (start, end) = (mean(&losses[..5]), mean(&losses[100..]));
        assert!(end < 0.1 * start, "{variant:?}: {start} to {end}");
        // The averaged weights know it too.
        let (mut x, mut y) = (vec![0.0; 32 * INPUTS], vec![0.0; 32]);
        let mut flights = vec![FirstFlight::default(); 32];
        let held_out = Batch { stencils: &mut x, flights: &mut flights, radiance: &mut y };
        Uniform.batch(999, held_out).unwrap();
        let score = trainer.validate(&x, &flights, &y, &[0.0; 32]).unwrap();
        assert!(score.rmse < 0.3 * start.sqrt(), "{variant:?}: {score:?} from {start}");
    }
}

#[test]
fn a_failing_source_is_named_and_changes_nothing() {
    struct Broken;
    impl SampleSource for Broken {
        fn batch(
            &mut self,
            _: u64,
            batch: Batch<'_>,
        ) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
            batch.stencils.fill(1.0);
            batch.radiance.fill(f32::NAN);
            Ok(())
        }
    }
    let mut trainer = Trainer::new(settings(Variant::SharedLevels, 20, Precision::F32)).unwrap();
    let before = trainer.weights().clone();
    let error = trainer.step(&mut Broken).unwrap_err();
    assert!(matches!(&error, RpnnError::Invalid(_)), "{error}");
    assert_eq!((trainer.steps_done(), trainer.weights()), (0, &before));
    struct Dry;
    impl SampleSource for Dry {
        fn batch(
            &mut self,
            _: u64,
            batch: Batch<'_>,
        ) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
            Uniform.batch(1000, batch)
        }
    }
    let error = pellucid_core::chain(&trainer.step(&mut Dry).unwrap_err());
    assert!(error.contains("batch 0") && error.contains("dry"), "{error}");
}

#[test]
fn damaged_checkpoints_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.safetensors");
    let trainer = Trainer::new(settings(Variant::SharedLevels, 20, Precision::F32)).unwrap();
    trainer.save(&path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    assert!(matches!(Trainer::resume(&path), Err(RpnnError::Invalid(_))));
    let at = bytes.windows(10).position(|w| w == b"rpnn-run-1").unwrap();
    let mut changed = bytes.clone();
    changed[at + 9] = b'2';
    std::fs::write(&path, &changed).unwrap();
    assert!(matches!(Trainer::resume(&path), Err(RpnnError::Unsupported(_))));
    assert!(matches!(Trainer::resume(&folder.path().join("none")), Err(RpnnError::Io(_))));
}
