//! Derivatives of radiance by the materials of voxels: those on the points' first flights, exact and sharp, and through
//! what follows the flights, which the network makes of their surroundings.

use pellucid_core::Control;
use pellucid_rpnn::variant::Head;
use pellucid_stencil::{FLIGHT_BINS, FirstFlight};
use pellucid_voxel::LabelGrid;
use rayon::prelude::*;

use super::{BoundNetwork, CHUNK, Contents, Outputs, between};
use crate::network::Network;
use crate::network::spread::{Spread, wanted};
use crate::{MaterialGradient, PredictError};

/// Points whose flights are in memory at a time.
const ROUND: usize = 16 * CHUNK;
/// Progress is reported in parts of this.
const WHOLE: u64 = 1000;
/// How much of it the flights are.
const FLIGHTS: u64 = 200;

/// Places of the network and the derivatives by its outputs there, `[place][channel][output]`.
struct AtSites {
    sites: Vec<u32>,
    d_outputs: Vec<f32>,
}

impl BoundNetwork {
    /// As [`BoundPredictor::pullback`](crate::BoundPredictor::pullback), of points that exist.
    pub(super) fn pull_back(
        &self,
        labels: &LabelGrid,
        points: &[u32],
        d_radiance: &[f32],
        out: &mut dyn MaterialGradient,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        let Some(table) = &self.table else { return Err(PredictError::before_update()) };
        let channels = self.object.channels();
        let (points, d_radiance) = weighty(points, d_radiance, channels);
        let flights = |done: u64, total: u64| control.report(FLIGHTS * done / total.max(1), WHOLE);
        let found = self.through_flights(
            labels,
            &points,
            &d_radiance,
            out,
            &control.silent().with_progress(&flights),
        )?;
        let (sites, d_outputs) =
            weighty(&found.sites, &found.d_outputs, channels * self.engine.head().outputs());
        let network =
            |done: u64, total: u64| control.report(FLIGHTS + (WHOLE - FLIGHTS) * done / total.max(1), WHOLE);
        let control = control.silent().with_progress(&network);
        if !sites.is_empty() && wanted(labels, out).iter().all(|axis| !axis.is_empty()) {
            let coefficients = Network::coefficients(&self.object)?;
            self.at(&sites, |voxels, near| {
                let total = voxels.len() + near.map_or(0, |near| near.places.len());
                let mut spread = Spread::new(&coefficients, labels, out, total, &control);
                let of = Contents { labels, table };
                self.engine.pull_back(of, near, voxels, &d_outputs, &mut spread)?;
                spread.flush()
            })?;
        }
        control.report(1, 1);
        Ok(())
    }

    /// Adds what the first flights pass; returns what is left for the network.
    fn through_flights(
        &self,
        labels: &LabelGrid,
        points: &[u32],
        d_radiance: &[f32],
        out: &mut dyn MaterialGradient,
        control: &Control<'_>,
    ) -> Result<AtSites, PredictError> {
        if let Some((_, blend)) = &self.sites.fine {
            let (needed, place) = blend.needed(points.iter().copied());
            let kept = self.node_outputs(labels, &needed, place.len(), &control.silent())?;
            let row = self.object.channels() * Head::MOST_OUTPUTS;
            let mut d_outputs = vec![0.0; needed.len() * row];
            let after = |i: usize, after: &mut [f32]| between(blend, &kept.outputs, points[i], after);
            let give = |i: usize, d_after: &[f32]| {
                let (near, weights) = blend.near(points[i]);
                for (&node, &weight) in near.iter().zip(weights).filter(|(_, w)| **w != 0.0) {
                    let to = &mut d_outputs[place[node as usize] as usize * row..][..row];
                    to.iter_mut().zip(d_after).for_each(|(to, d)| *to += weight * d);
                }
            };
            self.fly(labels, points, d_radiance, after, give, out, control)?;
            return Ok(AtSites { sites: needed, d_outputs });
        }
        let outputs = self.outputs(labels, points, &control.silent())?;
        let d_outputs = match self.engine.head() {
            Head::Radiance => passed(&outputs.values, d_radiance),
            Head::FirstFlight => self.fly_each(labels, points, d_radiance, &outputs, out, control)?,
        };
        Ok(AtSites { sites: points.to_vec(), d_outputs })
    }

    /// The flights of points that have outputs of their own; returns the derivatives by those.
    fn fly_each(
        &self,
        labels: &LabelGrid,
        points: &[u32],
        d_radiance: &[f32],
        outputs: &Outputs,
        out: &mut dyn MaterialGradient,
        control: &Control<'_>,
    ) -> Result<Vec<f32>, PredictError> {
        let row = self.object.channels() * Head::MOST_OUTPUTS;
        let mut d_outputs = vec![0.0; outputs.values.len()];
        let after = |i: usize, after: &mut [f32]| after.copy_from_slice(&outputs.values[i * row..][..row]);
        let give = |i: usize, d: &[f32]| d_outputs[i * row..][..row].copy_from_slice(d);
        self.fly(labels, points, d_radiance, after, give, out, control)?;
        Ok(d_outputs)
    }

    /// Adds what the first flights of points pass. `after` writes what follows the flight of the point at a position,
    /// `[channel][output]`, and `give` is told the derivatives by that, in the order of points.
    fn fly(
        &self,
        labels: &LabelGrid,
        points: &[u32],
        d_radiance: &[f32],
        after: impl Fn(usize, &mut [f32]) + Sync,
        mut give: impl FnMut(usize, &[f32]),
        out: &mut dyn MaterialGradient,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        let flights = self.flights(labels)?;
        let channels = self.object.channels();
        let row = channels * Head::MOST_OUTPUTS;
        let region = wanted(labels, out);
        let mut sink = |voxel: [u32; 3], label: u8, value: f32| {
            if value != 0.0 && (0..3).all(|a| region[a].contains(&voxel[a])) {
                out.add(voxel, label, value);
            }
        };
        for first in (0..points.len()).step_by(ROUND) {
            let part = first..points.len().min(first + ROUND);
            let (points_now, d_now) =
                (&points[part.clone()], &d_radiance[part.start * channels..part.end * channels]);
            let mut j = vec![0.0; points_now.len() * row];
            let mut d_j = vec![0.0; j.len()];
            let mut d_passed = vec![0.0; d_now.len()];
            j.par_chunks_mut(CHUNK * row)
                .zip(d_j.par_chunks_mut(CHUNK * row))
                .zip(d_passed.par_chunks_mut(CHUNK * channels))
                .enumerate()
                .try_for_each(|(chunk, ((j, d_j), d_passed))| {
                    control.check()?;
                    let own = chunk * CHUNK..(chunk * CHUNK + j.len() / row);
                    let mut flown = vec![FirstFlight::default(); d_passed.len()];
                    flights.extract(&points_now[own.clone()], &mut flown, &Control::none())?;
                    let mut radiance = vec![0.0; d_passed.len()];
                    for (i, j) in own.clone().zip(j.chunks_exact_mut(row)) {
                        after(part.start + i, j);
                    }
                    Head::FirstFlight.radiance(j, &flown, &mut radiance);
                    let d_own = &d_now[own.start * channels..own.end * channels];
                    d_passed.copy_from_slice(&passed(&radiance, d_own));
                    Head::FirstFlight.derivatives(&radiance, d_passed, &flown, d_j);
                    Ok::<(), PredictError>(())
                })?;
            let j = j.as_chunks::<{ FLIGHT_BINS + 1 }>().0;
            flights.pullback(points_now, j, &d_passed, &mut sink, &control.silent())?;
            part.clone().zip(d_j.chunks_exact(row)).for_each(|(i, d_j)| give(i, d_j));
            control.report(part.end as u64, points.len() as u64);
        }
        Ok(())
    }
}

/// What passes the last ReLU: nothing where it gave zero.
fn passed(radiance: &[f32], d_radiance: &[f32]) -> Vec<f32> {
    radiance.iter().zip(d_radiance).map(|(&l, &d)| if l > 0.0 { d } else { 0.0 }).collect()
}

/// The items whose row of values is not all zero, with their rows.
fn weighty(items: &[u32], values: &[f32], row: usize) -> (Vec<u32>, Vec<f32>) {
    let rows = items.iter().zip(values.chunks_exact(row));
    let kept = rows.filter(|(_, row)| row.iter().any(|&v| v != 0.0));
    let (items, rows): (Vec<u32>, Vec<&[f32]>) = kept.map(|(&item, row)| (item, row)).unzip();
    (items, rows.concat())
}
