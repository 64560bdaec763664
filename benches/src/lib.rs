//! What the benchmarks share: test volumes and the dense tables that they compare with.
#![forbid(unsafe_code)]

pub mod dense;
pub mod volumes;
