//! A network's weights as a setting.

#[cfg(feature = "rpnn")]
use std::sync::Arc;

/// Weights of a network and what they were trained for. Reading them takes the feature `rpnn`.
#[derive(Clone, Debug)]
pub struct NetworkWeights {
    #[cfg(feature = "rpnn")]
    pub(crate) trained: Arc<pellucid_rpnn::TrainedNetwork>,
    digest: String,
}

impl PartialEq for NetworkWeights {
    fn eq(&self, other: &Self) -> bool {
        self.digest == other.digest
    }
}

#[cfg(feature = "rpnn")]
impl NetworkWeights {
    /// Wraps weights in memory.
    pub fn new(trained: pellucid_rpnn::TrainedNetwork) -> Self {
        Self { digest: trained.weights.digest(), trained: Arc::new(trained) }
    }

    /// Reads a file of `pellucid train`.
    ///
    /// # Errors
    /// [`pellucid_rpnn::RpnnError`] when it is no such file.
    pub fn load(path: impl AsRef<std::path::Path>) -> Result<Self, pellucid_rpnn::RpnnError> {
        Ok(Self::new(pellucid_rpnn::file::load(path.as_ref())?))
    }
}
