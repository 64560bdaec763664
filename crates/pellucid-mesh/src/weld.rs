//! Joining vertices that meet in position, and sorting out useless triangles.

use std::collections::HashMap;

use crate::geometry::{Vec3, area_vector, dot, sub};

/// A triangle set with shared vertices.
pub(crate) struct Welded {
    /// Distinct positions.
    pub vertices: Vec<Vec3>,
    /// Kept triangles, corners as in the source.
    pub triangles: Vec<[u32; 3]>,
    /// The source triangle of each kept one.
    pub source: Vec<u32>,
    /// Triangles left out for having no area.
    pub degenerate: u64,
    /// Triangles left out because an earlier one has the same corners and faces the same way.
    pub duplicate: u64,
}

/// Joins equal positions, then joins vertices on open edges that lie within `tolerance` of each
/// other; drops degenerate and duplicate triangles.
pub(crate) fn weld(positions: &[Vec3], triangles: &[[u32; 3]], tolerance: f64) -> Welded {
    let (vertices, exact) = join_equal(positions);
    let corners: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(|v| exact[v as usize])).collect();
    let first = keep(&vertices, &corners);
    let open = open_vertices(&first.triangles);
    if open.is_empty() || tolerance <= 0.0 {
        return first;
    }
    let near = join_near(&vertices, &open, tolerance);
    if near.is_empty() {
        return first;
    }
    let corners: Vec<[u32; 3]> = corners.iter().map(|t| t.map(|v| *near.get(&v).unwrap_or(&v))).collect();
    keep(&vertices, &corners)
}

/// Distinct positions in order of first use, and each input's index among them.
fn join_equal(positions: &[Vec3]) -> (Vec<Vec3>, Vec<u32>) {
    let mut vertices = Vec::new();
    let mut index = HashMap::with_capacity(positions.len());
    let map = positions
        .iter()
        .map(|p| {
            // Adding 0 makes -0 equal 0 in bits too.
            let key = p.map(|c| (c + 0.0).to_bits());
            *index.entry(key).or_insert_with(|| {
                vertices.push(*p);
                vertices.len() as u32 - 1
            })
        })
        .collect();
    (vertices, map)
}

/// Vertices on edges with an odd number of triangles, ascending. Face to face copies count once:
/// a rim is open though its back copy has the same.
fn open_vertices(triangles: &[[u32; 3]]) -> Vec<u32> {
    let mut triangles: Vec<[u32; 3]> = triangles.to_vec();
    triangles.iter_mut().for_each(|t| t.sort_unstable());
    triangles.sort_unstable();
    triangles.dedup();
    let mut edges: Vec<(u32, u32)> = triangles.iter().flat_map(|t| directed_edges(*t)).collect();
    edges.iter_mut().for_each(|e| *e = (e.0.min(e.1), e.0.max(e.1)));
    edges.sort_unstable();
    let mut open: Vec<u32> =
        edges.chunk_by(|a, b| a == b).filter(|g| g.len() % 2 == 1).flat_map(|g| [g[0].0, g[0].1]).collect();
    open.sort_unstable();
    open.dedup();
    open
}

/// Maps each listed vertex that lies within `tolerance` of an earlier one onto it.
fn join_near(vertices: &[Vec3], listed: &[u32], tolerance: f64) -> HashMap<u32, u32> {
    let cell = |p: Vec3| p.map(|c| (c / tolerance).floor() as i64);
    let mut kept: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    let mut joined = HashMap::new();
    for &v in listed {
        let p = vertices[v as usize];
        let home = cell(p);
        let neighbours = (0..27).map(|k| [k % 3, k / 3 % 3, k / 9]);
        let target = neighbours
            .filter_map(|d| kept.get(&std::array::from_fn(|a| home[a].saturating_add(d[a] - 1))))
            .flatten()
            .copied()
            .filter(|&other| {
                let d = sub(p, vertices[other as usize]);
                dot(d, d) <= tolerance * tolerance
            })
            .min();
        match target {
            Some(other) => {
                joined.insert(v, other);
            }
            None => kept.entry(home).or_default().push(v),
        }
    }
    joined
}

/// Drops triangles without area and repeated ones.
fn keep(vertices: &[Vec3], corners: &[[u32; 3]]) -> Welded {
    let mut keyed: Vec<([u32; 3], u32)> = Vec::with_capacity(corners.len());
    let mut degenerate = 0;
    for (i, t) in corners.iter().enumerate() {
        let n = area_vector(t.map(|v| vertices[v as usize]));
        if t[0] == t[1] || t[1] == t[2] || t[2] == t[0] {
            degenerate += 1;
            continue;
        }
        // A sliver of collinear but distinct corners still closes the surface: count, but keep.
        if n == [0.0; 3] {
            degenerate += 1;
        }
        // The lowest corner first keeps the orientation: a wall between two bodies that touch, or a
        // surface and its back copy, are two triangles.
        let lowest = (0..3).fold(0, |best, k| if t[k] < t[best] { k } else { best });
        let key = [t[lowest], t[(lowest + 1) % 3], t[(lowest + 2) % 3]];
        keyed.push((key, i as u32));
    }
    let candidates = keyed.len();
    keyed.sort_unstable();
    keyed.dedup_by_key(|(key, _)| *key);
    let mut source: Vec<u32> = keyed.into_iter().map(|(_, i)| i).collect();
    source.sort_unstable();
    Welded {
        vertices: vertices.to_vec(),
        triangles: source.iter().map(|&i| corners[i as usize]).collect(),
        duplicate: (candidates - source.len()) as u64,
        source,
        degenerate,
    }
}

/// The three edges of a triangle in its own direction.
pub(crate) fn directed_edges([a, b, c]: [u32; 3]) -> [(u32, u32); 3] {
    [(a, b), (b, c), (c, a)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joins_equal_and_near_positions_and_drops_useless_triangles() {
        let positions = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [-0.0, 0.0, 0.0],       // equals 0
            [1.0 + 1e-9, 0.0, 0.0], // near 1
            [0.0, -1.0, 0.0],
        ];
        let triangles = [
            [0, 1, 2],
            [4, 3, 5], // shares the edge 0-1 but for 1e-9
            [1, 0, 2], // the first, reversed
            [1, 2, 0], // the first again
            [0, 3, 2], // two corners coincide
        ];
        let welded = weld(&positions, &triangles, 1e-6);
        assert_eq!(welded.source, [0, 1, 2]);
        assert_eq!(welded.triangles, [[0, 1, 2], [1, 0, 4], [1, 0, 2]]);
        assert_eq!((welded.degenerate, welded.duplicate), (1, 1));

        let strict = weld(&positions, &triangles, 0.0);
        assert_eq!(strict.triangles, [[0, 1, 2], [3, 0, 4], [1, 0, 2]]);
    }
}
