//! The derivative of radiance by the amounts of materials.

#[path = "pullback/bytes.rs"]
mod bytes;
#[path = "pullback/closed_form.rs"]
mod closed_form;
mod common;
#[path = "pullback/differences.rs"]
mod differences;
#[path = "pullback/edges.rs"]
mod edges;
#[path = "pullback/mixtures.rs"]
mod mixtures;
#[path = "pullback/pooled.rs"]
mod pooled;
#[path = "pullback/sums.rs"]
mod sums;
