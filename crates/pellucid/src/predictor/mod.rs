//! Adapters from this workspace's light transport to refine's [`AppearancePredictor`].
//!
//! [`AppearancePredictor`]: pellucid_refine::AppearancePredictor

#[cfg(feature = "job")]
mod corrected;
#[cfg(feature = "mc")]
mod monte_carlo;
#[cfg(feature = "rpnn")]
mod rpnn;

#[cfg(feature = "job")]
pub use corrected::{Corrected, Correction};
#[cfg(feature = "mc")]
pub use monte_carlo::MonteCarlo;
#[cfg(feature = "rpnn")]
pub use rpnn::{Rpnn, Sharing};
