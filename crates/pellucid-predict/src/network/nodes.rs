//! Where the network is run for many points: one surface voxel of each block, and how the others take its outputs.

use std::collections::HashMap;

use pellucid_voxel::{Control, Surface};
use rayon::prelude::*;

use crate::PredictError;

/// Most nodes that a point takes outputs from.
pub(super) const NEAREST: usize = 8;
/// Least cosine between the normals of points that share: parts about an edge stay apart.
const ALIKE: f32 = 0.8;
/// Width of the weights' Gaussian in spacings.
const WIDTH: f64 = 0.6;
/// What slopes cost, as a part of the spread that fixes them: keeps them where few nodes tell them.
const RIDGE: f64 = 0.05;
/// Greatest sum of the weights' sizes; past it an extrapolation is given up.
const STEEPEST: f64 = 2.0;
/// Blocks that a thread takes at a time.
const CHUNK: usize = 64;

/// A block's place in the lattice of blocks.
type Block = [u32; 3];

/// Surface points some way apart.
pub(super) struct Nodes {
    spacing_mm: f64,
    /// The surface point of each node.
    points: Vec<u32>,
    /// The nodes of each block: first and end.
    place: HashMap<Block, (u32, u32)>,
}

impl Nodes {
    /// Whether blocks of `spacing_mm` are single voxels, so that every point is a node.
    pub fn everywhere(surface: &Surface, spacing_mm: f64) -> bool {
        block_edges(surface, spacing_mm) == [1; 3]
    }

    /// Chooses the nodes of a surface about `spacing_mm` apart.
    ///
    /// # Errors
    /// [`PredictError::Cancelled`].
    pub fn new(surface: &Surface, spacing_mm: f64, control: &Control<'_>) -> Result<Self, PredictError> {
        let all: Vec<u32> = (0..surface.len() as u32).collect();
        let mut nodes = Self { spacing_mm, points: Vec::new(), place: HashMap::new() };
        let order = nodes.by_block(surface, &all);
        control.check()?;
        let blocks = nodes.blocks(surface, &all, &order);
        let mm = surface.frame().pitch().mm();
        let chosen: Vec<Vec<u32>> = blocks.par_iter().map(|members| nodes_of(surface, mm, members)).collect();
        control.check()?;
        let mut place = HashMap::with_capacity(blocks.len());
        let mut points = Vec::new();
        for (members, chosen) in blocks.iter().zip(&chosen) {
            let first = points.len() as u32;
            points.extend(chosen);
            place.insert(nodes.block_of(surface, members[0]), (first, points.len() as u32));
        }
        (nodes.points, nodes.place) = (points, place);
        Ok(nodes)
    }

    /// The surface point of each node.
    pub fn points(&self) -> &[u32] {
        &self.points
    }

    fn block_of(&self, surface: &Surface, point: u32) -> Block {
        let (voxel, edges) = (surface.voxels()[point as usize], block_edges(surface, self.spacing_mm));
        std::array::from_fn(|a| voxel[a] / edges[a])
    }

    /// Positions of points in the order of their blocks.
    fn by_block(&self, surface: &Surface, points: &[u32]) -> Vec<u32> {
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        order.par_sort_unstable_by_key(|&i| {
            let [x, y, z] = self.block_of(surface, points[i as usize]);
            (z, y, x, i)
        });
        order
    }

    /// The positions of each block's points, given in the order of blocks.
    fn blocks<'a>(&self, surface: &Surface, points: &[u32], order: &'a [u32]) -> Vec<&'a [u32]> {
        let block = |i: u32| self.block_of(surface, points[i as usize]);
        order.chunk_by(|a, b| block(*a) == block(*b)).collect()
    }
}

/// Edges in voxels of blocks of `spacing_mm`.
fn block_edges(surface: &Surface, spacing_mm: f64) -> [u32; 3] {
    surface.frame().pitch().mm().map(|mm| ((spacing_mm / mm).round() as u32).max(1))
}

/// From which nodes points take values, and how much from each: values between nodes follow a plane fitted to those about
/// the point (moving least squares over its tangent plane, Lancaster and Salkauskas 1981).
pub(super) struct Blend {
    nodes: usize,
    /// `[point]`: nodes by descending closeness, the last one repeated with weight 0.
    near: Vec<[u32; NEAREST]>,
    weights: Vec<[f32; NEAREST]>,
}

impl Blend {
    /// The weights of surface points, in their order.
    ///
    /// # Errors
    /// [`PredictError::Cancelled`].
    pub fn new(
        surface: &Surface,
        nodes: &Nodes,
        points: &[u32],
        control: &Control<'_>,
    ) -> Result<Self, PredictError> {
        let order = nodes.by_block(surface, points);
        let mm = surface.frame().pitch().mm();
        let fit = Fit { surface, mm, spacing_mm: nodes.spacing_mm, points: &nodes.points };
        let found = nodes
            .blocks(surface, points, &order)
            .par_chunks(CHUNK)
            .map(|blocks| -> Result<Vec<Near>, PredictError> {
                control.check()?;
                let mut found = Vec::new();
                let mut about = Vec::new();
                for members in blocks {
                    let block = nodes.block_of(surface, points[members[0] as usize]);
                    nodes_about(block, &nodes.place, &mut about);
                    found.extend(members.iter().map(|&i| fit.near(points[i as usize], &about)));
                }
                Ok(found)
            })
            .collect::<Result<Vec<_>, _>>()?;
        let mut near = vec![[0; NEAREST]; points.len()];
        let mut weights = vec![[0.0; NEAREST]; points.len()];
        for (i, found) in order.into_iter().zip(found.into_iter().flatten()) {
            (near[i as usize], weights[i as usize]) = found;
        }
        Ok(Self { nodes: nodes.points.len(), near, weights })
    }

    /// The nodes that some points take values from, ascending, and the position among them of every node.
    pub fn needed(&self, points: impl Iterator<Item = u32>) -> (Vec<u32>, Vec<u32>) {
        let mut place = vec![u32::MAX; self.nodes];
        for point in points {
            self.near[point as usize].iter().for_each(|&node| place[node as usize] = 0);
        }
        let needed: Vec<u32> = (0..self.nodes as u32).filter(|&node| place[node as usize] == 0).collect();
        (0..).zip(&needed).for_each(|(i, &node)| place[node as usize] = i);
        (needed, place)
    }

    /// A point's nodes, the closest first, and their weights.
    #[inline]
    pub fn near(&self, point: u32) -> (&[u32; NEAREST], &[f32; NEAREST]) {
        (&self.near[point as usize], &self.weights[point as usize])
    }
}

/// A point's nodes and weights.
type Near = ([u32; NEAREST], [f32; NEAREST]);

/// The nodes of a block: of each group of points with like normals the one nearest its middle.
fn nodes_of(surface: &Surface, mm: [f64; 3], members: &[u32]) -> Vec<u32> {
    let mut groups: Vec<(u32, Vec<u32>)> = Vec::new();
    for &point in members {
        match groups.iter_mut().find(|(seed, _)| alike(surface, *seed, point)) {
            Some((_, group)) => group.push(point),
            None => groups.push((point, vec![point])),
        }
    }
    let place = |point: u32| -> [f64; 3] {
        let voxel = surface.voxels()[point as usize];
        std::array::from_fn(|a| f64::from(voxel[a]) * mm[a])
    };
    let middle = |group: &[u32]| {
        let sum =
            group.iter().map(|&p| place(p)).fold([0.0; 3], |sum, p| std::array::from_fn(|a| sum[a] + p[a]));
        sum.map(|s| s / group.len() as f64)
    };
    let nearest = |(_, group): &(u32, Vec<u32>)| {
        let middle = middle(group);
        let distance =
            |p: &u32| -> f64 { place(*p).iter().zip(middle).map(|(a, b)| (a - b) * (a - b)).sum() };
        group.iter().copied().min_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.cmp(b)))
    };
    groups.iter().filter_map(nearest).collect()
}

fn alike(surface: &Surface, a: u32, b: u32) -> bool {
    let (a, b) = (surface.normals()[a as usize], surface.normals()[b as usize]);
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2] > ALIKE
}

/// The nodes of a block and of those about it.
fn nodes_about(block: Block, place: &HashMap<Block, (u32, u32)>, about: &mut Vec<u32>) {
    about.clear();
    for i in 0..27 {
        let step = [i % 3, i / 3 % 3, i / 9];
        let neighbour: [Option<u32>; 3] = std::array::from_fn(|a| (block[a] + step[a]).checked_sub(1));
        let [Some(x), Some(y), Some(z)] = neighbour else { continue };
        if let Some(&(first, end)) = place.get(&[x, y, z]) {
            about.extend(first..end);
        }
    }
}

/// What a point's weights follow from.
struct Fit<'a> {
    surface: &'a Surface,
    mm: [f64; 3],
    spacing_mm: f64,
    points: &'a [u32],
}

impl Fit<'_> {
    /// The nearest nodes among those `about` a point that face as it does, with their weights.
    fn near(&self, point: u32, about: &[u32]) -> Near {
        let offset = |node: u32| -> [f64; 3] {
            let (own, other) = (
                self.surface.voxels()[point as usize],
                self.surface.voxels()[self.points[node as usize] as usize],
            );
            std::array::from_fn(|a| (f64::from(other[a]) - f64::from(own[a])) * self.mm[a])
        };
        let square = |d: [f64; 3]| d.iter().map(|v| v * v).sum::<f64>();
        let mut nodes: Vec<(f64, u32)> = about
            .iter()
            .filter(|&&node| alike(self.surface, point, self.points[node as usize]))
            .map(|&node| (square(offset(node)), node))
            .collect();
        if nodes.is_empty() {
            // Its own group's node faces too far from it: the nearest one has to do.
            nodes.extend(about.iter().map(|&node| (square(offset(node)), node)));
            nodes.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            nodes.truncate(1);
        }
        nodes.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        nodes.truncate(NEAREST);
        let normal = self.surface.normals()[point as usize].map(f64::from);
        let (u, v) = tangents(normal);
        let width = WIDTH * self.spacing_mm;
        let places: Vec<[f64; 3]> = nodes
            .iter()
            .map(|&(distance, node)| {
                let d = offset(node);
                let along = |t: [f64; 3]| (0..3).map(|a| d[a] * t[a]).sum::<f64>() / width;
                [(-0.5 * distance / (width * width)).exp(), along(u), along(v)]
            })
            .collect();
        let weights = plane_weights(&places);
        let last = nodes.len() - 1;
        let near = std::array::from_fn(|i| nodes[i.min(last)].1);
        (near, std::array::from_fn(|i| weights.get(i).map_or(0.0, |&w| w as f32)))
    }
}

/// Two unit vectors across a unit vector.
fn tangents(n: [f64; 3]) -> ([f64; 3], [f64; 3]) {
    // The axis that the normal is farthest from.
    let axis = if n[0].abs() <= n[1].abs() && n[0].abs() <= n[2].abs() {
        [1.0, 0.0, 0.0]
    } else if n[1].abs() <= n[2].abs() {
        [0.0, 1.0, 0.0]
    } else {
        [0.0, 0.0, 1.0]
    };
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let u = cross(n, axis);
    let length = u.iter().map(|v| v * v).sum::<f64>().sqrt();
    let u = u.map(|v| v / length);
    (u, cross(n, u))
}

/// Weights of values at places `[closeness, u, v]` for the value of the plane fitted to them at the origin; their sum
/// is 1.
fn plane_weights(places: &[[f64; 3]]) -> Vec<f64> {
    let sum: f64 = places.iter().map(|p| p[0]).sum();
    let mean: [f64; 2] = std::array::from_fn(|a| places.iter().map(|p| p[0] * p[a + 1]).sum::<f64>() / sum);
    let moment = |a: usize, b: usize| {
        places.iter().map(|p| p[0] * (p[a + 1] - mean[a]) * (p[b + 1] - mean[b])).sum::<f64>() / sum
    };
    let (uu, uv, vv) = (moment(0, 0) + RIDGE, moment(0, 1), moment(1, 1) + RIDGE);
    let determinant = uu * vv - uv * uv;
    // Value at the origin: mean value less the slope times the mean place.
    let slope = [(vv * mean[0] - uv * mean[1]) / determinant, (uu * mean[1] - uv * mean[0]) / determinant];
    let weight =
        |p: &[f64; 3]| p[0] / sum * (1.0 - slope[0] * (p[1] - mean[0]) - slope[1] * (p[2] - mean[1]));
    let weights: Vec<f64> = places.iter().map(weight).collect();
    if weights.iter().map(|w| w.abs()).sum::<f64>() <= STEEPEST {
        return weights;
    }
    places.iter().map(|p| p[0] / sum).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use pellucid_voxel::{Frame, LabelGrid, Pitch, SurfaceOptions};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn weights_sum_to_one_and_stay_small(
            places in prop::collection::vec([0.05f64..1.0, -2.0f64..2.0, -2.0f64..2.0], 1..9),
        ) {
            let weights = plane_weights(&places);
            prop_assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-9);
            prop_assert!(weights.iter().map(|w| w.abs()).sum::<f64>() <= STEEPEST + 1e-9);
        }

        #[test]
        fn planes_are_met_off_the_middle(
            shift in [-0.5f64..0.5, -0.5f64..0.5],
            plane in [-1.0f64..1.0, -1.0f64..1.0, -1.0f64..1.0],
        ) {
            // A lattice of nodes with one left out, seen from off its middle.
            let places: Vec<[f64; 3]> = (0..8)
                .map(|i| [f64::from(i % 3) - 1.0 - shift[0], f64::from(i / 3) - 1.0 - shift[1]])
                .map(|[u, v]| [(-0.5 * (u * u + v * v)).exp(), u, v])
                .collect();
            let value = |p: &[f64; 3]| plane[0] + plane[1] * p[1] + plane[2] * p[2];
            let fitted: f64 = places.iter().zip(plane_weights(&places)).map(|(p, w)| w * value(p)).sum();
            let sum: f64 = places.iter().map(|p| p[0]).sum();
            let mean: [f64; 2] =
                std::array::from_fn(|a| places.iter().map(|p| p[0] * p[a + 1]).sum::<f64>() / sum);
            // What the ridge takes off a slope is at most a fifth of it here.
            let most = 0.2 * (mean[0].hypot(mean[1])) * plane[1].hypot(plane[2]);
            prop_assert!((fitted - plane[0]).abs() <= most + 1e-9, "{fitted} {plane:?} {most}");
        }
    }

    #[test]
    fn every_point_has_nodes_that_face_its_way() {
        let frame = Frame::new([0.0; 3], Pitch::j750(), [60, 30, 90]).unwrap();
        // A wall of two sides 0.17 mm apart, on a block.
        let grid = LabelGrid::from_fn(frame, |[x, _, z]| u8::from(z < 30 || (20..24).contains(&x)));
        let surface = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()).unwrap();
        for spacing in [0.1, 0.25, 0.6] {
            let nodes = Nodes::new(&surface, spacing, &Control::none()).unwrap();
            let all: Vec<u32> = (0..surface.len() as u32).collect();
            let blend = Blend::new(&surface, &nodes, &all, &Control::none()).unwrap();
            // Any points in any order have the same weights.
            let some: Vec<u32> = all.iter().rev().copied().step_by(7).collect();
            let of_some = Blend::new(&surface, &nodes, &some, &Control::none()).unwrap();
            for (i, &point) in some.iter().enumerate() {
                assert_eq!(of_some.near(i as u32), blend.near(point));
            }
            let part = nodes.points().len() as f64 / surface.len() as f64;
            assert!(part < 0.5 && part > 1e-3, "{part}");
            for point in 0..surface.len() as u32 {
                let (near, weights) = blend.near(point);
                assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-5);
                let facing = near.iter().zip(weights).filter(|(_, w)| **w != 0.0);
                let several = facing.clone().count() > 1;
                for (&node, _) in facing {
                    assert!(!several || alike(&surface, point, nodes.points()[node as usize]));
                }
            }
            let (needed, place) = blend.needed([5].into_iter());
            let mut own = blend.near(5).0.to_vec();
            own.sort_unstable();
            own.dedup();
            assert_eq!(needed, own);
            assert!(own.iter().enumerate().all(|(i, &node)| place[node as usize] == i as u32));
        }
    }
}
