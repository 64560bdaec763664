//! Who computes the outputs of a batch and the gradient of its loss.

use super::TrainSettings;
#[cfg(feature = "candle")]
use super::candle::CandlePasses;
use crate::{Network, RpnnError, Weights};

/// Who computes outputs and gradients. All else in a step is the trainer's: samples and mirrors, the loss,
/// clipping, the optimiser, the schedule.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Engine {
    /// This crate's [`Network`].
    #[default]
    Own,
    /// [`Rpnn`](crate::candle::Rpnn) on the CPU, in f32: the reference for runs of [`Engine::Own`].
    #[cfg(feature = "candle")]
    Candle,
}

/// The passes of one batch: forward, then backward.
#[derive(Clone, Debug)]
pub(super) enum Passes {
    Own(Box<Network>),
    #[cfg(feature = "candle")]
    Candle(Box<CandlePasses>),
}

impl Passes {
    pub(super) fn new(engine: Engine, settings: &TrainSettings) -> Result<Self, RpnnError> {
        match engine {
            Engine::Own => {
                let mut network =
                    Network::new(settings.variant, settings.head, settings.batch, settings.precision)?;
                if let Some(set) = settings.instruction_set {
                    network = network.with_instruction_set(set)?;
                }
                Ok(Self::Own(Box::new(network)))
            }
            #[cfg(feature = "candle")]
            Engine::Candle => Ok(Self::Candle(Box::new(CandlePasses::new(settings.precision)?))),
        }
    }

    /// As [`Network::forward`], with these weights.
    pub(super) fn forward(
        &mut self,
        weights: &Weights,
        inputs: &[f32],
        out: &mut [f32],
    ) -> Result<(), RpnnError> {
        match self {
            Self::Own(network) => {
                network.load(weights)?;
                network.forward(inputs, out)
            }
            #[cfg(feature = "candle")]
            Self::Candle(passes) => passes.forward(weights, inputs, out),
        }
    }

    /// As [`Network::backward`].
    pub(super) fn backward(&mut self, d_out: &[f32], gradient: &mut [f32]) -> Result<(), RpnnError> {
        match self {
            Self::Own(network) => network.backward(d_out, gradient),
            #[cfg(feature = "candle")]
            Self::Candle(passes) => passes.backward(d_out, gradient),
        }
    }
}
