//! What an export records, and what it may replace.

use crate::{Container, Recorded};

/// What the caller wants recorded, and whether an output may be replaced.
#[derive(Clone, Debug, PartialEq)]
pub struct ExportSettings {
    /// Replace an existing output of this program.
    pub force: bool,
    /// What slices are written as.
    pub format: Container,
    /// Random seed of the preparation, for the manifest.
    pub seed: u64,
    /// Program and version, for the manifest.
    pub generator: String,
    /// Anything else worth recording in the manifest: all that is needed to make the print again.
    pub settings: Recorded,
}

impl Default for ExportSettings {
    fn default() -> Self {
        Self {
            force: false,
            format: Container::Png,
            seed: 0,
            generator: concat!("pellucid-slice ", env!("CARGO_PKG_VERSION")).into(),
            settings: Recorded::default(),
        }
    }
}
