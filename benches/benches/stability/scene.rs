//! Solids of one or two materials, in voxels and in double precision.

use pellucid::trace::{
    AnalyticScene, Boundary, Estimate, Medium, Optics, Shape, TraceOptions, Tracer, Volume,
};
use pellucid::voxel::{
    Control, Frame, LabelGrid, Material, MaterialTable, Pitch, Surface, SurfaceOptions, Tile,
};

use super::Error;

/// Scattering and absorption per mm, and the phase function's mean cosine.
pub type Row = (f64, f64, f64);

/// How a solid is filled.
#[derive(Clone, Copy)]
pub enum Filling {
    /// The first material.
    One,
    /// Voxels of the first and of the second material by turns, along every axis; the pitch must be cubic.
    Checkerboard,
}

/// A box of voxels.
pub struct Solid {
    pub pitch_mm: [f64; 3],
    pub voxels: [u32; 3],
    pub rows: Vec<Row>,
    pub filling: Filling,
    pub boundary: Boundary,
}

/// A dielectric surface.
pub fn index(n: f64) -> Result<Boundary, Error> {
    Ok(Boundary::with_index(n)?)
}

impl Solid {
    /// A box of one material at a pitch of 0.05 mm.
    pub fn of(size_mm: [f64; 3], row: Row, boundary: Boundary) -> Self {
        let voxels = size_mm.map(|mm| (mm / 0.05).round() as u32);
        Self { pitch_mm: [0.05; 3], voxels, rows: vec![row], filling: Filling::One, boundary }
    }

    pub fn options(&self, spp: u32, seed: u64) -> TraceOptions {
        TraceOptions { spp, seed, boundary: self.boundary, ..TraceOptions::default() }
    }

    /// Its materials, of one channel.
    pub fn materials(&self) -> Result<MaterialTable, Error> {
        let materials = self.rows.iter().enumerate().map(|(i, &(s, a, g))| Material {
            name: format!("m{i}"),
            sigma_s: vec![s as f32],
            sigma_a: vec![a as f32],
            g: (g as f32).into(),
        });
        Ok(MaterialTable::new(vec!["light".to_owned()], materials.collect())?)
    }

    /// Its voxels.
    pub fn grid(&self) -> Result<LabelGrid, Error> {
        let frame = Frame::new([0.0; 3], Pitch::new(self.pitch_mm)?, self.voxels)?;
        Ok(match self.filling {
            Filling::One => LabelGrid::from_tiles(frame, |_| Tile::Constant(1)),
            Filling::Checkerboard => LabelGrid::from_fn(frame, |v| 1 + (v.iter().sum::<u32>() % 2) as u8),
        })
    }

    /// Its voxels ready to trace, and the surface voxel in the middle of the top.
    pub fn traced(&self, control: &Control<'_>) -> Result<(Volume, u32), Error> {
        let grid = self.grid()?;
        let surface = Surface::extract(&grid, &SurfaceOptions::default(), control)?;
        let size = grid.size();
        let top = surface.index_of([size[0] / 2, size[1] / 2, size[2] - 1]).ok_or("no top")?;
        Ok((Volume::new(&grid, &surface, control)?, top))
    }

    /// Radiance and standard error by the tracer's kernel.
    pub fn radiance(&self, spp: u32, seed: u64, control: &Control<'_>) -> Result<[f64; 2], Error> {
        let (volume, top) = self.traced(control)?;
        let materials = self.materials()?;
        let tracer = Tracer::new(&volume, &materials, self.options(spp, seed))?;
        let (mut l, mut e) = ([0.0], [0.0]);
        tracer.radiance_with_error(&[top], 0, &mut l, &mut e, control)?;
        Ok([f64::from(l[0]), f64::from(e[0])])
    }

    /// The same in double precision and without voxels, coefficients multiplied by `scale`.
    pub fn exact(&self, scale: f64, spp: u32, seed: u64, control: &Control<'_>) -> Result<Estimate, Error> {
        let edge = |a: usize| self.pitch_mm[a] * f64::from(self.voxels[a]);
        let size: [f64; 3] = std::array::from_fn(edge);
        // Coefficients as the kernel has them.
        let rows = self.rows.iter().map(|&(s, a, g)| Optics {
            sigma_s: scale * f64::from(s as f32),
            sigma_a: scale * f64::from(a as f32),
            g,
        });
        let medium = match self.filling {
            Filling::One => Medium::Homogeneous(0),
            Filling::Checkerboard => Medium::Checkerboard { cell_mm: self.pitch_mm[0], even: 0, odd: 1 },
        };
        let shape = Shape::Box { min_mm: [0.0; 3], max_mm: size };
        let scene = AnalyticScene::new(shape, medium, rows.collect())?;
        let middle = |a: usize| self.pitch_mm[a] * (f64::from(self.voxels[a] / 2) + 0.5);
        let point = [middle(0), middle(1), size[2]];
        Ok(scene.radiance(point, [0.0, 0.0, 1.0], &self.options(spp, seed), control)?)
    }
}
