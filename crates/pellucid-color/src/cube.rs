//! Trilinear tables over linear RGB.

use std::sync::atomic::AtomicU64;

use pellucid_voxel::Control;
use rayon::prelude::*;

use crate::ColorError;

/// `K` values at each node of a cube over linear RGB from 0 to a brightest component or a little
/// beyond. The axes are cube roots, near to perceptual steps, and 1 is a node: white is exact.
pub(crate) struct ColorCube<const K: usize> {
    nodes: usize,
    /// Nodes per unit of the cube root.
    scale: f32,
    /// `[blue][green][red]`, red fastest.
    values: Vec<[f32; K]>,
}

impl<const K: usize> ColorCube<K> {
    /// Evaluates `value` at every node, 2 to 129 a side, on rayon's pool. `brightest` is at least 1.
    pub fn build(
        nodes: usize,
        brightest: f64,
        control: &Control<'_>,
        value: impl Fn([f64; 3]) -> [f32; K] + Sync,
    ) -> Result<Self, ColorError> {
        if !(2..=129).contains(&nodes) {
            return Err(ColorError::invalid("table nodes", format!("{nodes} must lie within 2 to 129")));
        }
        let step = 1.0 / ((nodes - 1) as f64 / brightest.cbrt()).floor().max(1.0);
        let done = AtomicU64::new(0);
        let mut values = vec![[0.0; K]; nodes * nodes * nodes];
        values.par_chunks_mut(nodes).enumerate().try_for_each(|(row, out)| {
            control.check()?;
            for (i, out) in out.iter_mut().enumerate() {
                let root = [i, row % nodes, row / nodes].map(|at| at as f64 * step);
                *out = value(root.map(|v| v * v * v));
            }
            control.advance(&done, 1, (nodes * nodes) as u64);
            Ok::<(), ColorError>(())
        })?;
        Ok(Self { nodes, scale: (1.0 / step) as f32, values })
    }

    /// Trilinear interpolation, clamped to the cube; a component that is not a number counts as 0.
    pub fn at(&self, rgb: [f32; 3]) -> [f32; K] {
        let last = (self.nodes - 1) as f32;
        let mut corner = [0; 3];
        let mut part = [0.0; 3];
        for i in 0..3 {
            let at = (rgb[i].max(0.0).cbrt() * self.scale).min(last);
            corner[i] = (at as usize).min(self.nodes - 2);
            part[i] = at - corner[i] as f32;
        }
        let base = (corner[2] * self.nodes + corner[1]) * self.nodes + corner[0];
        let mut sum = [0.0; K];
        for (blue, weight_blue) in [(0, 1.0 - part[2]), (1, part[2])] {
            for (green, weight_green) in [(0, 1.0 - part[1]), (1, part[1])] {
                let at = base + (blue * self.nodes + green) * self.nodes;
                let weight = weight_blue * weight_green;
                let (low, high) = (&self.values[at], &self.values[at + 1]);
                let (weight_low, weight_high) = (weight * (1.0 - part[0]), weight * part[0]);
                for k in 0..K {
                    sum[k] += weight_low * low[k] + weight_high * high[k];
                }
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_functions_of_the_axes_are_exact() {
        let cube = ColorCube::<2>::build(12, 1.331, &Control::none(), |rgb| {
            let [r, g, b] = rgb.map(|v| v.cbrt() as f32);
            [r + 2.0 * g - b, 1.0 - g]
        })
        .unwrap();
        // 11 intervals, 10 of them up to 1.
        for rgb in [[0.0; 3], [0.3, 0.7, 0.01], [1.331, 1.0, 0.5], [1.331; 3]] {
            let [r, g, b] = rgb.map(f32::cbrt);
            let [first, second] = cube.at(rgb);
            assert!((first - (r + 2.0 * g - b)).abs() < 1e-5 && (second - (1.0 - g)).abs() < 1e-5, "{rgb:?}");
        }
        assert_eq!(cube.at([f32::NAN, -1.0, 9.0]), cube.at([0.0, 0.0, 1.331]));
        assert_eq!(cube.at([f32::INFINITY, 0.0, 0.0]), cube.at([1.331, 0.0, 0.0]));
    }
}
