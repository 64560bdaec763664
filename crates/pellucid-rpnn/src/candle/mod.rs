//! The network in candle: the readable form, the oracle of the own kernels' gradients, and the way to GPUs.
//!
//! | module | owns |
//! | --- | --- |
//! | `network` | [`Rpnn`], the four variants as a [`candle_nn::Module`] |
//! | `input` | [`InputLayer`], the input form as tensor operations |
//! | `parameters` | [`tensors`], from [`Weights`](crate::Weights) to named tensors |
//! | `flight` | [`radiance`], of [`Head::FirstFlight`](crate::variant::Head) outputs and first flights |
//!
//! Weight files are read unchanged, on any device:
//!
//! ```
//! use candle_core::{DType, Device, Tensor};
//! use candle_nn::{Module, VarBuilder};
//! use pellucid_rpnn::candle::{InputLayer, Rpnn};
//! use pellucid_rpnn::variant::Head;
//! use pellucid_rpnn::{Provenance, Variant, Weights, file};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("weights.safetensors");
//! # let form = Default::default();
//! # let range = [0.1, 24.0];
//! # let provenance = Provenance {
//! #     form, pitch_mm: [0.1; 3], refractive_index: 1.5, sigma_s_range: range, sigma_a_range: range,
//! #     history: String::new(),
//! # };
//! # file::save(&path, &Weights::initial(Variant::SharedLevels, Head::Radiance, 1, 0.4), &provenance)?;
//! let network = file::load(&path)?;
//! let (variant, head) = (network.weights.variant(), network.weights.head());
//! let vb = VarBuilder::from_buffered_safetensors(std::fs::read(&path)?, DType::F32, &Device::Cpu)?;
//! let rpnn = Rpnn::new(variant, head, vb)?;
//! let inputs = InputLayer::new(network.provenance.form, DType::F32, &Device::Cpu)?;
//! // Two points amid 6/mm of scattering and 6/mm of absorption.
//! let stencils = Tensor::full(6f32, (2, 9, 270), &Device::Cpu)?;
//! let radiance = rpnn.forward(&inputs.forward(&stencils)?)?;
//! assert_eq!(radiance.dims(), [2]);
//! # Ok(())
//! # }
//! ```
//!
//! Trained by candle-nn's optimisers, from the values that [`Weights::initial`](crate::Weights::initial) draws, and
//! written for all that reads weight files:
//!
//! ```
//! use candle_core::{DType, Device, Tensor};
//! use candle_nn::{AdamW, Module, Optimizer, ParamsAdamW, VarBuilder, VarMap};
//! use pellucid_rpnn::candle::{Rpnn, tensors};
//! use pellucid_rpnn::variant::Head;
//! use pellucid_rpnn::{Variant, Weights};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let (variant, head, device) = (Variant::SharedLevels, Head::Radiance, Device::Cpu);
//! let mut map = VarMap::new();
//! let rpnn = Rpnn::new(variant, head, VarBuilder::from_varmap(&map, DType::F32, &device))?;
//! // candle has no seed on the CPU: these values are the same in every run.
//! map.set(tensors(&Weights::initial(variant, head, 7, 0.4), &device)?.iter())?;
//! let mut optimiser = AdamW::new(map.all_vars(), ParamsAdamW { lr: 1e-4, ..Default::default() })?;
//! let (inputs, radiance) = (Tensor::full(0.1f32, (4, 9, 270), &device)?, Tensor::full(0.6f32, 4, &device)?);
//! let loss = (rpnn.forward(&inputs)? - &radiance)?.sqr()?.mean_all()?;
//! optimiser.backward_step(&loss)?;
//! let trained: Weights = rpnn.weights()?;
//! # assert_ne!(trained, Weights::initial(variant, head, 7, 0.4));
//! # Ok(())
//! # }
//! ```
//!
//! Devices beyond the CPU are candle's, behind the features `cuda` and `metal`. Neither was run by this project yet.

mod flight;
mod input;
mod network;
mod parameters;

pub use flight::radiance;
pub use input::InputLayer;
pub use network::Rpnn;
pub use parameters::tensors;
