//! Bodies that touch, doubled surfaces, partitions, nesting.

use super::tests::{J750, run, solid, volume};
use super::*;
use crate::geometry::add;
use crate::shapes::Shape;

/// Turned so that no face lies along an axis.
fn turned([x, y, z]: Vec3) -> Vec3 {
    let (c, s) = (0.4f64.cos(), 0.4f64.sin());
    let [x, y, z] = [c * x - s * y, s * x + c * y, z];
    let (c, s) = (1.1f64.cos(), 1.1f64.sin());
    [x, c * y - s * z, s * y + c * z]
}

/// Undoes [`turned`].
fn unturned([x, y, z]: Vec3) -> Vec3 {
    let (c, s) = (1.1f64.cos(), 1.1f64.sin());
    let [x, y, z] = [x, c * y + s * z, c * z - s * y];
    let (c, s) = (0.4f64.cos(), 0.4f64.sin());
    [c * x + s * y, c * y - s * x, z]
}

/// Rounded to what a file holds.
fn stored(shape: Shape) -> Shape {
    shape.moved(|p| p.map(|c| f64::from(c as f32)))
}

/// A cuboid whose faces are split along the other diagonal.
fn other_diagonal(low: Vec3, high: Vec3) -> Shape {
    let mut cuboid = Shape::cuboid(low, high);
    for [first, second] in cuboid.triangles.as_chunks_mut::<2>().0 {
        // (a, b, c) and (a, c, d) become (b, c, d) and (b, d, a).
        let ([a, b, c], d) = (*first, second[2]);
        (*first, *second) = ([b, c, d], [b, d, a]);
    }
    cuboid
}

/// Every triangle split in three at its centroid.
fn finer(mut shape: Shape) -> Shape {
    let corners = shape.corners();
    let old = std::mem::take(&mut shape.triangles);
    for (t, c) in old.into_iter().zip(corners) {
        shape.positions.push(crate::geometry::centroid(c));
        let m = shape.positions.len() as u32 - 1;
        shape.triangles.extend([[t[0], t[1], m], [t[1], t[2], m], [t[2], t[0], m]]);
    }
    shape
}

fn joined(parts: impl IntoIterator<Item = Shape>) -> Shape {
    parts.into_iter().fold(Shape::default(), |all, part| all.and(&part))
}

#[test]
fn boxes_that_share_walls_are_one_solid_without_air() {
    let cells: [&[[i32; 3]]; 5] = [
        &[[0, 0, 0], [1, 0, 0], [2, 0, 0]],
        &[[2, 0, 0], [0, 0, 0], [1, 0, 0], [4, 0, 0], [3, 0, 0]],
        &[[0, 0, 0], [0, 0, 1], [0, 1, 0], [0, 1, 1]],
        &[[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0], [0, 0, 1], [0, 1, 1], [1, 1, 1], [1, 0, 1]],
        &[[0, 0, 0], [1, 1, 0], [2, 2, 1]],
    ];
    // Cells that touch as a row, in any order, as a wall, as a block, and in an edge or corner only.
    for (cells, turn) in cells.into_iter().flat_map(|c| [(c, false), (c, true)]) {
        let shape = joined(cells.iter().map(|c| {
            let low = c.map(|c| f64::from(c) + 7.0);
            Shape::cuboid(low, low.map(|c| c + 1.0))
        }));
        let shape = if turn { stored(shape.moved(turned)) } else { shape };
        let v = run(&shape, [0.06, 0.05, 0.04]);
        let report = &v.report;
        assert!(report.closed && report.holes == 0 && report.cavities == 0, "{cells:?}: {report:?}");
        assert_eq!((report.shells, report.duplicate_triangles), (cells.len() as u64, 0), "{cells:?}");
        assert!((report.volume_mm3 - cells.len() as f64).abs() < 1e-5);
        let origin = super::tests::lowest(&shape);
        for voxel in super::tests::voxels(&v.grid) {
            let p = add(v.grid.frame().centre_mm(voxel.map(i64::from)), origin);
            let p = if turn { unturned(p) } else { p };
            // How far within a cell, or from all.
            let depth = |c: &[i32; 3]| {
                (0..3).map(|a| 0.5 - (p[a] - 7.5 - f64::from(c[a])).abs()).fold(f64::INFINITY, f64::min)
            };
            let depth = cells.iter().map(depth).fold(f64::NEG_INFINITY, f64::max);
            // On the walls between cells depth is 0, and the voxel solid.
            if depth.abs() > 1e-5 {
                assert_eq!(v.grid.get(voxel) == 5, depth > 0.0, "{cells:?}, turned {turn}: {p:?}");
            }
        }
    }
}

#[test]
fn a_rod_of_capped_segments_is_as_thick_everywhere() {
    // Segments along z with their caps, each its own mesh; the caps are fans of 12 triangles.
    let segment = |z: f64| {
        let n = 12u32;
        let ring = |k: u32, z: f64| {
            let a = f64::from(k) / f64::from(n) * std::f64::consts::TAU;
            [0.5 * a.cos(), 0.5 * a.sin(), z]
        };
        let mut positions: Vec<Vec3> = (0..2 * n).map(|k| ring(k % n, z + f64::from(k / n))).collect();
        positions.extend([[0.0, 0.0, z], [0.0, 0.0, z + 1.0]]);
        let triangles = (0..n).flat_map(|i| {
            let (j, up) = ((i + 1) % n, n);
            [[i, j, j + up], [i, j + up, i + up], [2 * n, j, i], [2 * n + 1, i + up, j + up]]
        });
        Shape { positions, triangles: triangles.collect() }
    };
    for turn in [false, true] {
        let rod = joined((0..4).map(|k| segment(f64::from(k))));
        let rod = if turn { stored(rod.moved(|[x, y, z]| [z, x, y])) } else { rod };
        let v = run(&rod, [0.05, 0.05, 0.04]);
        assert!(v.report.closed && v.report.shells == 4, "{:?}", v.report);
        let axis = if turn { 0 } else { 2 };
        let mut layers = vec![0u64; v.grid.size()[axis] as usize];
        super::tests::voxels(&v.grid).for_each(|p| layers[p[axis] as usize] += u64::from(v.grid.get(p) == 5));
        let inner = &layers[2..layers.len() - 2];
        assert!(inner.iter().all(|&n| n == inner[0] && n > 200), "{inner:?}");
    }
}

#[test]
fn one_wall_that_two_cells_share_is_a_partition() {
    for (cells, inwards) in [(2, false), (2, true), (3, false), (3, true), (5, false)] {
        // A bar of cells with single walls between them, every other one facing back if asked.
        let mut shape = Shape::default();
        for k in 0..cells {
            let x = f64::from(k);
            let cell = Shape::cuboid([x, 0.0, 0.0], [x + 1.0, 1.0, 1.0]);
            // The wall towards the next cell stays, the one towards the last goes.
            let mut cell = cell.keeping(|_, t| k == 0 || t.iter().any(|p| p[0] > x));
            if inwards && k % 2 == 0 && k + 1 < cells {
                let corners = cell.corners();
                for (t, c) in cell.triangles.iter_mut().zip(corners) {
                    if c.iter().all(|p| p[0] > x) {
                        t.swap(1, 2);
                    }
                }
            }
            shape = shape.and(&cell);
        }
        let v = run(&shape, [0.05, 0.05, 0.04]);
        let bar = run(&Shape::cuboid([0.0; 3], [f64::from(cells), 1.0, 1.0]), [0.05, 0.05, 0.04]);
        assert_eq!(v.grid, bar.grid, "{cells} {inwards}");
        assert!(v.report.closed && v.report.shells == 1, "{cells} {inwards}: {:?}", v.report);
    }
}

#[test]
fn a_bump_over_a_face_is_solid_with_it() {
    // A cube and a pyramid without base over a part of its top that is split to fit.
    let cube = Shape::cuboid([0.0; 3], [2.0; 3]).keeping(|_, t| t.iter().any(|p| p[2] < 2.0));
    let ring = |low: f64, high: f64| [[low, low, 2.0], [high, low, 2.0], [high, high, 2.0], [low, high, 2.0]];
    let mut top = Shape { positions: [ring(0.0, 2.0), ring(0.5, 1.5)].concat(), triangles: vec![] };
    for i in 0..4 {
        let j = (i + 1) % 4;
        top.triangles.extend([[i, j, j + 4], [i, j + 4, i + 4]]);
    }
    let disc = Shape { triangles: vec![[4, 5, 6], [4, 6, 7]], ..top.clone() };
    let mut bump = top.clone();
    bump.positions.push([1.0, 1.0, 3.0]);
    bump.triangles = (0..4).map(|i| [4 + i, 4 + (i + 1) % 4, 8]).collect();
    for bump in [bump.clone(), bump.inverted()] {
        let v = run(&joined([cube.clone(), top.clone(), disc.clone(), bump]), [0.05; 3]);
        assert!((volume(&v) / (8.0 + 1.0 / 3.0) - 1.0).abs() < 0.01, "{}", volume(&v));
    }
}

#[test]
fn doubled_surfaces_are_solid_however_their_backs_are_split() {
    let (low, high) = ([1.0, 2.0, 3.0], [3.0, 3.5, 5.0]);
    let front = Shape::cuboid(low, high);
    let expected = run(&front, J750);
    let backs = [
        front.clone().inverted(),
        other_diagonal(low, high).inverted(),
        finer(front.clone()).inverted(),
        finer(other_diagonal(low, high)).inverted(),
        // Five faces, one face, and half a face.
        other_diagonal(low, high).keeping(|i, _| i > 1).inverted(),
        other_diagonal(low, high).keeping(|i, _| i < 2).inverted(),
        front.clone().keeping(|i, _| i == 3).inverted(),
    ];
    for (k, back) in backs.into_iter().enumerate() {
        for shape in [front.clone().and(&back), back.clone().and(&front)] {
            let v = run(&shape, J750);
            assert_eq!(v.grid, expected.grid, "back {k}");
            assert!(v.report.closed && v.report.shells == 1, "back {k}: {:?}", v.report);
            assert_eq!(v.report.duplicate_triangles, back.triangles.len() as u64, "back {k}");
            let both = run(&stored(shape.moved(turned)), J750);
            let one = run(&stored(front.clone().moved(turned)), J750);
            assert!(solid(&both).abs_diff(solid(&one)) <= 4, "back {k}: {} {}", solid(&both), solid(&one));
        }
    }
}

#[test]
fn a_doubled_ball_whose_backs_bulge_otherwise_is_solid() {
    // Faces of a ring of quads that are not flat, split along either diagonal.
    let ball = |other: bool| {
        let (n, m) = (16u32, 9u32);
        let at = |i: u32, j: u32| {
            let (u, v) = (f64::from(i % n) / f64::from(n), f64::from(j) / f64::from(m));
            let (u, v) = ((u + 0.4 * v) * std::f64::consts::TAU, v * std::f64::consts::PI);
            [u.cos() * v.sin(), u.sin() * v.sin(), v.cos()]
        };
        let mut shape = Shape::default();
        for (i, j) in (0..n).flat_map(|i| (0..m).map(move |j| (i, j))) {
            let base = shape.positions.len() as u32;
            shape.positions.extend([at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)]);
            let quad = if other { [[0, 1, 3], [1, 2, 3]] } else { [[0, 1, 2], [0, 2, 3]] };
            shape.triangles.extend(quad.map(|t| t.map(|v: u32| v + base)));
        }
        shape
    };
    for front in [false, true] {
        let alone = run(&ball(front), J750);
        assert!(alone.report.closed, "{:?}", alone.report);
        for shape in [ball(front).and(&ball(!front).inverted()), ball(!front).inverted().and(&ball(front))] {
            let v = run(&shape, J750);
            assert!(v.report.closed && v.report.shells == 1, "{:?}", v.report);
            let differing = super::tests::difference(&v.grid, &alone.grid);
            assert_eq!(differing, 0, "front {front}: {:?} {:?}", v.report, alone.report);
        }
    }
}

#[test]
fn a_doubled_mesh_with_holes_is_as_solid_as_the_single_one() {
    let holed = Shape::sphere([0.0; 3], 2.0, 3).keeping(|i, _| i % 40 > 0);
    let expected = run(&holed, J750);
    for shape in [holed.clone().and(&holed.clone().inverted()), holed.clone().inverted().and(&holed)] {
        let v = run(&shape, J750);
        assert_eq!(v.grid, expected.grid);
        assert_eq!(v.report.holes, expected.report.holes);
    }
}

#[test]
fn a_doubled_hollow_keeps_its_cavity() {
    let hollow = Shape::sphere([0.0; 3], 2.0, 3).and(&Shape::sphere([0.0; 3], 1.4, 3).inverted());
    let expected = run(&hollow, J750);
    assert_eq!(expected.report.cavities, 1);
    for shape in [hollow.clone().and(&hollow.clone().inverted()), hollow.clone().inverted().and(&hollow)] {
        let v = run(&shape, J750);
        assert_eq!(v.grid, expected.grid);
        assert_eq!((v.report.cavities, v.report.shells), (1, 2));
    }
}

#[test]
fn nested_bodies_are_one_and_inner_shells_that_face_back_are_cavities() {
    let cube = |low: f64, high: f64| Shape::cuboid([low; 3], [high; 3]);
    let outer = run(&cube(0.0, 3.0), [0.06; 3]);
    // At any gap, in either order, and touching from within.
    for low in [0.06, 0.3, 1.2] {
        let inner = cube(low, 3.0 - low);
        assert_eq!(run(&cube(0.0, 3.0).and(&inner), [0.06; 3]).grid, outer.grid, "{low}");
        assert_eq!(run(&inner.clone().and(&cube(0.0, 3.0)), [0.06; 3]).grid, outer.grid, "{low}");
        let hollow = run(&inner.inverted().and(&cube(0.0, 3.0)), [0.06; 3]);
        assert_eq!(hollow.report.cavities, 1, "{low}");
        assert!(solid(&hollow) < solid(&outer));
    }
    assert_eq!(run(&cube(0.0, 3.0).and(&cube(0.0, 1.5)), [0.06; 3]).grid, outer.grid);
    assert_eq!(run(&cube(0.0, 3.0).and(&cube(0.0, 3.0)), [0.06; 3]).grid, outer.grid);
}

#[test]
fn rows_of_doubled_boxes_are_solid() {
    let cell = |k: i32| {
        let x = f64::from(k);
        ([x, 0.0, 0.0], [x + 1.0, 1.0, 1.0])
    };
    let front = |k: i32| Shape::cuboid(cell(k).0, cell(k).1);
    let other = |k: i32| other_diagonal(cell(k).0, cell(k).1);
    let bar = run(&Shape::cuboid([0.0; 3], [3.0, 1.0, 1.0]), J750);
    let rows: [(&str, Vec<Shape>); 5] = [
        ("each with its back", (0..3).flat_map(|k| [front(k), front(k).inverted()]).collect()),
        ("each with its back first", (0..3).flat_map(|k| [other(k).inverted(), front(k)]).collect()),
        ("fronts, then backs", (0..3).map(front).chain((0..3).map(|k| other(k).inverted())).collect()),
        ("backs, then fronts", (0..3).map(|k| front(k).inverted()).chain((0..3).map(front)).collect()),
        ("other diagonals next to each other", vec![front(0), other(1), front(2)]),
    ];
    for (name, parts) in rows {
        let v = run(&joined(parts), J750);
        assert_eq!(super::tests::difference(&v.grid, &bar.grid), 0, "{name}: {:?}", v.report);
        assert!(v.report.closed && v.report.shells == 3, "{name}: {:?}", v.report);
    }
}
