//! Path tracing as a predictor is the tracer, whose paths its draw chooses.

use std::sync::Arc;

use pellucid_predict::{
    Changed, Draw, InstructionSet, MaterialGradient, MonteCarlo, Object, Pass, PredictError, Predictor,
    predict_all,
};
use pellucid_trace::{AdjointOptions, Boundary, Derivatives, TraceOptions, Tracer, Tracking, Volume};
use pellucid_voxel::{Control, Frame, LabelGrid, MaterialTable, Pitch, Surface, SurfaceOptions, Tile};

fn grid() -> LabelGrid {
    let frame = Frame::new([0.0; 3], Pitch::j750(), [30, 20, 40]).unwrap();
    LabelGrid::from_tiles(frame, |[x, y, z]| Tile::Constant(1 + ((x + 2 * y + 3 * z) % 5) as u8))
}

fn surface(grid: &LabelGrid) -> Surface {
    Surface::extract(grid, &SurfaceOptions::default(), &Control::none()).unwrap()
}

fn object(grid: &LabelGrid, index: f64) -> Arc<Object> {
    Arc::new(Object::new(surface(grid), MaterialTable::cmykw(), index).unwrap())
}

#[test]
fn values_are_the_tracers() {
    let (grid, none) = (grid(), Control::none());
    let surface = surface(&grid);
    let volume = Volume::new(&grid, &surface, &none).unwrap();
    for (index, seed, pass) in
        [(1.5, 0, Pass::Loop(0)), (1.5, u64::MAX, Pass::Loop(7)), (1.0, 3, Pass::Judge(1))]
    {
        let object = object(&grid, index);
        let mut bound = MonteCarlo::new(3).unwrap().bind(Arc::clone(&object)).unwrap();
        bound.update(&grid, Changed::Unknown, &none).unwrap();
        let (values, seen) = predict_all(&*bound, &object, Draw::new(seed, pass), &none).unwrap();
        let boundary = Boundary::with_index(index).unwrap();
        let options = TraceOptions { spp: 3, seed, boundary, ..TraceOptions::default() };
        let tracer = Tracer::new(&volume, object.materials(), options).unwrap();
        let mut expected = vec![0.0; values.len()];
        tracer.radiance(&object.points(), pass.number(), &mut expected, &none).unwrap();
        assert_eq!(values, expected, "{index} {seed} {pass:?}");
        assert_eq!(seen.paths, 3 * values.len() as u64);
    }
    assert_eq!(Pass::Loop(7).number(), 7);
}

#[test]
fn effort_is_more_paths() {
    let (grid, none) = (grid(), Control::none());
    let object = object(&grid, 1.5);
    let values = |spp, effort| {
        let mut bound = MonteCarlo::new(spp).unwrap().bind(Arc::clone(&object)).unwrap();
        bound.update(&grid, Changed::Unknown, &none).unwrap();
        let draw = Draw::new(5, Pass::Loop(3)).with_effort(effort);
        let (values, seen) = predict_all(&*bound, &object, draw, &none).unwrap();
        (values, seen.paths)
    };
    assert_eq!(values(2, 3), values(6, 1));
    assert_eq!(values(2, 0), values(2, 1));
    assert_ne!(values(2, 1).0, values(2, 2).0);
}

/// What was added, in order.
#[derive(Default)]
struct Calls(Vec<([u32; 3], u8, u32)>);

impl MaterialGradient for Calls {
    fn add(&mut self, voxel: [u32; 3], label: u8, derivative: f32) {
        self.0.push((voxel, label, derivative.to_bits()));
    }

    fn wants(&self, first: [u32; 3], _: [u32; 3]) -> bool {
        first[2] >= 8
    }
}

impl Derivatives for Calls {
    fn add(&mut self, voxel: [u32; 3], label: u8, derivative: f32) {
        self.0.push((voxel, label, derivative.to_bits()));
    }

    fn wants(&self, first: [u32; 3], _: [u32; 3]) -> bool {
        first[2] >= 8
    }
}

#[test]
fn gradients_are_the_tracers() {
    let (grid, none) = (grid(), Control::none());
    let object = object(&grid, 1.5);
    let plain = MonteCarlo::new(3).unwrap().with_adjoint_paths(0.75).unwrap();
    for (predictor, pooled) in [(plain, false), (plain.with_pooled_adjoint(), true)] {
        assert!(predictor.supports(&object).unwrap().gradient);
        let mut bound = predictor.bind(Arc::clone(&object)).unwrap();
        bound.update(&grid, Changed::Unknown, &none).unwrap();
        let points = object.points();
        let weights: Vec<f32> = (0..3 * points.len()).map(|i| (i % 11) as f32 - 4.0).collect();
        let mut found = Calls::default();
        bound.pullback(&points, Draw::new(6, Pass::Judge(2)), &weights, &mut found, &none).unwrap();
        let volume = Volume::new(&grid, object.surface(), &none).unwrap();
        let options = TraceOptions { seed: 6, ..TraceOptions::default() };
        let tracer = Tracer::new(&volume, object.materials(), options).unwrap();
        let (adjoint, mut expected) = (AdjointOptions { paths: 0.75, pooled }, Calls::default());
        let pass = Pass::Judge(2).number();
        tracer.pullback(&points, pass, &weights, &adjoint, &mut expected, &none).unwrap();
        assert!(found.0.len() > 1000 && found.0 == expected.0);
    }
}

#[test]
fn instruction_sets_are_recorded_and_change_no_bit() {
    let (grid, none) = (grid(), Control::none());
    let object = object(&grid, 1.5);
    let values = |predictor: &MonteCarlo| {
        let mut bound = predictor.bind(Arc::clone(&object)).unwrap();
        bound.update(&grid, Changed::Unknown, &none).unwrap();
        predict_all(&*bound, &object, Draw::new(5, Pass::Proof), &none).unwrap().0
    };
    let default = MonteCarlo::new(2).unwrap();
    assert_eq!(default.identity().instruction_set, InstructionSet::chosen());
    let expected = values(&default);
    for set in InstructionSet::available() {
        let forced = default.with_instruction_set(set).unwrap();
        assert_eq!(forced.identity().instruction_set, set);
        assert!(forced.identity().exact);
        assert_eq!(values(&forced), expected, "{set}");
    }
}

#[test]
fn settings_are_checked_and_recorded() {
    assert!(matches!(MonteCarlo::new(0), Err(PredictError::Invalid(f)) if f.subject == "spp"));
    assert!(MonteCarlo::new(1).unwrap().with_roulette(f32::NAN).is_err());
    assert!(MonteCarlo::new(1).unwrap().with_adjoint_paths(0.0).is_err());
    let identity =
        MonteCarlo::new(9).unwrap().with_roulette(0.5).unwrap().with_tracking(Tracking::Delta).identity();
    assert_eq!(identity.name, "mc");
    let settings: Vec<(&str, &str)> =
        identity.settings.iter().map(|(k, v)| (k.as_str(), v.as_str())).collect();
    assert_eq!(
        settings,
        [
            ("adjoint-paths", "2"),
            ("adjoint-pooled", "false"),
            ("roulette", "0.5"),
            ("shared-bands", "4"),
            ("spp", "9"),
            ("tracking", "delta")
        ]
    );
}

#[test]
fn another_shape_is_refused_by_the_voxel() {
    let (grid, none) = (grid(), Control::none());
    let object = object(&grid, 1.5);
    let mut bound = MonteCarlo::new(1).unwrap().bind(Arc::clone(&object)).unwrap();
    let mut holed = grid.clone();
    holed.set([15, 10, 20], 0);
    for _ in 0..2 {
        let error = bound.update(&holed, Changed::Unknown, &none).unwrap_err();
        assert!(matches!(error, PredictError::Invalid(_)), "{error}");
        assert!(error.to_string().contains("[15, 10, 19]"), "{error}");
        assert!(bound.predict(&[0], Draw::new(0, Pass::Proof), &mut [0.0; 3], &none).is_err());
        bound.update(&grid, Changed::Unknown, &none).unwrap();
    }
}
