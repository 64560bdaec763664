//! One object under the network.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use pellucid_core::Control;
use pellucid_rpnn::variant::Head;
use pellucid_stencil::{FirstFlight, FirstFlights};
use pellucid_voxel::{CountSat, LabelGrid};
use rayon::prelude::*;

use super::Network;
use super::evaluate::{Engine, Outputs};
use super::nodes::Nodes;
use super::trained_range::TrainedRange;
use crate::labels::{KeptLabels, Update};
use crate::{BoundPredictor, Changed, Diagnostics, Draw, Object, PredictError, Sharing};

/// Points that a thread composes at a time.
const CHUNK: usize = 1024;

pub(super) struct BoundNetwork {
    object: Arc<Object>,
    sharing: Option<Sharing>,
    /// Where the network is run for points that share; geometry alone decides.
    nodes: Option<Nodes>,
    engine: Engine,
    labels: KeptLabels,
    table: Option<CountSat>,
}

impl BoundNetwork {
    pub(super) fn new(network: &Network, object: Arc<Object>) -> Result<Self, PredictError> {
        let inference = network.inference()?;
        let spaced = network.sharing.filter(|s| s.spacing_mm > 0.0 && inference.head() == Head::FirstFlight);
        let nodes = match spaced {
            Some(sharing) => Some(Nodes::new(object.surface(), sharing.spacing_mm, &Control::none())?),
            None => None,
        };
        let coefficients = Network::coefficients(&object)?;
        let trained = TrainedRange::new(&network.trained.provenance);
        Ok(Self {
            sharing: network.sharing,
            nodes,
            engine: Engine::new(inference, coefficients, trained, network.instruction_set),
            labels: KeptLabels::default(),
            table: None,
            object,
        })
    }

    /// Outputs at surface points.
    fn outputs(
        &self,
        labels: &LabelGrid,
        points: impl Iterator<Item = u32>,
        control: &Control<'_>,
    ) -> Result<Outputs, PredictError> {
        let Some(table) = &self.table else { return Err(PredictError::before_update()) };
        let surface = self.object.surface();
        let voxels: Vec<[u32; 3]> = points.map(|p| surface.voxels()[p as usize]).collect();
        self.engine.outputs(labels, table, self.sharing, &voxels, control)
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
        let outputs = self.outputs(labels, points.iter().copied(), control)?;
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
        nodes: &Nodes,
        labels: &LabelGrid,
        points: &[u32],
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<u64, PredictError> {
        let needed = nodes.needed(points);
        let outputs = self.outputs(labels, needed.iter().map(|&n| nodes.points()[n as usize]), control)?;
        let mut place = vec![0u32; nodes.points().len()];
        (0..).zip(&needed).for_each(|(i, &node)| place[node as usize] = i);
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
                    let (near, weights) = nodes.near(point);
                    for (&node, &weight) in near.iter().zip(weights) {
                        let at = place[node as usize] as usize;
                        let values = &outputs.values[at * row..][..row];
                        after.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
                    }
                    let closest = place[near[0] as usize] as usize;
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

impl BoundPredictor for BoundNetwork {
    fn update(
        &mut self,
        labels: &LabelGrid,
        changed: Changed<'_>,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        let fits = self.object.check_labels(labels).and_then(|()| self.object.check_solid(labels));
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
        let outside_training = match &self.nodes {
            Some(nodes) => self.predict_between(nodes, labels, points, out, control)?,
            None => self.predict_each(labels, points, out, control)?,
        };
        Ok(Diagnostics { outside_training, ..Diagnostics::default() })
    }
}
