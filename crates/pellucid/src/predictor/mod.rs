//! Adapters from this workspace's light transport to refine's [`AppearancePredictor`].
//!
//! [`AppearancePredictor`]: pellucid_refine::AppearancePredictor

mod monte_carlo;

pub use monte_carlo::MonteCarlo;
