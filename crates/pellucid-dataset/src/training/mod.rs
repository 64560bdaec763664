//! Training the appearance network on procedural volumes, and judging it on labelled sets (feature `training`).
//!
//! A run reads a [`TrainingSet`], is validated on a [`LabelledSet`](crate::LabelledSet), and leaves weights that
//! say what they were trained for ([`provenance`]) beside a state to go on from.

mod error;
mod judge;
mod run;
mod set;

pub use error::TrainingError;
pub use judge::judge_network;
pub use run::{
    CURVE_FILE, Outcome, RunSettings, STATE_FILE, UNPLANNED_STEPS, WEIGHTS_FILE, follow, run, validate,
};
pub use set::{TrainingSet, provenance, validation_set};
