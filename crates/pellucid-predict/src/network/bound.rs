//! One object under the network.

mod pullback;

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use pellucid_core::Control;
use pellucid_rpnn::variant::Head;
use pellucid_stencil::{FirstFlight, FirstFlights};
use pellucid_voxel::{CountSat, LabelGrid, Surface};
use rayon::prelude::*;

use super::evaluate::{Contents, Evaluator, Near, Outputs};
use super::nodes::{Blend, Nodes};
use crate::labels::{KeptLabels, Update};
use crate::{BoundPredictor, Changed, Diagnostics, Draw, MaterialGradient, Object, PredictError, Sharing};

/// Points that a thread composes at a time.
const CHUNK: usize = 1024;

pub(super) struct BoundNetwork {
    object: Arc<Object>,
    sites: Sites,
    engine: Box<dyn Evaluator>,
    labels: KeptLabels,
    table: Option<CountSat>,
    /// Outputs at the fine nodes that were asked for since the last update: a function of the labels alone.
    kept: Mutex<Arc<Kept>>,
}

/// Outputs of some fine nodes.
#[derive(Clone, Default)]
struct Kept {
    /// `[node]`; empty before the first.
    there: Vec<bool>,
    outputs: Outputs,
}

/// Where the network is run. Geometry alone decides.
struct Sites {
    /// The points that it is run for, and what every point takes from them; every point for itself without them.
    fine: Option<(Nodes, Blend)>,
    /// Finest levels that such a point has for itself; the points that the others are read for, and what it takes from
    /// them.
    coarse: Option<(usize, Nodes, Blend)>,
}

impl Sites {
    fn new(
        surface: &Surface,
        sharing: Option<Sharing>,
        head: Head,
        control: &Control<'_>,
    ) -> Result<Self, PredictError> {
        let Some(sharing) = sharing else { return Ok(Self { fine: None, coarse: None }) };
        let all: Vec<u32> = (0..surface.len() as u32).collect();
        let spaced = head == Head::FirstFlight && !Nodes::everywhere(surface, sharing.spacing_mm);
        let fine = match spaced {
            true => {
                let nodes = Nodes::new(surface, sharing.spacing_mm, control)?;
                let blend = Blend::new(surface, &nodes, &all, control)?;
                Some((nodes, blend))
            }
            false => None,
        };
        let shares_levels = sharing.shares_levels() && !Nodes::everywhere(surface, sharing.coarse_mm);
        let coarse = match shares_levels {
            true => {
                let nodes = Nodes::new(surface, sharing.coarse_mm, control)?;
                let of = fine.as_ref().map_or(&all[..], |(nodes, _)| nodes.points());
                let blend = Blend::new(surface, &nodes, of, control)?;
                Some((sharing.fine_levels, nodes, blend))
            }
            false => None,
        };
        Ok(Self { fine, coarse })
    }
}

impl BoundNetwork {
    pub(super) fn new(
        engine: Box<dyn Evaluator>,
        sharing: Option<Sharing>,
        object: Arc<Object>,
    ) -> Result<Self, PredictError> {
        Ok(Self {
            sites: Sites::new(object.surface(), sharing, engine.head(), &Control::none())?,
            engine,
            labels: KeptLabels::default(),
            table: None,
            kept: Mutex::default(),
            object,
        })
    }

    /// Outputs at some of the sites, which are given as surface points or positions among the fine nodes.
    fn outputs(
        &self,
        labels: &LabelGrid,
        sites: &[u32],
        control: &Control<'_>,
    ) -> Result<Outputs, PredictError> {
        let Some(table) = &self.table else { return Err(PredictError::before_update()) };
        let of = Contents { labels, table };
        self.at(sites, |voxels, near| match near {
            None => self.engine.outputs(of, voxels, control),
            Some(near) => self.engine.outputs_near(of, near, voxels, control),
        })
    }

    /// Works with the voxels of some of the sites and, where levels are shared, the places about them.
    pub(super) fn at<R>(
        &self,
        sites: &[u32],
        work: impl FnOnce(&[[u32; 3]], Option<&Near<'_>>) -> Result<R, PredictError>,
    ) -> Result<R, PredictError> {
        let surface = self.object.surface();
        let point =
            |site: u32| self.sites.fine.as_ref().map_or(site, |(nodes, _)| nodes.points()[site as usize]);
        let voxels: Vec<[u32; 3]> = sites.iter().map(|&s| surface.voxels()[point(s) as usize]).collect();
        let Some((fine, nodes, blend)) = &self.sites.coarse else { return work(&voxels, None) };
        let (needed, place) = blend.needed(sites.iter().copied());
        let places: Vec<[u32; 3]> =
            needed.iter().map(|&node| surface.voxels()[nodes.points()[node as usize] as usize]).collect();
        let shares = |i: u32| {
            let (near, weights) = blend.near(sites[i as usize]);
            (near.map(|node| place[node as usize]), *weights)
        };
        work(&voxels, Some(&Near { fine: *fine, places: &places, shares: &shares }))
    }

    /// Outputs at fine nodes, in the order of all; those that are not among `nodes` may be missing.
    fn node_outputs(
        &self,
        labels: &LabelGrid,
        nodes: &[u32],
        count: usize,
        control: &Control<'_>,
    ) -> Result<Arc<Kept>, PredictError> {
        let kept = Arc::clone(&self.kept.lock().unwrap_or_else(PoisonError::into_inner));
        let missing: Vec<u32> =
            nodes.iter().copied().filter(|&n| !kept.there.get(n as usize).is_some_and(|t| *t)).collect();
        if missing.is_empty() {
            return Ok(kept);
        }
        // Without the lock: others may find the same nodes meanwhile, with the same values.
        let found = self.outputs(labels, &missing, control)?;
        let mut guard = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let all = Arc::make_mut(&mut guard);
        let channels = self.object.channels();
        if all.there.is_empty() {
            all.there.resize(count, false);
            all.outputs = Outputs::zeros(count, channels, Head::FirstFlight.outputs());
        }
        all.outputs.put(&missing, &found, channels);
        missing.iter().for_each(|&node| all.there[node as usize] = true);
        Ok(Arc::clone(&guard))
    }

    /// First flights of some points, `[point][channel]`.
    fn flights<'a>(&'a self, labels: &'a LabelGrid) -> Result<FirstFlights<'a>, PredictError> {
        let object = &self.object;
        Ok(FirstFlights::new(object.materials(), labels, object.surface(), object.refractive_index())?)
    }

    /// Every point on its own.
    fn predict_each(
        &self,
        labels: &LabelGrid,
        points: &[u32],
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<u64, PredictError> {
        let outputs = self.outputs(labels, points, control)?;
        let mut flown = Vec::new();
        if self.engine.head() == Head::FirstFlight {
            flown.resize(out.len(), FirstFlight::default());
            self.flights(labels)?.extract(points, &mut flown, &control.silent())?;
        }
        self.engine.head().radiance(&outputs.values, &flown, out);
        Ok(outputs.outside.iter().filter(|outside| **outside).count() as u64)
    }

    /// First flights of their own, what follows them from the nodes about each point.
    fn predict_between(
        &self,
        blend: &Blend,
        labels: &LabelGrid,
        points: &[u32],
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<u64, PredictError> {
        let (needed, place) = blend.needed(points.iter().copied());
        let kept = self.node_outputs(labels, &needed, place.len(), control)?;
        let outputs = &kept.outputs;
        let flights = self.flights(labels)?;
        let channels = self.object.channels();
        let row = channels * Head::MOST_OUTPUTS;
        let outside = AtomicU64::new(0);
        points.par_chunks(CHUNK).zip(out.par_chunks_mut(CHUNK * channels)).try_for_each(
            |(points, out)| {
                control.check()?;
                let mut flown = vec![FirstFlight::default(); out.len()];
                flights.extract(points, &mut flown, &Control::none())?;
                let mut after = vec![0.0; points.len() * row];
                let mut count = 0;
                for (&point, after) in points.iter().zip(after.chunks_exact_mut(row)) {
                    between(blend, outputs, point, after);
                    let closest = blend.near(point).0[0] as usize;
                    let beyond = &outputs.outside[closest * channels..][..channels];
                    count += beyond.iter().filter(|outside| **outside).count() as u64;
                }
                Head::FirstFlight.radiance(&after, &flown, out);
                outside.fetch_add(count, Ordering::Relaxed);
                Ok::<(), PredictError>(())
            },
        )?;
        Ok(outside.into_inner())
    }
}

/// Adds to `after` what follows the flight of a point, `[channel][output]`, from the nodes about it.
#[inline]
fn between(blend: &Blend, outputs: &Outputs, point: u32, after: &mut [f32]) {
    let (near, weights) = blend.near(point);
    for (&node, &weight) in near.iter().zip(weights) {
        let values = &outputs.values[node as usize * after.len()..][..after.len()];
        after.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
    }
}

impl BoundPredictor for BoundNetwork {
    fn update(
        &mut self,
        labels: &LabelGrid,
        changed: Changed<'_>,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        let fits = self.object.check_labels(labels).and_then(|()| self.object.check_solid(labels));
        *self.kept.get_mut().unwrap_or_else(PoisonError::into_inner) = Arc::default();
        fits.inspect_err(|_| self.labels.forget())?;
        let table = &mut self.table;
        let (materials, silent) = (self.object.materials().len(), control.silent());
        self.labels.update(labels, changed, control, |update| {
            match (update, table.as_mut()) {
                (Update::Tiles(tiles), Some(table)) => table.update(labels, tiles, &silent)?,
                _ => *table = Some(CountSat::build(labels, materials, &silent)?),
            }
            Ok(())
        })
    }

    fn predict(
        &self,
        points: &[u32],
        _: Draw,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<Diagnostics, PredictError> {
        let Some(labels) = self.labels.current() else { return Err(PredictError::before_update()) };
        self.object.check_points(points, out.len())?;
        control.check()?;
        let outside_training = match &self.sites.fine {
            Some((_, blend)) => self.predict_between(blend, labels, points, out, control)?,
            None => self.predict_each(labels, points, out, control)?,
        };
        Ok(Diagnostics { outside_training, ..Diagnostics::default() })
    }

    fn pullback(
        &self,
        points: &[u32],
        _: Draw,
        d_radiance: &[f32],
        out: &mut dyn MaterialGradient,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        if !self.engine.has_gradient() {
            return Err(PredictError::unsupported("gradient", "this form of the network has none"));
        }
        let Some(labels) = self.labels.current() else { return Err(PredictError::before_update()) };
        self.object.check_derivatives(points, d_radiance)?;
        control.check()?;
        self.pull_back(labels, points, d_radiance, out, control)
    }
}
