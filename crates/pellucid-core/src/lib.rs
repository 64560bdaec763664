//! The ground under the Pellucid crates.
//!
//! | module | owns |
//! | --- | --- |
//! | `checkpoints` | what long work has done, kept in a folder: `Checkpoints` (feature `json`) |
//! | [`control`] | progress and cancellation of long work: [`Control`], [`Cancelled`] |
//! | [`fault`] | what is wrong with which input, and what would be right: [`Fault`], [`FileError`], [`chain`] |
//! | [`digest`] | telling data apart: [`Digest`] |
//! | [`files`] | reading no more than a bound, writing whole or not at all |
//! | `json` | errors of JSON files in plain words (feature `json`) |
//! | [`memory`] | amounts of memory: [`Bytes`], and what a process takes |
//! | [`random`] | numbers addressed by seed, domain, item and sample |
//! | [`instruction_set`] | which vector instructions are used, and how to force fewer |
//! | [`staging`] | output folders that appear complete or not at all |
//! | [`stats`] | statistics of errors: [`ErrorStats`], [`NoisyScore`] |
//! | [`team`] | processes that share out their work: [`Team`] |
#![forbid(unsafe_code)]

#[cfg(feature = "json")]
pub mod checkpoints;
pub mod control;
pub mod digest;
pub mod fault;
pub mod files;
pub mod instruction_set;
#[cfg(feature = "json")]
pub mod json;
pub mod memory;
pub mod random;
pub mod staging;
pub mod stats;
pub mod team;

#[cfg(feature = "json")]
pub use checkpoints::{CheckpointError, Checkpoints};
pub use control::{Cancelled, Control, Progress};
pub use digest::Digest;
pub use fault::{Fault, FileError, chain};
pub use instruction_set::InstructionSet;
pub use memory::Bytes;
pub use random::{Domain, stream};
pub use stats::{ErrorStats, NoisyScore};
pub use team::Team;

/// The README's example, compiled and run by the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
