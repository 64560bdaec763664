//! Which shells bound the solid, and which way they face.

use crate::bvh::Bvh;
use crate::geometry::{Bounds, Vec3, area_vector, centroid, dot, length, nearest_on_triangle};
use crate::shell::{Role, Shell};
use crate::winding::WindingTree;

/// Most points of a shell that are tested for lying inside another.
const NESTING_SAMPLES: usize = 32;
/// Most triangles of a shell that are looked for on another.
const COVER_SAMPLES: usize = 64;
/// Share of them that must lie on it: a copy may lack a few.
const COVERED: f64 = 0.8;
/// Winding number from which a point is strictly inside a closed surface: on a flat part of it,
/// and at the corners of its hull, it is one half or less.
const INSIDE: f64 = 0.75;

/// The mesh that the shells are made of.
struct Mesh<'m> {
    vertices: &'m [Vec3],
    triangles: &'m [[u32; 3]],
}

impl Mesh<'_> {
    fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|v| self.vertices[v as usize])
    }

    fn bounds(&self, shell: &Shell) -> Bounds {
        Bounds::of(shell.triangles.iter().flat_map(|&t| self.corners(t)))
    }

    fn closed_surface(&self, shell: &Shell) -> Vec<[Vec3; 3]> {
        shell.closed_surface(self.vertices, self.triangles)
    }
}

/// Finds back copies, partitions within solid, and shells to flip.
pub(crate) fn decide_roles(vertices: &[Vec3], triangles: &[[u32; 3]], shells: &mut [Shell], tolerance: f64) {
    let mesh = Mesh { vertices, triangles };
    let twins = find_back_copies(&mesh, shells, tolerance);
    if shells.iter().any(|s| s.volume < 0.0) {
        decide_flips(&mesh, shells, &twins);
    }
    keep_partitions_in_solid(&mesh, shells);
}

/// Up to `most` members of a list, evenly spaced.
fn spread<T: Copy>(list: &[T], most: usize) -> impl Iterator<Item = T> {
    list.iter().step_by(list.len().div_ceil(most).max(1)).copied()
}

/// Marks shells that are the same surface as another, or a part of it, seen from behind. Gives each
/// shell's back copy where that is all of it.
///
/// Renderers that leave out what faces away get both sides of a surface as two; together they wind
/// around nothing.
fn find_back_copies(mesh: &Mesh, shells: &mut [Shell], tolerance: f64) -> Vec<Option<usize>> {
    let mut twins = vec![None; shells.len()];
    // What faces out of a closed surface is no back.
    let mut candidates: Vec<usize> =
        (0..shells.len()).filter(|&s| shells[s].volume < 0.0 || !shells[s].caps.is_empty()).collect();
    if shells.len() < 2 || candidates.is_empty() {
        return twins;
    }
    // Of two copies that face neither in nor out the first is the front.
    candidates.sort_by_key(|&s| (shells[s].volume >= 0.0, std::cmp::Reverse(s)));
    let mut shell_of = vec![0u32; mesh.triangles.len()];
    for (s, shell) in shells.iter().enumerate() {
        shell.triangles.iter().for_each(|&t| shell_of[t as usize] = s as u32);
    }
    let boxes: Vec<Bounds> = (0..mesh.triangles.len() as u32).map(|t| Bounds::of(mesh.corners(t))).collect();
    let tree = Bvh::build(&boxes);
    for s in candidates {
        let faces = |t: u32, p: Vec3| {
            let mut found = shells_behind(mesh, &tree, t, p, 4.0 * tolerance, &shell_of);
            found.retain(|&other| other != s as u32 && !shells[other as usize].is_back());
            found
        };
        // Shells that the samples lie on, and how many samples lie on a body.
        let mut covers: Vec<u32> = Vec::new();
        let (mut samples, mut on_bodies) = (0, 0);
        for t in spread(&shells[s].triangles, COVER_SAMPLES) {
            samples += 1;
            let [a, b, c] = mesh.corners(t).map(|p| faces(t, p));
            let both = a.into_iter().filter(|other| b.contains(other) && c.contains(other));
            let before = covers.len();
            covers.extend(both);
            on_bodies += usize::from(covers[before..].iter().any(|&o| shells[o as usize].volume > 0.0));
        }
        covers.sort_unstable();
        let Some(most) = covers.chunk_by(|a, b| a == b).max_by_key(|c| c.len()) else { continue };
        let enough = COVERED * f64::from(samples);
        let alone = most.len() as f64 >= enough;
        // What several bodies back together, each its part, is no hollow either.
        if alone || (shells[s].volume < 0.0 && on_bodies as f64 >= enough) {
            let front = most[0] as usize;
            let (own, other) = (shells[s].volume, shells[front].volume);
            if alone && own < 0.0 && (own + other).abs() < 0.1 * other {
                twins[front] = Some(s);
            }
            shells[s].role = Role::BackCopy(front as u32);
        }
    }
    twins
}

/// Shells with a triangle that `p`, a corner of triangle `t`, lies on, and that faces the other way.
fn shells_behind(mesh: &Mesh, tree: &Bvh, t: u32, p: Vec3, reach: f64, shell_of: &[u32]) -> Vec<u32> {
    let n = area_vector(mesh.corners(t));
    let around = Bounds { min: p.map(|c| c - reach), max: p.map(|c| c + reach) };
    let mut found = Vec::new();
    tree.any_overlapping(&around, |other| {
        let corners = mesh.corners(other);
        let m = area_vector(corners);
        if dot(n, m) < -0.5 * length(n) * length(m) && nearest_on_triangle(p, corners).1 <= reach * reach {
            found.push(shell_of[other as usize]);
        }
        false
    });
    found.sort_unstable();
    found.dedup();
    found
}

/// Marks shells to flip: those that face inwards where nothing solid surrounds them, and what lies
/// inside a flipped shell, which keeps its orientation relative to it.
///
/// Where a shell and its back copy lie within solid, one of them makes a cavity and the other adds
/// nothing: the front is the one that is listed first or second as with the shell around them.
fn decide_flips(mesh: &Mesh, shells: &mut [Shell], twins: &[Option<usize>]) {
    let mut order: Vec<usize> = (0..shells.len()).filter(|&s| shells[s].role == Role::Wall).collect();
    order.sort_by(|&a, &b| shells[b].volume.abs().total_cmp(&shells[a].volume.abs()).then(a.cmp(&b)));
    let boxes: Vec<Bounds> = order.iter().map(|&s| mesh.bounds(&shells[s])).collect();
    let tree = Bvh::build(&boxes);
    let mut fields: Vec<Option<WindingTree>> = vec![None; order.len()];
    for rank in 0..order.len() {
        let own = &shells[order[rank]];
        let samples: Vec<Vec3> =
            spread(&own.triangles, NESTING_SAMPLES).map(|t| mesh.corners(t)[0]).collect();
        let mut around = Vec::new();
        tree.any_overlapping(&boxes[rank], |j| {
            let j = j as usize;
            let holds = (0..3)
                .all(|k| boxes[j].min[k] <= boxes[rank].min[k] && boxes[rank].max[k] <= boxes[j].max[k]);
            if j < rank && holds {
                around.push(j);
            }
            false
        });
        around.sort_unstable();
        around.retain(|&j| {
            let field =
                fields[j].get_or_insert_with(|| WindingTree::build(&mesh.closed_surface(&shells[order[j]])));
            samples.iter().all(|&p| field.at(p).abs() > INSIDE)
        });
        let solid_around: i32 = around.iter().map(|&j| shells[order[j]].sign()).sum();
        // The smallest shell around comes last.
        let parent = around.last().map(|&j| order[j]);
        let i = order[rank];
        if let (Some(parent), Some(back)) = (parent, twins[i])
            && solid_around > 0
        {
            let back_first = twins[parent].is_some_and(|b| b < parent);
            if (back < i) != back_first {
                shells[i].role = Role::BackCopy(back as u32);
                shells[back].role = Role::Wall;
                order[rank] = back;
                fields[rank] = None;
            }
        }
        let i = order[rank];
        shells[i].flipped = parent.is_some_and(|p| shells[p].flipped);
        if solid_around <= 0 && shells[i].sign() < 0 {
            shells[i].flipped ^= true;
        }
    }
}

/// Partitions that do not lie within solid bound some of it after all.
fn keep_partitions_in_solid(mesh: &Mesh, shells: &mut [Shell]) {
    if shells.iter().all(|s| s.role != Role::Partition) {
        return;
    }
    let walls = shells.iter().filter(|s| s.role == Role::Wall);
    let surfaces = walls.flat_map(|s| {
        let mut surface = mesh.closed_surface(s);
        if s.flipped {
            surface.iter_mut().for_each(|t| t.swap(1, 2));
        }
        surface
    });
    let field = WindingTree::build(&surfaces.collect::<Vec<_>>());
    for shell in shells.iter_mut().filter(|s| s.role == Role::Partition) {
        let mut points = spread(&shell.triangles, NESTING_SAMPLES).map(|t| centroid(mesh.corners(t)));
        if !points.all(|p| field.at(p).abs() > INSIDE) {
            shell.role = Role::Wall;
            shell.flipped = shell.volume < 0.0;
        }
    }
}
