//! Volumes that the benchmarks share.
#![forbid(unsafe_code)]

pub mod volumes;
