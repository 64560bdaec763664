//! The network as a predictor: what it computes does not depend on how.

use pellucid::predictor::{Rpnn, Sharing};
use pellucid::refine::{AppearancePredictor, PredictError, Scene};
use pellucid::rpnn::file::Provenance;
use pellucid::rpnn::transform::{FeatureTransform, InputForm, LevelOrder};
use pellucid::rpnn::{Precision, Variant, Weights};
use pellucid::voxel::{Control, Frame, LabelGrid, MaterialTable, Pitch, Surface, SurfaceOptions, Tile};

fn provenance() -> Provenance {
    Provenance {
        form: InputForm { transform: FeatureTransform::Log, order: LevelOrder::CoarseToFine },
        pitch_mm: Pitch::j750().mm(),
        refractive_index: 1.5,
        sigma_s_range: [0.3, 24.0],
        sigma_a_range: [0.0027, 16.2],
        history: String::new(),
    }
}

fn predictor(provenance: Provenance) -> Rpnn {
    // Untrained, but far from zero everywhere.
    let weights = Weights::initial(Variant::SharedLevelsAndOctants, 2, 8.0);
    Rpnn::new(weights, provenance, Precision::F32)
}

/// A block of mixed labels with air around it.
fn block() -> (LabelGrid, Surface) {
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
    (grid, surface)
}

fn predict(rpnn: &mut Rpnn, grid: &LabelGrid, surface: &Surface, points: &[u32]) -> Vec<f32> {
    let materials = MaterialTable::cmykw();
    let scene = Scene { grid, surface, materials: &materials };
    let mut out = vec![0.0; points.len() * 3];
    rpnn.predict(&scene, points, 0, &mut out, &Control::none()).unwrap();
    out
}

#[test]
fn values_do_not_depend_on_threads_or_company() {
    let (grid, surface) = block();
    let all: Vec<u32> = (0..surface.len() as u32).collect();
    let together = predict(&mut predictor(provenance()), &grid, &surface, &all);
    assert!(together.iter().filter(|&&v| v > 0.0).count() > together.len() / 2);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let alone = pool.install(|| predict(&mut predictor(provenance()), &grid, &surface, &all));
    assert_eq!(together, alone);
    let some: Vec<u32> = all.iter().rev().step_by(7).copied().collect();
    let part = predict(&mut predictor(provenance()), &grid, &surface, &some);
    for (i, &p) in some.iter().enumerate() {
        assert_eq!(part[3 * i..3 * i + 3], together[3 * p as usize..][..3]);
    }
}

#[test]
fn a_refreshed_table_predicts_as_a_new_one() {
    let (mut grid, surface) = block();
    let points: Vec<u32> = (0..surface.len() as u32).step_by(3).collect();
    let mut rpnn = predictor(provenance());
    let before = predict(&mut rpnn, &grid, &surface, &points);
    let tiles = grid.update_tiles(|at, _| (at == [0, 1, 1]).then_some(Tile::Constant(4)));
    rpnn.tiles_changed(&tiles);
    let after = predict(&mut rpnn, &grid, &surface, &points);
    assert_ne!(before, after);
    assert_eq!(after, predict(&mut predictor(provenance()), &grid, &surface, &points));
    // Without a word of what changed everything is built anew.
    grid.update_tiles(|at, _| (at == [1, 1, 1]).then_some(Tile::Constant(2)));
    let last = predict(&mut rpnn, &grid, &surface, &points);
    assert_eq!(last, predict(&mut predictor(provenance()), &grid, &surface, &points));
}

#[test]
fn what_training_did_not_see_is_counted_or_refused() {
    let (grid, surface) = block();
    let points: Vec<u32> = (0..surface.len() as u32).collect();
    let mut rpnn = predictor(provenance());
    predict(&mut rpnn, &grid, &surface, &points);
    assert_eq!(rpnn.outside_training(), 0);
    // Cyan scatters red at 0.45/mm, less than this range holds; white at 24 in blue, more.
    let narrow = Provenance { sigma_s_range: [0.5, 20.0], ..provenance() };
    let mut rpnn = predictor(narrow);
    predict(&mut rpnn, &grid, &surface, &points);
    let count = rpnn.outside_training();
    assert!(count > 0 && count < 3 * points.len() as u64, "{count} of {}", 3 * points.len());

    let materials = MaterialTable::cmykw();
    let scene = Scene { grid: &grid, surface: &surface, materials: &materials };
    let elsewhere = Provenance { pitch_mm: [0.1; 3], ..provenance() };
    let mut out = vec![0.0; 3];
    let error = predictor(elsewhere).predict(&scene, &[0], 0, &mut out, &Control::none()).unwrap_err();
    assert!(matches!(error, PredictError::Unsupported { .. }), "{error}");
    let mut rpnn = predictor(provenance());
    assert!(rpnn.predict(&scene, &[0], 0, &mut out[..2], &Control::none()).is_err());
    assert!(rpnn.predict(&scene, &[u32::MAX], 0, &mut out, &Control::none()).is_err());
    assert!(rpnn.check(1.0, Pitch::j750()).is_err() && rpnn.check(1.5, Pitch::j750()).is_ok());
}

#[test]
fn blocks_of_one_voxel_share_with_nobody_and_larger_ones_hardly_matter() {
    let (grid, surface) = block();
    let points: Vec<u32> = (0..surface.len() as u32).step_by(5).collect();
    let sharing = |s| predictor(provenance()).with_sharing(s);
    let whole = predict(&mut sharing(None).unwrap(), &grid, &surface, &points);
    for fine_levels in [1, 4, 8] {
        let alone = Some(Sharing { fine_levels, block: 1 });
        assert_eq!(predict(&mut sharing(alone).unwrap(), &grid, &surface, &points), whole);
    }
    let difference = |s: Sharing| {
        let shared = predict(&mut sharing(Some(s)).unwrap(), &grid, &surface, &points);
        let squares = |v: &mut dyn Iterator<Item = f32>| v.map(|d| f64::from(d * d)).sum::<f64>();
        let spread = squares(&mut whole.iter().map(|v| v - whole.iter().sum::<f32>() / whole.len() as f32));
        (squares(&mut shared.iter().zip(&whole).map(|(a, b)| a - b)) / spread).sqrt()
    };
    // Six own levels see 160 voxels along x, and blocks of three move the rest by one voxel; with one own level and
    // blocks of fifteen a point sees little but its block's surroundings.
    let (little, much) =
        (difference(Sharing { fine_levels: 6, block: 3 }), difference(Sharing { fine_levels: 1, block: 15 }));
    assert!(little > 0.0 && little < 0.1 && much > 2.0 * little, "{little} {much}");
    for (fine_levels, block) in [(0, 3), (9, 3), (4, 2), (4, 0)] {
        assert!(sharing(Some(Sharing { fine_levels, block })).is_err());
    }
    let mut paper = provenance();
    paper.form.order = LevelOrder::FineToCoarse;
    assert!(predictor(paper.clone()).with_sharing(Some(Sharing::default())).is_err());
    predict(&mut predictor(paper), &grid, &surface, &points);
}
