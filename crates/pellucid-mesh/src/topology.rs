//! Shells of a mesh, their orientation, their holes and the caps that close them.

use crate::bvh::Bvh;
use crate::geometry::{Bounds, Vec3, add, cross, dot, length, scale, sub};
use crate::weld::{Welded, directed_edges, weld};
use crate::winding::WindingTree;

/// Most vertices of a shell that are tested for lying inside another.
const NESTING_SAMPLES: usize = 32;

/// A maximal set of triangles joined by edges that exactly two triangles share.
#[derive(Clone, Debug)]
pub(crate) struct Shell {
    /// Kept triangles, ascending.
    pub triangles: Vec<u32>,
    /// Triangles that close the holes; with them every edge runs as often one way as the other.
    pub caps: Vec<[Vec3; 3]>,
    /// Holes: connected boundary curves.
    pub holes: u64,
    /// Signed volume with its caps, after orientation was made consistent and before flipping.
    pub volume: f64,
    /// The shell faced inwards without being a cavity, and was flipped.
    pub flipped: bool,
}

/// A welded mesh whose shells are consistently oriented, outward where they enclose solid, with
/// the caps that close its holes.
pub(crate) struct Topology {
    pub vertices: Vec<Vec3>,
    /// Kept triangles with orientation put right.
    pub triangles: Vec<[u32; 3]>,
    /// The input triangle of each kept one.
    pub source: Vec<u32>,
    /// Whether the orientation of a kept triangle differs from the input's.
    pub reversed: Vec<bool>,
    pub shells: Vec<Shell>,
    /// Edges of kept triangles.
    pub edges: u64,
    pub boundary_edges: u64,
    pub non_manifold_edges: u64,
    /// Edges that their two triangles run the same way in the input.
    pub inconsistent_edges: u64,
    pub degenerate: u64,
    pub duplicate: u64,
}

/// Triangles around one edge: `(low vertex, high vertex, triangle, runs low to high)`.
type EdgeUse = (u32, u32, u32, bool);

impl Topology {
    /// Analyses a triangle set. `tolerance` is the distance within which open edges are joined.
    pub fn build(positions: &[Vec3], triangles: &[[u32; 3]], tolerance: f64) -> Self {
        let Welded { vertices, mut triangles, source, degenerate, duplicate } =
            weld(positions, triangles, tolerance);
        let uses = edge_uses(&triangles);
        let (mut edges, mut boundary_edges, mut non_manifold_edges, mut inconsistent_edges) = (0, 0, 0, 0);
        for group in uses.chunk_by(same_edge) {
            edges += 1;
            match group {
                [_] => boundary_edges += 1,
                [a, b] => inconsistent_edges += u64::from(a.3 == b.3),
                _ => non_manifold_edges += 1,
            }
        }
        let (members, mut reversed) = orient(&uses, triangles.len());
        reverse(&mut triangles, &reversed);
        let mut shells: Vec<Shell> =
            members.into_iter().map(|m| Shell::close(&vertices, &triangles, m)).collect();
        decide_flips(&vertices, &triangles, &mut shells);
        for shell in shells.iter_mut().filter(|s| s.flipped) {
            for &t in &shell.triangles {
                triangles[t as usize].swap(1, 2);
                reversed[t as usize] ^= true;
            }
            shell.caps.iter_mut().for_each(|c| c.swap(1, 2));
        }
        Self {
            vertices,
            triangles,
            source,
            reversed,
            shells,
            edges,
            boundary_edges,
            non_manifold_edges,
            inconsistent_edges,
            degenerate,
            duplicate,
        }
    }

    /// The corners of a kept triangle.
    pub fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|v| self.vertices[v as usize])
    }

    /// The caps of all shells.
    pub fn caps(&self) -> Vec<[Vec3; 3]> {
        self.shells.iter().flat_map(|s| s.caps.iter().copied()).collect()
    }
}

fn same_edge(a: &EdgeUse, b: &EdgeUse) -> bool {
    (a.0, a.1) == (b.0, b.1)
}

fn edge_uses(triangles: &[[u32; 3]]) -> Vec<EdgeUse> {
    let mut uses: Vec<EdgeUse> = triangles
        .iter()
        .enumerate()
        .flat_map(|(i, t)| directed_edges(*t).map(|(a, b)| (a.min(b), a.max(b), i as u32, a < b)))
        .collect();
    uses.sort_unstable();
    uses
}

/// Splits triangles into shells and says which to reverse so that the two triangles of each
/// manifold edge run it opposite ways. The smaller part of a shell is reversed.
fn orient(uses: &[EdgeUse], count: usize) -> (Vec<Vec<u32>>, Vec<bool>) {
    // Neighbours over manifold edges as a compressed list: (triangle, same direction).
    let pairs = || {
        uses.chunk_by(same_edge).filter_map(|g| match g {
            [a, b] => Some((a.2, b.2, a.3 == b.3)),
            _ => None,
        })
    };
    let mut starts = vec![0u32; count + 1];
    for (a, b, _) in pairs() {
        starts[a as usize + 1] += 1;
        starts[b as usize + 1] += 1;
    }
    for i in 0..count {
        starts[i + 1] += starts[i];
    }
    let mut next = starts.clone();
    let mut neighbours = vec![(0u32, false); starts[count] as usize];
    for (a, b, same) in pairs() {
        for (from, to) in [(a, b), (b, a)] {
            neighbours[next[from as usize] as usize] = (to, same);
            next[from as usize] += 1;
        }
    }
    let mut reversed = vec![false; count];
    let mut seen = vec![false; count];
    let mut shells = Vec::new();
    for seed in 0..count {
        if seen[seed] {
            continue;
        }
        seen[seed] = true;
        let mut members = vec![seed as u32];
        let mut head = 0;
        while head < members.len() {
            let t = members[head] as usize;
            head += 1;
            for &(other, same) in &neighbours[starts[t] as usize..starts[t + 1] as usize] {
                if !seen[other as usize] {
                    seen[other as usize] = true;
                    reversed[other as usize] = reversed[t] ^ same;
                    members.push(other);
                }
            }
        }
        let turned = members.iter().filter(|&&t| reversed[t as usize]).count();
        if turned * 2 > members.len() {
            members.iter().for_each(|&t| reversed[t as usize] ^= true);
        }
        members.sort_unstable();
        shells.push(members);
    }
    (shells, reversed)
}

fn reverse(triangles: &mut [[u32; 3]], which: &[bool]) {
    for (t, _) in triangles.iter_mut().zip(which).filter(|(_, r)| **r) {
        t.swap(1, 2);
    }
}

impl Shell {
    /// Finds the boundary of a set of triangles and closes each connected part of it with a cone
    /// from the mean of its vertices.
    ///
    /// Any surface with the same boundary would do: two such surfaces bound a closed one, whose
    /// winding number is an integer (Jacobson et al. 2013, section 4).
    fn close(vertices: &[Vec3], triangles: &[[u32; 3]], members: Vec<u32>) -> Self {
        let own: Vec<[u32; 3]> = members.iter().map(|&t| triangles[t as usize]).collect();
        // Directed boundary edges `(from, to, times)`.
        let boundary: Vec<(u32, u32, u32)> = edge_uses(&own)
            .chunk_by(same_edge)
            .filter_map(|g| {
                let net = g.iter().map(|u| if u.3 { 1i64 } else { -1 }).sum::<i64>();
                let (low, high) = (g[0].0, g[0].1);
                match net {
                    0 => None,
                    n if n > 0 => Some((low, high, n as u32)),
                    n => Some((high, low, -n as u32)),
                }
            })
            .collect();
        let (group_of, centres) = boundary_groups(vertices, &boundary);
        let mut caps = Vec::new();
        for (&(from, to, times), &group) in boundary.iter().zip(&group_of) {
            let cap = [vertices[to as usize], vertices[from as usize], centres[group]];
            caps.extend(std::iter::repeat_n(cap, times as usize));
        }
        let origin = vertices[own[0][0] as usize];
        let all = || own.iter().map(|t| t.map(|v| vertices[v as usize])).chain(caps.iter().copied());
        let volume: f64 = all()
            .map(|t| {
                let [a, b, c] = t.map(|v| sub(v, origin));
                dot(a, cross(b, c)) / 6.0
            })
            .sum();
        // A flat sheet's volume is rounding noise: it faces neither in nor out.
        let noise = 1e-9 * length(Bounds::of(all().flatten()).extent()).powi(3);
        let volume = if volume.abs() > noise { volume } else { 0.0 };
        Self { triangles: members, holes: centres.len() as u64, caps, volume, flipped: false }
    }

    /// Corners of all triangles and caps.
    fn closed_surface(&self, vertices: &[Vec3], triangles: &[[u32; 3]]) -> Vec<[Vec3; 3]> {
        let own = self.triangles.iter().map(|&t| triangles[t as usize].map(|v| vertices[v as usize]));
        own.chain(self.caps.iter().copied()).collect()
    }
}

/// Connected parts of a set of edges: the part of each edge, and each part's centre, the
/// length-weighted mean of its edges' middles.
fn boundary_groups(vertices: &[Vec3], edges: &[(u32, u32, u32)]) -> (Vec<usize>, Vec<Vec3>) {
    let mut ends: Vec<u32> = edges.iter().flat_map(|e| [e.0, e.1]).collect();
    ends.sort_unstable();
    ends.dedup();
    let local = |v: u32| ends.partition_point(|&e| e < v);
    let mut parent: Vec<usize> = (0..ends.len()).collect();
    fn root(parent: &mut [usize], mut i: usize) -> usize {
        while parent[i] != i {
            parent[i] = parent[parent[i]];
            i = parent[i];
        }
        i
    }
    for e in edges {
        let (a, b) = (root(&mut parent, local(e.0)), root(&mut parent, local(e.1)));
        parent[a.max(b)] = a.min(b);
    }
    let mut number = vec![usize::MAX; ends.len()];
    let mut sums: Vec<(Vec3, f64)> = Vec::new();
    let mut group_of = Vec::with_capacity(edges.len());
    for e in edges {
        let r = root(&mut parent, local(e.0));
        if number[r] == usize::MAX {
            number[r] = sums.len();
            sums.push(([0.0; 3], 0.0));
        }
        // Low vertex first, so that both sides of a cut find the same centre to the last bit.
        let (a, b) = (vertices[e.0.min(e.1) as usize], vertices[e.0.max(e.1) as usize]);
        let weight = length(sub(b, a)) * f64::from(e.2);
        let sum = &mut sums[number[r]];
        *sum = (add(sum.0, scale(add(a, b), 0.5 * weight)), sum.1 + weight);
        group_of.push(number[r]);
    }
    let centre = |(p, w): (Vec3, f64)| if w > 0.0 { scale(p, 1.0 / w) } else { [0.0; 3] };
    (group_of, sums.into_iter().map(centre).collect())
}

/// Marks shells to flip: those that face inwards where nothing solid surrounds them, and what lies
/// inside a flipped shell, which keeps its orientation relative to it.
fn decide_flips(vertices: &[Vec3], triangles: &[[u32; 3]], shells: &mut [Shell]) {
    if shells.iter().all(|s| s.volume >= 0.0) {
        return;
    }
    let mut order: Vec<usize> = (0..shells.len()).collect();
    order.sort_by(|&a, &b| shells[b].volume.abs().total_cmp(&shells[a].volume.abs()).then(a.cmp(&b)));
    let corner = |t: u32, k: usize| vertices[triangles[t as usize][k] as usize];
    let boxes: Vec<Bounds> = shells
        .iter()
        .map(|s| Bounds::of(s.triangles.iter().flat_map(|&t| (0..3).map(move |k| corner(t, k)))))
        .collect();
    let tree = Bvh::build(&boxes);
    let mut fields: Vec<Option<WindingTree>> = vec![None; shells.len()];
    let mut rank = vec![0; shells.len()];
    order.iter().enumerate().for_each(|(r, &i)| rank[i] = r);
    for &i in &order {
        let samples: Vec<Vec3> = {
            let list = &shells[i].triangles;
            let step = list.len().div_ceil(NESTING_SAMPLES);
            list.iter().step_by(step).map(|&t| corner(t, 0)).collect()
        };
        let mut around = Vec::new();
        tree.any_overlapping(&boxes[i], |j| {
            let j = j as usize;
            let holds =
                (0..3).all(|k| boxes[j].min[k] <= boxes[i].min[k] && boxes[i].max[k] <= boxes[j].max[k]);
            if rank[j] < rank[i] && holds {
                around.push(j);
            }
            false
        });
        around.sort_unstable_by_key(|&j| rank[j]);
        around.retain(|&j| {
            let field = fields[j]
                .get_or_insert_with(|| WindingTree::build(&shells[j].closed_surface(vertices, triangles)));
            samples.iter().all(|&p| field.at(p).abs() > 0.25)
        });
        let sign = |s: &Shell| if (s.volume < 0.0) ^ s.flipped { -1 } else { 1 };
        let solid_around: i32 = around.iter().map(|&j| sign(&shells[j])).sum();
        // The smallest shell around comes last.
        shells[i].flipped = around.last().is_some_and(|&j| shells[j].flipped);
        if solid_around <= 0 && sign(&shells[i]) < 0 {
            shells[i].flipped ^= true;
        }
    }
}
