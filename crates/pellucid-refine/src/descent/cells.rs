//! Derivatives by voxels, summed over the cells that share a mixture.

use pellucid_predict::MaterialGradient;
use rayon::prelude::*;

use crate::Setup;

/// Voxels whose cells one task finds.
const TASK: usize = 1024;

/// Sums derivatives by the amounts of labels over the cells (surface voxel and layer) of a refinement.
pub(super) struct CellGradient<'a> {
    setup: &'a Setup<'a>,
    pitch: [f64; 3],
    /// Position of each label in the ink model's; `u8::MAX` for others.
    position: [u8; 256],
    /// `[point][layer][label]`.
    values: Vec<f32>,
    /// The voxel asked for last, and where its cell's values are: predictors give a voxel's labels one after another.
    last: Option<([u32; 3], Option<usize>)>,
}

impl<'a> CellGradient<'a> {
    /// No derivatives yet.
    pub(super) fn new(setup: &'a Setup<'a>) -> Self {
        let labels = setup.problem.ink.labels();
        let mut position = [u8::MAX; 256];
        labels.iter().zip(0..).for_each(|(&label, at)| position[usize::from(label)] = at);
        Self {
            setup,
            pitch: setup.problem.object.surface().frame().pitch().mm(),
            position,
            values: vec![0.0; setup.points.len() * setup.layers.count() * labels.len()],
            last: None,
        }
    }

    /// Derivatives by the amount of each ink in place of white, `[point][layer][ink]`.
    pub(super) fn by_inks(self) -> Vec<f32> {
        let labels = self.setup.problem.ink.labels().len();
        let mut values = self.values;
        let cells = values.len() / labels;
        for cell in 0..cells {
            let white = values[cell * labels + labels - 1];
            for ink in 0..labels - 1 {
                values[cell * (labels - 1) + ink] = values[cell * labels + ink] - white;
            }
        }
        values.truncate(cells * (labels - 1));
        values
    }

    fn add_to(&mut self, cell: usize, label: u8, derivative: f32) {
        let position = self.position[usize::from(label)];
        if position != u8::MAX {
            self.values[cell + usize::from(position)] += derivative;
        }
    }

    fn cell(&self, voxel: [u32; 3]) -> Option<usize> {
        let Setup { problem, layers, .. } = self.setup;
        let point = problem.nearest.nearest(voxel)?;
        let at = problem.object.surface().voxels()[point as usize];
        let squared: f64 =
            (0..3).map(|a| ((f64::from(voxel[a]) - f64::from(at[a])) * self.pitch[a]).powi(2)).sum();
        let layer = layers.layer_at(squared)?;
        Some((point as usize * layers.count() + layer) * problem.ink.labels().len())
    }
}

impl MaterialGradient for CellGradient<'_> {
    fn add(&mut self, voxel: [u32; 3], label: u8, derivative: f32) {
        let cell = match self.last {
            Some((last, cell)) if last == voxel => cell,
            _ => self.cell(voxel),
        };
        self.last = Some((voxel, cell));
        if let Some(cell) = cell {
            self.add_to(cell, label, derivative);
        }
    }

    fn add_rows(&mut self, voxels: &[[u32; 3]], derivatives: &[f32]) {
        let Some(materials) = derivatives.len().checked_div(voxels.len()) else { return };
        let cells = voxels.par_iter().with_min_len(TASK).map(|&voxel| self.cell(voxel));
        let cells: Vec<Option<usize>> = cells.collect();
        for (cell, row) in cells.into_iter().zip(derivatives.chunks_exact(materials.max(1))) {
            if let Some(cell) = cell {
                (1..=u8::MAX).zip(row).for_each(|(label, &value)| self.add_to(cell, label, value));
            }
        }
    }

    fn wants(&self, first: [u32; 3], end: [u32; 3]) -> bool {
        let [x, y, mut z] = [0, 1, 2].map(|a| first[a]..end[a]);
        z.any(|z| {
            y.clone().any(|y| x.clone().any(|x| self.setup.problem.nearest.nearest([x, y, z]).is_some()))
        })
    }
}
