//! The appearance network as a predictor.

use std::sync::atomic::{AtomicU64, Ordering};

use pellucid_refine::{AppearancePredictor, PredictError, Scene};
use pellucid_rpnn::file::Provenance;
use pellucid_rpnn::variant::INPUTS;
use pellucid_rpnn::{Inference, Precision, RpnnError, Weights};
use pellucid_stencil::{Coefficients, Features, StencilError, StencilSpec, Stencils, near_order};
use pellucid_voxel::{Control, CountSat, Pitch, VoxelError};
use rayon::prelude::*;

/// Points whose stencils are in memory at a time, a thread: 7 MB in three channels.
const CHUNK: usize = 256;
/// Coefficients that exceed the trained range by less are taken for equal.
const SLACK: f64 = 1.01;
/// Position of the point's own voxel within its stencil.
const CENTRE: usize = 2 * 67;

/// Predicts by the radiance-predicting neural network (Rittig et al. 2021): without noise, in a time that does
/// not depend on how long light travels in the material.
///
/// The same labels give the same values for any number of threads and whatever else is predicted with them.
pub struct Rpnn {
    weights: Weights,
    provenance: Provenance,
    precision: Precision,
    table: Option<CountSat>,
    /// Tiles changed since `table` was up to date; `None` when nobody said.
    changed: Option<Vec<u32>>,
    outside: u64,
}

impl Rpnn {
    /// A predictor with weights and what they were trained for.
    pub fn new(weights: Weights, provenance: Provenance, precision: Precision) -> Self {
        Self { weights, provenance, precision, table: None, changed: None, outside: 0 }
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

    /// Whether a raw stencil holds coefficients that training did not: more than its largest anywhere, or less
    /// than its smallest in the point's own voxel. Elsewhere air makes means of any size below.
    fn is_outside(&self, stencil: &[f32]) -> bool {
        let [s, a] = [self.provenance.sigma_s_range, self.provenance.sigma_a_range];
        let (most_s, most_a) = ((s[1] * SLACK) as f32, (a[1] * SLACK) as f32);
        let own = &stencil[CENTRE..CENTRE + 2];
        let little = |v: f32, least: f64| f64::from(v) * SLACK < least;
        little(own[0], s[0])
            || little(own[1], a[0])
            || stencil.chunks_exact(2).fold(false, |any, v| any | (v[0] > most_s) | (v[1] > most_a))
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
        let order = near_order(&voxels);
        let (done, outside) = (AtomicU64::new(0), AtomicU64::new(0));
        let network =
            Inference::new(&self.weights, self.provenance.form, self.precision).map_err(from_rpnn)?;

        let predicted = order
            .par_chunks(CHUNK)
            .map_init(
                || (network.clone(), vec![0.0f32; CHUNK * channels * INPUTS]),
                |(network, values), chunk| -> Result<Vec<f32>, PredictError> {
                    control.check()?;
                    let near: Vec<[u32; 3]> = chunk.iter().map(|&i| voxels[i as usize]).collect();
                    let values = &mut values[..chunk.len() * channels * INPUTS];
                    stencils
                        .extract(&coefficients, &near, values, &control.silent())
                        .map_err(from_stencil)?;
                    let mut radiance = vec![0.0; chunk.len() * channels];
                    network.radiance(values, &mut radiance).map_err(from_rpnn)?;
                    let count = values.chunks_exact(INPUTS).filter(|v| self.is_outside(v)).count();
                    outside.fetch_add(count as u64, Ordering::Relaxed);
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
        StencilError::Voxel(e) => e.into(),
        other => PredictError::failed("rpnn", other),
    }
}

fn from_rpnn(error: RpnnError) -> PredictError {
    PredictError::failed("rpnn", error)
}
