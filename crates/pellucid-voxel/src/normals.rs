//! Outward normals from the solid voxels about a surface voxel.
//!
//! The estimate is the gradient of the smoothed solid, turned outward: minus the first moment
//! of the solid voxels within a ball in millimetres, weighted by a smooth function of distance.
//! Three things are added.
//!
//! - A staircase whose steps are longer than the ball cannot be told from a level plane. The
//!   moment in a ball of twice the radius is taken instead where it differs by no more than that
//!   uncertainty, about the voxel edge along the normal over the radius. So level and gently
//!   curved parts are smoothed more, and edges are not.
//! - Where the moment is weak the solid may be a thin sheet. If the solid voxels of either ball
//!   are spread far less along one direction than along the others, that direction is the
//!   normal's axis.
//! - An estimate must not point into the solid: its product with the sum of the directions to
//!   the voxel's open faces must be positive. Else the ball's radius is halved, which leaves
//!   other parts nearby, such as the far side of a narrow gap, out of it.
//!
//! When no ball serves, the sum of the open faces' directions is taken; when that is zero too
//! (a lone voxel), the first open face in the order +z, -z, +x, -x, +y, -y. A sheet one voxel
//! thick has no outer side: its normal's sign is arbitrary but the same on every run.
//!
//! At the J750's pitch and the default radius the tests' tilted planes are met to 0.8 degrees
//! root mean square (7 at most), a 6 mm sphere to 0.4, tilted sheets of 0.12, 0.2, 0.3 and 0.5 mm
//! to 1.0, 1.3, 2.0 and 0.6. Planes close to the coarse y axis are the hardest.

use crate::eigen::symmetric_eigen;
use crate::normal_window::{Block, MAX_REACH, Moments, Window};
use crate::{LabelGrid, TILE, VoxelError};

/// Least radius in edges of the coarsest axis.
const LEAST_EDGES: f64 = 1.75;
/// Least moment taken, as a part of that of a half-space.
const LEAST_MOMENT: f64 = 0.05;
/// Moment below which the solid may be a thin sheet, as a part of that of a half-space.
const SHEET_MOMENT: f64 = 0.85;
/// Least cosine between the moment and a sheet's normal from the wide ball.
const ALIKE: f64 = 0.7;
/// Greatest variance across a sheet as a part of the next greater one.
const SHEET_VARIANCE: f64 = 0.15;
/// Angle in voxel edges along the normal over the radius that a ball leaves uncertain.
const UNCERTAINTY: f64 = 0.75;

/// Directions to the six face neighbours in the order of preference.
const FACES: [[i32; 3]; 6] = [[0, 0, 1], [0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]];

/// Estimates normals tile by tile.
pub(crate) struct NormalEstimator<'a> {
    grid: &'a LabelGrid,
    pitch: [f64; 3],
    radius: f64,
    /// The ball asked for, then ever smaller ones.
    windows: Vec<Window>,
    wide: Window,
    reach: [usize; 3],
}

impl<'a> NormalEstimator<'a> {
    pub(crate) fn new(grid: &'a LabelGrid, radius_mm: f64) -> Result<Self, VoxelError> {
        if !(radius_mm.is_finite() && radius_mm > 0.0) {
            return Err(VoxelError::invalid(
                "normal_radius_mm",
                format!("{radius_mm}; it must be finite and above 0, such as 0.25"),
            ));
        }
        let edges = grid.frame().pitch();
        let pitch = edges.mm();
        let most = MAX_REACH as f64 * edges.min_mm();
        let radius = radius_mm.max(LEAST_EDGES * edges.max_mm()).min(most);
        let halves = std::iter::successors(Some(radius), |r| Some(r / 2.0));
        let windows: Vec<_> =
            halves.take_while(|&r| r > edges.min_mm()).map(|r| Window::new(r, pitch)).collect();
        let wide = Window::new((2.0 * radius).min(most), pitch);
        let reach = wide.reach.map(|r| r.max(1));
        Ok(Self { grid, pitch, radius, windows, wide, reach })
    }

    /// Normals of a tile's surface voxels, in the order of `points`.
    pub(crate) fn tile(&self, t: [u32; 3], points: &[(u32, [u32; 3])]) -> Vec<[f32; 3]> {
        let block = Block::new(self.grid, t, self.reach);
        let local = |voxel: [u32; 3]| voxel.map(|v| v as usize % TILE);
        points.iter().map(|(_, voxel)| self.normal(&block, local(*voxel)).map(|c| c as f32)).collect()
    }

    fn normal(&self, block: &Block, local: [usize; 3]) -> [f64; 3] {
        let faces: Vec<[i32; 3]> = FACES
            .into_iter()
            .filter(|d| !block.solid(std::array::from_fn(|a| local[a] as i32 + d[a])))
            .collect();
        let open: [f64; 3] = std::array::from_fn(|a| faces.iter().map(|d| f64::from(d[a])).sum());
        let both_sides = open == [0.0; 3];
        let outward = |n: [f64; 3]| both_sides || dot(n, open) > 0.0;
        for (i, window) in self.windows.iter().enumerate() {
            let moment = self.outward_mm(window.first(block, local));
            let length = dot(moment, moment).sqrt();
            if i == 0 && length < SHEET_MOMENT * window.half_space {
                let sheet = |window: &Window| self.sheet_normal(&window.moments(block, local), moment, open);
                let alike = |n: &[f64; 3]| dot(*n, moment) > ALIKE * length;
                if let Some(n) = sheet(window).or_else(|| sheet(&self.wide).filter(alike)) {
                    return n;
                }
            }
            if length >= LEAST_MOMENT * window.half_space && outward(moment) {
                let n = moment.map(|c| c / length);
                return if i == 0 {
                    self.smoother(block, local, n).filter(|&n| outward(n)).unwrap_or(n)
                } else {
                    n
                };
            }
        }
        unit(open).unwrap_or_else(|| faces.first().copied().unwrap_or(FACES[0]).map(f64::from))
    }

    /// Minus the first moment in mm times weight.
    fn outward_mm(&self, first: [i64; 3]) -> [f64; 3] {
        std::array::from_fn(|a| -(first[a] as f64) * self.pitch[a])
    }

    /// The wide ball's normal where it agrees with `normal` within the latter's uncertainty.
    fn smoother(&self, block: &Block, local: [usize; 3], normal: [f64; 3]) -> Option<[f64; 3]> {
        let wide = unit(self.outward_mm(self.wide.first(block, local)))?;
        let edge = (0..3).map(|a| normal[a].abs() * self.pitch[a]).fold(0.0, f64::max);
        let angle = dot(wide, normal).clamp(-1.0, 1.0).acos();
        (angle <= UNCERTAINTY * edge / self.radius).then_some(wide)
    }

    /// The axis of least variance when the solid voxels form a thin sheet, on the side of the
    /// open faces, else of `moment`.
    fn sheet_normal(&self, m: &Moments, moment: [f64; 3], open: [f64; 3]) -> Option<[f64; 3]> {
        let weight = m.weight as f64;
        let covariance = |i: usize, a: usize, b: usize| {
            let product = m.first[a] as f64 * m.first[b] as f64 / weight;
            (m.second[i] as f64 - product) * self.pitch[a] * self.pitch[b]
        };
        let (variance, axes) = symmetric_eigen([
            covariance(0, 0, 0),
            covariance(1, 1, 1),
            covariance(2, 2, 2),
            covariance(3, 0, 1),
            covariance(4, 0, 2),
            covariance(5, 1, 2),
        ]);
        // A row of voxels has no axis across it.
        if variance[1] <= 1e-9 * variance[2] || variance[0] > SHEET_VARIANCE * variance[1] {
            return None;
        }
        let axis = axes[0];
        let least = 0.3 * dot(open, open).sqrt();
        let side = [dot(axis, open), dot(axis, moment), axis[2], axis[0], axis[1]];
        let enough = [least, 1e-9 * weight * self.radius, 1e-9, 1e-9, 0.0];
        // At a sheet's rim every open face may lie across the axis.
        if open != [0.0; 3] && side[0].abs() <= least {
            return None;
        }
        let sign =
            side.iter().zip(enough).find(|(s, enough)| s.abs() > *enough).map_or(1.0, |(s, _)| s.signum());
        unit(axis.map(|c| c * sign))
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    let length = dot(v, v).sqrt();
    (length > 0.0).then(|| v.map(|c| c / length))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Control, Frame, Pitch, Surface, SurfaceOptions, Tile};

    /// A grid about the origin, `half` mm to each side, solid where `solid` says so.
    fn carve(pitch: Pitch, half: f64, solid: impl Fn([f64; 3]) -> bool + Sync) -> LabelGrid {
        let size = pitch.mm().map(|p| (2.0 * half / p).ceil() as u32);
        let frame = Frame::new([-half; 3], pitch, size).unwrap();
        LabelGrid::from_fn(frame, |v| u8::from(solid(frame.centre_mm(v.map(i64::from)))))
    }

    fn surface(grid: &LabelGrid) -> Surface {
        Surface::extract(grid, &SurfaceOptions::default(), &Control::none()).unwrap()
    }

    /// Angles in degrees between the normals and what `expected` gives for positions in mm.
    fn angles(surface: &Surface, expected: impl Fn([f64; 3]) -> Option<[f64; 3]>) -> Vec<f64> {
        (0..surface.len())
            .filter_map(|i| {
                let n = surface.normals()[i].map(f64::from);
                expected(surface.position_mm(i as u32))
                    .map(|e| dot(n, e).clamp(-1.0, 1.0).acos().to_degrees())
            })
            .collect()
    }

    fn rms(values: &[f64]) -> f64 {
        assert!(values.len() > 50, "{} values say little", values.len());
        (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
    }

    /// Directions spread evenly over the sphere.
    fn directions(count: usize) -> impl Iterator<Item = [f64; 3]> {
        (0..count).map(move |i| {
            let z = 1.0 - (2 * i + 1) as f64 / count as f64;
            let (s, c) = (i as f64 * 2.399_963_229_728_653).sin_cos();
            let r = (1.0 - z * z).sqrt();
            [r * c, r * s, z]
        })
    }

    fn within(p: [f64; 3], radius: f64) -> bool {
        dot(p, p) < radius * radius
    }

    #[test]
    fn tilted_planes_at_printer_pitch() {
        let mut all = Vec::new();
        for (i, n) in directions(40).enumerate() {
            let offset = 0.001 * (i * 37 % 83) as f64;
            let grid = carve(Pitch::j750(), 1.0, |p| dot(p, n) <= offset);
            let found = angles(&surface(&grid), |p| within(p, 0.45).then_some(n));
            assert!(found.iter().all(|&a| a < 14.0), "{n:?} {:?}", found.iter().copied().fold(0.0, f64::max));
            all.extend(found);
        }
        assert!(rms(&all) < 1.3, "{}", rms(&all));
    }

    #[test]
    fn spheres_and_cavities_at_printer_pitch() {
        for sign in [1.0, -1.0] {
            let grid = carve(Pitch::j750(), 3.6, |p| (dot(p, p) <= 9.0) == (sign > 0.0));
            let found =
                angles(&surface(&grid), |p| within(p, 3.3).then(|| unit(p).unwrap().map(|c| c * sign)));
            assert!(rms(&found) < 1.3, "{}", rms(&found));
        }
    }

    #[test]
    fn both_sides_of_thin_sheets() {
        for thickness in [0.12, 0.2, 0.3, 0.5] {
            let (mut axis_angles, mut wrong_sides) = (Vec::new(), 0);
            for n in directions(40) {
                let grid = carve(Pitch::j750(), 1.0, |p| dot(p, n).abs() <= thickness / 2.0);
                // A sheet under two voxels along its normal has voxels that belong to both sides.
                let edges = (0..3).map(|a| n[a].abs() * grid.frame().pitch().mm()[a]).sum::<f64>();
                let side = |p: [f64; 3]| if dot(p, n) < 0.0 { n.map(|c| -c) } else { n };
                let found = angles(&surface(&grid), |p| within(p, 0.45).then(|| side(p)));
                if thickness >= 2.0 * edges {
                    wrong_sides += found.iter().filter(|&&a| a > 90.0).count();
                }
                axis_angles.extend(found.iter().map(|a| a.min(180.0 - a)));
            }
            assert_eq!(wrong_sides, 0, "thickness {thickness}");
            assert!(rms(&axis_angles) < 2.5, "thickness {thickness}: {}", rms(&axis_angles));
        }
    }

    #[test]
    fn a_narrow_gap_does_not_turn_normals_over() {
        // Sheets of 0.15 and 0.8 mm with 0.1 mm of air between them.
        for n in directions(40) {
            let grid = carve(Pitch::j750(), 1.2, |p| {
                let h = dot(p, n);
                (-0.15..=0.0).contains(&h) || (0.1..=0.9).contains(&h)
            });
            let faces_gap = |p: [f64; 3]| {
                let h = dot(p, n);
                let edges = (0..3).map(|a| n[a].abs() * Pitch::j750().mm()[a]).fold(0.0, f64::max);
                if !within(p, 0.5) || edges > 0.06 {
                    None
                } else if (-0.03..=0.0).contains(&h) {
                    Some(n)
                } else {
                    (0.1..=0.15).contains(&h).then(|| n.map(|c| -c))
                }
            };
            let found = angles(&surface(&grid), faces_gap);
            assert!(found.iter().all(|&a| a < 60.0), "{n:?} {:?}", found.iter().copied().fold(0.0, f64::max));
        }
    }

    #[test]
    fn edges_stay_where_they_are() {
        let grid = carve(Pitch::j750(), 1.5, |p| p.iter().all(|c| c.abs() <= 1.2));
        // Twice the ball's radius from the edges the faces are flat.
        let flat = |p: [f64; 3]| {
            let a = (0..3).max_by(|&a, &b| p[a].abs().total_cmp(&p[b].abs())).unwrap();
            let others = (0..3).filter(|&b| b != a).all(|b| p[b].abs() < 0.65);
            others.then(|| std::array::from_fn(|b| if a == b { p[a].signum() } else { 0.0 }))
        };
        assert!(angles(&surface(&grid), flat).iter().all(|&a| a < 1e-3));
        let s = surface(&grid);
        let corner = s.normals()[s.len() - 1];
        assert!(corner.iter().all(|&c| c > 0.3), "{corner:?}");
    }

    #[test]
    fn lone_voxels_rods_and_single_layers_have_unit_normals_towards_air() {
        let frame = Frame::new([0.0; 3], Pitch::j750(), [40, 40, 40]).unwrap();
        let normal = |grid: &LabelGrid, voxel| {
            let s = surface(grid);
            s.normals()[s.index_of(voxel).unwrap() as usize]
        };
        let mut lone = LabelGrid::new(frame);
        lone.set([20, 20, 20], 1);
        assert_eq!(normal(&lone, [20, 20, 20]), [0.0, 0.0, 1.0]);
        for axis in 0..3 {
            let (mut rod, mut layer) = (LabelGrid::new(frame), LabelGrid::new(frame));
            for i in 0..1600u32 {
                let (u, v) = (i % 40, i / 40);
                let mut voxel = [20, 20, 20];
                voxel[axis] = u;
                rod.set(voxel, 1);
                layer.set(std::array::from_fn(|a| [20, u, v][(a + 3 - axis) % 3]), 1);
            }
            let n = normal(&rod, [20, 20, 20]);
            assert!(n[axis].abs() < 1e-6, "rod along {axis}: {n:?}");
            let n = normal(&layer, [20, 20, 20]);
            assert!(n[axis] > 0.999, "layer across {axis}: {n:?}");
        }
    }

    #[test]
    fn a_mirrored_volume_has_mirrored_normals() {
        let solid = |p: [f64; 3]| {
            within(p, 0.7) && p[0] + 0.3 * p[1] < 0.4 || (p[0] - p[2]).abs() < 0.06 || p[1] < 0.3 * p[2] - 0.6
        };
        let grid = carve(Pitch::j750(), 1.0, solid);
        let [sx, sy, sz] = grid.size();
        let mut mirrored = LabelGrid::new(*grid.frame());
        for (x, y, z) in (0..sz).flat_map(|z| (0..sy).flat_map(move |y| (0..sx).map(move |x| (x, y, z)))) {
            mirrored.set([sx - 1 - x, y, z], grid.get([x, y, z]));
        }
        let (a, b) = (surface(&grid), surface(&mirrored));
        assert_eq!(a.len(), b.len());
        let mut open_choices = 0;
        for (i, &[x, y, z]) in a.voxels().iter().enumerate() {
            let n = a.normals()[i];
            let m = b.normals()[b.index_of([sx - 1 - x, y, z]).unwrap() as usize];
            let same = (n[0] + m[0]).abs() < 1e-6 && (n[1] - m[1]).abs() < 1e-6 && (n[2] - m[2]).abs() < 1e-6;
            open_choices += usize::from(!same);
        }
        // Only where both sides are open and nothing tells them apart may the choice differ.
        assert!(open_choices * 50 < a.len(), "{open_choices} of {}", a.len());
    }

    #[test]
    fn any_pitch_and_radius_gives_unit_normals() {
        for mm in [[0.02, 1.0, 0.02], [1.0, 0.03, 0.5], [0.01; 3], [2.0; 3]] {
            let pitch = Pitch::new(mm).unwrap();
            let frame = Frame::new([0.0; 3], pitch, [30, 20, 25]).unwrap();
            let mut grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(1));
            for i in 0..20 {
                grid.set([i, i, i], 0);
                grid.set([29 - i, i, 5], 0);
            }
            for normal_radius_mm in [1e-9, 0.05, 0.25, 1e9] {
                let s = Surface::extract(
                    &grid,
                    &SurfaceOptions { normal_radius_mm, ..SurfaceOptions::default() },
                    &Control::none(),
                )
                .unwrap();
                for n in s.normals() {
                    assert!((dot(n.map(f64::from), n.map(f64::from)) - 1.0).abs() < 1e-5, "{n:?}");
                }
            }
        }
    }
}
