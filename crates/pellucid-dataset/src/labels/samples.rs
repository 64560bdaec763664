//! Labelled samples of one volume.

use pellucid_halftone::RankedNoise;
use pellucid_stencil::{Coefficients, Features, StencilSpec, Stencils};
use pellucid_trace::{Boundary, ErrorTarget, TraceOptions, Tracer, Volume};
use pellucid_voxel::{Control, CountSat, LabelGrid, Material, MaterialTable, Surface, SurfaceOptions, Tile};
use rand_core::Rng;
use rand_pcg::Pcg64;

use super::half_stencils::HalfStencils;
use crate::volume::fill;
use crate::volume::texture::halftone_noise;
use crate::{DatasetError, Recipe, Split};

/// Points whose stencils are extracted at a time.
const CHUNK: usize = 256;

/// How a point is labelled: how many paths its radiance takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Labelling {
    /// A fixed number for each point and channel.
    Paths(u32),
    /// As many as bring the standard error to a target.
    Error(ErrorTarget),
}

impl Labelling {
    /// What a split asks for.
    pub fn of(split: &Split) -> Self {
        match split.std_error {
            Some(std_error) => Self::Error(ErrorTarget { std_error, max_spp: split.spp.max(32) }),
            None => Self::Paths(split.spp),
        }
    }
}

/// Labelled points of one volume.
#[derive(Clone, Debug, PartialEq)]
pub struct Samples {
    /// A checksum of the volume's labels.
    pub digest: u64,
    /// The points' voxels `[x, y, z]`.
    pub voxels: Vec<[u32; 3]>,
    /// Ordered `[point][channel][level][z][y][x][feature]`, 1/mm.
    pub stencils: HalfStencils,
    /// Ordered `[point][channel]`, within 0..=1.
    pub radiance: Vec<f32>,
    /// Standard errors of `radiance`.
    pub std_error: Vec<f32>,
}

/// Makes the labelled samples of the volumes of one split. Everything follows from the recipe, the split, the
/// materials and the boundary.
#[derive(Clone, Debug)]
pub struct Sampler {
    recipe: Recipe,
    split: Split,
    materials: MaterialTable,
    coefficients: Coefficients,
    boundary: Boundary,
    blue: RankedNoise,
}

impl Sampler {
    /// A sampler for `split`, of `materials` of which the last is white, thinned or thickened by the split's
    /// density.
    ///
    /// # Errors
    /// [`DatasetError::Invalid`] for a recipe out of range or a split that it lacks.
    pub fn new(
        recipe: &Recipe,
        split: &str,
        materials: &MaterialTable,
        boundary: Boundary,
    ) -> Result<Self, DatasetError> {
        recipe.check()?;
        let split = recipe.split(split)?.clone();
        let factor = |values: &[f32]| values.iter().map(|v| (f64::from(*v) * split.density) as f32).collect();
        let scaled = materials.materials().iter().map(|m| Material {
            name: m.name.clone(),
            sigma_s: factor(&m.sigma_s),
            sigma_a: factor(&m.sigma_a),
            g: m.g,
        });
        let materials = MaterialTable::new(materials.channel_names().to_vec(), scaled.collect())?;
        let coefficients = Coefficients::all(&materials, Features::ScatterAbsorb)?;
        let blue = halftone_noise(recipe.pitch);
        Ok(Self { recipe: recipe.clone(), split, materials, coefficients, boundary, blue })
    }

    /// The split.
    pub fn split(&self) -> &Split {
        &self.split
    }

    /// The materials with the split's density.
    pub fn materials(&self) -> &MaterialTable {
        &self.materials
    }

    /// Channels, each a sample a point.
    pub fn channels(&self) -> usize {
        self.materials.channels()
    }

    /// Draws `points` surface voxels of a volume, uniformly and with repeats, and labels them.
    ///
    /// # Errors
    /// [`DatasetError::Cancelled`]; others when the volume cannot be built, which takes a recipe at the edge
    /// of its ranges.
    pub fn samples(
        &self,
        volume: u32,
        points: u32,
        labels: Labelling,
        control: &Control<'_>,
    ) -> Result<Samples, DatasetError> {
        let grid = self.grid(volume)?;
        let surface = Surface::extract(&grid, &SurfaceOptions::default(), control)?;
        if surface.is_empty() {
            return Err(DatasetError::invalid(
                format!("volume {volume} of split {:?}", self.split.name),
                "has no solid voxel; use a finer pitch or larger solids",
            ));
        }
        let mut rng = self.recipe.rng(&self.split, volume, 1);
        let chosen: Vec<u32> = (0..points).map(|_| (rng.next_u64() % surface.len() as u64) as u32).collect();
        let voxels: Vec<[u32; 3]> = chosen.iter().map(|&p| surface.voxels()[p as usize]).collect();

        let stencils = self.stencils(&grid, &voxels, control)?;
        let traced = Volume::new(&grid, &surface, control)?;
        let spp = if let Labelling::Paths(spp) = labels { spp } else { 1 };
        let options =
            TraceOptions { spp, seed: rng.next_u64(), boundary: self.boundary, ..Default::default() };
        let tracer = Tracer::new(&traced, &self.materials, options)?;
        let mut radiance = vec![0.0; chosen.len() * self.channels()];
        let mut std_error = radiance.clone();
        match labels {
            Labelling::Paths(_) => {
                tracer.radiance_with_error(&chosen, 0, &mut radiance, &mut std_error, control)?;
            }
            Labelling::Error(target) => {
                // Paths of their own: comparisons with the other kind of label are independent.
                tracer.radiance_to(&chosen, 1, target, &mut radiance, &mut std_error, control)?;
            }
        }
        Ok(Samples { digest: digest(&grid), voxels, stencils, radiance, std_error })
    }

    /// The voxels of a volume.
    ///
    /// # Errors
    /// As [`Sampler::samples`].
    pub fn grid(&self, volume: u32) -> Result<LabelGrid, DatasetError> {
        let (shape, texture) = self.recipe.draw(&self.split, volume, self.materials.len());
        Ok(fill(&shape, &texture, self.recipe.pitch, &self.blue)?)
    }

    /// The stencils of some voxels of a volume, ordered as [`Samples::stencils`].
    ///
    /// # Errors
    /// [`DatasetError::Invalid`] when a voxel lies outside the grid, [`DatasetError::Cancelled`].
    pub fn stencils(
        &self,
        grid: &LabelGrid,
        voxels: &[[u32; 3]],
        control: &Control<'_>,
    ) -> Result<HalfStencils, DatasetError> {
        let sat = CountSat::build(grid, self.materials.len(), control)?;
        let stencils = Stencils::new(StencilSpec::paper(), grid, &sat)?;
        let row = self.coefficients.values_per_point(stencils.spec());
        let mut out = HalfStencils::zeros(voxels.len() * self.channels());
        let mut buffer = vec![0.0; voxels.len().min(CHUNK) * row];
        // Neighbours are cheaper together.
        let order = pellucid_stencil::near_order(voxels);
        for order in order.chunks(CHUNK) {
            let part: Vec<[u32; 3]> = order.iter().map(|&i| voxels[i as usize]).collect();
            let buffer = &mut buffer[..part.len() * row];
            stencils.extract(&self.coefficients, &part, buffer, control)?;
            for (values, &i) in buffer.chunks_exact(row).zip(order) {
                out.set(i as usize * self.channels(), values);
            }
        }
        Ok(out)
    }
}

/// A checksum of a grid's labels: FNV-1a, tile by tile.
pub(crate) fn digest(grid: &LabelGrid) -> u64 {
    let mut sum = Fnv::new();
    for tile in grid.tiles() {
        match tile {
            Tile::Constant(label) => sum.add(&[*label]),
            Tile::Dense(labels) => sum.add(&labels[..]),
        }
    }
    sum.0
}

/// FNV-1a over words of eight bytes, the last one padded with zeros.
pub(crate) struct Fnv(pub(crate) u64);

impl Fnv {
    pub(crate) fn new() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }

    pub(crate) fn add(&mut self, bytes: &[u8]) {
        for word in bytes.chunks(8) {
            let mut padded = [0; 8];
            padded[..word.len()].copy_from_slice(word);
            self.0 = (self.0 ^ u64::from_le_bytes(padded)).wrapping_mul(0x0100_0000_01b3);
            self.0 ^= self.0 >> 29;
        }
    }
}

/// A random permutation of `0..n`.
pub(crate) fn permutation(n: usize, mut rng: Pcg64) -> Vec<u32> {
    let mut order: Vec<u32> = (0..n as u32).collect();
    for i in (1..n).rev() {
        order.swap(i, (rng.next_u64() % (i as u64 + 1)) as usize);
    }
    order
}
