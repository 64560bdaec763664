//! The network on one thread: samples a second, forward and training step, by precision and instruction set.
//!
//! `cargo bench -p pellucid-benches --bench network`
//!
//! Every round times all forms in turn and the best of a form's rounds counts, so that whatever else the machine
//! does falls on all alike.

use std::time::Instant;

use pellucid_rpnn::adamw::{AdamW, AdamWSettings};
use pellucid_rpnn::variant::{Head, INPUTS};
use pellucid_rpnn::{InstructionSet, Network, Precision, RpnnError, Variant, Weights};

const VARIANT: Variant = Variant::SharedLevelsAndOctants;
const HEAD: Head = Head::FirstFlight;
/// Samples of a prediction's batch and of a training step.
const FORWARD: usize = 64;
const STEP: usize = 256;
const ROUNDS: usize = 40;
/// Multiply-adds of a sample: 9 levels of two 60x60 layers on 8 octants and three 480x480 ones, one less in the
/// first level, and the end.
const PRODUCTS: f64 = (9 * (2 * 8 * 3600 + 3 * 480 * 480) - 480 * 480 + 8 * (2 * 3600 + 4 * 60)) as f64;

/// One precision on one instruction set.
struct Case {
    precision: Precision,
    set: InstructionSet,
    weights: Weights,
    network: Network,
    adam: AdamW,
    /// Best seconds a sample.
    forward: f64,
    step: f64,
}

impl Case {
    fn new(precision: Precision, set: InstructionSet) -> Result<Self, RpnnError> {
        let weights = Weights::initial(VARIANT, HEAD, 1, 0.5);
        let mut network = Network::new(VARIANT, HEAD, STEP, precision)?.with_instruction_set(set)?;
        network.load(&weights)?;
        let adam = AdamW::new(AdamWSettings::default(), weights.values());
        Ok(Self { precision, set, weights, network, adam, forward: f64::INFINITY, step: f64::INFINITY })
    }

    fn round(&mut self, inputs: &[f32], outputs: &mut [f32], gradient: &mut [f32]) -> Result<(), RpnnError> {
        // The first finds the caches full of another form's work.
        for _ in 0..4 {
            let start = Instant::now();
            self.network.forward(&inputs[..FORWARD * INPUTS], &mut outputs[..FORWARD * HEAD.outputs()])?;
            self.forward = self.forward.min(start.elapsed().as_secs_f64() / FORWARD as f64);
        }
        let start = Instant::now();
        self.network.load(&self.weights)?;
        self.network.forward(inputs, outputs)?;
        outputs.iter_mut().for_each(|out| *out = (*out - 0.5) * 2.0 / STEP as f32);
        gradient.fill(0.0);
        self.network.backward(outputs, gradient)?;
        self.adam.step(self.weights.values_mut(), gradient, 1e-6)?;
        self.step = self.step.min(start.elapsed().as_secs_f64() / STEP as f64);
        Ok(())
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut cases = Vec::new();
    for precision in [Precision::F32, Precision::Bf16] {
        for set in InstructionSet::available() {
            // Products of f32 need no bf16.
            if precision == Precision::Bf16 || set <= InstructionSet::Avx512 {
                cases.push(Case::new(precision, set)?);
            }
        }
    }
    let inputs: Vec<f32> = (0..STEP * INPUTS).map(|i| (i as f32 * 0.37).sin().max(0.0)).collect();
    let mut outputs = vec![0.0; STEP * HEAD.outputs()];
    let mut gradient = vec![0.0; cases[0].weights.values().len()];
    for round in 0..ROUNDS {
        // The portable form is slow and needs fewer.
        for case in cases.iter_mut().filter(|case| case.set > InstructionSet::Portable || round % 8 == 0) {
            case.round(&inputs, &mut outputs, &mut gradient)?;
        }
    }
    println!(
        "| precision | instruction set | forward, samples/s | training step, samples/s | forward, GMAC/s |"
    );
    println!("| --- | --- | --- | --- | --- |");
    for case in &cases {
        let base = cases.iter().find(|base| base.precision == case.precision).unwrap_or(case);
        println!(
            "| {:?} | {} | {:.0} ({:.1}x) | {:.0} ({:.1}x) | {:.1} |",
            case.precision,
            case.set,
            1.0 / case.forward,
            base.forward / case.forward,
            1.0 / case.step,
            base.step / case.step,
            PRODUCTS / case.forward * 1e-9,
        );
    }
    Ok(())
}
