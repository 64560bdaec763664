//! The network as a predictor: what it computes does not depend on how.

mod common;

use std::sync::Arc;

use common::{network, provenance};
use pellucid_predict::{
    Changed, Draw, InstructionSet, Network, Object, Pass, PredictError, Predictor, Sharing, predict_all,
};
use pellucid_rpnn::Provenance;
use pellucid_rpnn::transform::LevelOrder;
use pellucid_voxel::{Control, Frame, LabelGrid, MaterialTable, Pitch, Surface, SurfaceOptions, Tile};

const DRAW: Draw = Draw { seed: 0, pass: Pass::Loop(0) };

/// A block of mixed labels with air around it.
fn block() -> (LabelGrid, Arc<Object>) {
    let frame = Frame::new([0.0; 3], Pitch::j750(), [40, 34, 50]).unwrap();
    let mut grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(0));
    for z in 3..47u32 {
        for y in 3..31u32 {
            for x in 3..37u32 {
                grid.set([x, y, z], 1 + ((x * 7 + y * 5 + z * 3) % 11 % 5) as u8);
            }
        }
    }
    let surface = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()).unwrap();
    (grid, Arc::new(Object::new(surface, MaterialTable::cmykw(), 1.5).unwrap()))
}

fn predict(network: &Network, grid: &LabelGrid, object: &Arc<Object>, points: &[u32]) -> Vec<f32> {
    let mut bound = network.bind(Arc::clone(object)).unwrap();
    bound.update(grid, Changed::Unknown, &Control::none()).unwrap();
    let mut out = vec![0.0; points.len() * 3];
    bound.predict(points, DRAW, &mut out, &Control::none()).unwrap();
    out
}

#[test]
fn an_updated_table_predicts_as_a_new_one() {
    let (mut grid, object) = block();
    let none = Control::none();
    let network = network(provenance());
    let mut bound = network.bind(Arc::clone(&object)).unwrap();
    bound.update(&grid, Changed::Unknown, &none).unwrap();
    let values =
        |bound: &dyn pellucid_predict::BoundPredictor| predict_all(bound, &object, DRAW, &none).unwrap().0;
    let before = values(&*bound);
    assert!(before.iter().filter(|&&v| v > 0.0).count() > before.len() / 2);
    let solid = |tile: &Tile, label: u8| match tile {
        Tile::Dense(labels) => Tile::Dense(Box::new(labels.map(|l| if l == 0 { 0 } else { label }))),
        Tile::Constant(_) => Tile::Constant(label),
    };
    let tiles = grid.update_tiles(|at, tile| (at == [0, 1, 1]).then(|| solid(tile, 4)));
    bound.update(&grid, Changed::Tiles(&tiles), &none).unwrap();
    let after = values(&*bound);
    assert_ne!(before, after);
    assert_eq!(after, predict(&network, &grid, &object, &object.points()));
    // Without a word of what changed it is found.
    grid.update_tiles(|at, tile| (at == [1, 1, 1]).then(|| solid(tile, 2)));
    bound.update(&grid, Changed::Unknown, &none).unwrap();
    let last = values(&*bound);
    assert_ne!(last, after);
    assert_eq!(last, predict(&network, &grid, &object, &object.points()));
}

#[test]
fn what_training_did_not_see_is_counted_or_refused() {
    let (grid, object) = block();
    let none = Control::none();
    let outside = |provenance: Provenance| {
        let mut bound = network(provenance).bind(Arc::clone(&object)).unwrap();
        bound.update(&grid, Changed::Unknown, &none).unwrap();
        predict_all(&*bound, &object, DRAW, &none).unwrap().1.outside_training
    };
    assert_eq!(outside(provenance()), 0);
    // Cyan scatters red at 0.45/mm, less than this range holds; white at 24 in blue, more.
    let narrow = Provenance { sigma_s_range: [0.5, 20.0], ..provenance() };
    let (count, all) = (outside(narrow), 3 * object.surface().len() as u64);
    assert!(count > 0 && count < all, "{count} of {all}");

    for (other, field) in [
        (Provenance { pitch_mm: [0.1; 3], ..provenance() }, "pitch"),
        (Provenance { refractive_index: 1.0, ..provenance() }, "refractive index"),
    ] {
        let network = network(other);
        for error in [network.supports(&object).unwrap_err(), network.bind(object.clone()).err().unwrap()] {
            assert!(matches!(&error, PredictError::Unsupported(f) if f.subject == field), "{error}");
            assert!(error.to_string().contains("path tracer"), "{error}");
        }
    }
}

#[test]
fn labels_of_another_shape_are_refused() {
    let (mut grid, object) = block();
    let mut bound = network(provenance()).bind(Arc::clone(&object)).unwrap();
    let gone = object.surface().voxels()[77];
    grid.set(gone, 0);
    let error = bound.update(&grid, Changed::Unknown, &Control::none()).unwrap_err().to_string();
    assert!(error.contains(&format!("{gone:?}")), "{error}");
}

#[test]
fn blocks_of_one_voxel_share_with_nobody_and_larger_ones_hardly_matter() {
    let (grid, object) = block();
    let points: Vec<u32> = object.points().into_iter().step_by(13).collect();
    let sharing = |s| network(provenance()).with_sharing(s);
    let whole = predict(&sharing(None).unwrap(), &grid, &object, &points);
    for fine_levels in [1, 4, 8] {
        let alone = Some(Sharing { spacing_mm: 0.0, fine_levels, block: 1 });
        assert_eq!(predict(&sharing(alone).unwrap(), &grid, &object, &points), whole);
    }
    let difference = |s: Sharing| {
        let shared = predict(&sharing(Some(s)).unwrap(), &grid, &object, &points);
        let squares = |v: &mut dyn Iterator<Item = f32>| v.map(|d| f64::from(d * d)).sum::<f64>();
        let spread = squares(&mut whole.iter().map(|v| v - whole.iter().sum::<f32>() / whole.len() as f32));
        (squares(&mut shared.iter().zip(&whole).map(|(a, b)| a - b)) / spread).sqrt()
    };
    // Six own levels see 160 voxels along x, and blocks of three move the rest by one voxel; with one own level and
    // blocks of fifteen a point sees little but its block's surroundings.
    let (little, much) = (
        difference(Sharing { spacing_mm: 0.0, fine_levels: 6, block: 3 }),
        difference(Sharing { spacing_mm: 0.0, fine_levels: 1, block: 15 }),
    );
    assert!(little > 0.0 && little < 0.1 && much > 2.0 * little, "{little} {much}");
    for (fine_levels, block) in [(0, 3), (10, 3), (4, 2), (4, 0)] {
        assert!(sharing(Some(Sharing { spacing_mm: 0.0, fine_levels, block })).is_err());
    }
    let mut paper = provenance();
    paper.form.order = LevelOrder::FineToCoarse;
    assert!(network(paper.clone()).with_sharing(Some(Sharing::default())).is_err());
    assert_eq!(network(paper.clone()).sharing().unwrap().fine_levels, 9);
    predict(&network(paper), &grid, &object, &points);
}

#[test]
fn a_forced_instruction_set_is_recorded_and_moves_values_by_rounding_only() {
    let (grid, object) = block();
    let points: Vec<u32> = object.points().into_iter().step_by(301).collect();
    let on = |set| network(provenance()).with_instruction_set(set).unwrap();
    let portable = predict(&on(InstructionSet::Portable), &grid, &object, &points);
    for set in InstructionSet::available() {
        let recorded = on(set).identity().instruction_set;
        assert!(recorded <= set, "{recorded} for {set}");
        let values = predict(&on(set), &grid, &object, &points);
        assert_eq!(values, predict(&on(recorded), &grid, &object, &points), "{recorded} for {set}");
        for (a, b) in values.iter().zip(&portable) {
            assert!((a - b).abs() < 1e-4 * (1.0 + b.abs()), "{set}: {a} {b}");
        }
    }
}

#[test]
fn the_identity_names_the_weights() {
    let network = network(provenance());
    let identity = network.identity();
    let weights = identity.weights.unwrap();
    assert_eq!((identity.name.as_str(), identity.exact), ("rpnn", false));
    assert_eq!(weights.variant, network.trained().weights.variant().name());
    assert_eq!(weights.digest, network.trained().weights.digest());
    assert_eq!(weights.history, ["drawn at random", "never trained"]);
    assert_eq!(identity.settings["precision"], "f32");
    assert!(identity.settings["sharing"].contains("3 levels"));
}
