//! The adjoint of the stencil: gradients of descriptor values carried back to the voxels.
//!
//! The descriptor is linear in the amount of each material in each voxel. Its transpose adds every
//! cell's gradient to the voxels of its box, which a difference table does in eight entries a
//! corner; one pass of sums over the table ends the work.

use std::sync::atomic::AtomicU64;

use pellucid_voxel::Control;
use rayon::prelude::*;

use crate::{Coefficients, StencilError, StencilSpec};

/// A box of voxels, `size` from `low` on, that gradients are wanted for. It may reach past the
/// grid; what lies outside the box is left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// First voxel `[x, y, z]`.
    pub low: [i64; 3],
    /// Voxels along `[x, y, z]`, each at least 1.
    pub size: [u32; 3],
}

impl Region {
    /// Number of voxels.
    pub fn voxels(&self) -> usize {
        self.size.iter().map(|&s| s as usize).product()
    }
}

/// Carries gradients back to the voxels of a region: `out`, ordered `[material][z][y][x]` over the
/// region, gets the derivative of the sum of `gradients` times descriptor values by the amount of
/// each material in each voxel (1 for a voxel of that material), label 1 first.
///
/// `gradients` are laid out as [`crate::Stencils::extract`] lays out descriptors. Sums are in f64,
/// in the order of `points`, and the same for any number of threads.
///
/// # Errors
/// [`StencilError::Invalid`] when a buffer has another length than points, coefficients and region
/// ask for, or the region is empty; [`StencilError::Cancelled`].
pub fn scatter(
    spec: &StencilSpec,
    coefficients: &Coefficients,
    points: &[[u32; 3]],
    gradients: &[f32],
    region: Region,
    out: &mut [f64],
    control: &Control,
) -> Result<(), StencilError> {
    let mut scatter = Scatter::new(coefficients, region, out)?;
    scatter.add(spec, points, gradients, control)?;
    scatter.finish(&control.silent())
}

/// [`scatter`] in parts: gradients of one descriptor after another, of the same or another spec, and at last the sums.
#[derive(Debug)]
pub struct Scatter<'a> {
    coefficients: &'a Coefficients,
    region: Region,
    /// A difference table a material until the end.
    out: &'a mut [f64],
}

impl<'a> Scatter<'a> {
    /// Begins with nothing in `out`, which is laid out as for [`scatter`].
    ///
    /// # Errors
    /// [`StencilError::Invalid`] when `out` has another length than coefficients and region ask for, or the region is
    /// empty.
    pub fn new(
        coefficients: &'a Coefficients,
        region: Region,
        out: &'a mut [f64],
    ) -> Result<Self, StencilError> {
        let (voxels, materials) = (region.voxels(), coefficients.materials());
        if voxels == 0 {
            return Err(StencilError::invalid("region", format!("{:?} has an empty axis", region.size)));
        }
        if out.len() != voxels * materials {
            return Err(StencilError::invalid(
                "output",
                format!("{} values for {voxels} voxels of {materials} materials", out.len()),
            ));
        }
        out.par_chunks_exact_mut(voxels).for_each(|table| table.fill(0.0));
        Ok(Self { coefficients, region, out })
    }

    /// Adds the gradients of descriptors. Progress counts materials.
    ///
    /// # Errors
    /// [`StencilError::Invalid`] when the lengths do not agree; [`StencilError::Cancelled`].
    pub fn add(
        &mut self,
        spec: &StencilSpec,
        points: &[[u32; 3]],
        gradients: &[f32],
        control: &Control,
    ) -> Result<(), StencilError> {
        let (coefficients, region) = (self.coefficients, self.region);
        let row = coefficients.values_per_point(spec);
        if gradients.len() != points.len() * row {
            return Err(StencilError::invalid(
                "gradients",
                format!("{} values for {} points of {row}", gradients.len(), points.len()),
            ));
        }
        let done = AtomicU64::new(0);
        let total = coefficients.materials() as u64;
        self.out.par_chunks_exact_mut(region.voxels()).enumerate().try_for_each(|(material, table)| {
            let mut cells = vec![0.0; spec.cells_per_level()];
            for (point, gradients) in points.iter().zip(gradients.chunks_exact(row)) {
                control.check()?;
                for level in (0..spec.levels()).filter(|&level| meets(spec, level, *point, region)) {
                    coefficients.cell_gradients(spec, level, material, gradients, &mut cells);
                    add_level(spec, level, *point, &cells, region, table);
                }
            }
            control.advance(&done, 1, total);
            Ok(())
        })
    }

    /// Ends with the derivatives in place.
    ///
    /// # Errors
    /// [`StencilError::Cancelled`].
    pub fn finish(self, control: &Control) -> Result<(), StencilError> {
        let size = self.region.size.map(|s| s as usize);
        self.out.par_chunks_exact_mut(self.region.voxels()).try_for_each(|table| sum(size, table, control))
    }
}

/// Whether a point's cells at a level reach into a region.
fn meets(spec: &StencilSpec, level: usize, point: [u32; 3], region: Region) -> bool {
    let edge = i64::from(spec.cell_edge(level));
    (0..3).all(|a| {
        let length = edge * spec.cells()[a] as i64;
        let low = i64::from(point[a]) - length / 2 - region.low[a];
        // A half voxel at either end counts as a whole one.
        low < i64::from(region.size[a]) && low + length + 1 > 0
    })
}

/// Adds the cells of one level to a difference table; `cells` hold gradients by an eighth voxel.
fn add_level(
    spec: &StencilSpec,
    level: usize,
    point: [u32; 3],
    cells: &[f64],
    region: Region,
    table: &mut [f64],
) {
    let [nx, ny, nz] = spec.cells();
    let edge = i64::from(spec.cell_edge(level));
    // Where the table changes at corner `i` of an axis: a half voxel counts at both its ends.
    let at = |a: usize, i: usize| {
        let first = i64::from(point[a]) + edge * i as i64 - edge * spec.cells()[a] as i64 / 2 - region.low[a];
        let second = if level == 0 { first } else { first + 1 };
        [first, second].map(|v| v.max(0) as usize).map(|v| (v < region.size[a] as usize).then_some(v))
    };
    let [sx, sy, _] = region.size.map(|s| s as usize);
    let cell = |x: usize, y: usize, z: usize| {
        let inside = x < nx && y < ny && z < nz;
        if inside { cells[spec.cell_index([x, y, z])] } else { 0.0 }
    };
    for k in 0..=nz {
        let zs = at(2, k);
        for j in 0..=ny {
            let ys = at(1, j);
            for i in 0..=nx {
                let mut change = 0.0;
                for step in 0..8usize {
                    let (dx, dy, dz) = (step & 1, step >> 1 & 1, step >> 2);
                    let sign = if step.count_ones() % 2 == 0 { 1.0 } else { -1.0 };
                    // Cell `index - 1` of the wrapped subtraction lies outside.
                    change += sign * cell(i.wrapping_sub(dx), j.wrapping_sub(dy), k.wrapping_sub(dz));
                }
                if change == 0.0 {
                    continue;
                }
                for z in zs.into_iter().flatten() {
                    for y in ys.into_iter().flatten() {
                        for x in at(0, i).into_iter().flatten() {
                            table[(z * sy + y) * sx + x] += change;
                        }
                    }
                }
            }
        }
    }
}

/// Turns a difference table into values: sums along x, y and z.
fn sum([sx, sy, _]: [usize; 3], table: &mut [f64], control: &Control) -> Result<(), StencilError> {
    for layer in table.chunks_exact_mut(sx * sy) {
        control.check()?;
        for row in layer.chunks_exact_mut(sx) {
            let mut run = 0.0;
            for value in row {
                run += *value;
                *value = run;
            }
        }
        for at in sx..layer.len() {
            layer[at] += layer[at - sx];
        }
    }
    let mut rest = table;
    while rest.len() > sx * sy {
        control.check()?;
        let (before, after) = rest.split_at_mut(sx * sy);
        after.iter_mut().zip(&*before).for_each(|(value, before)| *value += before);
        rest = after;
    }
    Ok(())
}
