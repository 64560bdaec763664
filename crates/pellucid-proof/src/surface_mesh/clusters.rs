//! Which surface voxels a vertex stands for.

use pellucid_core::Control;
use pellucid_voxel::Surface;
use rayon::prelude::*;

use super::cells::{Cells, key_of, place_of};
use crate::ProofError;

/// Surface voxels of every vertex; each has at least one.
#[derive(Clone, Debug)]
pub(super) struct Clusters {
    /// Where each vertex's voxels end.
    ends: Vec<usize>,
    points: Vec<u32>,
}

impl Clusters {
    /// The surface voxels about each corner that face its way: those within half a cell, or where there are none
    /// those of the cells that meet there.
    pub fn gather(cells: &Cells, surface: &Surface, control: &Control<'_>) -> Result<Self, ProofError> {
        let outward = outward(cells);
        let near = |(point, voxel): (usize, &[u32; 3])| {
            let found = corners_about(*voxel, cells.voxels)
                .filter_map(|corner| cells.corners.binary_search(&corner).ok())
                .map(|corner| (corner as u32, point as u32));
            found.collect::<Vec<_>>()
        };
        let mut pairs: Vec<(u32, u32)> =
            surface.voxels().par_iter().enumerate().flat_map_iter(near).collect();
        control.check()?;
        pairs.par_sort_unstable();
        let faces = |corner: usize, point: u32| {
            let normal = surface.normals()[point as usize];
            (0..3).map(|a| normal[a] * outward[corner][a]).sum::<f32>() > 0.0
        };
        let (mut ends, mut points) =
            (Vec::with_capacity(cells.corners.len()), Vec::with_capacity(pairs.len()));
        let mut rest = &pairs[..];
        for corner in 0..cells.corners.len() {
            let (own, others) = rest.split_at(rest.partition_point(|pair| pair.0 as usize == corner));
            rest = others;
            let own: Vec<u32> = match own {
                [] => adjacent(cells, corner),
                _ => own.iter().map(|pair| pair.1).collect(),
            };
            let before = points.len();
            points.extend(own.iter().copied().filter(|&point| faces(corner, point)));
            if points.len() == before {
                points.extend(own);
            }
            ends.push(points.len());
        }
        Ok(Self { ends, points })
    }

    /// The surface voxels of a vertex.
    pub fn of(&self, vertex: usize) -> &[u32] {
        let start = vertex.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.points[start..self.ends[vertex]]
    }
}

/// Corners whose distance from a voxel is half a cell or less along every axis.
fn corners_about(voxel: [u32; 3], cell: [u32; 3]) -> impl Iterator<Item = u64> {
    let range = |a: usize| {
        let (v, cell) = (i64::from(voxel[a]), i64::from(cell[a]));
        let half = (cell + 1) / 2;
        (v - half).div_euclid(cell) + 1..=(v + half) / cell
    };
    let [xs, ys, zs] = [0, 1, 2].map(range);
    zs.flat_map(move |z| {
        let xs = xs.clone();
        ys.clone().flat_map(move |y| xs.clone().map(move |x| key_of([x, y, z])))
    })
}

/// Surface voxels of the cells that meet at a corner.
fn adjacent(cells: &Cells, corner: usize) -> Vec<u32> {
    let place = place_of(cells.corners[corner]);
    let around = (0..8).map(|i| std::array::from_fn(|a| place[a] - (i >> a & 1)));
    let inside = around.filter(|place: &[i64; 3]| place.iter().all(|&v| v >= 0));
    inside.flat_map(|place| cells.members_of(key_of(place))).collect()
}

/// Which way is out at each corner: the sum of its quads' directions.
fn outward(cells: &Cells) -> Vec<[f32; 3]> {
    let mut sums = vec![[0.0f32; 3]; cells.corners.len()];
    for quad in &cells.quads {
        let [a, b, _, d] = quad.map(|i| place_of(cells.corners[i as usize]));
        let edge = |to: [i64; 3]| std::array::from_fn::<i64, 3, _>(|i| to[i] - a[i]);
        let (u, v) = (edge(b), edge(d));
        let direction = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        for &corner in quad {
            (0..3).for_each(|a| sums[corner as usize][a] += direction[a] as f32);
        }
    }
    sums
}
