//! Samples a second on one thread: forward and training step, this crate beside candle.
//!
//! `cargo run --release -p pellucid-rpnn --features candle --example throughput`

use std::time::Instant;

use candle_core::{DType, Device, Tensor};
use candle_nn::{Module, VarBuilder, VarMap};
use pellucid_rpnn::adamw::{AdamW, AdamWSettings};
use pellucid_rpnn::candle::Rpnn;
use pellucid_rpnn::variant::{Head, INPUTS, LEVEL_INPUTS, LEVELS};
use pellucid_rpnn::{Network, Precision, Variant, Weights};

const BATCH: usize = 256;

/// The best of several timings, as samples a second.
fn rate(rounds: usize, mut work: impl FnMut()) -> f64 {
    work();
    let best = (0..rounds)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min);
    BATCH as f64 / best
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let inputs: Vec<f32> = (0..BATCH * INPUTS).map(|i| (i as f32 * 0.37).sin().max(0.0)).collect();
    let labels = vec![0.5f32; BATCH];
    println!(
        "{:>10} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9}",
        "variant", "f32 fwd", "f32 step", "bf16 fwd", "bf16 step", "candle fwd", "candle step"
    );
    for variant in Variant::ALL {
        let mut row = Vec::new();
        for precision in [Precision::F32, Precision::Bf16] {
            let mut weights = Weights::initial(variant, Head::Radiance, 1, 0.5);
            let mut network = Network::new(variant, Head::Radiance, BATCH, precision)?;
            network.load(&weights)?;
            let (mut out, mut d_out) = (vec![0.0; BATCH], vec![0.0; BATCH]);
            row.push(rate(5, || network.forward(&inputs, &mut out).expect("shapes agree")));
            let mut adam = AdamW::new(AdamWSettings::default(), weights.values());
            let mut gradient = vec![0.0; weights.values().len()];
            row.push(rate(5, || {
                network.load(&weights).expect("one variant");
                network.forward(&inputs, &mut out).expect("shapes agree");
                for ((d, o), l) in d_out.iter_mut().zip(&out).zip(&labels) {
                    *d = 2.0 * (o - l) / BATCH as f32;
                }
                gradient.fill(0.0);
                network.backward(&d_out, &mut gradient).expect("shapes agree");
                adam.step(weights.values_mut(), &gradient, 1e-4).expect("finite");
            }));
        }
        let vb = VarBuilder::from_varmap(&VarMap::new(), DType::F32, &Device::Cpu);
        let model = Rpnn::new(variant, Head::Radiance, vb)?;
        let x = Tensor::from_slice(&inputs, (BATCH, LEVELS, LEVEL_INPUTS), &Device::Cpu)?;
        let y = Tensor::from_slice(&labels, BATCH, &Device::Cpu)?;
        row.push(rate(3, || drop(model.forward(&x).expect("shapes agree"))));
        // Without the optimiser: candle's own would only add to this.
        row.push(rate(3, || {
            let loss = (model.forward(&x).expect("shapes agree") - &y)
                .and_then(|d| d.sqr())
                .and_then(|d| d.mean_all());
            drop(loss.and_then(|l| l.backward()).expect("differentiable"));
        }));
        let row: Vec<String> = row.iter().map(|r| format!("{r:9.0}")).collect();
        println!("{:>10} {}", variant.name(), row.join(" "));
    }
    Ok(())
}
