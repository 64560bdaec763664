//! Points a second and error of the network in candle on a device, beside this project's own kernels on the processor.
//!
//! `benches/device/measure.sh cuda` builds and runs it; on the processor alone
//! `cargo run --release -p pellucid-benches --features candle --example device_rate -- cpu`.
//!
//! Prints one JSON object. `network` is the network by itself, stencils already on the device, in samples (a point in a
//! channel) a second by batch and precision; `predictors` are whole predictions of a halftoned ball's surface, stencils
//! and first flights included, in points of three channels a second, with their greatest and root mean square
//! difference from own f32 kernels run for every point, and their root mean square error against 1024 paths.

use std::sync::Arc;
use std::time::{Duration, Instant};

use candle_core::{DType, Device, Tensor};
use candle_nn::{Module, VarBuilder};
use pellucid::predict::{
    BoundPredictor, CandleNetwork, Changed, Draw, MonteCarlo, Network, NetworkDevice, Object, Pass,
    Predictor, Sharing,
};
use pellucid::rpnn::candle::Rpnn;
use pellucid::rpnn::variant::{LEVEL_INPUTS, LEVELS};
use pellucid::rpnn::{Precision, SHIPPED, TrainedNetwork, shipped};
use pellucid::voxel::{Control, LabelGrid, MaterialTable, Surface, SurfaceOptions};
use pellucid_benches::solids;
use serde_json::{Value, json};

/// What is measured is repeated for so long.
const LONG: Duration = Duration::from_secs(4);
/// About so many points are compared with paths.
const TRACED: usize = 400;
const DRAW: Draw = Draw::new(3, Pass::Judge(0));

type Failure = Box<dyn std::error::Error>;

/// The best time of `work` in seconds, after one that does not count.
fn best(mut work: impl FnMut() -> Result<(), Failure>) -> Result<f64, Failure> {
    work()?;
    let (start, mut best) = (Instant::now(), f64::INFINITY);
    while start.elapsed() < LONG {
        let clock = Instant::now();
        work()?;
        best = best.min(clock.elapsed().as_secs_f64());
    }
    Ok(best)
}

fn network_alone(trained: &TrainedNetwork, device: &Device) -> Result<Vec<Value>, Failure> {
    let mut rows = Vec::new();
    let batches: &[usize] = if device.is_cpu() { &[128] } else { &[1024, 4096, 16_384] };
    for (name, dtype) in [("f32", DType::F32), ("bf16", DType::BF16)] {
        let vb = VarBuilder::from_slice_safetensors(SHIPPED, dtype, device)?;
        let rpnn = Rpnn::new(trained.weights.variant(), trained.weights.head(), vb)?;
        for &batch in batches {
            let inputs = Tensor::rand(0f32, 0.5, (batch, LEVELS, LEVEL_INPUTS), device)?.to_dtype(dtype)?;
            let seconds = best(|| {
                // One value of each sample comes back, so that all of it was computed.
                let out = rpnn.forward(&inputs)?.to_dtype(DType::F32)?;
                out.flatten_all()?.to_vec1::<f32>()?;
                Ok(())
            })?;
            rows.push(json!({ "precision": name, "batch": batch, "samples_per_s": batch as f64 / seconds }));
        }
    }
    Ok(rows)
}

struct Scene {
    labels: LabelGrid,
    object: Arc<Object>,
}

impl Scene {
    fn new() -> Result<Self, Failure> {
        let labels = solids::ball(10.0, 1.0);
        let surface = Surface::extract(&labels, &SurfaceOptions::default(), &Control::none())?;
        let object = Arc::new(Object::new(surface, MaterialTable::cmykw(), 1.5)?);
        Ok(Self { labels, object })
    }

    fn bound(&self, predictor: &dyn Predictor) -> Result<Box<dyn BoundPredictor>, Failure> {
        let mut bound = predictor.bind(self.object.clone())?;
        bound.update(&self.labels, Changed::Unknown, &Control::none())?;
        Ok(bound)
    }

    fn radiance(&self, bound: &dyn BoundPredictor, points: &[u32]) -> Result<Vec<f32>, Failure> {
        let mut out = vec![0.0; points.len() * self.object.channels()];
        bound.predict(points, DRAW, &mut out, &Control::none())?;
        Ok(out)
    }
}

fn rms(a: &[f32], b: &[f32]) -> f64 {
    (a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
}

fn predictors(trained: Arc<TrainedNetwork>, device: &Device) -> Result<Vec<Value>, Failure> {
    let scene = Scene::new()?;
    let all = scene.object.points();
    // The processor would take minutes for all of them without sharing.
    let limit = if device.is_cpu() { 2_000 } else { 40_000 };
    let points: Vec<u32> = all.iter().copied().take(limit).collect();
    let some: Vec<u32> = points.iter().copied().step_by((points.len() / TRACED).max(1)).collect();
    let traced = scene.radiance(&*scene.bound(&MonteCarlo::new(1024)?)?, &some)?;
    let own =
        |precision, sharing| Network::new(trained.clone(), precision).with_sharing_where_possible(sharing);
    let candle = |precision, sharing| {
        CandleNetwork::new(trained.clone(), device.clone(), precision)?.with_sharing(sharing)
    };
    let reference = scene.radiance(&*scene.bound(&own(Precision::F32, None)?)?, &points)?;
    let shared = Some(Sharing::default());
    let every: [(&str, Box<dyn Predictor>); 7] = [
        ("own f32, every point", Box::new(own(Precision::F32, None)?)),
        ("own bf16, every point", Box::new(own(Precision::Bf16, None)?)),
        ("own bf16, shared", Box::new(own(Precision::Bf16, shared)?)),
        ("candle f32, every point", Box::new(candle(Precision::F32, None)?)),
        ("candle bf16, every point", Box::new(candle(Precision::Bf16, None)?)),
        ("candle f32, shared", Box::new(candle(Precision::F32, shared)?)),
        ("candle bf16, shared", Box::new(candle(Precision::Bf16, shared)?)),
    ];
    let mut rows = Vec::new();
    for (name, predictor) in &every {
        let bound = scene.bound(&**predictor)?;
        let values = scene.radiance(&*bound, &points)?;
        let largest = values.iter().zip(&reference).fold(0f32, |w, (a, b)| w.max((a - b).abs()));
        let at_some = scene.radiance(&*bound, &some)?;
        let seconds = best(|| scene.radiance(&*bound, &points).map(drop))?;
        rows.push(json!({
            "predictor": name,
            "points_per_s": points.len() as f64 / seconds,
            "largest_difference": largest,
            "rms_difference": rms(&values, &reference),
            "rms_error": rms(&at_some, &traced),
        }));
    }
    Ok(rows)
}

fn main() -> Result<(), Failure> {
    let name = std::env::args().nth(1).unwrap_or_else(|| "cpu".to_owned());
    let kind = NetworkDevice::from_name(&name).ok_or_else(|| format!("{name}: cpu, cuda or metal"))?;
    let device = kind.open()?;
    let trained = Arc::new(shipped()?);
    let told = json!({
        "device": name,
        "weights": trained.weights.digest(),
        "head": trained.weights.head().name(),
        "threads": rayon::current_num_threads(),
        "instruction_set": pellucid::core::InstructionSet::chosen().name(),
        "network": network_alone(&trained, &device)?,
        "predictors": predictors(trained, &device)?,
    });
    println!("{}", serde_json::to_string_pretty(&told)?);
    Ok(())
}
