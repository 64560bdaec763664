use super::*;
use crate::geometry::{Bounds, add, cross, scale, sub};
use crate::shapes::Shape;
use crate::winding::triangle_winding;
use proptest::prelude::*;

pub(super) const J750: [f64; 3] = [25.4 / 600.0, 25.4 / 300.0, 25.4 / 940.0];

pub(super) fn run(shape: &Shape, pitch: [f64; 3]) -> Voxelised {
    let options = VoxeliseOptions { pitch: Pitch::new(pitch).unwrap(), ..Default::default() };
    voxelise(&shape.model(), &options, &Control::none()).unwrap()
}

pub(super) fn solid(v: &Voxelised) -> u64 {
    v.grid.histogram()[5]
}

pub(super) fn volume(v: &Voxelised) -> f64 {
    solid(v) as f64 * v.grid.frame().pitch().volume_mm3()
}

/// Voxels whose labels differ; the grids lie in equal frames.
pub(super) fn difference(a: &LabelGrid, b: &LabelGrid) -> u64 {
    assert_eq!(a.frame(), b.frame());
    voxels(a).filter(|&v| a.get(v) != b.get(v)).count() as u64
}

pub(super) fn voxels(grid: &LabelGrid) -> impl Iterator<Item = [u32; 3]> + use<> {
    let [sx, sy, sz] = grid.size();
    (0..sz).flat_map(move |z| (0..sy).flat_map(move |y| (0..sx).map(move |x| [x, y, z])))
}

/// The point of a shape's space that voxelisation puts at 0.
pub(super) fn lowest(shape: &Shape) -> Vec3 {
    Bounds::of(shape.corners().into_iter().flatten()).min
}

#[test]
fn sphere_volume_is_within_half_a_percent() {
    for (radius, pitch) in
        [(5.0, J750), (2.0, J750), (3.0, [0.05; 3]), (4.0, [0.11, 0.03, 0.07]), (2.0, [0.1; 3])]
    {
        let v = run(&Shape::sphere([1.0, -2.0, 0.3], radius, 6), pitch);
        let exact = 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
        let error = volume(&v) / exact - 1.0;
        assert!(error.abs() < 0.005, "radius {radius} at {pitch:?}: {error}");
        assert!(v.report.closed && v.report.shells == 1 && v.report.thin_voxels == 0, "{:?}", v.report);
        assert!((v.report.volume_mm3 / exact - 1.0).abs() < 1e-3);
    }
}

#[test]
fn torus_volume_and_hole() {
    let v = run(&Shape::torus(3.0, 1.0, 160, 80), J750);
    let exact = 2.0 * std::f64::consts::PI.powi(2) * 3.0;
    assert!((volume(&v) / exact - 1.0).abs() < 0.005, "{} of {exact}", volume(&v));
    let centre = v.placement.to_mm([0.0; 3]);
    assert_eq!(v.grid.at(v.grid.frame().voxel_at(centre)), AIR);
}

#[test]
fn cuboid_on_voxel_faces_is_exact() {
    let high = [40.0 * J750[0], 20.0 * J750[1], 60.0 * J750[2]];
    let v = run(&Shape::cuboid([0.0; 3], high), J750);
    assert_eq!(v.grid.size(), [42, 22, 62]);
    assert_eq!(solid(&v), 40 * 20 * 60);
    assert_eq!(v.report.thin_voxels, 0);
    for voxel in voxels(&v.grid) {
        let inside = (0..3).all(|a| voxel[a] > 0 && voxel[a] + 1 < v.grid.size()[a]);
        assert_eq!(v.grid.get(voxel) == 5, inside, "{voxel:?}");
    }
}

#[test]
fn cuboid_with_faces_through_centres_is_a_cuboid() {
    for pitch in [J750, [0.125; 3]] {
        let high = [40.5 * pitch[0], 20.5 * pitch[1], 60.5 * pitch[2]];
        let v = run(&Shape::cuboid([0.0; 3], high), pitch);
        let kept: Vec<[u32; 3]> = voxels(&v.grid).filter(|&p| v.grid.get(p) == 5).collect();
        let spans: Vec<u64> = (0..3)
            .map(|a| {
                let (low, high) = (kept.iter().map(|p| p[a]).min(), kept.iter().map(|p| p[a]).max());
                u64::from(high.unwrap() - low.unwrap() + 1)
            })
            .collect();
        assert_eq!(kept.len() as u64, spans.iter().product::<u64>());
        assert!(spans.iter().zip([40, 20, 60]).all(|(&s, n)| s == n || s == n + 1), "{spans:?}");
        assert_eq!(v.report.thin_voxels, 0);
    }
}

#[test]
fn thin_slabs_are_kept_along_every_axis_and_offset() {
    for axis in 0..3 {
        for thickness in [0.5, 0.05, 0.01, 1e-4] {
            for offset in [1.0, 1.0 + 0.3 * J750[axis], 1.0 + 0.77 * J750[axis]] {
                let (mut low, mut high) = ([0.0; 3], [2.0; 3]);
                (low[axis], high[axis]) = (offset, offset + thickness);
                // A cube far from the slab fixes where the slab lies between voxel centres.
                let anchor = Shape::cuboid([0.0; 3].map(|_| -1.5), [-1.0; 3]);
                let v = run(&Shape::cuboid(low, high).and(&anchor), J750);
                let frame = *v.grid.frame();
                let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
                let corner = |p: [f64; 3]| frame.voxel_at(v.placement.to_mm(p.map(|c| c * 1e-3)));
                let (from, to) = (corner(low), corner(high));
                for i in from[a] + 1..to[a] {
                    for j in from[b] + 1..to[b] {
                        let mut p = [0; 3];
                        (p[a], p[b]) = (i, j);
                        let thick = (from[axis] - 2..=to[axis] + 2)
                            .filter(|&t| {
                                p[axis] = t;
                                v.grid.at(p) == 5
                            })
                            .count() as f64;
                        let voxels = thickness / J750[axis];
                        assert!(thick >= voxels.floor().max(1.0) && thick <= voxels.ceil().max(1.0));
                    }
                }
                assert_eq!(
                    v.report.thin_voxels > 0,
                    thickness < J750[axis] && thin_at(offset, thickness, axis)
                );
            }
        }
    }
}

/// Whether no voxel centre lies within the slab, the grid starting at -1.5 mm.
fn thin_at(offset: f64, thickness: f64, axis: usize) -> bool {
    let [low, high] = [offset, offset + thickness].map(|c| ((c + 1.5) / J750[axis] - 0.5).ceil());
    low == high
}

#[test]
fn open_sheets_are_one_voxel_thick_and_reported_open() {
    for (u, v) in [
        ([4.0, 0.0, 0.0], [0.0, 4.0, 0.0]),
        ([0.0, 4.0, 0.0], [0.0, 0.0, 4.0]),
        ([4.0, 0.0, 0.0], [0.0, 0.0, 4.0]),
        ([4.0, 0.3, 1.1], [0.2, 4.0, 0.9]),
        ([3.0, 0.0, 3.0], [-1.0, 4.0, 1.0]),
    ] {
        let sheet = Shape::sheet([0.0; 3], u, v);
        let out = run(&sheet, J750);
        assert!(!out.report.closed && out.report.holes == 1 && out.report.boundary_edges == 4);
        // Along the axis it faces most, every line through its inner part meets the sheet once, or
        // twice where it steps from one layer to the next.
        let n = cross(u, v);
        let weight: Vec<f64> = (0..3).map(|a| (n[a] * J750[a]).abs()).collect();
        let axis = (0..3).fold(0, |best, a| if weight[a] > weight[best] { a } else { best });
        for i in 5..95 {
            for j in 5..95 {
                let p = add(scale(u, f64::from(i) / 100.0), scale(v, f64::from(j) / 100.0));
                let at = out.grid.frame().voxel_at(out.placement.to_mm(p.map(|c| c * 1e-3)));
                let count = (-3..=3)
                    .filter(|d| {
                        let mut q = at;
                        q[axis] += d;
                        out.grid.at(q) == 5
                    })
                    .count();
                assert!((1..=2).contains(&count), "{count} at {p:?} of {u:?} x {v:?}");
            }
        }
    }
}

#[test]
fn needles_and_grains_are_kept() {
    let pieces = Shape::cuboid([0.0; 3], [0.5; 3])
        .and(&Shape::cuboid([0.9, 0.91, 0.0], [0.902, 0.912, 2.0]))
        .and(&Shape::sphere([1.5, 1.52, 1.01], 0.002, 1));
    let v = run(&pieces, J750);
    for z in 1..20 {
        let at = v.placement.to_mm([0.901e-3, 0.911e-3, f64::from(z) * 1e-4]);
        let [x, y, z] = v.grid.frame().voxel_at(at);
        let near = (0..9).any(|k| v.grid.at([x + k % 3 - 1, y + k / 3 - 1, z]) == 5);
        assert!(near, "the needle has a gap at layer {z}");
    }
    assert_eq!(v.grid.at(v.grid.frame().voxel_at(v.placement.to_mm([1.5e-3, 1.52e-3, 1.01e-3]))), 5);
}

#[test]
fn thin_round_rods_have_no_gap_longer_than_a_voxel() {
    // Radii of 0.1 to 0.45 voxels, slowly drifting across the grid, with an anchor that fixes it.
    for radius in [0.1, 0.25, 0.45] {
        let pitch = [0.05; 3];
        let (n, r) = (24u32, radius * 0.05);
        let positions: Vec<Vec3> = (0..2 * n)
            .map(|k| {
                let a = f64::from(k % n) / f64::from(n) * std::f64::consts::TAU;
                let z = 4.0 * f64::from(k / n);
                [1.0 + 0.05 * z + r * a.cos(), 1.0 + 0.08 * z + r * a.sin(), z]
            })
            .collect();
        let side = (0..n).flat_map(|i| {
            let (j, up) = ((i + 1) % n, n);
            [[i, j, j + up], [i, j + up, i + up]]
        });
        let ends = (1..n - 1).flat_map(|i| [[0, i + 1, i], [n, n + i, n + i + 1]]);
        let rod = Shape { positions, triangles: side.chain(ends).collect() };
        let v = run(&rod.and(&Shape::cuboid([0.0; 3], [0.5; 3])), pitch);
        assert!(v.report.closed);
        let mut empty = 0;
        for layer in 1..79 {
            let z = (f64::from(layer) + 0.5) * 0.05;
            let [x, y, k] = v.grid.frame().voxel_at([1.0 + 0.05 * z, 1.0 + 0.08 * z, z]);
            let any = (0..25).any(|i| v.grid.at([x + i % 5 - 2, y + i / 5 - 2, k]) == 5);
            empty = if any { 0 } else { empty + 1 };
            assert!(empty <= 1, "radius {radius}: gap at {z} mm");
        }
    }
}

#[test]
fn sharp_edges_of_a_thick_body_get_no_voxels() {
    // A square prism turned so that every long edge cuts lines of two axes short.
    let (c, s) = (0.6f64.cos(), 0.6f64.sin());
    let prism = Shape::cuboid([0.0; 3], [2.0; 3]).moved(|[x, y, z]| [c * x - s * y, s * x + c * y, z]);
    assert_eq!(run(&prism, [0.05; 3]).report.thin_voxels, 0);
}

#[test]
fn a_hemisphere_without_base_is_closed_flat() {
    let half = Shape::sphere([0.0; 3], 3.0, 6).keeping(|_, t| t.iter().all(|p| p[2] >= -1e-9));
    let v = run(&half, J750);
    assert!(!v.report.closed && v.report.holes == 1);
    let exact = 2.0 / 3.0 * std::f64::consts::PI * 27.0;
    assert!((volume(&v) / exact - 1.0).abs() < 0.01, "{} of {exact}", volume(&v));
}

#[test]
fn the_mesh_decides_at_a_hole_not_the_cap() {
    // A sphere with its top sixth cut off: the winding number bulges into the opening.
    let cut = 2.0;
    let bowl = Shape::sphere([0.0; 3], 3.0, 5).keeping(|_, t| t.iter().all(|p| p[2] < cut));
    let v = run(&bowl, [0.1; 3]);
    let corners = bowl.corners();
    let origin = lowest(&bowl);
    for voxel in voxels(&v.grid) {
        if voxel[0] % 3 + voxel[1] % 3 + voxel[2] % 2 > 0 {
            continue;
        }
        let p = add(v.grid.frame().centre_mm(voxel.map(i64::from)), origin);
        let w: f64 = corners.iter().map(|t| triangle_winding(p, *t)).sum();
        if (w.abs() - 0.5).abs() > 0.01 {
            assert_eq!(v.grid.get(voxel) == 5, w.abs() > 0.5, "{p:?} winds {w}");
        }
    }
}

#[test]
fn missing_triangles_change_few_voxels() {
    let sphere = Shape::sphere([0.0; 3], 3.0, 4);
    let whole = run(&sphere, J750);
    // One triangle in 23 is missing, but none at the sides, so that both have the same frame.
    let holed = sphere.keeping(|i, t| i % 23 > 0 || t.iter().any(|p| p.iter().any(|c| c.abs() > 2.8)));
    let v = run(&holed, J750);
    assert!(v.report.holes > 100, "{}", v.report.holes);
    let changed = difference(&whole.grid, &v.grid);
    assert!((changed as f64) < 0.002 * solid(&whole) as f64, "{changed} of {}", solid(&whole));
}

#[test]
fn an_inverted_mesh_is_the_same_solid() {
    let vase = Shape::sphere([0.0; 3], 2.0, 4).and(&Shape::sphere([0.0; 3], 1.5, 4).inverted());
    let (a, b) = (run(&vase, J750), run(&vase.clone().inverted(), J750));
    assert_eq!(a.grid, b.grid);
    assert_eq!((a.report.flipped_shells, a.report.cavities), (0, 1));
    assert_eq!((b.report.flipped_shells, b.report.cavities), (2, 1));
    let exact = 4.0 / 3.0 * std::f64::consts::PI * (8.0 - 1.5f64.powi(3));
    assert!((volume(&a) / exact - 1.0).abs() < 0.01);
}

#[test]
fn an_island_in_a_cavity_is_solid_whichever_way_it_faces() {
    let ball = |r: f64| Shape::sphere([0.0; 3], r, 4);
    let hollow = ball(2.0).and(&ball(1.5).inverted());
    let a = run(&hollow.clone().and(&ball(0.7)), J750);
    let b = run(&hollow.and(&ball(0.7).inverted()), J750);
    assert_eq!(a.grid, b.grid);
    assert_eq!(a.grid.at(a.grid.frame().voxel_at([2.0; 3])), 5);
    assert_eq!(b.report.flipped_shells, 1);
}

#[test]
fn overlapping_shells_unite_whichever_way_they_face() {
    let first = Shape::cuboid([0.0; 3], [2.0; 3]);
    let second = Shape::cuboid([1.0; 3], [3.0; 3]);
    let a = run(&first.clone().and(&second), J750);
    let b = run(&first.and(&second.inverted()), J750);
    assert!((volume(&a) / 15.0 - 1.0).abs() < 0.03, "{}", volume(&a));
    assert_eq!(a.grid, b.grid);
    assert_eq!(b.report.flipped_shells, 1);
}

#[test]
fn a_self_intersecting_shell_is_solid_in_both_lobes() {
    // A cuboid whose top is turned half a turn about z: its sides cross in the middle.
    let twisted =
        Shape::cuboid([-1.0; 3], [1.0; 3]).moved(|[x, y, z]| if z > 0.0 { [-x, -y, z] } else { [x, y, z] });
    let v = run(&twisted, J750);
    for z in [-0.8, 0.8] {
        let at = v.grid.frame().voxel_at([1.0, 1.0, 1.0 + z]);
        assert_eq!(v.grid.at(at), 5, "{z}");
    }
}

#[test]
fn single_reversed_triangles_are_put_right() {
    let sphere = Shape::sphere([0.0; 3], 2.0, 4);
    let mut broken = sphere.clone();
    broken.triangles.iter_mut().step_by(17).for_each(|t| t.swap(1, 2));
    let (a, b) = (run(&sphere, J750), run(&broken, J750));
    assert_eq!(a.grid, b.grid);
    assert_eq!(b.report.reversed_triangles, sphere.triangles.len().div_ceil(17) as u64);
    assert!(b.report.closed && b.report.inconsistent_edges > 0);
}

#[test]
fn a_mesh_doubled_with_reversed_copies_is_solid() {
    let sphere = Shape::sphere([0.0; 3], 2.0, 3);
    let doubled = sphere.clone().and(&sphere.clone().inverted());
    let v = run(&doubled, J750);
    assert_eq!(v.grid, run(&sphere, J750).grid);
    assert_eq!(v.report.duplicate_triangles, sphere.triangles.len() as u64);
}

#[test]
fn refuses_what_has_no_size() {
    let model = Shape::sheet([0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]).model();
    let with = |scale, label, margin| {
        voxelise(&model, &VoxeliseOptions { scale, label, margin, ..Default::default() }, &Control::none())
    };
    assert!(with(Scale::Native, 5, 1).is_ok());
    for height in [20.0, 0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(with(Scale::HeightMm(height), 5, 1), Err(MeshError::Invalid { .. })), "{height}");
    }
    assert!(matches!(with(Scale::Native, 0, 1), Err(MeshError::Invalid { .. })));
    assert!(matches!(with(Scale::Native, 5, 0), Err(MeshError::Invalid { .. })));

    let point = Shape { positions: vec![[1.0; 3]; 3], triangles: vec![[0, 1, 2]] }.model();
    let options = VoxeliseOptions::default();
    assert!(matches!(voxelise(&point, &options, &Control::none()), Err(MeshError::Invalid { .. })));
    let huge = Shape::cuboid([0.0; 3], [1e6; 3]).model();
    assert!(matches!(voxelise(&huge, &options, &Control::none()), Err(MeshError::Unsupported { .. })));
}

#[test]
fn cancelling_stops() {
    let stop = std::sync::atomic::AtomicBool::new(true);
    let control = Control::none().with_cancel(&stop);
    let model = Shape::cuboid([0.0; 3], [1.0; 3]).model();
    let result = voxelise(&model, &VoxeliseOptions::default(), &control);
    assert!(matches!(result, Err(MeshError::Cancelled)));
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let holed = Shape::torus(2.0, 0.8, 40, 20).keeping(|i, _| i % 9 > 0);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| run(&holed, J750))
    };
    let (one, three) = (with(1), with(3));
    assert_eq!(one.grid, three.grid);
    assert_eq!(one.report, three.report);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    // Whatever is cut from a bumpy shape or turned, a voxel is solid where the exact winding number
    // of the oriented triangles says so, but for the stated error of the hierarchy around one half.
    #[test]
    fn voxels_agree_with_the_exact_winding_number(
        keep in prop::collection::vec(prop::bool::weighted(0.9), 60),
        stretch in prop::array::uniform3(0.5..1.5f64),
        tilt in -0.5..0.5f64,
        all in any::<bool>(),
    ) {
        let shape = Shape::torus(1.0, 0.45, 14, 9)
            .keeping(|i, _| all || keep[i % keep.len()])
            .moved(|[x, y, z]| [stretch[0] * x + tilt * z, stretch[1] * y, stretch[2] * z - tilt * x]);
        let pitch = [0.07, 0.1, 0.05];
        let v = run(&shape, pitch);
        let origin = lowest(&shape);
        // Loose pieces that face inwards are turned round, which changes what winds about what.
        let topology = crate::topology::Topology::build(&shape.positions, &shape.triangles, 1e-9);
        let at = |v: u32| topology.vertices[v as usize];
        let corners: Vec<_> = topology.triangles.iter().map(|t| t.map(at)).collect();
        let thick = v.report.thin_voxels == 0;
        for voxel in voxels(&v.grid).step_by(7) {
            let p = add(v.grid.frame().centre_mm(voxel.map(i64::from)), origin);
            let w: f64 = corners.iter().map(|t| triangle_winding(p, *t)).sum();
            let is_solid = v.grid.get(voxel) == 5;
            let near_surface = corners.iter().any(|t| crate::geometry::nearest_on_triangle(p, *t).1 < 1e-18);
            if (w.abs() - 0.5).abs() > 0.005 && !near_surface && (thick || !is_solid) {
                prop_assert_eq!(is_solid, w.abs() > 0.5, "{:?} winds {}", p, w);
            }
        }
    }
}

#[test]
fn shapes_are_what_they_claim() {
    let sphere = Shape::sphere([0.0; 3], 1.0, 2);
    assert_eq!(sphere.triangles.len(), 20 * 16);
    let v: f64 = sphere.corners().iter().map(|[a, b, c]| crate::geometry::dot(*a, cross(*b, *c)) / 6.0).sum();
    assert!((3.9..4.19).contains(&v), "{v}");
    let [a, b, c] = Shape::cuboid([0.0; 3], [1.0; 3]).corners()[0];
    assert!(cross(sub(b, a), sub(c, a))[2] < 0.0, "the first face is the bottom and faces down");
}
