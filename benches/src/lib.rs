//! What the benchmarks share: test volumes, the dense tables that they compare with, plots.
#![forbid(unsafe_code)]

pub mod dense;
pub mod plot;
pub mod volumes;
