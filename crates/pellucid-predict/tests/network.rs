//! The network as a predictor: what it computes does not depend on how.

mod common;

use std::sync::Arc;

use common::{network, provenance};
use pellucid_predict::{
    Changed, Draw, InstructionSet, Network, Object, Pass, PredictError, Predictor, Sharing, predict_all,
};
use pellucid_rpnn::Provenance;
use pellucid_rpnn::transform::LevelOrder;
use pellucid_rpnn::variant::Head;
use pellucid_voxel::{Control, Frame, LabelGrid, MaterialTable, Pitch, Surface, SurfaceOptions, Tile};

const DRAW: Draw = Draw::new(0, Pass::Loop(0));

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
fn places_at_every_voxel_change_nothing_and_far_ones_hardly_matter() {
    let (grid, object) = block();
    let points: Vec<u32> = object.points().into_iter().step_by(13).collect();
    for head in Head::ALL {
        let sharing = |s| common::network_of(head, provenance()).with_sharing(s);
        let whole = predict(&sharing(None).unwrap(), &grid, &object, &points);
        let difference = |s: Sharing| {
            let shared = predict(&sharing(Some(s)).unwrap(), &grid, &object, &points);
            let squares = |v: &mut dyn Iterator<Item = f32>| v.map(|d| f64::from(d * d)).sum::<f64>();
            let mean = whole.iter().sum::<f32>() / whole.len() as f32;
            let spread = squares(&mut whole.iter().map(|v| v - mean));
            (squares(&mut shared.iter().zip(&whole).map(|(a, b)| a - b)) / spread).sqrt()
        };
        let way = |spacing_mm, fine_levels, coarse_mm| Sharing { spacing_mm, fine_levels, coarse_mm };
        for fine_levels in [1, 4, 8] {
            assert_eq!(difference(way(0.0, fine_levels, 0.03)), 0.0, "{head:?}, {fine_levels} fine levels");
        }
        let (little, much) = (difference(way(0.0, 6, 0.1)), difference(way(0.0, 1, 0.8)));
        assert!(little > 0.0 && little < 0.1 && much > 2.0 * little, "{head:?} {little} {much}");
        let (near, far) = (difference(way(0.1, 9, 0.0)), difference(way(0.6, 9, 0.0)));
        match head {
            Head::Radiance => assert_eq!((near, far), (0.0, 0.0), "radiance is not shared"),
            Head::FirstFlight => assert!(near > 0.0 && near < 0.3 && far > near, "{near} {far}"),
        }
        for (spacing_mm, fine_levels, coarse_mm) in
            [(0.2, 0, 1.0), (0.2, 10, 1.0), (-0.1, 4, 1.0), (0.1, 4, f64::NAN)]
        {
            assert!(sharing(Some(way(spacing_mm, fine_levels, coarse_mm))).is_err());
        }
    }
    let mut paper = provenance();
    paper.form.order = LevelOrder::FineToCoarse;
    assert!(network(paper.clone()).with_sharing(Some(Sharing::default())).is_err());
    assert_eq!(network(paper.clone()).sharing().unwrap().fine_levels, 9);
    predict(&network(paper), &grid, &object, &points);
}

#[test]
fn predictions_do_not_depend_on_what_else_is_asked_for() {
    let (grid, object) = block();
    for head in Head::ALL {
        let network = common::network_of(head, provenance());
        let all = object.points();
        let whole = predict(&network, &grid, &object, &all);
        for point in [0, 17, 400] {
            let alone = predict(&network, &grid, &object, &[all[point]]);
            assert_eq!(alone, whole[3 * point..3 * point + 3]);
        }
    }
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
