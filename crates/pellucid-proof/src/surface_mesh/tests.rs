use super::*;
use pellucid_voxel::{AIR, Frame, Pitch, SurfaceOptions};
use proptest::prelude::*;
use std::collections::HashMap;

fn grid(size: [u32; 3], solid: impl Fn([f64; 3]) -> bool + Sync) -> (LabelGrid, Surface) {
    let frame = Frame::new([-1.0, 2.0, 0.5], Pitch::j750(), size).unwrap();
    let grid = LabelGrid::from_fn(frame, |voxel| u8::from(solid(frame.centre_mm(voxel.map(i64::from)))));
    let surface = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()).unwrap();
    (grid, surface)
}

fn ball(radius: f64) -> (LabelGrid, Surface) {
    let size = Pitch::j750().mm().map(|mm| (2.0 * radius / mm).ceil() as u32 + 2);
    let middle = [-1.0 + radius + 0.04, 2.0 + radius + 0.08, 0.5 + radius + 0.03];
    grid(size, |p| (0..3).map(|a| (p[a] - middle[a]).powi(2)).sum::<f64>() < radius * radius)
}

/// Twice the volume of the tetrahedra from the origin over both triangles of each quad, divided: mm³.
fn volume(mesh: &SurfaceMesh) -> f64 {
    let at = |i: u32| mesh.positions_mm()[i as usize].map(f64::from);
    let triple = |a: [f64; 3], b: [f64; 3], c: [f64; 3]| {
        a[0] * (b[1] * c[2] - b[2] * c[1])
            + a[1] * (b[2] * c[0] - b[0] * c[2])
            + a[2] * (b[0] * c[1] - b[1] * c[0])
    };
    let six: f64 = mesh
        .quads()
        .iter()
        .map(|&[a, b, c, d]| triple(at(a), at(b), at(c)) + triple(at(a), at(c), at(d)))
        .sum();
    six / 6.0
}

#[test]
fn a_ball_keeps_its_size_at_any_fineness() {
    let (labels, surface) = ball(1.5);
    for most in [40_000, 6_000, 900] {
        let mesh = SurfaceMesh::build(&labels, &surface, most, &Control::none()).unwrap();
        let count = mesh.positions_mm().len();
        assert!(count <= most && count > most / 4, "{count} of {most}");
        let exact = 4.0 / 3.0 * std::f64::consts::PI * 1.5f64.powi(3);
        let ratio = volume(&mesh) / exact;
        assert!((ratio - 1.0).abs() < 0.05, "{most}: {ratio}, cells {:?}", mesh.cell_voxels());
        let middle = [0.54, 3.58, 2.03];
        for p in mesh.positions_mm() {
            let r = (0..3).map(|a| (f64::from(p[a]) - middle[a]).powi(2)).sum::<f64>().sqrt();
            assert!((r - 1.5).abs() < 0.5 * mesh.cell_mm()[1] + 0.05, "{most}: {r}");
        }
    }
}

#[test]
fn the_mesh_is_closed_and_finest_for_small_objects() {
    let (labels, surface) = ball(0.6);
    let mesh = SurfaceMesh::build(&labels, &surface, 1_000_000, &Control::none()).unwrap();
    assert_eq!(mesh.cell_voxels(), [1; 3]);
    let faces: usize = surface
        .voxels()
        .iter()
        .map(|v| {
            let beside = |axis: usize, step: i64| {
                let mut at = v.map(i64::from);
                at[axis] += step;
                labels.at(at) == AIR
            };
            (0..3).map(|a| usize::from(beside(a, -1)) + usize::from(beside(a, 1))).sum::<usize>()
        })
        .sum();
    assert_eq!(mesh.quads().len(), faces, "a quad for every face that air touches");
    let mut runs: HashMap<(u32, u32), i32> = HashMap::new();
    for quad in mesh.quads() {
        for i in 0..4 {
            let (a, b) = (quad[i], quad[(i + 1) % 4]);
            *runs.entry((a.min(b), a.max(b))).or_default() += if a < b { 1 } else { -1 };
        }
    }
    assert!(runs.values().all(|&net| net == 0), "every edge is run as often one way as the other");
}

#[test]
fn the_two_sides_of_a_thin_sheet_keep_their_own_values() {
    let (labels, surface) = grid([60, 30, 40], |p| (p[2] - 1.0).abs() < 0.06 && p[0].abs() < 0.9);
    let up: Vec<[f32; 1]> = surface.normals().iter().map(|n| [if n[2] > 0.0 { 1.0 } else { 0.0 }]).collect();
    let mesh = SurfaceMesh::build(&labels, &surface, 500, &Control::none()).unwrap();
    assert!(mesh.cell_mm()[2] > 0.1, "thinner than a cell");
    let means = mesh.means(&up).unwrap();
    let clear = means.iter().filter(|v| v[0] < 0.01 || v[0] > 0.99).count();
    assert!(clear * 10 > means.len() * 7, "{clear} of {}", means.len());
    assert!(mesh.means(&up[1..]).is_err());
}

#[test]
fn what_cannot_be_built_is_refused() {
    let (labels, surface) = ball(0.3);
    assert!(matches!(
        SurfaceMesh::build(&labels, &surface, 7, &Control::none()),
        Err(ProofError::Invalid(_))
    ));
    let stop = std::sync::atomic::AtomicBool::new(true);
    let control = Control::none().with_cancel(&stop);
    assert!(matches!(SurfaceMesh::build(&labels, &surface, 100, &control), Err(ProofError::Cancelled)));
    // Many bodies need more corners than one.
    let (labels, surface) = grid([32, 16, 48], |p| ((p[0] * 9.0) as i64 + (p[1] * 5.0) as i64) % 2 == 0);
    let mesh = SurfaceMesh::build(&labels, &surface, 8, &Control::none()).unwrap();
    assert_eq!(mesh.positions_mm().len(), 8);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn any_voxels_have_a_mesh_whose_means_lie_between(seed in any::<u64>(), share in 2u64..10, most in 8usize..400) {
        let frame = Frame::new([0.0; 3], Pitch::j750(), [9, 7, 11]).unwrap();
        let labels = LabelGrid::from_fn(frame, |[x, y, z]| {
            let at = u64::from(x + 100 * y + 10_000 * z) ^ seed;
            u8::from(at.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32 & 15 < share)
        });
        let surface = Surface::extract(&labels, &SurfaceOptions::default(), &Control::none()).unwrap();
        prop_assume!(!surface.is_empty());
        let mesh = SurfaceMesh::build(&labels, &surface, most, &Control::none()).unwrap();
        prop_assert!(mesh.positions_mm().len() <= most);
        let values: Vec<[f32; 2]> = (0..surface.len()).map(|i| [i as f32, 1.0]).collect();
        for [a, b] in mesh.means(&values).unwrap() {
            prop_assert!((0.0..surface.len() as f32).contains(&a) && b == 1.0);
        }
    }
}
