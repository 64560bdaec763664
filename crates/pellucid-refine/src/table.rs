//! Demands to mixtures, tabulated over density.

use rayon::prelude::*;

use crate::{InkModel, RefineError, density};

/// Most labels in a mixture.
pub(crate) const MAX_LABELS: usize = 8;
/// Nodes along each axis of the table.
const NODES: usize = 33;

/// A printable mixture: cumulative fractions in halftone order, and its density per colour.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Mixture {
    /// `cumulative[i]` is the share of the labels up to `i`.
    pub cumulative: [f32; MAX_LABELS],
    /// Density of the printable colour, R, G, B.
    pub density: [f32; 3],
}

/// Mixtures on a cube of densities. Nodes lie at quadratically spaced densities: in pale tones a
/// mixture's fractions grow with the square of its density.
pub(crate) struct DemandTable {
    labels: Vec<u8>,
    nodes: Vec<Mixture>,
}

impl DemandTable {
    pub fn build(ink: &dyn InkModel) -> Result<Self, RefineError> {
        let labels = ink.labels().to_vec();
        if labels.is_empty() || labels.len() > MAX_LABELS {
            return Err(RefineError::unsupported(
                "ink labels",
                format!("{} labels; 1 to {MAX_LABELS} can be halftoned", labels.len()),
            ));
        }
        let nodes = (0..NODES * NODES * NODES)
            .into_par_iter()
            .map(|i| {
                let at = [i % NODES, i / NODES % NODES, i / NODES / NODES]
                    .map(|k| density::MAX * (k as f32 / (NODES - 1) as f32).powi(2));
                let mut fractions = [0.0; MAX_LABELS];
                let rgb = ink.fractions(at.map(density::reflectance), &mut fractions[..labels.len()]);
                let mut sum = 0.0;
                let cumulative = fractions.map(|f| {
                    sum += f.max(0.0);
                    sum
                });
                Mixture { cumulative: cumulative.map(|c| c / sum), density: rgb.map(density::of) }
            })
            .collect();
        Ok(Self { labels, nodes })
    }

    pub fn labels(&self) -> &[u8] {
        &self.labels
    }

    /// The printable mixture nearest to a density per colour.
    pub fn mixture(&self, wanted: [f32; 3]) -> Mixture {
        let at = wanted.map(|d| (d / density::MAX).clamp(0.0, 1.0).sqrt() * (NODES - 1) as f32);
        let low = at.map(|v| (v as usize).min(NODES - 2));
        let part: [f32; 3] = std::array::from_fn(|a| at[a] - low[a] as f32);
        let mut out = Mixture::default();
        for corner in 0..8 {
            let step = [corner & 1, corner >> 1 & 1, corner >> 2];
            let weight: f32 = (0..3).map(|a| if step[a] == 1 { part[a] } else { 1.0 - part[a] }).product();
            let [x, y, z]: [usize; 3] = std::array::from_fn(|a| low[a] + step[a]);
            let node = &self.nodes[(z * NODES + y) * NODES + x];
            for (o, v) in out.cumulative.iter_mut().zip(&node.cumulative) {
                *o += weight * v;
            }
            for (o, v) in out.density.iter_mut().zip(&node.density) {
                *o += weight * v;
            }
        }
        out
    }

    /// The label that a threshold within 0..1 picks from a mixture.
    #[inline]
    pub fn label(&self, mixture: &Mixture, threshold: f32) -> u8 {
        let last = self.labels.len() - 1;
        let pick = (0..last).find(|&i| threshold < mixture.cumulative[i]).unwrap_or(last);
        self.labels[pick]
    }
}
