//! A team predicts as one member alone, and notices where its members part.

use std::sync::Arc;

use pellucid_core::team::{Team, Threads};
use pellucid_predict::conformance::{self, Case};
use pellucid_predict::{
    Averaged, BoundPredictor, Changed, Corrected, Correction, Diagnostics, Draw, MaterialGradient,
    MonteCarlo, Object, Pass, Predictor, Shared, WithGradient, predict_all,
};
use pellucid_voxel::{Control, Frame, LabelGrid, MaterialTable, Pitch, Surface, SurfaceOptions};

const DRAW: Draw = Draw::new(3, Pass::Loop(1));

/// A block of scattered inks with `label` in one voxel.
fn block(label: u8) -> LabelGrid {
    let frame = Frame::new([0.0; 3], Pitch::j750(), [30, 16, 40]).unwrap();
    let mut grid = LabelGrid::from_fn(frame, |[x, y, z]| 1 + ((x * 7 + y * 5 + z * 3) % 11 % 5) as u8);
    grid.set([4, 4, 4], label);
    grid
}

fn object() -> Arc<Object> {
    let surface = Surface::extract(&block(1), &SurfaceOptions::default(), &Control::none()).unwrap();
    Arc::new(Object::new(surface, MaterialTable::cmykw(), 1.5).unwrap())
}

/// Every call.
#[derive(Default, PartialEq)]
struct Calls(Vec<([u32; 3], u8, u32)>);

impl MaterialGradient for Calls {
    fn add(&mut self, voxel: [u32; 3], label: u8, derivative: f32) {
        self.0.push((voxel, label, derivative.to_bits()));
    }
}

/// Radiance, diagnostics and gradient.
fn seen(predictor: &dyn Predictor, object: &Arc<Object>) -> (Vec<f32>, Diagnostics, Calls) {
    let none = Control::none();
    let mut bound = predictor.bind(Arc::clone(object)).unwrap();
    bound.update(&block(1), Changed::Unknown, &none).unwrap();
    let (radiance, diagnostics) = predict_all(&*bound, object, DRAW, &none).unwrap();
    let mut calls = Calls::default();
    bound.pullback(&object.points(), DRAW, &radiance, &mut calls, &none).unwrap();
    (radiance, diagnostics, calls)
}

#[test]
fn values_paths_and_gradients_are_those_of_one_alone() {
    let object = object();
    let [fast, tracer] = [1, 3].map(|spp| MonteCarlo::new(spp).unwrap().with_pooled_adjoint());
    let made = |team: Option<Arc<dyn Team>>| -> Box<dyn Predictor> {
        let Some(team) = team else {
            let corrected = Corrected::new(fast, tracer, Correction::default()).unwrap();
            return Box::new(WithGradient::new(corrected, tracer));
        };
        let shared = |tracer| Shared::new(tracer, Arc::clone(&team));
        let corrected = Corrected::new(shared(fast), shared(tracer), Correction::default()).unwrap();
        Box::new(WithGradient::new(corrected, shared(tracer)))
    };
    let alone = seen(&*made(None), &object);
    assert!(!alone.2.0.is_empty());
    for size in [1, 2, 3] {
        let all = Threads::run(size, |team| seen(&*made(Some(Arc::new(team))), &object));
        assert!(all.iter().all(|member| *member == alone), "{size} members");
    }
}

#[test]
fn members_hold_what_every_predictor_must() {
    Threads::run(2, |team| {
        let team: Arc<dyn Team> = Arc::new(team);
        let shared = |spp| Shared::new(MonteCarlo::new(spp).unwrap(), Arc::clone(&team));
        let corrected = Corrected::new(shared(1), shared(2), Correction::default()).unwrap();
        let averaged = Averaged::new(shared(1), shared(2), 0.2).unwrap();
        let case = Case::planted(3).unwrap();
        for predictor in [&shared(2) as &dyn Predictor, &corrected, &averaged] {
            if let Err(violation) = conformance::check(predictor, &case) {
                panic!("rank {}: {violation}: {:?}", team.rank(), violation.source);
            }
        }
    });
}

#[test]
fn members_with_other_labels_are_told() {
    let object = object();
    let told = Threads::run(2, |team| {
        let labels = block(1 + team.rank() as u8);
        let shared = Shared::new(MonteCarlo::new(1).unwrap(), Arc::new(team));
        let mut bound: Box<dyn BoundPredictor> = shared.bind(Arc::clone(&object)).unwrap();
        let error = bound.update(&labels, Changed::Unknown, &Control::none()).unwrap_err();
        let refused = predict_all(&*bound, &object, DRAW, &Control::none()).is_err();
        (std::error::Error::source(&error).unwrap().to_string(), refused)
    });
    assert!(told.iter().all(|(text, refused)| text.contains("different labels") && *refused), "{told:?}");
}

#[test]
fn one_cancelled_member_stops_all() {
    use std::sync::atomic::AtomicBool;
    let object = object();
    let stopped = Threads::run(2, |team| {
        let cancel = AtomicBool::new(team.rank() == 1);
        let shared = Shared::new(MonteCarlo::new(1).unwrap(), Arc::new(team));
        let mut bound = shared.bind(Arc::clone(&object)).unwrap();
        let none = Control::none();
        let with = none.with_cancel(&cancel);
        let stopped_update = bound.update(&block(1), Changed::Unknown, &with).is_err();
        bound.update(&block(1), Changed::Tiles(&[]), &none).unwrap();
        let stopped = predict_all(&*bound, &object, DRAW, &with).is_err();
        (stopped_update, stopped, predict_all(&*bound, &object, DRAW, &none).is_ok())
    });
    assert_eq!(stopped, [(true, true, true); 2]);
}
