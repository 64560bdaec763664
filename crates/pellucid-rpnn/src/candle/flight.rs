//! Radiance from a network's outputs and exact first flights.

use candle_core::{Result, Tensor};

use super::network::relu;
use crate::variant::FLIGHT_BINS;

/// Radiance `[samples]` from the outputs `[samples][4]` of [`Head::FirstFlight`](crate::variant::Head::FirstFlight) and
/// the samples' first flights `[samples][5]`, ordered as [`FirstFlight::to_array`](crate::variant::FirstFlight::to_array)
/// says: [`Head::radiance`](crate::variant::Head::radiance) as tensor operations, for losses of the radiance.
///
/// # Errors
/// When the shapes, types or devices do not agree.
pub fn radiance(outputs: &Tensor, flights: &Tensor) -> Result<Tensor> {
    let part = |first, values| flights.narrow(1, first, values);
    let (masses, escaped, returned) =
        (part(0, FLIGHT_BINS)?, part(FLIGHT_BINS, 1)?, part(FLIGHT_BINS + 1, 1)?);
    let scattered = (outputs * Tensor::cat(&[masses, returned], 1)?)?.sum(1)?;
    relu(&(scattered + escaped.squeeze(1)?)?)
}
