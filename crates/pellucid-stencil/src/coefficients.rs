//! From material counts to features.

use std::ops::Range;

use pellucid_core::InstructionSet;
use pellucid_voxel::MaterialTable;
use pellucid_voxel::sat::tables::LANES;

use crate::kernel::{Kernel, Rows, Sums};
use crate::{StencilError, StencilSpec};

/// What is held for each cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Features {
    /// Mean scattering and absorption coefficient: 2 values.
    ScatterAbsorb,
    /// The same and the part of the cell that is solid, within 0..=1: 3 values.
    WithOccupancy,
}

impl Features {
    /// Values a cell and channel.
    pub fn len(self) -> usize {
        match self {
            Features::ScatterAbsorb => 2,
            Features::WithOccupancy => 3,
        }
    }

    /// Lanes of a channel in a row of coefficients: a power of two.
    fn lanes(self) -> usize {
        self.len().next_power_of_two()
    }

    /// Always false.
    pub fn is_empty(self) -> bool {
        false
    }
}

/// The coefficients that counts are multiplied by, of chosen channels of a material table.
#[derive(Clone, Debug)]
pub struct Coefficients {
    features: Features,
    materials: usize,
    channels: usize,
    /// Ordered `[material][distinct channel][lane]`: two or four lanes a channel hold its values,
    /// zeros up to `width`.
    rows: Vec<f64>,
    /// Lanes over the distinct channels, rounded up to a multiple of eight.
    width: usize,
    /// For each channel asked for, the first one of equal coefficients.
    first: Vec<usize>,
}

impl Coefficients {
    /// Takes the coefficients of `channels`, in that order. Channels of equal coefficients are
    /// computed once and copied.
    ///
    /// # Errors
    /// [`StencilError::Invalid`] when no channel is asked for or one is past the table.
    pub fn new(table: &MaterialTable, channels: &[usize], features: Features) -> Result<Self, StencilError> {
        if channels.is_empty() {
            return Err(StencilError::invalid("channels", "needs at least one"));
        }
        if let Some(bad) = channels.iter().find(|&&c| c >= table.channels()) {
            return Err(StencilError::invalid(
                "channels",
                format!("{bad} of a material table with {}", table.channels()),
            ));
        }
        let same = |a: usize, b: usize| {
            let bits = |v: &[f32]| (v[a].to_bits(), v[b].to_bits());
            table.materials().iter().all(|m| [bits(&m.sigma_s), bits(&m.sigma_a)].iter().all(|(a, b)| a == b))
        };
        let first: Vec<usize> = (0..channels.len())
            .map(|i| (0..i).find(|&k| same(channels[k], channels[i])).unwrap_or(i))
            .collect();
        let kept: Vec<usize> = (0..channels.len()).filter(|&i| first[i] == i).map(|i| channels[i]).collect();
        let width = (kept.len() * features.lanes()).next_multiple_of(8);
        let mut rows = Vec::with_capacity(table.len() * width);
        for m in table.materials() {
            for &channel in &kept {
                let values = [f64::from(m.sigma_s[channel]), f64::from(m.sigma_a[channel]), 1.0, 0.0];
                rows.extend(&values[..features.lanes()]);
            }
            rows.resize(rows.len().next_multiple_of(width), 0.0);
        }
        Ok(Self { features, materials: table.len(), channels: channels.len(), rows, width, first })
    }

    /// All channels of a table in order.
    ///
    /// # Errors
    /// None for a valid table; the signature follows [`Coefficients::new`].
    pub fn all(table: &MaterialTable, features: Features) -> Result<Self, StencilError> {
        Self::new(table, &(0..table.channels()).collect::<Vec<_>>(), features)
    }

    /// What is held for each cell.
    pub fn features(&self) -> Features {
        self.features
    }

    /// Channels asked for.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Materials counted.
    pub fn materials(&self) -> usize {
        self.materials
    }

    /// Values of one point's descriptor over all channels.
    pub fn values_per_point(&self, spec: &StencilSpec) -> usize {
        self.channels * spec.cells_in_all() * self.features.len()
    }

    /// Converts the counts of one point, ordered `[level][cell][material]`, to its descriptor,
    /// ordered `[channel][level][cell][feature]`.
    ///
    /// Each value is the f64 sum over materials in label order, times a power of two, rounded to
    /// f32 once: equal counts give equal bits.
    ///
    /// # Panics
    /// When a slice has another length than the spec asks for.
    pub fn convert(&self, spec: &StencilSpec, counts: &[u32], out: &mut [f32]) {
        let (cells, m) = (spec.cells_per_level(), self.materials);
        assert_eq!(counts.len(), spec.levels() * cells * m, "counts of one point");
        assert_eq!(out.len(), self.values_per_point(spec), "descriptor of one point");
        let kernel = Kernel::of(InstructionSet::chosen());
        let mut sums = vec![Sums::default(); m.div_ceil(LANES) * cells];
        for (level, counts) in counts.chunks_exact(cells * m).enumerate() {
            for (cell, counts) in counts.chunks_exact(m).enumerate() {
                for (group, counts) in counts.chunks(LANES).enumerate() {
                    sums[group * cells + cell][..counts.len()].copy_from_slice(counts);
                }
            }
            let cells = level * cells..(level + 1) * cells;
            self.convert_cells(kernel, spec, cells, &sums, out);
        }
    }

    /// The gradients of one level's cells by an eighth voxel of a material, from the gradients of a
    /// point's descriptor.
    pub(crate) fn cell_gradients(
        &self,
        spec: &StencilSpec,
        level: usize,
        material: usize,
        gradients: &[f32],
        cells: &mut [f64],
    ) {
        let f = self.features.len();
        cells.fill(0.0);
        for (channel, gradients) in gradients.chunks_exact(spec.cells_in_all() * f).enumerate() {
            let distinct = (0..self.first[channel]).filter(|&c| self.first[c] == c).count();
            let values = &self.rows[material * self.width + distinct * self.features.lanes()..][..f];
            let gradients = &gradients[level * cells.len() * f..];
            for (cell, gradients) in cells.iter_mut().zip(gradients.chunks_exact(f)) {
                *cell += gradients.iter().zip(values).map(|(&g, v)| f64::from(g) * v).sum::<f64>();
            }
        }
        let factor = spec.level_factor(level);
        cells.iter_mut().for_each(|cell| *cell *= factor);
    }

    /// Converts the counts of some cells of a level, ordered `[group][cell]`, numbered over all
    /// levels, into a whole point's descriptor.
    pub(crate) fn convert_cells(
        &self,
        kernel: Kernel,
        spec: &StencilSpec,
        cells: Range<usize>,
        counts: &[Sums],
        out: &mut [f32],
    ) {
        let f = self.features.len();
        let per_channel = spec.cells_in_all() * f;
        let rows = Rows {
            values: &self.rows,
            width: self.width,
            features: f,
            factor: spec.level_factor(cells.start / spec.cells_per_level()),
        };
        let out = &mut out[cells.start * f..];
        if counts.iter().all(|c| c[..LANES] == [0; LANES]) {
            for channel in 0..self.channels {
                out[channel * per_channel..][..cells.len() * f].fill(0.0);
            }
            return;
        }
        let starts = (0..self.channels).filter(|&c| self.first[c] == c).map(|c| c * per_channel);
        kernel.features(&rows, self.materials, counts, cells.len(), starts, out);
        for (channel, &first) in self.first.iter().enumerate() {
            if first != channel {
                let from = first * per_channel..first * per_channel + cells.len() * f;
                out.copy_within(from, channel * per_channel);
            }
        }
    }
}
