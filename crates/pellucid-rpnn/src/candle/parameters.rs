//! From weights to named tensors.

use std::collections::HashMap;

use candle_core::{Device, Result, Tensor};

use crate::Weights;

/// The tensors of weights on a device, by their names in weight files: for
/// [`VarBuilder::from_tensors`](candle_nn::VarBuilder::from_tensors) and [`VarMap::set`](candle_nn::VarMap::set).
///
/// # Errors
/// When the device fails.
pub fn tensors(weights: &Weights, device: &Device) -> Result<HashMap<String, Tensor>> {
    let mut tensors = HashMap::new();
    for layer in &weights.layout().layers {
        let values = &weights.values()[layer.weight.clone()];
        let matrix = Tensor::from_slice(values, (layer.outputs, layer.inputs), device)?;
        tensors.insert(format!("{}.weight", layer.name), matrix);
        if !layer.bias.is_empty() {
            let bias = Tensor::from_slice(&weights.values()[layer.bias.clone()], layer.outputs, device)?;
            tensors.insert(format!("{}.bias", layer.name), bias);
        }
    }
    Ok(tensors)
}
