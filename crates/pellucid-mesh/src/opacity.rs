//! Where a model is see-through: opacity of its materials, and the bodies that are clear throughout.

use std::collections::HashMap;

use crate::geometry::length;
use crate::{MeshError, Model};

/// Opacity from which a place counts as opaque, where the file says nothing else.
pub const HALF: f32 = 0.5;

/// Most places along an edge at which a triangle's opacity is looked at.
const MAX_PROBES: f64 = 32.0;

/// How opaque a material is: the alpha of its factor, times that of the vertices, times that of a texture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Opacity {
    /// Index into [`Model::textures`] of an image whose channels are the opacity; 1 without it.
    pub texture: Option<u32>,
    /// Places below it are see-through, 0 to 1.
    pub threshold: f32,
}

impl Model {
    /// The same model with how opaque each material is; `None` for a material that is opaque whatever its alpha.
    ///
    /// # Errors
    /// [`MeshError::Invalid`] if there is not one a material, or a texture or threshold is out of range.
    pub fn with_opacity(mut self, opacity: Vec<Option<Opacity>>) -> Result<Self, MeshError> {
        let fail = |reason: &str| {
            Err(MeshError::invalid(self.name(), "opacity", reason, "give one for each material, or none"))
        };
        if opacity.len() != self.materials().len() {
            return fail("there is not one for each material");
        }
        let textures = self.textures().len();
        if opacity.iter().flatten().any(|o| o.texture.is_some_and(|t| t as usize >= textures)) {
            return fail("its texture is out of range");
        }
        if opacity.iter().flatten().any(|o| !(0.0..=1.0).contains(&o.threshold)) {
            return fail("its threshold is not within 0..1");
        }
        self.opacity = opacity;
        Ok(self)
    }

    /// How opaque each material is; empty for a model that is opaque throughout.
    pub fn opacity(&self) -> &[Option<Opacity>] {
        &self.opacity
    }

    /// Whether a surface point is see-through: its opacity, averaged over a patch as [`Model::color_at`] does, lies below
    /// its material's threshold.
    ///
    /// # Panics
    /// If `triangle` is not an index of [`Model::triangles`].
    pub fn is_clear_at(&self, triangle: u32, barycentric: [f64; 3], footprint_m: f64) -> bool {
        let t = self.triangles()[triangle as usize];
        let Some(opacity) = self.opacity.get(t.material as usize).copied().flatten() else { return false };
        let alpha = |k: usize| f64::from(self.vertices()[t.vertices[k] as usize].color[3]);
        let of_vertices: f64 = (0..3).map(|k| barycentric[k] * alpha(k)).sum();
        let mut value = f64::from(self.materials()[t.material as usize].factor[3]) * of_vertices;
        if let Some(texture) = opacity.texture {
            value *= f64::from(self.texel_at(triangle, texture, barycentric, footprint_m)[0]);
        }
        value < f64::from(opacity.threshold)
    }

    /// Whether a triangle is see-through wherever one looks.
    fn is_clear_throughout(&self, triangle: u32) -> bool {
        let material = self.triangles()[triangle as usize].material;
        let Some(opacity) = self.opacity.get(material as usize).copied().flatten() else { return false };
        let corners = self.corners_m(triangle);
        let edges = [(0, 1), (1, 2), (2, 0)];
        let edge = |(a, b): (usize, usize)| length(std::array::from_fn(|k| corners[a][k] - corners[b][k]));
        let longest = edges.map(edge).into_iter().fold(0.0, f64::max);
        let probes = match opacity.texture {
            Some(texture) => self.texels_along(triangle, texture).ceil().clamp(1.0, MAX_PROBES) as u32,
            None => 1,
        };
        let footprint_m = longest / f64::from(probes);
        let share = |i: u32| f64::from(i) / f64::from(probes);
        (0..=probes).all(|i| {
            (0..=probes - i).all(|j| {
                let (a, b) = (share(i), share(j));
                self.is_clear_at(triangle, [a, b, 1.0 - a - b], footprint_m)
            })
        })
    }

    /// Of each triangle, whether it bounds a body that is clear throughout: see-through triangles that close in a volume
    /// by themselves, or that hang together with no opaque one. Other see-through places are windows in a body.
    pub fn clear_bodies(&self) -> Vec<bool> {
        let count = self.triangles().len();
        if self.opacity.iter().all(Option::is_none) {
            return vec![false; count];
        }
        let clear: Vec<bool> = (0..count as u32).map(|t| self.is_clear_throughout(t)).collect();
        let edges = self.edges();
        let mut groups = Groups::new(count);
        for around in edges.values() {
            let clear_here = around.iter().filter(|&&t| clear[t as usize]);
            clear_here.clone().zip(clear_here.skip(1)).for_each(|(&a, &b)| groups.join(a, b));
        }
        // Of a group: whether an edge of it has one triangle of it alone, and whether it touches an opaque one.
        let (mut open, mut touches) = (vec![false; count], vec![false; count]);
        for around in edges.values() {
            let of_clear: Vec<u32> = around.iter().copied().filter(|&t| clear[t as usize]).collect();
            let Some(&first) = of_clear.first() else { continue };
            let group = groups.of(first) as usize;
            open[group] |= of_clear.len() == 1;
            touches[group] |= of_clear.len() < around.len();
        }
        (0..count as u32)
            .map(|t| {
                let group = groups.of(t) as usize;
                clear[t as usize] && !(open[group] && touches[group])
            })
            .collect()
    }

    /// The triangles around every edge, corners at one place being one.
    fn edges(&self) -> HashMap<[u32; 2], Vec<u32>> {
        let mut places: HashMap<[u64; 3], u32> = HashMap::new();
        let mut edges: HashMap<[u32; 2], Vec<u32>> = HashMap::new();
        for t in 0..self.triangles().len() as u32 {
            // Zero has two signs.
            let corners = self.corners_m(t).map(|p| {
                let next = places.len() as u32;
                *places.entry(p.map(|c| (c + 0.0).to_bits())).or_insert(next)
            });
            for (a, b) in [(0, 1), (1, 2), (2, 0)] {
                let (a, b) = (corners[a], corners[b]);
                if a != b {
                    edges.entry([a.min(b), a.max(b)]).or_default().push(t);
                }
            }
        }
        edges
    }
}

/// Triangles that hang together.
struct Groups {
    above: Vec<u32>,
}

impl Groups {
    fn new(count: usize) -> Self {
        Self { above: (0..count as u32).collect() }
    }

    fn of(&mut self, mut t: u32) -> u32 {
        while self.above[t as usize] != t {
            let next = self.above[self.above[t as usize] as usize];
            self.above[t as usize] = next;
            t = next;
        }
        t
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.of(a), self.of(b));
        self.above[a.max(b) as usize] = a.min(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::Shape;
    use crate::{Image, Texture, Triangle};

    /// A cube, and one of an edge of 1 mm beside it.
    fn two_cubes() -> Model {
        let (a, b) =
            (Shape::cuboid([0.0; 3], [2.0; 3]).model(), Shape::cuboid([2.0, 0.0, 0.0], [3.0; 3]).model());
        let base = a.vertices().len() as u32;
        let vertices = [a.vertices(), b.vertices()].concat();
        let moved =
            b.triangles().iter().map(|t| Triangle { vertices: t.vertices.map(|v| v + base), material: 1 });
        let triangles = a.triangles().iter().copied().chain(moved).collect();
        let materials = [a.materials(), b.materials()].concat();
        Model::new("cubes", vertices, triangles, materials, vec![]).unwrap()
    }

    fn see_through(model: Model, material: usize, alpha: f32) -> Model {
        let mut materials = model.materials().to_vec();
        materials[material].factor[3] = alpha;
        let count = materials.len();
        let (vertices, triangles) = (model.vertices().to_vec(), model.triangles().to_vec());
        Model::new("m", vertices, triangles, materials, model.textures().to_vec())
            .and_then(|m| m.with_opacity(vec![Some(Opacity { texture: None, threshold: HALF }); count]))
            .unwrap()
    }

    #[test]
    fn a_body_is_clear_below_one_half_only() {
        for (alpha, clear) in [(0.0, true), (0.49, true), (0.5, false), (1.0, false)] {
            let model = see_through(two_cubes(), 1, alpha);
            let bodies = model.clear_bodies();
            let expected: Vec<bool> = model.triangles().iter().map(|t| clear && t.material == 1).collect();
            assert_eq!(bodies, expected, "{alpha}");
        }
        // Without opacities alpha does not count.
        let mut materials = two_cubes().materials().to_vec();
        materials[1].factor[3] = 0.0;
        let plain = two_cubes();
        let (vertices, triangles) = (plain.vertices().to_vec(), plain.triangles().to_vec());
        let opaque = Model::new("m", vertices, triangles, materials, vec![]).unwrap();
        assert!(opaque.clear_bodies().iter().all(|c| !c));
    }

    #[test]
    fn a_clear_side_of_a_cube_is_a_window_and_no_body() {
        let cube = Shape::cuboid([0.0; 3], [2.0; 3]).model();
        let mut triangles = cube.triangles().to_vec();
        triangles[..2].iter_mut().for_each(|t| t.material = 1);
        let materials = [cube.materials(), cube.materials()].concat();
        let model = Model::new("m", cube.vertices().to_vec(), triangles, materials, vec![]).unwrap();
        let model = see_through(model, 1, 0.0);
        assert!(model.clear_bodies().iter().all(|c| !c));
        assert!(model.is_clear_at(0, [0.2, 0.3, 0.5], 0.0) && !model.is_clear_at(2, [0.2, 0.3, 0.5], 0.0));
    }

    #[test]
    fn a_texture_with_one_opaque_spot_makes_no_clear_body() {
        let mut texels = vec![0; 64 * 64];
        for clear in [true, false] {
            texels[40 * 64 + 20] = if clear { 0 } else { 255 };
            let image = Image::from_linear_grey8(64, 64, texels.clone()).unwrap();
            let texture = Texture::new(image.into(), crate::Sampler::default());
            let cube = Shape::cuboid([0.0; 3], [2.0; 3]).model();
            let uv = |p: [f64; 3]| [(p[0] + p[1]) as f32 * 250.0, (p[2] + p[1]) as f32 * 250.0];
            let vertices =
                cube.vertices().iter().map(|v| crate::Vertex { uv: uv(v.position_m), ..*v }).collect();
            let count = cube.materials().len();
            let model = Model::new(
                "m",
                vertices,
                cube.triangles().to_vec(),
                cube.materials().to_vec(),
                vec![texture],
            )
            .and_then(|m| m.with_opacity(vec![Some(Opacity { texture: Some(0), threshold: 0.01 }); count]))
            .unwrap();
            assert_eq!(model.clear_bodies().iter().all(|c| *c), clear);
        }
    }

    #[test]
    fn opacities_out_of_range_are_refused() {
        let opacity = |texture, threshold| vec![Some(Opacity { texture, threshold }); 2];
        for bad in [vec![None], opacity(Some(0), 0.5), opacity(None, f32::NAN), opacity(None, 1.5)] {
            assert!(matches!(two_cubes().with_opacity(bad), Err(MeshError::Invalid { .. })));
        }
    }
}
