//! The input form as tensor operations.

use candle_core::{DType, Device, Result, Tensor};
use candle_nn::Module;

use crate::transform::{FeatureTransform, InputForm, LevelOrder};
use crate::variant::{CELLS, FEATURES, LEVEL_INPUTS, LEVELS};

/// [`InputForm`] as a module: raw stencils `[samples][9][270]` in 1/mm, none negative, finest level first, to the inputs
/// of an [`Rpnn`](super::Rpnn).
#[derive(Clone, Debug)]
pub struct InputLayer {
    /// What each raw value is multiplied by, `[9][270]`.
    factors: Tensor,
    /// What the logarithms are multiplied by, `[270]`; none are taken without it.
    of_logarithms: Option<Tensor>,
    /// The levels' positions, where the coarse ones come first.
    order: Option<Tensor>,
}

impl InputLayer {
    /// The layer of a form, for stencils of a float type on a device.
    ///
    /// # Errors
    /// When the device fails.
    pub fn new(form: InputForm, dtype: DType, device: &Device) -> Result<Self> {
        let (features, logarithms) = match form.transform {
            FeatureTransform::Scaled => ([1.0 / 64.0; FEATURES], None),
            FeatureTransform::Log => ([0.2, 30.0], Some([1.0 / 3.0, 1.0 / 4.0])),
        };
        let tensor = |values: Vec<f64>| Tensor::new(values, device)?.to_dtype(dtype);
        let level = |values: [f64; FEATURES]| values.into_iter().cycle().take(CELLS * FEATURES);
        let factors = (0..LEVELS).flat_map(|k| level(features.map(|f| f * f64::from(1u32 << k)))).collect();
        Ok(Self {
            factors: tensor(factors)?.reshape((LEVELS, LEVEL_INPUTS))?,
            of_logarithms: logarithms.map(|factors| tensor(level(factors).collect())).transpose()?,
            order: match form.order {
                LevelOrder::FineToCoarse => None,
                LevelOrder::CoarseToFine => {
                    Some(Tensor::new((0..LEVELS as u32).rev().collect::<Vec<_>>(), device)?)
                }
            },
        })
    }
}

impl Module for InputLayer {
    fn forward(&self, stencils: &Tensor) -> Result<Tensor> {
        let mut values = stencils.broadcast_mul(&self.factors)?;
        if let Some(factors) = &self.of_logarithms {
            values = (values + 1.0)?.log()?.broadcast_mul(factors)?;
        }
        match &self.order {
            Some(order) => values.index_select(order, 1),
            None => Ok(values),
        }
    }
}
