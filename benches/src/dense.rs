//! The method's usual form, for comparison: a dense f64 summed-area table of one coefficient.

use ndarray::Array3;
use pellucid_voxel::{LabelGrid, MaterialTable};

/// Sums of a coefficient over all voxels below each corner, `[z][y][x]` over corners.
pub struct DenseSat {
    sums: Array3<f64>,
}

impl DenseSat {
    /// Sums `values` of each voxel's label, label 0 first.
    pub fn build(grid: &LabelGrid, values: &[f64]) -> Self {
        let [sx, sy, sz] = grid.size().map(|s| s as usize);
        let mut sums = Array3::zeros((sz + 1, sy + 1, sx + 1));
        let mut layer = vec![0u8; sx * sy];
        for z in 0..sz {
            grid.copy_layer(z as u32, &mut layer).expect("a layer of the grid");
            for y in 0..sy {
                let mut run = 0.0;
                for x in 0..sx {
                    run += values[usize::from(layer[y * sx + x])];
                    sums[[z + 1, y + 1, x + 1]] =
                        run + sums[[z, y + 1, x + 1]] + sums[[z + 1, y, x + 1]] - sums[[z, y, x + 1]];
                }
            }
        }
        Self { sums }
    }

    /// Tables of scattering and absorption of every channel.
    pub fn of_channels(grid: &LabelGrid, table: &MaterialTable) -> Vec<Self> {
        let coefficient = |channel: usize, k: usize| -> Vec<f64> {
            let of = table.materials().iter().map(|m| f64::from([&m.sigma_s, &m.sigma_a][k][channel]));
            std::iter::once(0.0).chain(of).collect()
        };
        (0..2 * table.channels()).map(|i| Self::build(grid, &coefficient(i / 2, i % 2))).collect()
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.sums.len() * size_of::<f64>()
    }

    /// Sum over a box cut to the grid: eight look-ups.
    pub fn sum(&self, low: [i64; 3], high: [i64; 3]) -> f64 {
        let (nz, ny, nx) = self.sums.dim();
        let clip = |v: i64, n: usize| v.clamp(0, n as i64 - 1) as usize;
        let ([x0, y0, z0], [x1, y1, z1]) = (low, high);
        let (x0, x1, y0, y1) = (clip(x0, nx), clip(x1, nx), clip(y0, ny), clip(y1, ny));
        let (z0, z1) = (clip(z0, nz), clip(z1, nz));
        let s = &self.sums;
        s[[z1, y1, x1]] - s[[z1, y1, x0]] - s[[z1, y0, x1]] + s[[z1, y0, x0]] - s[[z0, y1, x1]]
            + s[[z0, y1, x0]]
            + s[[z0, y0, x1]]
            - s[[z0, y0, x0]]
    }
}

/// The 9 levels of 5 x 3 x 9 cells of one point from one table a value, on whole voxels (cells of
/// even length lie half a voxel off centre): `[table][level][cell]`.
pub fn stencil(tables: &[DenseSat], point: [u32; 3], out: &mut [f32]) {
    let mut out = out.iter_mut();
    for table in tables {
        for level in 0..9 {
            let edge = 1i64 << level;
            let scale = 1.0 / (edge * edge * edge) as f64;
            for z in 0..9 {
                for y in 0..3 {
                    for x in 0..5 {
                        let cell = [x - 2, y - 1, z - 4];
                        let low: [i64; 3] =
                            std::array::from_fn(|a| i64::from(point[a]) + cell[a] * edge - edge / 2);
                        let value = table.sum(low, low.map(|l| l + edge)) * scale;
                        if let Some(out) = out.next() {
                            *out = value as f32;
                        }
                    }
                }
            }
        }
    }
}
