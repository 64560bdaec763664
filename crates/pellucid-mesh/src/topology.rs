//! Shells of a mesh, their orientation, their holes and the caps that close them.

use std::collections::BTreeMap;

use crate::edges::{EdgeUse, Fans, apexes_beyond, edge_uses, same_edge};
use crate::geometry::{Bounds, Vec3, area_vector, centroid, has_area, length};
use crate::mesh_places::{MOST_PLACES, middle};
use crate::nesting::decide_roles;
use crate::shell::{Role, Shell};
use crate::weld::{Welded, weld};

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
    /// Middles of some edges of either kind, and of some input triangles that were not kept.
    pub non_manifold_at: Vec<Vec3>,
    pub inconsistent_at: Vec<Vec3>,
    pub left_out: Vec<Vec3>,
}

impl Topology {
    /// Analyses a triangle set. `tolerance` is the distance within which open edges are joined.
    ///
    /// Triangles grow together into patches over edges that two of them share, each patch with one
    /// orientation. Where more meet, patches that bound the same wedge of solid join into shells,
    /// so that a wall that two bodies have in common counts for both.
    pub fn build(positions: &[Vec3], triangles: &[[u32; 3]], tolerance: f64) -> Self {
        let given = triangles;
        let (inside, strays) = without_strays(positions, triangles);
        let Welded { vertices, mut triangles, mut source, degenerate, duplicate } =
            weld(positions, &inside.iter().map(|&t| triangles[t as usize]).collect::<Vec<_>>(), tolerance);
        source.iter_mut().for_each(|s| *s = inside[*s as usize]);
        let uses = edge_uses(&triangles);
        let (mut edges, mut boundary_edges, mut non_manifold_edges, mut inconsistent_edges) = (0, 0, 0, 0);
        let (mut non_manifold_at, mut inconsistent_at) = (Vec::new(), Vec::new());
        for group in uses.chunk_by(same_edge) {
            edges += 1;
            let (count, places) = match group {
                [_] => {
                    boundary_edges += 1;
                    continue;
                }
                [a, b] if a.3 == b.3 => (&mut inconsistent_edges, &mut inconsistent_at),
                [_, _] => continue,
                _ => (&mut non_manifold_edges, &mut non_manifold_at),
            };
            *count += 1;
            if places.len() < MOST_PLACES {
                places.push(middle(vertices[group[0].0 as usize], vertices[group[0].1 as usize]));
            }
        }
        let left_out = left_out(positions, given, &source);
        let fans = Fans { vertices: &vertices, triangles: &triangles, tolerance, beyond: Vec::new() };
        let (patches, mut reversed) = orient(&fans, &uses);
        reverse(&mut triangles, &reversed);
        let members = join_patches(&vertices, &triangles, patches, tolerance);
        let mut shells: Vec<Shell> = members
            .into_iter()
            .map(|(m, role)| Shell { role, ..Shell::close(&vertices, &triangles, m) })
            .collect();
        decide_roles(&vertices, &triangles, &mut shells, tolerance);
        for shell in shells.iter_mut().filter(|s| s.flipped) {
            for &t in &shell.triangles {
                triangles[t as usize].swap(1, 2);
                reversed[t as usize] ^= true;
            }
            // The apex stays the third corner.
            shell.caps.iter_mut().for_each(|c| c.swap(0, 1));
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
            degenerate: degenerate + strays,
            duplicate,
            non_manifold_at,
            inconsistent_at,
            left_out,
        }
    }

    /// The corners of a kept triangle.
    pub fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|v| self.vertices[v as usize])
    }

    /// The triangles of the shells that bound the solid.
    pub fn wall_triangles(&self) -> impl Iterator<Item = u32> {
        self.walls().flat_map(|s| s.triangles.iter().copied())
    }

    /// The shells that bound the solid.
    pub fn walls(&self) -> impl Iterator<Item = &Shell> {
        self.shells.iter().filter(|s| s.role == Role::Wall)
    }

    /// The caps of the shells that bound the solid; the third corner is the apex over their hole.
    pub fn caps(&self) -> Vec<[Vec3; 3]> {
        self.walls().flat_map(|s| s.caps.iter().copied()).collect()
    }
}

/// Middles of some of the triangles that are not among those kept.
fn left_out(positions: &[Vec3], triangles: &[[u32; 3]], kept: &[u32]) -> Vec<Vec3> {
    let mut is_kept = vec![false; triangles.len()];
    kept.iter().for_each(|&t| is_kept[t as usize] = true);
    let others = triangles.iter().zip(is_kept).filter(|(_, kept)| !kept);
    others.map(|(t, _)| centroid(t.map(|v| positions[v as usize]))).take(MOST_PLACES).collect()
}

/// The triangles within the box around those that have an area, and how many are not.
fn without_strays(positions: &[Vec3], triangles: &[[u32; 3]]) -> (Vec<u32>, u64) {
    let corners = |t: &[u32; 3]| t.map(|v| positions[v as usize]);
    let all = triangles.iter().map(corners);
    let area = Bounds::of(all.filter(|c| has_area(*c)).flatten());
    let within = |p: Vec3| (0..3).all(|a| area.min[a] <= p[a] && p[a] <= area.max[a]);
    let inside: Vec<u32> = (0..triangles.len() as u32)
        .filter(|&t| area == Bounds::EMPTY || corners(&triangles[t as usize]).into_iter().all(within))
        .collect();
    let strays = (triangles.len() - inside.len()) as u64;
    (inside, strays)
}

/// Splits triangles into patches and says which to reverse so that the two triangles of each
/// manifold edge run it opposite ways. The smaller part of a patch is reversed.
fn orient(fans: &Fans, uses: &[EdgeUse]) -> (Vec<Vec<u32>>, Vec<bool>) {
    let count = fans.triangles.len();
    // Neighbours over manifold edges: (triangle, triangle, same direction).
    let pairs: Vec<(u32, u32, bool)> = uses
        .chunk_by(same_edge)
        .filter_map(|g| match g {
            [a, b] if !fans.folded(a, b) => Some((a.2, b.2, a.3 == b.3)),
            _ => None,
        })
        .collect();
    // As a compressed list.
    let mut starts = vec![0u32; count + 1];
    for &(a, b, _) in &pairs {
        starts[a as usize + 1] += 1;
        starts[b as usize + 1] += 1;
    }
    for i in 0..count {
        starts[i + 1] += starts[i];
    }
    let mut next = starts.clone();
    let mut neighbours = vec![(0u32, false); starts[count] as usize];
    for &(a, b, same) in &pairs {
        for (from, to) in [(a, b), (b, a)] {
            neighbours[next[from as usize] as usize] = (to, same);
            next[from as usize] += 1;
        }
    }
    let mut reversed = vec![false; count];
    let mut seen = vec![false; count];
    let mut patches = Vec::new();
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
        patches.push(members);
    }
    (patches, reversed)
}

fn reverse(triangles: &mut [[u32; 3]], which: &[bool]) {
    for (t, _) in triangles.iter_mut().zip(which).filter(|(_, r)| **r) {
        t.swap(1, 2);
    }
}

/// Joins oriented patches into shells over the edges where several meet. Gives each shell's
/// triangles, and [`Role::Partition`] for a patch without which the others close up.
fn join_patches(
    vertices: &[Vec3],
    triangles: &[[u32; 3]],
    patches: Vec<Vec<u32>>,
    tolerance: f64,
) -> Vec<(Vec<u32>, Role)> {
    let mut patch_of = vec![0u32; triangles.len()];
    for (p, members) in patches.iter().enumerate() {
        members.iter().for_each(|&t| patch_of[t as usize] = p as u32);
    }
    let uses = edge_uses(triangles);
    let fans = Fans { vertices, triangles, tolerance, beyond: apexes_beyond(triangles, &uses) };
    let meetings: Vec<&[EdgeUse]> = uses.chunk_by(same_edge).filter(|g| g.len() > 2).collect();
    let left_out = partitions(&fans, &meetings, &patches, &patch_of);
    let mut shell_of: Vec<u32> = (0..patches.len() as u32).collect();
    for meeting in &meetings {
        for (a, b) in fans.wedges(&remaining(meeting, |t| left_out[patch_of[t as usize] as usize])) {
            let [a, b] = [a, b].map(|t| root(&mut shell_of, patch_of[t as usize]));
            shell_of[a.max(b) as usize] = a.min(b);
        }
    }
    // A shell comes where its first patch came.
    let mut shells: BTreeMap<u32, (Vec<u32>, Role)> = BTreeMap::new();
    for (p, members) in patches.into_iter().enumerate() {
        let role = if left_out[p] { Role::Partition } else { Role::Wall };
        let shell = shells.entry(root(&mut shell_of, p as u32)).or_insert((Vec::new(), role));
        shell.0.extend(members);
    }
    let mut shells: Vec<(Vec<u32>, Role)> = shells.into_values().collect();
    shells.iter_mut().for_each(|s| s.0.sort_unstable());
    shells
}

fn root(parent: &mut [u32], mut i: u32) -> u32 {
    while parent[i as usize] != i {
        parent[i as usize] = parent[parent[i as usize] as usize];
        i = parent[i as usize];
    }
    i
}

fn remaining(meeting: &[EdgeUse], left_out: impl Fn(u32) -> bool) -> Vec<EdgeUse> {
    meeting.iter().filter(|u| !left_out(u.2)).copied().collect()
}

/// Patches without which all triangles around every edge they end on pair up: the one copy of a
/// wall inside a body, a part of a body covered by another. Smaller ones go first.
fn partitions(fans: &Fans, meetings: &[&[EdgeUse]], patches: &[Vec<u32>], patch_of: &[u32]) -> Vec<bool> {
    let mut left_out = vec![false; patches.len()];
    // The meetings of each patch that do not pair up as they are.
    let pairs_up = |meeting: &[EdgeUse], left_out: &[bool], but: u32| {
        let rest =
            remaining(meeting, |t| left_out[patch_of[t as usize] as usize] || patch_of[t as usize] == but);
        if rest.is_empty() { but == u32::MAX } else { 2 * fans.wedges(&rest).len() == rest.len() }
    };
    let mut meetings_of: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    let mut unpaired: Vec<u32> = Vec::new();
    for (m, meeting) in meetings.iter().enumerate() {
        let mut around: Vec<u32> = meeting.iter().map(|u| patch_of[u.2 as usize]).collect();
        around.sort_unstable();
        around.dedup();
        if !pairs_up(meeting, &left_out, u32::MAX) {
            unpaired.extend(&around);
        }
        around.into_iter().for_each(|p| meetings_of.entry(p).or_default().push(m));
    }
    unpaired.sort_unstable();
    unpaired.dedup();
    let area = |p: u32| -> f64 {
        let corners = |&t: &u32| fans.triangles[t as usize].map(|v| fans.vertices[v as usize]);
        patches[p as usize].iter().map(|t| length(area_vector(corners(t)))).sum()
    };
    let mut by_area: Vec<(f64, u32)> = unpaired.into_iter().map(|p| (area(p), p)).collect();
    by_area.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    for (_, p) in by_area {
        let own = &meetings_of[&p];
        let needed = own.iter().any(|&m| !pairs_up(meetings[m], &left_out, u32::MAX));
        if needed && own.iter().all(|&m| pairs_up(meetings[m], &left_out, p)) {
            left_out[p as usize] = true;
        }
    }
    left_out
}
