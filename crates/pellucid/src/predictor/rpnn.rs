//! The appearance network as a predictor.

use std::sync::atomic::{AtomicU64, Ordering};

use pellucid_refine::{AppearancePredictor, PredictError, Scene};
use pellucid_rpnn::file::Provenance;
use pellucid_rpnn::transform::LevelOrder;
use pellucid_rpnn::variant::{CELLS_XYZ, INPUTS, LEVEL_INPUTS, LEVELS};
use pellucid_rpnn::{Inference, Precision, RpnnError, Weights};
use pellucid_stencil::{Coefficients, Features, StencilError, StencilSpec, Stencils, near_order};
use pellucid_voxel::{Control, CountSat, Pitch, VoxelError};
use rayon::prelude::*;

/// Points whose stencils are in memory at a time, a thread: 7 MB in three channels, half of it where they share
/// coarse levels.
const CHUNK: usize = 256;
/// Coefficients that exceed the trained range by less are taken for equal.
const SLACK: f64 = 1.01;
/// Position of the point's own voxel within its stencil.
const CENTRE: usize = 2 * 67;

/// How neighbouring points share what the network makes of their coarse surroundings.
///
/// Points of one cubic block of voxels take the coarse levels of the stencil about the block's central voxel,
/// and their own finest levels. This leaves out most of the work, since coarse cells hardly differ between
/// neighbours; `docs/results/network_error/network_error.md` has what it costs in accuracy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sharing {
    /// Finest levels that every point has for itself, 1 to 8.
    pub fine_levels: usize,
    /// Edge of a block in voxels, odd.
    pub block: u32,
}

impl Default for Sharing {
    /// Three levels of their own, the coarser ones shared by blocks of 5³ voxels.
    fn default() -> Self {
        Self { fine_levels: 3, block: 5 }
    }
}

/// Predicts by the radiance-predicting neural network (Rittig et al. 2021): without noise, in a time that does
/// not depend on how long light travels in the material.
///
/// The same labels give the same values for any number of threads and whatever else is predicted with them.
pub struct Rpnn {
    weights: Weights,
    provenance: Provenance,
    precision: Precision,
    sharing: Option<Sharing>,
    table: Option<CountSat>,
    /// Tiles changed since `table` was up to date; `None` when nobody said.
    changed: Option<Vec<u32>>,
    outside: u64,
}

impl Rpnn {
    /// A predictor with weights and what they were trained for. Points share coarse levels where the weights
    /// read them first.
    pub fn new(weights: Weights, provenance: Provenance, precision: Precision) -> Self {
        let sharing = (provenance.form.order == LevelOrder::CoarseToFine).then(Sharing::default);
        Self { weights, provenance, precision, sharing, table: None, changed: None, outside: 0 }
    }

    /// The same with another way of sharing, or with all levels of every point its own.
    ///
    /// # Errors
    /// [`PredictError`] when the block's edge is even, there are not 1 to 8 fine levels, or the weights read
    /// their levels from fine to coarse.
    pub fn with_sharing(mut self, sharing: Option<Sharing>) -> Result<Self, PredictError> {
        if let Some(s) = sharing {
            if s.block.is_multiple_of(2) || s.block > 255 || !(1..LEVELS).contains(&s.fine_levels) {
                return Err(PredictError::invalid(
                    "sharing",
                    format!("{s:?}; blocks have odd edges up to 255, fine levels are 1 to 8"),
                ));
            }
            if self.provenance.form.order != LevelOrder::CoarseToFine {
                return Err(PredictError::unsupported(
                    "sharing",
                    "the weights read their levels from fine to coarse",
                ));
            }
        }
        self.sharing = sharing;
        Ok(self)
    }

    /// A predictor with the weights that this library carries.
    ///
    /// # Errors
    /// [`RpnnError`] when they are damaged.
    #[cfg(feature = "weights")]
    pub fn shipped() -> Result<Self, RpnnError> {
        let (weights, provenance) = pellucid_rpnn::shipped()?;
        Ok(Self::new(weights, provenance, Precision::Bf16))
    }

    /// What the weights were trained for.
    pub fn provenance(&self) -> &Provenance {
        &self.provenance
    }

    /// Tells whether the weights fit a boundary and voxels.
    ///
    /// # Errors
    /// [`PredictError::Unsupported`] naming what they were trained for.
    pub fn check(&self, refractive_index: f64, pitch: Pitch) -> Result<(), PredictError> {
        let p = &self.provenance;
        if (refractive_index - p.refractive_index).abs() > 1e-3 {
            return Err(PredictError::unsupported(
                "refractive index",
                format!(
                    "{refractive_index}; the network was trained for {}; use the path tracer",
                    p.refractive_index
                ),
            ));
        }
        if pitch.mm().iter().zip(p.pitch_mm).any(|(a, b)| (a / b - 1.0).abs() > 0.01) {
            return Err(PredictError::unsupported(
                "pitch",
                format!(
                    "{:?} mm; the network was trained for {:?} mm; use the path tracer",
                    pitch.mm(),
                    p.pitch_mm
                ),
            ));
        }
        Ok(())
    }

    /// Samples (points times channels) of the last prediction in whose surroundings a coefficient lies outside
    /// the range that the network was trained on.
    pub fn outside_training(&self) -> u64 {
        self.outside
    }

    /// Brings the table up to date with the grid.
    fn refresh(&mut self, scene: &Scene<'_>, control: &Control<'_>) -> Result<CountSat, VoxelError> {
        let materials = scene.materials.len();
        let fits = |t: &CountSat| t.size() == scene.grid.size() && t.materials() == materials;
        match (self.table.take().filter(fits), self.changed.take()) {
            (Some(mut table), Some(tiles)) => {
                table.update(scene.grid, &tiles, control)?;
                Ok(table)
            }
            _ => CountSat::build(scene.grid, materials, control),
        }
    }

    /// Whether a raw stencil, or its finest levels, holds coefficients that training did not: more than its
    /// largest anywhere, or less than its smallest in the point's own voxel. Elsewhere air makes means of any
    /// size below.
    fn is_outside(&self, stencil: &[f32]) -> bool {
        let [s, a] = [self.provenance.sigma_s_range, self.provenance.sigma_a_range];
        let own = &stencil[CENTRE..CENTRE + 2];
        let little = |v: f32, least: f64| f64::from(v) * SLACK < least;
        little(own[0], s[0]) || little(own[1], a[0]) || self.exceeds(stencil)
    }

    /// Whether cells hold more than training's largest coefficients.
    fn exceeds(&self, cells: &[f32]) -> bool {
        let most = |range: [f64; 2]| (range[1] * SLACK) as f32;
        let (most_s, most_a) = (most(self.provenance.sigma_s_range), most(self.provenance.sigma_a_range));
        cells.chunks_exact(2).fold(false, |any, v| any | (v[0] > most_s) | (v[1] > most_a))
    }
}

/// What a thread works with.
struct Work<'a> {
    rpnn: &'a Rpnn,
    coefficients: &'a Coefficients,
    /// All levels, for points on their own and for blocks.
    whole: &'a Stencils<'a>,
    /// The finest levels of points that share the others.
    fine: Option<&'a Stencils<'a>>,
    network: Inference,
    stencils: Vec<f32>,
}

impl Work<'_> {
    /// Radiance of some voxels `[voxel][channel]`, and how many of the values lie outside what training saw.
    fn predict(&mut self, voxels: &[[u32; 3]], size: [u32; 3]) -> Result<(Vec<f32>, u64), PredictError> {
        let mut radiance = vec![0.0; voxels.len() * self.coefficients.channels()];
        let (Some(sharing), Some(fine)) = (self.rpnn.sharing, self.fine) else {
            self.extract(self.whole, voxels)?;
            self.network.radiance(&self.stencils, &mut radiance).map_err(from_rpnn)?;
            let outside = self.stencils.chunks_exact(INPUTS).filter(|s| self.rpnn.is_outside(s)).count();
            return Ok((radiance, outside as u64));
        };
        let mut blocks: Vec<[u32; 3]> = Vec::new();
        let mut block_of = Vec::with_capacity(voxels.len());
        for centre in voxels.iter().map(|v| sharing.centre(*v, size)) {
            if blocks.last() != Some(&centre) {
                blocks.push(centre);
            }
            block_of.push(blocks.len() as u32 - 1);
        }
        let channels = self.coefficients.channels() as u32;
        let places: Vec<u32> =
            block_of.iter().flat_map(|b| (0..channels).map(move |c| b * channels + c)).collect();
        self.extract(self.whole, &blocks)?;
        let coarse = sharing.fine_levels * LEVEL_INPUTS..;
        let beyond: Vec<bool> =
            self.stencils.chunks_exact(INPUTS).map(|s| self.rpnn.exceeds(&s[coarse.clone()])).collect();
        let states = self.network.coarse_states(sharing.fine_levels, &self.stencils).map_err(from_rpnn)?;
        self.extract(fine, voxels)?;
        self.network.radiance_near(&states, &places, &self.stencils, &mut radiance).map_err(from_rpnn)?;
        let samples = self.stencils.chunks_exact(sharing.fine_levels * LEVEL_INPUTS).zip(&places);
        let outside = samples.filter(|(s, p)| self.rpnn.is_outside(s) || beyond[**p as usize]).count();
        Ok((radiance, outside as u64))
    }

    fn extract(&mut self, of: &Stencils<'_>, voxels: &[[u32; 3]]) -> Result<(), PredictError> {
        self.stencils.resize(voxels.len() * self.coefficients.values_per_point(of.spec()), 0.0);
        of.extract(self.coefficients, voxels, &mut self.stencils, &Control::none()).map_err(from_stencil)
    }
}

impl Sharing {
    /// The central voxel of a voxel's block, within a grid of `size`.
    fn centre(self, voxel: [u32; 3], size: [u32; 3]) -> [u32; 3] {
        std::array::from_fn(|a| (voxel[a] / self.block * self.block + self.block / 2).min(size[a] - 1))
    }
}

impl AppearancePredictor for Rpnn {
    fn name(&self) -> &str {
        "rpnn"
    }

    fn predict(
        &mut self,
        scene: &Scene<'_>,
        points: &[u32],
        _: u32,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        let channels = scene.materials.channels();
        if out.len() != points.len() * channels {
            return Err(PredictError::invalid(
                "output",
                format!("{} values for {} points in {channels} channels", out.len(), points.len()),
            ));
        }
        if let Some(p) = points.iter().find(|&&p| p as usize >= scene.surface.len()) {
            return Err(PredictError::invalid(
                "points",
                format!("{p}; the surface has {} voxels", scene.surface.len()),
            ));
        }
        self.check(self.provenance.refractive_index, scene.grid.frame().pitch())?;
        let table = self.refresh(scene, &control.silent())?;
        let coefficients =
            Coefficients::all(scene.materials, Features::ScatterAbsorb).map_err(from_stencil)?;
        let stencils = Stencils::new(StencilSpec::paper(), scene.grid, &table).map_err(from_stencil)?;
        let voxels: Vec<[u32; 3]> = points.iter().map(|&p| scene.surface.voxels()[p as usize]).collect();
        // Points that share a block come one after another, and neighbouring blocks close together.
        let size = scene.grid.size();
        let order = match self.sharing {
            Some(sharing) => near_order(&voxels.iter().map(|v| sharing.centre(*v, size)).collect::<Vec<_>>()),
            None => near_order(&voxels),
        };
        let fine = match self.sharing {
            Some(sharing) => {
                let spec = StencilSpec::new(CELLS_XYZ, sharing.fine_levels).map_err(from_stencil)?;
                Some(Stencils::new(spec, scene.grid, &table).map_err(from_stencil)?)
            }
            None => None,
        };
        let (done, outside) = (AtomicU64::new(0), AtomicU64::new(0));
        let network =
            Inference::new(&self.weights, self.provenance.form, self.precision).map_err(from_rpnn)?;

        let predicted = order
            .par_chunks(CHUNK)
            .map_init(
                || Work {
                    rpnn: self,
                    coefficients: &coefficients,
                    whole: &stencils,
                    fine: fine.as_ref(),
                    network: network.clone(),
                    stencils: Vec::new(),
                },
                |work, chunk| -> Result<Vec<f32>, PredictError> {
                    control.check()?;
                    let near: Vec<[u32; 3]> = chunk.iter().map(|&i| voxels[i as usize]).collect();
                    let (radiance, count) = work.predict(&near, size)?;
                    outside.fetch_add(count, Ordering::Relaxed);
                    control.advance(&done, chunk.len() as u64, points.len() as u64);
                    Ok(radiance)
                },
            )
            .collect::<Result<Vec<_>, _>>()?;
        for (chunk, radiance) in order.chunks(CHUNK).zip(&predicted) {
            for (&i, radiance) in chunk.iter().zip(radiance.chunks_exact(channels)) {
                out[i as usize * channels..][..channels].copy_from_slice(radiance);
            }
        }
        self.outside = outside.into_inner();
        self.table = Some(table);
        Ok(())
    }

    fn tiles_changed(&mut self, tiles: &[u32]) {
        let mut all = self.changed.take().unwrap_or_default();
        all.extend_from_slice(tiles);
        all.sort_unstable();
        all.dedup();
        self.changed = Some(all);
    }
}

fn from_stencil(error: StencilError) -> PredictError {
    match error {
        StencilError::Cancelled => PredictError::Cancelled,
        other => PredictError::failed("rpnn", other),
    }
}

fn from_rpnn(error: RpnnError) -> PredictError {
    PredictError::failed("rpnn", error)
}
