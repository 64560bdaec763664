//! The forms that the network is computed in, and how far each may be from the naive one.

use pellucid_rpnn::transform::InputForm;
use pellucid_rpnn::{Inference, InstructionSet, Precision, Weights};

/// Outputs of raw stencils `[sample][9][270]`, `[sample][output]`: what the network's users get.
type Compute = Box<dyn Fn(&Weights, InputForm, &[f32]) -> Vec<f64>>;

pub struct Form {
    pub name: String,
    /// Greatest difference from the naive f64 network, as a part of 1 plus the largest plain output of the case.
    pub tolerance: f64,
    pub compute: Compute,
}

/// Rounding of f32 over sums of 480 terms and nine levels; 3e-6 at most was seen.
const F32: f64 = 1e-5;
/// Rounding of bf16 weights and activations, 8 bits; 0.015 at most was seen.
const BF16: f64 = 0.04;
/// Rounding of f64; 4e-15 at most was seen.
#[cfg(feature = "candle")]
const F64: f64 = 1e-13;

pub fn all() -> Vec<Form> {
    let mut forms = Vec::new();
    for set in InstructionSet::available() {
        for (precision, tolerance) in [(Precision::F32, F32), (Precision::Bf16, BF16)] {
            let compute = move |weights: &Weights, form: InputForm, stencils: &[f32]| {
                own(weights, form, stencils, precision, set)
            };
            let name = format!("own {precision:?} on {set}");
            forms.push(Form { name, tolerance, compute: Box::new(compute) });
        }
    }
    #[cfg(feature = "candle")]
    for (dtype, tolerance) in [(candle_core::DType::F32, F32), (candle_core::DType::F64, F64)] {
        let compute = move |weights: &Weights, form: InputForm, stencils: &[f32]| {
            candle(weights, form, stencils, dtype)
        };
        forms.push(Form { name: format!("candle {dtype:?}"), tolerance, compute: Box::new(compute) });
    }
    forms
}

fn own(
    weights: &Weights,
    form: InputForm,
    stencils: &[f32],
    precision: Precision,
    set: InstructionSet,
) -> Vec<f64> {
    let mut inference = Inference::new(weights, form, precision).unwrap().with_instruction_set(set).unwrap();
    let mut out = vec![0.0; stencils.len() / 2430 * weights.head().outputs()];
    inference.outputs(stencils, &mut out).unwrap();
    out.into_iter().map(f64::from).collect()
}

#[cfg(feature = "candle")]
fn candle(weights: &Weights, form: InputForm, stencils: &[f32], dtype: candle_core::DType) -> Vec<f64> {
    use candle_core::{DType, Device, Tensor};
    use candle_nn::{Module, VarBuilder};
    use pellucid_rpnn::candle::{InputLayer, Rpnn, tensors};

    let device = &Device::Cpu;
    let vb = VarBuilder::from_tensors(tensors(weights, device).unwrap(), dtype, device);
    let rpnn = Rpnn::new(weights.variant(), weights.head(), vb).unwrap();
    let inputs = InputLayer::new(form, dtype, device).unwrap();
    let stencils = Tensor::from_slice(stencils, (stencils.len() / 2430, 9, 270), device).unwrap();
    let out = rpnn.forward(&inputs.forward(&stencils.to_dtype(dtype).unwrap()).unwrap()).unwrap();
    out.to_dtype(DType::F64).unwrap().flatten_all().unwrap().to_vec1().unwrap()
}
