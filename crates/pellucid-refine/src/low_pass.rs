//! Wide Gaussians over the surface.

use std::collections::HashMap;

use pellucid_core::{Cancelled, Control};
use pellucid_voxel::Surface;
use rayon::prelude::*;

/// Standard deviation in mm of the mean that local contrast leaves out.
pub(crate) const LOCAL_MM: f64 = 1.0;
/// Edge of the cells that surface voxels are pooled in, in standard deviations of the whole; at least a voxel's.
const CELL_SIGMAS: f64 = 0.3;
/// Cells on each side within reach of a pass, whose deviation is one cell.
const REACH: i32 = 2;
/// Share of a pass' variance that is left by cutting it at two deviations: 1 - 2 e^-2 / (1 - e^-2).
const CUT_VARIANCE: f64 = 0.687;
/// Normals that differ more lie on another side.
const SAME_SIDE: f64 = 0.5;
/// Points that one task handles.
const CHUNK: usize = 4096;
/// No cell.
const NONE: u32 = u32::MAX;

/// A Gaussian over the surface that is wide against the voxels: values are pooled in cells, smoothed from cell to cell,
/// and read between the cells' centres. Never goes through a thin sheet.
pub(crate) struct LowPass {
    edge_mm: f64,
    passes: u32,
    cell_of: Vec<u32>,
    positions: Vec<[f32; 3]>,
    cells: Vec<Cell>,
    /// For each cell those within reach on the same side, itself too, with the weights of a pass.
    neighbours: Vec<Vec<(u32, f32)>>,
}

/// Cells of each place, by the side that their normals face.
type Index = HashMap<[i32; 3], [u32; 6]>;

struct Cell {
    count: f64,
    centre: [f64; 3],
    normal: [f64; 3],
}

impl LowPass {
    /// Prepares a Gaussian of `sigma_mm`.
    pub(crate) fn new(surface: &Surface, sigma_mm: f64, control: &Control<'_>) -> Result<Self, Cancelled> {
        let pitch = surface.frame().pitch();
        let edge_mm = (CELL_SIGMAS * sigma_mm).max(pitch.max_mm());
        let pitch = pitch.mm();
        let position =
            |voxel: &[u32; 3]| -> [f64; 3] { std::array::from_fn(|a| f64::from(voxel[a]) * pitch[a]) };
        let mut index = Index::new();
        let mut cells: Vec<Cell> = Vec::new();
        let mut keys = Vec::new();
        let mut cell_of = Vec::with_capacity(surface.len());
        for (i, (voxel, normal)) in surface.voxels().iter().zip(surface.normals()).enumerate() {
            if i % CHUNK == 0 {
                control.check()?;
            }
            let (at, normal) = (position(voxel), normal.map(f64::from));
            let key = at.map(|v| (v / edge_mm).floor() as i32);
            let cell = &mut index.entry(key).or_insert([NONE; 6])[side(normal)];
            if *cell == NONE {
                *cell = cells.len() as u32;
                cells.push(Cell { count: 0.0, centre: [0.0; 3], normal: [0.0; 3] });
                keys.push(key);
            }
            let sums = &mut cells[*cell as usize];
            sums.count += 1.0;
            (0..3).for_each(|a| sums.centre[a] += at[a]);
            (0..3).for_each(|a| sums.normal[a] += normal[a]);
            cell_of.push(*cell);
        }
        for cell in &mut cells {
            cell.centre = cell.centre.map(|v| v / cell.count);
            let length = cell.normal.iter().map(|v| v * v).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
            cell.normal = cell.normal.map(|v| v / length);
        }
        let neighbours = (0..cells.len())
            .into_par_iter()
            .map(|i| {
                control.check()?;
                Ok(within_reach(&index, &cells, keys[i], i, edge_mm))
            })
            .collect::<Result<_, Cancelled>>()?;
        // Pooling and reading make up for one.
        let passes = (sigma_mm * sigma_mm / (CUT_VARIANCE * edge_mm * edge_mm)).round().max(1.0) as u32 - 1;
        let positions = surface.voxels().iter().map(|v| position(v).map(|p| p as f32)).collect();
        Ok(Self { edge_mm, passes, cell_of, positions, cells, neighbours })
    }

    /// Smooths one value a surface voxel. A constant stays.
    pub(crate) fn scalar(&self, values: &[f32], control: &Control<'_>) -> Result<Vec<f32>, Cancelled> {
        let values: Vec<[f32; 1]> = values.iter().map(|&v| [v]).collect();
        Ok(self.apply(&values, control)?.into_iter().map(|[v]| v).collect())
    }

    /// One value a surface voxel less its mean: what smoothing takes away.
    pub(crate) fn contrast(
        &self,
        mut values: Vec<f32>,
        control: &Control<'_>,
    ) -> Result<Vec<f32>, Cancelled> {
        let means = self.scalar(&values, control)?;
        values.iter_mut().zip(means).for_each(|(value, mean)| *value -= mean);
        Ok(values)
    }

    /// Smooths `N` values a surface voxel. Constants stay.
    pub(crate) fn apply<const N: usize>(
        &self,
        values: &[[f32; N]],
        control: &Control<'_>,
    ) -> Result<Vec<[f32; N]>, Cancelled> {
        let mut means = vec![[0.0f64; N]; self.cells.len()];
        for (value, &cell) in values.iter().zip(&self.cell_of) {
            (0..N).for_each(|c| means[cell as usize][c] += f64::from(value[c]));
        }
        means.iter_mut().zip(&self.cells).for_each(|(m, cell)| *m = m.map(|v| v / cell.count));
        for _ in 0..self.passes {
            control.check()?;
            let average = |list: &Vec<(u32, f32)>| {
                weighted(list.iter().map(|&(i, weight)| (f64::from(weight), &means[i as usize])))
            };
            means = self.neighbours.par_iter().map(average).collect();
        }
        let mut out = vec![[0.0f32; N]; values.len()];
        out.par_chunks_mut(CHUNK).enumerate().try_for_each(|(chunk, out)| {
            control.check()?;
            for (i, out) in out.iter_mut().enumerate() {
                let point = chunk * CHUNK + i;
                let at = self.positions[point].map(f64::from);
                let list = &self.neighbours[self.cell_of[point] as usize];
                let near = list.iter().map(|&(i, _)| i as usize);
                let near = near.map(|i| (self.cells[i].weight(at, self.edge_mm), &means[i]));
                *out = weighted(near).map(|v| v as f32);
            }
            Ok(())
        })?;
        Ok(out)
    }
}

fn weighted<'m, const N: usize>(values: impl Iterator<Item = (f64, &'m [f64; N])>) -> [f64; N] {
    let (mut sum, mut total) = ([0.0; N], 0.0);
    for (weight, value) in values {
        (0..N).for_each(|c| sum[c] += weight * value[c]);
        total += weight;
    }
    sum.map(|s| s / total)
}

impl Cell {
    /// What the cell counts for at a place, in a Gaussian of one cell's edge.
    fn weight(&self, at: [f64; 3], edge_mm: f64) -> f64 {
        let squared: f64 = (0..3).map(|a| (at[a] - self.centre[a]).powi(2)).sum();
        self.count * (-0.5 * squared / (edge_mm * edge_mm)).exp()
    }
}

/// The axis and sign that a normal follows most, below 6.
fn side(normal: [f64; 3]) -> usize {
    let axis = (0..3).fold(0, |best, a| if normal[a].abs() > normal[best].abs() { a } else { best });
    2 * axis + usize::from(normal[axis] < 0.0)
}

fn within_reach(index: &Index, cells: &[Cell], key: [i32; 3], own: usize, edge_mm: f64) -> Vec<(u32, f32)> {
    let cell = &cells[own];
    let mut found = Vec::new();
    for z in -REACH..=REACH {
        for y in -REACH..=REACH {
            for x in -REACH..=REACH {
                let at = [key[0] + x, key[1] + y, key[2] + z];
                for &i in index.get(&at).into_iter().flatten().filter(|&&i| i != NONE) {
                    let other = &cells[i as usize];
                    let agree: f64 = (0..3).map(|a| cell.normal[a] * other.normal[a]).sum();
                    let squared: f64 = (0..3).map(|a| (cell.centre[a] - other.centre[a]).powi(2)).sum();
                    let near = squared <= (f64::from(REACH) * edge_mm).powi(2);
                    if i as usize == own || (agree > SAME_SIDE && near) {
                        found.push((i, other.weight(cell.centre, edge_mm) as f32));
                    }
                }
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use pellucid_voxel::{Frame, LabelGrid, Pitch, SurfaceOptions, Tile};

    fn block(size: [u32; 3]) -> Surface {
        let frame = Frame::new([0.0; 3], Pitch::j750(), size).unwrap();
        let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(1));
        Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()).unwrap()
    }

    #[test]
    fn a_line_spreads_by_the_stated_deviation_and_constants_stay() {
        // 12.7 mm along x, 5 mm along y, 0.5 mm thick.
        let surface = block([300, 60, 20]);
        for sigma in [1.0, 0.0300f64.sqrt()] {
            let low = LowPass::new(&surface, sigma, &Control::none()).unwrap();
            let same = low.scalar(&vec![0.7; surface.len()], &Control::none()).unwrap();
            assert!(same.iter().all(|v| (v - 0.7).abs() < 1e-6));
            let top = |v: &[u32; 3]| v[2] == 19;
            let line: Vec<f32> =
                surface.voxels().iter().map(|v| if top(v) && v[0] == 150 { 1.0 } else { 0.0 }).collect();
            let spread = low.scalar(&line, &Control::none()).unwrap();
            let (mut total, mut second) = (0.0, 0.0);
            for (v, s) in surface.voxels().iter().zip(&spread).filter(|(v, _)| top(v)) {
                let d = (f64::from(v[0]) - 150.0) * 25.4 / 600.0;
                total += f64::from(*s);
                second += f64::from(*s) * d * d;
            }
            let deviation = (second / total).sqrt() / sigma;
            assert!((0.88..1.12).contains(&deviation), "{sigma}: {deviation}");
            // Nothing goes through: at the middle of the bottom there is only what comes round the edges, 2.5 mm off.
            let at = |voxel| spread[surface.index_of(voxel).unwrap() as usize];
            assert!(at([150, 30, 0]) < 0.02 * at([150, 30, 19]), "{}", at([150, 30, 0]));
        }
    }
}
