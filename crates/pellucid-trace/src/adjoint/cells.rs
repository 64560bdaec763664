//! Where derivatives are added up: integers, so that the order of additions does not matter.

use std::sync::atomic::{AtomicI64, Ordering};

use pellucid_core::Team;
use rayon::prelude::*;

use super::{Derivatives, Phases};
use crate::TraceError;
use crate::bricks::{BRICK, MARGIN};
use crate::volume::Volume;

/// Units a millimetre.
const UNIT: f32 = (1 << 24) as f32;
/// Sums that a team adds up at a time: 8 MB.
const MESSAGE: usize = 1 << 20;
/// Bricks that one task hands out.
const TASK: usize = 128;
/// Bricks whose rows are in memory at a time.
const TOGETHER: usize = 16 * TASK;

/// Sums of one channel, in units of 2^-24 mm, for every voxel of the bricks that are wanted: T l of the flights, and
/// for each phase function the scatterings' row less -T l.
pub(crate) struct Cells {
    /// 1 + position among the bricks that have cells, 0 for none; laid out as the bricks' table.
    table: Vec<u32>,
    /// Positions along `[x, y, z]` of those bricks, margin included.
    bricks: Vec<[u32; 3]>,
    /// `[brick][voxel][sum]`.
    sums: Vec<AtomicI64>,
    /// Sums a voxel.
    stride: usize,
}

impl Cells {
    /// For the solid voxels that `out` wants.
    /// `phases` is the most phase functions that a channel has.
    pub(crate) fn new(volume: &Volume, out: &dyn Derivatives, phases: usize) -> Result<Self, TraceError> {
        let size = volume.frame().size();
        let region = out.region().unwrap_or([[0; 3], size]);
        let mut table = vec![0u32; volume.bricks().table.len()];
        let mut bricks = Vec::new();
        for (i, brick) in volume.bricks().solid() {
            let first: [u32; 3] =
                std::array::from_fn(|a| (brick[a] * BRICK as u32).saturating_sub(MARGIN).max(region[0][a]));
            let end: [u32; 3] = std::array::from_fn(|a| {
                (brick[a] * BRICK as u32 + BRICK as u32).saturating_sub(MARGIN).min(region[1][a]).min(size[a])
            });
            if (0..3).all(|a| first[a] < end[a]) && out.wants(first, end) {
                bricks.push(brick);
                table[i] = bricks.len() as u32;
            }
        }
        let stride = 1 + phases;
        let count = bricks.len() * BRICK.pow(3) * stride;
        let mut sums: Vec<AtomicI64> = Vec::new();
        if sums.try_reserve_exact(count).is_err() {
            return Err(TraceError::unsupported(
                "derivative",
                format!("{} bytes for {} boxes of 64 voxels; want fewer", count * 8, bricks.len()),
            ));
        }
        sums.par_extend((0..count).into_par_iter().map(|_| AtomicI64::new(0)));
        Ok(Self { table, bricks, sums, stride })
    }

    /// Nothing is wanted.
    pub(crate) fn is_empty(&self) -> bool {
        self.bricks.is_empty()
    }

    pub(crate) fn table(&self) -> &[u32] {
        &self.table
    }

    /// The sums of a cell.
    #[inline(always)]
    pub(crate) fn sums(&self, cell: u32) -> &[AtomicI64] {
        &self.sums[cell as usize * self.stride..][..self.stride]
    }

    /// Adds to a cell's length and to its scatterings by every phase function.
    #[inline(always)]
    pub(crate) fn add(&self, cell: u32, length: f32, scattering: f32) {
        let sums = self.sums(cell);
        if length != 0.0 {
            add(&sums[0], length);
        }
        if scattering != 0.0 {
            sums[1..].iter().for_each(|sum| add(sum, scattering));
        }
    }

    /// Adds a scattering by the palette's material `byte` at a cosine: `value` is that of the material's own phase
    /// function.
    #[inline(always)]
    pub(crate) fn scatter(&self, cell: u32, value: f32, phases: &Phases, byte: u32, cosine: f32) {
        for (k, sum) in self.sums(cell)[1..].iter().enumerate().take(phases.len()) {
            add(sum, value * phases.ratio(k, byte, cosine));
        }
    }

    /// Adds up the sums of a team's members.
    pub(crate) fn sum(&mut self, team: &dyn Team) {
        if team.size() == 1 {
            return;
        }
        let mut message = Vec::with_capacity(self.sums.len().min(MESSAGE));
        for sums in self.sums.chunks_mut(MESSAGE) {
            message.clear();
            message.extend(sums.iter_mut().map(|sum| *sum.get_mut()));
            team.sum(&mut message);
            sums.iter_mut().zip(&message).for_each(|(sum, &all)| *sum.get_mut() = all);
        }
    }

    /// Averages the scatterings' rows over each brick, weighed by scattering coefficients.
    pub(crate) fn pool(&mut self, volume: &Volume, phases: &Phases) {
        let stride = self.stride;
        self.sums.par_chunks_mut(64 * stride).zip(&self.bricks).for_each(|(sums, brick)| {
            // 0 in air.
            let sigma_s: [f64; 64] = std::array::from_fn(|local| {
                let inverse = phases.inv_sigma_s[volume.bricks().byte(inner(brick, local)) as usize & 15];
                if inverse > 0.0 { 1.0 / f64::from(inverse) } else { 0.0 }
            });
            let total: f64 = sigma_s.iter().sum();
            if total == 0.0 {
                return;
            }
            for row in 1..stride {
                let mut weighed = 0.0;
                for (sums, sigma_s) in sums.chunks_exact_mut(stride).zip(sigma_s) {
                    let beyond_length = *sums[row].get_mut() - *sums[0].get_mut();
                    weighed += sigma_s * beyond_length as f64;
                }
                let mean = (weighed / total) as i64;
                sums.chunks_exact_mut(stride)
                    .for_each(|sums| *sums[row].get_mut() = *sums[0].get_mut() + mean);
            }
        });
    }

    /// Hands out the sums of some bricks after the other, as voxels with the rows that `row` writes of their sums in mm,
    /// and sets them to 0. Of the voxels within the region those that are not all 0.
    pub(crate) fn drain<E: Send>(
        &mut self,
        volume: &Volume,
        region: Option<[[u32; 3]; 2]>,
        width: usize,
        row: impl Fn(&[f64], &mut [f32]) + Sync,
        mut visit: impl FnMut(&[[u32; 3]], &[f32]) -> Result<(), E>,
    ) -> Result<(), E> {
        let stride = self.stride;
        let size = 64 * stride;
        let wanted = |voxel: &[u32; 3]| {
            region.is_none_or(|[first, end]| (0..3).all(|a| (first[a]..end[a]).contains(&voxel[a])))
        };
        let of_bricks = |(sums, bricks): (&mut [AtomicI64], &[[u32; 3]])| {
            let (mut voxels, mut rows) = (Vec::new(), Vec::new());
            let mut values = vec![0.0; stride];
            for (sums, brick) in sums.chunks_exact_mut(size).zip(bricks) {
                for (local, sums) in sums.chunks_exact_mut(stride).enumerate() {
                    if sums.iter_mut().all(|s| *s.get_mut() == 0) {
                        continue;
                    }
                    for (value, sum) in values.iter_mut().zip(sums) {
                        *value = std::mem::take(sum.get_mut()) as f64 / f64::from(UNIT);
                    }
                    let inner = inner(brick, local);
                    let voxel = inner.map(|c| c.wrapping_sub(MARGIN));
                    if volume.bricks().byte(inner) & 15 != 0 && wanted(&voxel) {
                        voxels.push(voxel);
                        rows.resize(rows.len() + width, 0.0);
                        let start = rows.len() - width;
                        row(&values, &mut rows[start..]);
                    }
                }
            }
            (voxels, rows)
        };
        for (sums, bricks) in self.sums.chunks_mut(size * TOGETHER).zip(self.bricks.chunks(TOGETHER)) {
            let parts = sums.par_chunks_mut(size * TASK).zip(bricks.par_chunks(TASK));
            let parts: Vec<_> = parts.map(of_bricks).collect();
            parts.iter().try_for_each(|(voxels, rows)| visit(voxels, rows))?;
        }
        Ok(())
    }
}

/// Position, margin included, of a brick's voxel.
fn inner(brick: &[u32; 3], local: usize) -> [u32; 3] {
    let at = [local % BRICK, local / BRICK % BRICK, local / BRICK / BRICK];
    std::array::from_fn(|a| brick[a] * BRICK as u32 + at[a] as u32)
}

#[inline(always)]
fn add(sum: &AtomicI64, value: f32) {
    sum.fetch_add((value * UNIT) as i64, Ordering::Relaxed);
}
