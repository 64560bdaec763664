//! Depth layers below the surface, and how many of them each surface voxel has.

use std::sync::atomic::{AtomicU32, Ordering};

use pellucid_voxel::{LabelGrid, MaterialTable, NearestSurface, Surface, TILE};
use rayon::prelude::*;

use crate::{RefineError, RefineSettings};

/// Layers by depth from centre to centre, thinner near the surface, with the share that each has
/// in the density seen from outside.
#[derive(Clone, Debug)]
pub(crate) struct DepthLayers {
    depth_mm: f32,
    ends_mm: Vec<f32>,
    weights: Vec<[f32; 3]>,
}

/// Growth of the layers' thickness with depth: ends lie at (i / count) to this power.
const SPACING: f64 = 1.5;

impl DepthLayers {
    /// Layers whose weight falls off exponentially with `reach_mm` per colour.
    pub fn new(settings: &RefineSettings, reach_mm: [f64; 3]) -> Self {
        let count = settings.layers as usize;
        let end = |i: usize| settings.coloured_depth_mm * (i as f64 / count as f64).powf(SPACING);
        let total = reach_mm.map(|r| 1.0 - (-settings.coloured_depth_mm / r).exp());
        let weights = (0..count)
            .map(|i| {
                std::array::from_fn(|c| {
                    let left = |z: f64| (-z / reach_mm[c]).exp();
                    (((left(end(i)) - left(end(i + 1))) / total[c]) as f32).max(1e-6)
                })
            })
            .collect();
        Self {
            depth_mm: settings.coloured_depth_mm as f32,
            ends_mm: (1..=count).map(|i| end(i) as f32).collect(),
            weights,
        }
    }

    /// Number of layers.
    pub fn count(&self) -> usize {
        self.ends_mm.len()
    }

    /// The share of each layer in the density of each colour; sums to 1.
    pub fn weights(&self) -> &[[f32; 3]] {
        &self.weights
    }

    /// The layer of a depth in mm; `None` past the coloured depth.
    #[inline]
    pub fn layer(&self, depth_mm: f32) -> Option<usize> {
        (depth_mm < self.depth_mm)
            .then(|| self.ends_mm.iter().position(|&end| depth_mm < end).unwrap_or(self.count() - 1))
    }
}

/// The depth per colour in mm over which colour below a white surface counts: a few transport
/// mean free paths of the white.
pub(crate) fn reach_mm(materials: &MaterialTable, white: u8, factor: f64) -> Result<[f64; 3], RefineError> {
    let material = materials.get(white).ok_or_else(|| {
        RefineError::invalid("ink labels", format!("the white label {white} is not among the materials"))
    })?;
    let transport = |c: usize| {
        let s = f64::from(material.sigma_s[c]) * (1.0 - f64::from(material.g));
        s + f64::from(material.sigma_a[c])
    };
    let channels = materials.channels();
    // Channels of a spectrum run from blue to red; three are R, G, B.
    let of = |c: usize| if channels == 3 { c } else { (2 - c) * (channels - 1) / 2 };
    Ok(std::array::from_fn(|c| (factor / transport(of(c)).max(1e-3)).clamp(0.02, 10.0)))
}

/// Depth in mm and layer of voxel `voxel` below surface voxel `of`.
#[inline]
pub(crate) fn depth_mm(voxel: [u32; 3], of: [u32; 3], pitch: [f32; 3]) -> f32 {
    let square = |a: usize| ((voxel[a] as f32 - of[a] as f32) * pitch[a]).powi(2);
    (square(0) + square(1) + square(2)).sqrt()
}

/// Number of layers down to the deepest voxel that follows each surface voxel, at least 1. Thin
/// parts have fewer than all: there, demand must not be moved below the medial axis.
pub(crate) fn available(
    grid: &LabelGrid,
    surface: &Surface,
    nearest: &NearestSurface,
    layers: &DepthLayers,
) -> Vec<u8> {
    let pitch = grid.frame().pitch().mm().map(|p| p as f32);
    let found: Vec<AtomicU32> = surface.voxels().iter().map(|_| AtomicU32::new(1)).collect();
    let [dx, dy, _] = grid.tile_dims().map(|d| d as usize);
    (0..grid.tiles().len()).into_par_iter().for_each(|t| {
        let Some(entries) = nearest.tile(t) else { return };
        let base = [t % dx, t / dx % dy, t / dx / dy].map(|v| (v * TILE) as u32);
        for (i, &s) in entries.iter().enumerate() {
            if s == NearestSurface::NONE {
                continue;
            }
            let voxel = local(base, i);
            if let Some(layer) = layers.layer(depth_mm(voxel, surface.voxels()[s as usize], pitch)) {
                found[s as usize].fetch_max(layer as u32 + 1, Ordering::Relaxed);
            }
        }
    });
    found.into_iter().map(|f| f.into_inner() as u8).collect()
}

/// The voxel at position `i` of a tile whose first voxel is `base`.
#[inline]
pub(crate) fn local(base: [u32; 3], i: usize) -> [u32; 3] {
    [base[0] + (i % TILE) as u32, base[1] + (i / TILE % TILE) as u32, base[2] + (i / TILE / TILE) as u32]
}
