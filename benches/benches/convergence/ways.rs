//! The ways to refine that are compared.

use std::sync::Arc;

use pellucid::predict::{Network, Predictor};
use pellucid::{PredictorKind, PrintJob, PrintSettings, StrategyKind};
use pellucid_benches::appearance::Error;

/// A strategy with what predicts for it.
pub struct Way {
    /// What it is called in tables.
    pub name: &'static str,
    strategy: StrategyKind,
    by: By,
}

/// What predicts.
enum By {
    /// The predictor that settings name, with so many paths where they are not the strategy's own.
    Settings(PredictorKind, Option<u32>),
    /// The network without paths, which no setting of a job asks for.
    NetworkAlone,
}

/// The default of the first strategy, which the others are measured by.
pub const SURFACE_FIRST: &str = "surface-first, 16 paths";
/// The default of the second, and of the library.
pub const DESCENT: &str = "descent by paths";

const fn way(name: &'static str, strategy: StrategyKind, by: By) -> Way {
    Way { name, strategy, by }
}

/// In the order of the tables.
pub const WAYS: [Way; 7] = [
    way(SURFACE_FIRST, StrategyKind::SurfaceFirst, By::Settings(PredictorKind::MonteCarlo, None)),
    way(
        "surface-first, 4 paths",
        StrategyKind::SurfaceFirst,
        By::Settings(PredictorKind::MonteCarlo, Some(4)),
    ),
    way(
        "surface-first, 512 paths",
        StrategyKind::SurfaceFirst,
        By::Settings(PredictorKind::MonteCarlo, Some(512)),
    ),
    way("surface-first, network alone", StrategyKind::SurfaceFirst, By::NetworkAlone),
    way(
        "surface-first, corrected network",
        StrategyKind::SurfaceFirst,
        By::Settings(PredictorKind::Rpnn, None),
    ),
    way(DESCENT, StrategyKind::Descent, By::Settings(PredictorKind::MonteCarlo, None)),
    way("descent, averaged network", StrategyKind::Descent, By::Settings(PredictorKind::Rpnn, None)),
];

impl Way {
    /// Settings of a job that goes this way, all others being `settings`.
    pub fn settings(&self, settings: PrintSettings) -> PrintSettings {
        let (predictor, spp) = match self.by {
            By::Settings(predictor, spp) => (predictor, spp),
            By::NetworkAlone => (PredictorKind::MonteCarlo, None),
        };
        PrintSettings { strategy: self.strategy, predictor, spp, ..settings }
    }

    /// What predicts for such a job.
    ///
    /// # Errors
    /// When the network cannot be made.
    pub fn predictor(&self, job: &PrintJob) -> Result<Arc<dyn Predictor>, Error> {
        Ok(match self.by {
            By::Settings(..) => Arc::clone(job.predictor()),
            By::NetworkAlone => Arc::new(Network::shipped()?.with_sharing(job.settings().sharing)?),
        })
    }
}
