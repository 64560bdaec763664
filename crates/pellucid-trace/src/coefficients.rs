//! Per-channel look-ups by palette position.

use pellucid_voxel::MaterialTable;

use crate::Tracking;
use crate::kernel::MOST_BANDS;
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

/// What bands that share paths look up beside the walking band's coefficients, by palette position. Rows past `count`
/// are 0.
#[derive(Clone, Debug)]
pub(crate) struct SharedBands {
    pub(crate) count: usize,
    /// What a band keeps at a tentative collision, over the most that any keeps.
    pub(crate) keep: [[f32; 16]; MOST_BANDS],
    /// Probability that a tentative collision scatters, over the walking band's.
    pub(crate) scatter: [[f32; 16]; MOST_BANDS],
    /// Probability that it does not, over the walking band's.
    pub(crate) null: [[f32; 16]; MOST_BANDS],
}

impl Coefficients {
    /// For bands that share paths with one majorant: what each needs to walk, and what the others then look up. `None`
    /// where [`Tracking::Auto`] would not use delta tracking.
    pub(crate) fn shared(
        materials: &MaterialTable,
        palette: &[u8],
        channels: &[usize],
        tracking: Tracking,
    ) -> Option<Vec<(Self, SharedBands)>> {
        let own: Vec<Self> =
            channels.iter().map(|&c| Self::new(materials, palette, c, Tracking::Delta)).collect();
        let extinction = |c: usize| palette.iter().skip(1).map(move |&l| f64::from(materials.sigma_t(l, c)));
        let majorant = channels.iter().flat_map(|&c| extinction(c)).fold(0.0, f64::max);
        let least = channels.iter().flat_map(|&c| extinction(c)).fold(majorant, f64::min);
        if majorant == 0.0 || (tracking == Tracking::Auto && majorant > 16.0 * least) {
            return None;
        }
        // Keep and probability to scatter, [band][position].
        let mut keep = [[0.0f64; 16]; MOST_BANDS];
        let mut scatter = [[0.0f64; 16]; MOST_BANDS];
        for (j, &c) in channels.iter().enumerate() {
            keep[j] = [1.0; 16];
            for (p, m) in palette.iter().enumerate().filter_map(|(p, &l)| Some((p, materials.get(l)?))) {
                let (s, a) = (f64::from(m.sigma_s[c]), f64::from(m.sigma_a[c]));
                keep[j][p] = 1.0 - a / majorant;
                scatter[j][p] = if majorant > a { (s / (majorant - a)).min(1.0) } else { 0.0 };
            }
        }
        let most: [f64; 16] =
            std::array::from_fn(|p| (0..channels.len()).map(|j| keep[j][p]).fold(0.0, f64::max));
        let ratio = |a: f64, b: f64| if b > 0.0 { (a / b) as f32 } else { 0.0 };
        let walker = |h: usize| {
            let walking = Self {
                regular: false,
                mean_free_path: [(1.0 / majorant).min(1e30) as f32; 16],
                keep: most.map(|v| v as f32),
                scatter: scatter[h].map(|v| v as f32),
                inv_scatter: scatter[h].map(|v| ratio(1.0, v)),
                ..own[h].clone()
            };
            let mut shared = SharedBands {
                count: channels.len(),
                keep: [[0.0; 16]; MOST_BANDS],
                scatter: [[0.0; 16]; MOST_BANDS],
                null: [[0.0; 16]; MOST_BANDS],
            };
            for j in 0..channels.len() {
                for p in 0..16 {
                    shared.keep[j][p] = ratio(keep[j][p], most[p]);
                    shared.scatter[j][p] = ratio(scatter[j][p], scatter[h][p]);
                    shared.null[j][p] = ratio(1.0 - scatter[j][p], 1.0 - scatter[h][p]);
                }
            }
            (walking, shared)
        };
        Some((0..channels.len()).map(walker).collect())
    }

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
