//! The suite finds what it is there to find: a mock of three different channels passes, and each of its planted faults
//! is caught by the check that is meant for it.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use pellucid_core::{Domain, random};
use pellucid_predict::conformance::{self, Case, Violation};
use pellucid_predict::{
    Averaged, BoundPredictor, Capabilities, Changed, Corrected, Correction, Diagnostics, Draw, Identity,
    InstructionSet, Learned, MaterialGradient, Object, PredictError, Predictor,
};
use pellucid_voxel::{Control, LabelGrid, TILE};

/// What the mock does wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    None,
    CountsCalls,
    KnowsItsCompany,
    KnowsItsThreads,
    KnowsItsPlace,
    IgnoresTheSeed,
    IgnoresThePass,
    IsSecretlyRandom,
    IgnoresTheEffort,
    ForgetsTiles,
    TrustsTheFirstTiles,
    TrustsAfterFailure,
    NeverStops,
    StopsOnlyAtFirst,
    AcceptsAnyLength,
    AcceptsAnyFrame,
    PredictsNothing,
    LeavesHoles,
    AbsorbsTwice,
    ForgetsItsMemory,
    LearnsByItself,
    DeniesItsGradient,
    GradientCountsCalls,
    GradientKnowsItsThreads,
    GradientIsNotLinear,
    GradientKnowsItsPlace,
    GradientLeavesItsRegion,
    GradientColoursAir,
    GradientNeverStops,
    GradientAcceptsAnyLength,
    GradientPullsNothing,
}

struct Mock(Fault);

#[derive(Default)]
struct Memory {
    passes: Vec<u32>,
    sum: f64,
}

struct BoundMock {
    fault: Fault,
    object: Arc<Object>,
    /// One label a surface voxel.
    labels: Vec<u8>,
    current: bool,
    calls: AtomicU64,
    own: AtomicU64,
    memory: Memory,
}

impl Predictor for Mock {
    fn identity(&self) -> Identity {
        Identity::new("mock", InstructionSet::Portable, true)
    }

    fn supports(&self, _: &Object) -> Result<Capabilities, PredictError> {
        let own = Capabilities::new(self.0 != Fault::IsSecretlyRandom);
        Ok(if self.0 == Fault::DeniesItsGradient { own } else { own.with_gradient() })
    }

    fn bind(&self, object: Arc<Object>) -> Result<Box<dyn BoundPredictor>, PredictError> {
        Ok(Box::new(BoundMock {
            fault: self.0,
            labels: vec![0; object.surface().len()],
            object,
            current: false,
            calls: AtomicU64::new(0),
            own: AtomicU64::new(0),
            memory: Memory::default(),
        }))
    }
}

impl BoundMock {
    /// A different function of the label in each channel, with noise of the draw.
    fn value(&self, point: u32, channel: usize, draw: Draw, wrong: f64) -> f32 {
        let label = f64::from(self.labels[point as usize]);
        let bright = (0.1 + 0.13 * label * (channel as f64 + 1.0)).fract();
        let seed = if self.fault == Fault::IgnoresTheSeed { 0 } else { draw.seed };
        let pass = if self.fault == Fault::IgnoresThePass { 0 } else { draw.pass.number() };
        let noise = random::uniform(seed, Domain::new("mock").pass(pass), u64::from(point), channel as u64);
        let effort = if self.fault == Fault::IgnoresTheEffort { 1 } else { draw.effort };
        let noise = (noise - 0.5) / f64::from(effort).sqrt();
        (bright + 0.1 * noise + wrong + 0.01 * self.memory.sum) as f32
    }
}

impl BoundPredictor for BoundMock {
    fn update(
        &mut self,
        labels: &LabelGrid,
        changed: Changed<'_>,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        let trusted = self.current
            || self.fault == Fault::TrustsTheFirstTiles
            || self.fault == Fault::TrustsAfterFailure && self.labels[0] != 0;
        self.current = false;
        if self.fault != Fault::AcceptsAnyFrame {
            self.object.check_labels(labels)?;
        }
        control.check()?;
        let [nx, ny, _] = labels.tile_dims();
        for (own, voxel) in self.labels.iter_mut().zip(self.object.surface().voxels()) {
            let [x, y, z] = voxel.map(|v| v / TILE as u32);
            let tile = (z * ny + y) * nx + x;
            let take = match changed {
                Changed::Tiles(tiles) if trusted => {
                    tiles.contains(&tile) && (self.fault != Fault::ForgetsTiles || tile % 2 == 0)
                }
                _ => true,
            };
            if take {
                *own = labels.get(*voxel);
            }
        }
        if let Some(label) = self.labels.iter().find(|&&l| self.object.materials().get(l).is_none()) {
            return Err(PredictError::invalid("labels", format!("label {label} has no material")));
        }
        self.current = true;
        Ok(())
    }

    fn predict(
        &self,
        points: &[u32],
        draw: Draw,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<Diagnostics, PredictError> {
        if !self.current && self.fault != Fault::PredictsNothing {
            return Err(PredictError::before_update());
        }
        let channels = self.object.channels();
        if self.fault != Fault::AcceptsAnyLength || out.len().is_multiple_of(channels) {
            self.object.check_points(points, out.len())?;
        }
        let calls = self.calls.fetch_add(1, Ordering::Relaxed);
        for (i, (values, &point)) in out.chunks_exact_mut(channels).zip(points).enumerate() {
            let stops = self.fault != Fault::NeverStops && (i == 0 || self.fault != Fault::StopsOnlyAtFirst);
            if stops {
                control.check()?;
            }
            let wrong = 1e-3
                * match self.fault {
                    Fault::CountsCalls => calls as f64,
                    Fault::KnowsItsCompany => points.len() as f64,
                    Fault::KnowsItsThreads => rayon::current_num_threads() as f64,
                    Fault::KnowsItsPlace => i as f64,
                    _ => 0.0,
                };
            for (c, value) in values.iter_mut().enumerate() {
                if self.fault != Fault::LeavesHoles || i % 5 != 0 {
                    *value = self.value(point, c, draw, wrong);
                }
            }
            control.report(i as u64 + 1, points.len() as u64);
        }
        if self.fault == Fault::LearnsByItself {
            self.own.fetch_add(1, Ordering::Relaxed);
        }
        let learned = Learned {
            predictor: "mock".into(),
            passes: vec![draw.pass.number()],
            values: vec![f64::from(draw.pass.number()) + 0.5],
            ..Learned::default()
        };
        let mut seen = Diagnostics::default();
        seen.learned = learned;
        Ok(seen)
    }

    fn pullback(
        &self,
        points: &[u32],
        _: Draw,
        d_radiance: &[f32],
        out: &mut dyn MaterialGradient,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        if !self.current {
            return Err(PredictError::before_update());
        }
        if self.fault != Fault::GradientAcceptsAnyLength || points.len() != 1 {
            self.object.check_points(points, d_radiance.len())?;
        }
        let calls = self.calls.fetch_add(1, Ordering::Relaxed);
        let channels = self.object.channels();
        let region = out.region().unwrap_or([[0; 3], self.object.frame().size()]);
        for (i, (d_radiance, &point)) in d_radiance.chunks_exact(channels).zip(points).enumerate() {
            if self.fault != Fault::GradientNeverStops {
                control.check()?;
            }
            let voxel = self.object.surface().voxels()[point as usize];
            let wanted = (0..3).all(|a| (region[0][a]..region[1][a]).contains(&voxel[a]));
            if self.fault == Fault::GradientPullsNothing
                || !wanted && self.fault != Fault::GradientLeavesItsRegion
            {
                continue;
            }
            let wrong = match self.fault {
                Fault::GradientCountsCalls => 0.1 * calls as f32,
                Fault::GradientKnowsItsThreads => 0.1 * rayon::current_num_threads() as f32,
                Fault::GradientKnowsItsPlace => 0.1 * i as f32,
                _ => 0.0,
            };
            for label in 1..=self.object.materials().len() as u8 {
                let terms =
                    d_radiance.iter().enumerate().map(|(c, d)| d * f32::from(label) * (c as f32 + 1.0));
                let sum: f32 = terms.sum();
                let value = if self.fault == Fault::GradientIsNotLinear { sum.abs() } else { sum };
                let at = if self.fault == Fault::GradientColoursAir { [0; 3] } else { voxel };
                out.add(at, label, value * (1.0 + wrong));
            }
            control.report(i as u64 + 1, points.len() as u64);
        }
        Ok(())
    }

    fn absorb(&mut self, learned: &Learned) -> Result<(), PredictError> {
        if learned.is_empty() {
            return Ok(());
        }
        if learned.predictor != "mock" {
            return Err(PredictError::invalid("learned values", "not the mock's"));
        }
        let known = learned.passes.iter().all(|p| self.memory.passes.contains(p));
        if !known || self.fault == Fault::AbsorbsTwice {
            self.memory.sum = 0.5 * self.memory.sum + learned.values[0];
            self.memory.passes.extend(&learned.passes);
        }
        Ok(())
    }

    fn memory(&self) -> Learned {
        let own = self.own.load(Ordering::Relaxed);
        if self.memory.passes.is_empty() && own == 0 {
            return Learned::default();
        }
        let sum = if self.fault == Fault::ForgetsItsMemory { 0.0 } else { self.memory.sum };
        Learned {
            predictor: "mock".into(),
            passes: self.memory.passes.clone(),
            values: vec![sum + own as f64],
            ..Learned::default()
        }
    }
}

fn case() -> Case {
    Case::planted(3).unwrap()
}

#[test]
fn a_faultless_mock_passes_in_any_number_of_channels() {
    for channels in [1, 3, 5, 31] {
        conformance::check(&Mock(Fault::None), &Case::planted(channels).unwrap()).unwrap();
    }
}

#[test]
fn so_does_one_that_another_corrects() {
    // The seed moves the one and not the other, so that there is something to correct.
    let fast = Mock(Fault::IgnoresTheSeed);
    let corrected = Corrected::new(fast, Mock(Fault::None), Correction::default()).unwrap();
    conformance::check(&corrected, &case()).unwrap();
}

#[test]
fn so_does_one_that_tells_the_changes_between_averaged_passes() {
    let fast = Mock(Fault::IgnoresTheSeed);
    conformance::check(&Averaged::new(fast, Mock(Fault::None), 0.2).unwrap(), &case()).unwrap();
}

#[test]
fn every_fault_is_found_by_its_check() {
    type Check = fn(&dyn Predictor, &Case) -> Result<(), Violation>;
    let expected: [(Fault, Check); 30] = [
        (Fault::CountsCalls, conformance::repetition),
        (Fault::KnowsItsCompany, conformance::shards),
        (Fault::KnowsItsThreads, conformance::threads),
        (Fault::KnowsItsPlace, conformance::order),
        (Fault::IgnoresTheSeed, conformance::draws),
        (Fault::IgnoresThePass, conformance::draws),
        (Fault::IsSecretlyRandom, conformance::draws),
        (Fault::IgnoresTheEffort, conformance::effort),
        (Fault::ForgetsTiles, conformance::updates),
        (Fault::TrustsTheFirstTiles, conformance::updates),
        (Fault::TrustsAfterFailure, conformance::updates),
        (Fault::NeverStops, conformance::cancellation),
        (Fault::StopsOnlyAtFirst, conformance::cancellation),
        (Fault::AcceptsAnyLength, conformance::errors),
        (Fault::AcceptsAnyFrame, conformance::errors),
        (Fault::PredictsNothing, conformance::errors),
        (Fault::LeavesHoles, conformance::repetition),
        (Fault::AbsorbsTwice, conformance::learning),
        (Fault::ForgetsItsMemory, conformance::learning),
        (Fault::LearnsByItself, conformance::learning),
        (Fault::DeniesItsGradient, conformance::gradients),
        (Fault::GradientCountsCalls, conformance::gradients),
        (Fault::GradientKnowsItsThreads, conformance::gradients),
        (Fault::GradientIsNotLinear, conformance::gradients),
        (Fault::GradientKnowsItsPlace, conformance::gradients),
        (Fault::GradientLeavesItsRegion, conformance::gradients),
        (Fault::GradientColoursAir, conformance::gradients),
        (Fault::GradientNeverStops, conformance::gradients),
        (Fault::GradientAcceptsAnyLength, conformance::gradients),
        (Fault::GradientPullsNothing, conformance::gradients),
    ];
    let case = case();
    for (fault, check) in expected {
        let found = check(&Mock(fault), &case);
        assert!(found.is_err(), "{fault:?} passed the check that is meant for it");
        assert!(conformance::check(&Mock(fault), &case).is_err(), "{fault:?}");
    }
}

#[test]
fn a_case_needs_something_to_change() {
    let planted = case();
    let one = pellucid_voxel::MaterialTable::new(
        vec!["only".into()],
        vec![pellucid_voxel::Material::from_albedo("grey", &[0.5], &[5.0], 0.0)],
    )
    .unwrap();
    let object = Object::new(planted.object.surface().clone(), one, 1.5).unwrap();
    assert!(Case::new(Arc::new(object), planted.labels.clone(), 100).is_err());
    assert!((100..250).contains(&planted.points.len()));
}
