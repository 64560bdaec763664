//! Per-channel look-ups by palette position.

use pellucid_voxel::MaterialTable;

use crate::Tracking;
use crate::phase::NEAR_ISOTROPIC;

/// How the kernel samples Henyey-Greenstein cosines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Phase {
    /// One g for every material, away from 0.
    Uniform,
    /// Anything else.
    PerMaterial,
}

/// Scattering and absorption in 1/mm by palette position.
#[derive(Clone, Debug)]
pub(crate) struct Optics16 {
    pub(crate) sigma_s: [f32; 16],
    pub(crate) sigma_a: [f32; 16],
}

impl Optics16 {
    pub(crate) fn new(materials: &MaterialTable, palette: &[u8], channel: usize) -> Self {
        let mut out = Self { sigma_s: [0.0; 16], sigma_a: [0.0; 16] };
        for (p, &label) in palette.iter().enumerate() {
            if let Some(m) = materials.get(label) {
                out.sigma_s[p] = m.sigma_s[channel];
                out.sigma_a[p] = m.sigma_a[channel];
            }
        }
        out
    }
}

/// What a channel's walk looks up by palette position (0 is air). Unused positions are harmless.
#[derive(Clone, Debug)]
pub(crate) struct Coefficients {
    /// Voxel-by-voxel flights with local extinction instead of delta tracking.
    pub(crate) regular: bool,
    /// Mean free path between tentative collisions in mm: one over the majorant, or over the
    /// position's own extinction in regular tracking; at most 1e30. The same in all sixteen lanes
    /// in delta tracking.
    pub(crate) mean_free_path: [f32; 16],
    /// Share of weight kept at a tentative collision, 1 - sigma_a / majorant.
    pub(crate) keep: [f32; 16],
    /// Probability that a tentative collision that is not absorbed scatters.
    pub(crate) scatter: [f32; 16],
    /// One over `scatter`, 0 where that is 0.
    pub(crate) inv_scatter: [f32; 16],
    /// Mean cosine.
    pub(crate) g: [f32; 16],
    pub(crate) phase: Phase,
}

impl Coefficients {
    /// For the labels of `palette` in one channel. The table's own checks keep every coefficient
    /// finite and at least 0.
    pub(crate) fn new(materials: &MaterialTable, palette: &[u8], channel: usize, tracking: Tracking) -> Self {
        let rows: Vec<(f64, f64, f64)> = palette
            .iter()
            .map(|&label| {
                materials.get(label).map_or((0.0, 0.0, 0.0), |m| {
                    (f64::from(m.sigma_s[channel]), f64::from(m.sigma_a[channel]), f64::from(m.g.at(channel)))
                })
            })
            .collect();
        let total = |r: &(f64, f64, f64)| r.0 + r.1;
        let majorant = rows.iter().map(total).fold(0.0, f64::max);
        let least = rows[1..].iter().map(total).fold(majorant, f64::min);
        let regular = match tracking {
            Tracking::Delta => false,
            Tracking::Regular => true,
            Tracking::Auto => majorant > 16.0 * least,
        };
        let mut out = Self {
            regular,
            mean_free_path: [(1.0 / majorant).min(1e30) as f32; 16],
            keep: [1.0; 16],
            scatter: [0.0; 16],
            inv_scatter: [0.0; 16],
            g: [0.5; 16],
            phase: Phase::Uniform,
        };
        for (p, r) in rows.iter().enumerate() {
            let rate = if regular { total(r) } else { majorant };
            out.mean_free_path[p] = (1.0 / rate).min(1e30) as f32;
            if rate > 0.0 {
                out.keep[p] = (1.0 - r.1 / rate) as f32;
                // Rounding must not push a purely scattering material's probability below 1.
                let scatter = if rate > r.1 { (r.0 / (rate - r.1)).min(1.0) } else { 0.0 };
                out.scatter[p] = scatter as f32;
                out.inv_scatter[p] = if scatter > 0.0 { (1.0 / scatter) as f32 } else { 0.0 };
            }
            if p > 0 {
                out.g[p] = r.2 as f32;
            }
        }
        let g: Vec<f32> = (1..rows.len()).map(|p| out.g[p]).collect();
        let uniform = g.iter().all(|&v| v == g[0] && f64::from(v).abs() >= NEAR_ISOTROPIC);
        if uniform && !g.is_empty() {
            out.g = [g[0]; 16];
        } else {
            out.phase = Phase::PerMaterial;
        }
        out
    }
}
