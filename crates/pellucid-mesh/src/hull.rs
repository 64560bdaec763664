//! Inverted hulls: outlines as games draw them, a blown-up copy of a body that faces inwards.
//!
//! Viewers leave out what a single-sided material shows from behind, so that of the hull only its
//! far side is seen around the body. It bounds no solid. The same shape is an object with a hollow
//! whose every face is the wrong way round; what tells them apart is that a hull does not look
//! like what it is around.

use crate::geometry::{Bounds, Vec3, area_vector, dot, length, sub};
use crate::shell::{Role, Shell};
use crate::topology::Topology;
use crate::winding::WindingTree;
use crate::{Model, Note, PlacedMesh};

/// Points of a shell that are tested for lying inside another, and for their colour.
const SAMPLES: usize = 64;
/// Share of them that must.
const MOST: f64 = 0.9;
/// Winding number from which a point is inside a closed surface and not on it.
const INSIDE: f64 = 0.75;
/// Largest share of a hull that may be missing: through more one sees its inner side.
const OPEN: f64 = 0.1;
/// Difference of linear colour that can be seen.
const SEEN: f32 = 0.01;

/// The model without inverted hulls, and a note on each material they had.
pub(crate) fn without_hulls(model: Model) -> (Model, Vec<Note>) {
    if !may_have_hull(&model) {
        return (model, Vec::new());
    }
    let hulls = Scene::new(&model).hulls();
    let mut dropped = vec![false; model.triangles().len()];
    hulls.iter().for_each(|&t| dropped[t as usize] = true);
    if hulls.is_empty() || dropped.iter().all(|d| *d) {
        return (model, Vec::new());
    }
    let mut counts = vec![0u64; model.materials().len()];
    hulls.iter().for_each(|&t| counts[model.triangles()[t as usize].material as usize] += 1);
    let used = counts.iter().enumerate().filter(|(_, n)| **n > 0);
    let notes = used.map(|(m, count)| Note {
        object: format!("material {:?}", model.materials()[m].name),
        text: format!(
            "{count} triangles face inwards around a body, as drawn outlines do; they do not show from \
             outside and are left out"
        ),
    });
    let notes = notes.collect();
    (model.keeping(|t| !dropped[t as usize]), notes)
}

/// Whether all triangles of some single-sided material together face inwards.
fn may_have_hull(model: &Model) -> bool {
    let [low, high] = model.bounds_m();
    let origin: Vec3 = std::array::from_fn(|a| 0.5 * (low[a] + high[a]));
    let mut volumes = vec![0.0; model.materials().len()];
    for (t, triangle) in model.triangles().iter().enumerate() {
        let corners = model.corners_m(t as u32);
        volumes[triangle.material as usize] += dot(sub(corners[0], origin), area_vector(corners));
    }
    volumes.iter().zip(model.materials()).any(|(&volume, m)| volume < 0.0 && !m.double_sided)
}

/// A model's shells.
struct Scene<'m> {
    model: &'m Model,
    topology: Topology,
    boxes: Vec<Bounds>,
}

impl<'m> Scene<'m> {
    fn new(model: &'m Model) -> Self {
        let topology = PlacedMesh::topology_of(model, |p| p);
        let boxes =
            topology.shells.iter().map(|s| Bounds::of(s.triangles.iter().flat_map(|&t| topology.corners(t))));
        Self { model, boxes: boxes.collect(), topology }
    }

    /// The model's triangles that are part of hulls.
    fn hulls(&self) -> Vec<u32> {
        let shells = &self.topology.shells;
        let bodies: Vec<usize> = (0..shells.len()).filter(|&s| shells[s].role == Role::Wall).collect();
        let found = bodies.iter().filter(|&&s| shells[s].volume < 0.0 && self.is_hull(s, &bodies));
        found.flat_map(|&s| self.sources(&shells[s])).collect()
    }

    fn sources(&self, shell: &Shell) -> impl Iterator<Item = u32> {
        shell.triangles.iter().map(|&t| self.topology.source[t as usize])
    }

    fn is_hull(&self, hull: usize, bodies: &[usize]) -> bool {
        let shells = &self.topology.shells;
        let own = &shells[hull];
        let material = |source: u32| self.model.triangles()[source as usize].material;
        if self.sources(own).any(|s| self.model.materials()[material(s) as usize].double_sided) {
            return false;
        }
        let area = |corners: &[Vec3; 3]| length(area_vector(*corners));
        let caps: f64 = own.caps.iter().map(area).sum();
        let whole: f64 = own.triangles.iter().map(|&t| area(&self.topology.corners(t))).sum();
        if caps > OPEN * whole {
            return false;
        }
        let larger = |&&s: &&usize| shells[s].volume > own.volume.abs();
        if bodies.iter().filter(larger).any(|&s| self.lies_within(hull, s, &self.field(s))) {
            return false;
        }
        let field = self.field(hull);
        let smaller = |&&s: &&usize| shells[s].volume.abs() < own.volume.abs();
        let within: Vec<usize> =
            bodies.iter().filter(smaller).filter(|&&s| self.lies_within(s, hull, &field)).copied().collect();
        let volume: f64 = within.iter().map(|&s| shells[s].volume).sum();
        volume > 0.0 && self.looks_unlike(hull, &within)
    }

    fn field(&self, shell: usize) -> WindingTree {
        let topology = &self.topology;
        WindingTree::build(&topology.shells[shell].closed_surface(&topology.vertices, &topology.triangles))
    }

    /// Whether a shell lies within another, whose field is given.
    fn lies_within(&self, inner: usize, outer: usize, field: &WindingTree) -> bool {
        if !self.boxes[inner].overlaps(&self.boxes[outer]) {
            return false;
        }
        let points = samples(&self.topology.shells[inner]).map(|t| self.topology.corners(t)[0]);
        share(points, |p| field.at(p).abs() > INSIDE) >= MOST
    }

    /// Whether a hull has materials of its own, or one colour that what is within it has not.
    fn looks_unlike(&self, hull: usize, within: &[usize]) -> bool {
        let shells = &self.topology.shells;
        let outward = || within.iter().map(|&s| &shells[s]).filter(|s| s.volume > 0.0);
        let materials = |shell: &Shell| {
            let mut all: Vec<u32> =
                self.sources(shell).map(|s| self.model.triangles()[s as usize].material).collect();
            all.sort_unstable();
            all.dedup();
            all
        };
        let own = materials(&shells[hull]);
        if outward().all(|s| materials(s).iter().all(|m| !own.contains(m))) {
            return true;
        }
        let color = |t: u32| self.model.color_at(self.topology.source[t as usize], [1.0 / 3.0; 3], 0.0);
        let mut colors = samples(&shells[hull]).map(color);
        let Some(first) = colors.next() else { return false };
        let alike = |c: [f32; 3]| (0..3).all(|k| (c[k] - first[k]).abs() < SEEN);
        colors.all(alike) && outward().all(|s| share(samples(s).map(color), alike) < 0.5)
    }
}

/// Triangles of a shell, evenly spaced.
fn samples(shell: &Shell) -> impl Iterator<Item = u32> {
    shell.triangles.iter().step_by(shell.triangles.len().div_ceil(SAMPLES)).copied()
}

fn share<T>(items: impl Iterator<Item = T>, holds: impl Fn(T) -> bool) -> f64 {
    let (mut all, mut some) = (0u32, 0u32);
    for item in items {
        all += 1;
        some += u32::from(holds(item));
    }
    if all == 0 { 0.0 } else { f64::from(some) / f64::from(all) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::BaseColor;
    use crate::shapes::Shape;

    const RED: [f32; 3] = [0.8, 0.1, 0.05];
    const BLACK: [f32; 3] = [0.02; 3];

    /// Shapes with a colour and a material each.
    fn scene(parts: &[(Shape, [f32; 3], u32)], double_sided: &[u32]) -> Model {
        let mut all = Shape::default();
        let mut of = Vec::new();
        for (part, color, material) in parts {
            all = all.and(part);
            of.extend(part.triangles.iter().map(|_| (*color, *material)));
        }
        let plain = all.colored(|i| of[i].0);
        let count = parts.iter().map(|p| p.2).max().unwrap() + 1;
        let material = |m| BaseColor {
            name: format!("paint {m}"),
            factor: [1.0; 4],
            texture: None,
            double_sided: double_sided.contains(&m),
        };
        let mut triangles = plain.triangles().to_vec();
        triangles.iter_mut().zip(&of).for_each(|(t, o)| t.material = o.1);
        let materials = (0..count).map(material).collect();
        Model::new("scene", plain.vertices().to_vec(), triangles, materials, vec![]).unwrap()
    }

    fn kept(model: Model) -> (usize, usize) {
        let (model, notes) = without_hulls(model);
        (model.triangles().len(), notes.len())
    }

    #[test]
    fn hulls_of_any_thickness_are_left_out() {
        let body = Shape::sphere([0.5, 0.0, 0.2], 1.0, 3);
        let n = body.triangles.len();
        for thickness in [1e-3, 0.01, 0.03, 0.1, 0.4] {
            let hull = Shape::sphere([0.5, 0.0, 0.2], 1.0 + thickness, 3).inverted();
            let (body, hull) = ((body.clone(), RED), (hull, BLACK));
            // A material of its own, or a colour of its own; in either order.
            for other in [1, 0] {
                let (body, hull) = ((body.0.clone(), RED, 0), (hull.0.clone(), BLACK, other));
                assert_eq!(kept(scene(&[body.clone(), hull.clone()], &[])), (n, 1), "{thickness} {other}");
                assert_eq!(kept(scene(&[hull.clone(), body.clone()], &[])), (n, 1), "{thickness} {other}");
                // Seen from both sides it is a skin.
                let skin = scene(&[body, hull], &[other]);
                assert_eq!(kept(skin), (2 * n, 0), "{thickness} {other}");
            }
        }
    }

    #[test]
    fn hulls_around_several_bodies_and_with_a_small_hole_are_left_out() {
        let bodies = [0.0, 3.0].map(|x| Shape::sphere([x, 0.0, 0.0], 1.0, 3));
        let hulls = [0.0, 3.0].map(|x| Shape::sphere([x, 0.0, 0.0], 1.05, 3).inverted());
        let around = Shape::cuboid([-2.0; 3], [6.0, 3.0, 3.0]).inverted();
        let n = 2 * bodies[0].triangles.len();
        let parts = |hulls: &[Shape]| {
            let hulls = hulls.iter().map(|h| (h.clone(), BLACK, 1));
            scene(&bodies.iter().map(|b| (b.clone(), RED, 0)).chain(hulls).collect::<Vec<_>>(), &[])
        };
        assert_eq!(kept(parts(&hulls)), (n, 1));
        assert_eq!(kept(parts(std::slice::from_ref(&around))), (n, 1));
        assert_eq!(kept(parts(&hulls.clone().map(|h| h.keeping(|i, _| i % 30 > 0)))), (n, 1));
        // An open box shows its inside.
        let open = around.keeping(|_, t| t.iter().any(|p| p[2] < 3.0));
        assert_eq!(kept(parts(&[open])).1, 0);
    }

    #[test]
    fn what_is_inside_out_altogether_is_no_hull() {
        let hollow = Shape::sphere([0.0; 3], 1.0, 3).and(&Shape::sphere([0.0; 3], 0.8, 3).inverted());
        let n = hollow.triangles.len();
        assert_eq!(kept(scene(&[(hollow.clone().inverted(), RED, 0)], &[])), (n, 0));
        assert_eq!(kept(scene(&[(hollow, RED, 0)], &[])), (n, 0));
        // A figure with eyes, each part with its material.
        let parts = [
            (Shape::sphere([0.0; 3], 1.0, 3).inverted(), RED, 0),
            (Shape::sphere([0.0, 0.0, 0.8], 0.1, 2).inverted(), BLACK, 1),
        ];
        assert_eq!(kept(scene(&parts, &[])).1, 0);
        // A cavity of another colour in a body stays one.
        let lined = [
            (Shape::sphere([0.0; 3], 1.0, 3), RED, 0),
            (Shape::sphere([0.0; 3], 0.8, 3).inverted(), BLACK, 1),
            (Shape::sphere([0.0; 3], 0.3, 3), RED, 0),
        ];
        assert_eq!(kept(scene(&lined, &[])).1, 0);
    }
}
