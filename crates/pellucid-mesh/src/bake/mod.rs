//! A mesh with one new texture: from colours of its surface to an image and the UV map that goes with it.
//!
//! The model's own UV map is kept where each texel of it lies on one place of the surface. Where it overlaps, tiles or
//! spans several textures, or where there is none, every triangle gets a place of its own in a new atlas.

mod atlas;
mod raster;

use std::sync::atomic::AtomicU64;

use pellucid_voxel::Control;
use rayon::prelude::*;

use crate::geometry::{Vec3, area_vector, length, scale};
use crate::{MeshError, PlacedMesh};
use raster::{NOTHING, Raster};

/// Where each corner of a triangle lies in an image: 0 to 1, from its upper left corner.
pub type CornerUv = [[f64; 2]; 3];

/// How fine a baked texture is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BakeOptions {
    /// Edge of a texel of a new atlas on the surface, in mm, above 0.
    pub texel_mm: f64,
    /// Longest edge of the image in texels, 16 to 16384; coarser texels are taken where that does not suffice.
    pub max_edge: u32,
}

impl Default for BakeOptions {
    fn default() -> Self {
        Self { texel_mm: 0.05, max_edge: 8192 }
    }
}

/// A place of the surface whose colour is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Its triangle.
    pub triangle: u32,
    /// Weights of the triangle's corners.
    pub barycentric: [f64; 3],
    /// In print space.
    pub position_mm: [f64; 3],
    /// The triangle's unit normal as the file has it; zero for a triangle without area.
    pub normal: [f64; 3],
    /// Edge of a texel here, in metres of the model, for [`Model::color_at`](crate::Model::color_at).
    pub footprint_m: f64,
}

/// A triangle mesh in print space with one texture.
#[derive(Clone, Debug, PartialEq)]
pub struct TexturedMesh {
    /// The model's name.
    pub name: String,
    /// In mm, z up.
    pub positions_mm: Vec<[f64; 3]>,
    /// Corners as positions in `positions_mm`.
    pub triangles: Vec<[u32; 3]>,
    /// By triangle.
    pub uv: Vec<CornerUv>,
    /// Whether the model's own UV map was kept.
    pub own_uv_map: bool,
    /// Width and height of the image.
    pub size: [u32; 2],
    /// sRGB, row by row from the top.
    pub texels: Vec<[u8; 3]>,
}

impl PlacedMesh<'_> {
    /// Bakes colours into a texture. `color` gives linear RGB, 0 to 1, of a point of the surface, and is asked once a
    /// texel. Progress counts rows of texels. The result does not depend on the number of threads.
    ///
    /// ```
    /// # use pellucid_mesh::{BaseColor, Model, PlacedMesh, Scale, Triangle, Vertex, bake::BakeOptions};
    /// # use pellucid_voxel::Control;
    /// # let vertex = |x: f64, y: f64| Vertex { position_m: [x, y, 0.0], uv: [0.0; 2], color: [1.0; 4] };
    /// # let vertices = vec![vertex(0.0, 0.0), vertex(0.01, 0.0), vertex(0.0, 0.01)];
    /// # let white = BaseColor { name: String::new(), factor: [1.0; 4], texture: None, double_sided: true };
    /// # let triangles = vec![Triangle { vertices: [0, 1, 2], material: 0 }];
    /// # let model = Model::new("plate", vertices, triangles, vec![white], vec![])?;
    /// let placed = PlacedMesh::new(&model, Scale::Native)?;
    /// // Lighter to the right; the model has no UV map, so that it gets one.
    /// let shade = |at: &pellucid_mesh::bake::SurfacePoint| [(at.position_mm[0] / 10.0) as f32; 3];
    /// let baked = placed.bake(&BakeOptions::default(), shade, &Control::none())?;
    /// assert!(!baked.own_uv_map && baked.size[0] >= 200);
    /// # Ok::<(), pellucid_mesh::MeshError>(())
    /// ```
    ///
    /// # Errors
    /// [`MeshError::Invalid`] for options out of range, [`MeshError::Unsupported`] where the triangles do not fit into
    /// the largest image, [`MeshError::Cancelled`].
    pub fn bake(
        &self,
        options: &BakeOptions,
        color: impl Fn(&SurfacePoint) -> [f32; 3] + Sync,
        control: &Control<'_>,
    ) -> Result<TexturedMesh, MeshError> {
        let model = self.model();
        let fault = |object: &str, reason: String, remedy: &str| {
            Err(MeshError::invalid(model.name(), object, reason, remedy))
        };
        if !(options.texel_mm.is_finite() && options.texel_mm > 0.0) {
            return fault(
                "texel",
                format!("{} mm", options.texel_mm),
                "give a positive number of millimetres",
            );
        }
        if !(16..=16384).contains(&options.max_edge) {
            return fault("texture edge", format!("{} texels", options.max_edge), "give 16 to 16384");
        }
        let corners: Vec<[Vec3; 3]> = (0..model.triangles().len() as u32)
            .map(|t| model.corners_m(t).map(|p| self.placement().to_mm(p)))
            .collect();
        let (raster, own_uv_map) = match self.own_map(options, &corners, control)? {
            Some(raster) => (raster, true),
            None => (atlas::pack(model.name(), &corners, options, control)?, false),
        };
        let texels = self.paint(&raster, &corners, color, control)?;
        let positions_mm = model.vertices().iter().map(|v| self.placement().to_mm(v.position_m)).collect();
        let Raster { size, uv, .. } = raster;
        let uv = uv.iter().map(|t| t.map(|[u, v]| [u / f64::from(size[0]), v / f64::from(size[1])]));
        Ok(TexturedMesh {
            name: model.name().to_owned(),
            positions_mm,
            triangles: model.triangles().iter().map(|t| t.vertices).collect(),
            uv: uv.collect(),
            own_uv_map,
            size,
            texels,
        })
    }

    /// The model's own map at the size of its texture, or finer where the surface needs it; `None` where texels would
    /// lie on several places or outside the image.
    fn own_map(
        &self,
        options: &BakeOptions,
        corners: &[[Vec3; 3]],
        control: &Control<'_>,
    ) -> Result<Option<Raster>, MeshError> {
        let model = self.model();
        let mut texture = None;
        for triangle in model.triangles() {
            let own = model.materials()[triangle.material as usize].texture;
            if own.is_none() || *texture.get_or_insert(own) != own {
                return Ok(None);
            }
        }
        let Some(texture) = texture.flatten() else { return Ok(None) };
        let uv: Vec<CornerUv> = model
            .triangles()
            .iter()
            .map(|t| t.vertices.map(|v| model.vertices()[v as usize].uv.map(f64::from)))
            .collect();
        if uv.iter().flatten().flatten().any(|c| !(-1e-4..=1.0 + 1e-4).contains(c)) {
            return Ok(None);
        }
        // Triangles with an area but none in the image show one texel all over.
        let flat = |(uv, corners): (&CornerUv, &[Vec3; 3])| {
            crate::geometry::has_area(*corners) && raster::area(uv).abs() < 1e-12
        };
        if uv.iter().zip(corners).any(flat) {
            return Ok(None);
        }
        let [width, height] = model.textures()[texture as usize].size();
        let surface: f64 = corners.iter().map(|c| length(area_vector(*c))).sum();
        let covered: f64 = uv.iter().map(|uv| raster::area(uv).abs()).sum();
        let texels = covered * f64::from(width) * f64::from(height);
        let finer = (surface / options.texel_mm.powi(2) / texels.max(1.0)).sqrt().max(1.0);
        let most = f64::from(options.max_edge) / f64::from(width.max(height));
        let scale = finer.min(most);
        let size = [width, height].map(|edge| ((f64::from(edge) * scale).round() as u32).max(1));
        if size.iter().any(|edge| *edge > options.max_edge) {
            return Ok(None);
        }
        let mut raster = Raster::new(size, uv);
        let overlaps = raster.cover(control)?;
        if overlaps {
            return Ok(None);
        }
        raster.spread(control)?;
        Ok(Some(raster))
    }

    fn paint(
        &self,
        raster: &Raster,
        corners: &[[Vec3; 3]],
        color: impl Fn(&SurfacePoint) -> [f32; 3] + Sync,
        control: &Control<'_>,
    ) -> Result<Vec<[u8; 3]>, MeshError> {
        let [width, height] = raster.size;
        let done = AtomicU64::new(0);
        let mut texels = vec![[0u8; 3]; raster.owner.len()];
        let rows = texels.par_chunks_mut(width as usize).zip(raster.owner.par_chunks(width as usize));
        rows.enumerate().try_for_each(|(y, (texels, owners))| {
            control.check()?;
            for (x, (texel, &owner)) in texels.iter_mut().zip(owners).enumerate() {
                if owner == NOTHING {
                    continue;
                }
                let corners = corners[owner as usize];
                let barycentric = raster.barycentric(owner, [x as u32, y as u32]);
                let position_mm =
                    std::array::from_fn(|a| (0..3).map(|k| barycentric[k] * corners[k][a]).sum());
                let vector = area_vector(corners);
                let area = length(vector);
                let normal = if area > 0.0 { scale(vector, 1.0 / area) } else { [0.0; 3] };
                let in_image = raster::area(&raster.uv[owner as usize]).abs();
                let texel_mm = if in_image > 0.0 { (area / in_image).sqrt() } else { 0.0 };
                let footprint_m = texel_mm / self.placement().mm_per_m();
                let point = SurfacePoint { triangle: owner, barycentric, position_mm, normal, footprint_m };
                *texel = color(&point).map(encode);
            }
            control.advance(&done, 1, u64::from(height));
            Ok::<(), MeshError>(())
        })?;
        fill(&mut texels, &raster.owner);
        Ok(texels)
    }
}

/// Texels on no triangle take the mean of the others: smaller copies of the image mix them in.
fn fill(texels: &mut [[u8; 3]], owner: &[u32]) {
    let (mut sum, mut count) = ([0u64; 3], 0u64);
    for (texel, _) in texels.iter().zip(owner).filter(|(_, o)| **o != NOTHING) {
        (0..3).for_each(|c| sum[c] += u64::from(texel[c]));
        count += 1;
    }
    let mean = sum.map(|v| v.checked_div(count).unwrap_or(0) as u8);
    for (texel, _) in texels.iter_mut().zip(owner).filter(|(_, o)| **o == NOTHING) {
        *texel = mean;
    }
}

/// Linear light as an sRGB code (IEC 61966-2-1).
fn encode(linear: f32) -> u8 {
    let v = f64::from(linear).clamp(0.0, 1.0);
    let code = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    (255.0 * code).round() as u8
}

#[cfg(test)]
mod tests;
