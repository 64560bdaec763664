//! A part of a mesh, its holes and the caps that close them.

use crate::edges::{edge_uses, same_edge};
use crate::geometry::{Bounds, Vec3, add, area_vector, cross, dot, length, scale, sub};

/// Volume over area and size below which an open shell is a sheet; a ball's is 0.17.
const SHEET: f64 = 0.02;

/// What a shell is to the solid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Role {
    /// It bounds the solid: a body or a cavity.
    Wall,
    /// The back of the shell of this index, or a part of it: the same surface facing the other way.
    BackCopy(u32),
    /// A sheet that divides a solid and bounds none.
    Partition,
}

/// A maximal set of triangles that bound one solid, as far as their edges tell.
#[derive(Clone, Debug)]
pub(crate) struct Shell {
    /// Kept triangles, ascending.
    pub triangles: Vec<u32>,
    /// Triangles that close the holes; with them every edge runs as often one way as the other. The
    /// third corner is the apex over the hole.
    pub caps: Vec<[Vec3; 3]>,
    /// Holes: connected boundary curves.
    pub holes: u64,
    /// Signed volume with its caps, after orientation was made consistent and before flipping.
    pub volume: f64,
    /// The shell faced inwards without being a cavity, and was flipped.
    pub flipped: bool,
    pub role: Role,
}

impl Shell {
    /// Signed volume with its caps as it is oriented now; negative of a hollow.
    pub fn enclosed(&self) -> f64 {
        if self.flipped { -self.volume } else { self.volume }
    }

    /// Finds the boundary of a set of triangles and closes each connected part of it with a cone
    /// from the mean of its vertices.
    ///
    /// Any surface with the same boundary would do: two such surfaces bound a closed one, whose
    /// winding number is an integer (Jacobson et al. 2013, section 4).
    pub fn close(vertices: &[Vec3], triangles: &[[u32; 3]], members: Vec<u32>) -> Self {
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
        Self {
            triangles: members,
            holes: centres.len() as u64,
            caps,
            volume,
            flipped: false,
            role: Role::Wall,
        }
    }

    /// Whether it is the back copy of another.
    pub fn is_back(&self) -> bool {
        matches!(self.role, Role::BackCopy(_))
    }

    /// Whether it is an open sheet whose two sides are near each other, rather than a body with
    /// a hole: what its caps close in is flat for its size.
    pub fn is_sheet(&self, vertices: &[Vec3], triangles: &[[u32; 3]]) -> bool {
        if self.caps.is_empty() {
            return false;
        }
        let corners = || self.triangles.iter().map(|&t| triangles[t as usize].map(|v| vertices[v as usize]));
        let area: f64 = corners().map(|c| length(area_vector(c))).sum();
        let size = length(Bounds::of(corners().flatten()).extent());
        self.volume.abs() < SHEET * area * size
    }

    /// +1 where it faces out of what it encloses, -1 where it faces in, as it stands now.
    pub fn sign(&self) -> i32 {
        if (self.volume < 0.0) ^ self.flipped { -1 } else { 1 }
    }

    /// Corners of all triangles and caps.
    pub fn closed_surface(&self, vertices: &[Vec3], triangles: &[[u32; 3]]) -> Vec<[Vec3; 3]> {
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
