//! What a report records of a predictor, so that a print can be made again.

use std::collections::BTreeMap;

use pellucid_core::InstructionSet;

/// Which predictor, with what settings, on which instructions.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Identity {
    /// A short name, such as `mc` or `rpnn`.
    pub name: String,
    /// Settings that decide the values, by name.
    #[cfg_attr(feature = "serde", serde(default))]
    pub settings: BTreeMap<String, String>,
    /// The network's weights, where there is a network.
    #[cfg_attr(feature = "serde", serde(default))]
    pub weights: Option<WeightsIdentity>,
    /// The instructions that the values were made with. Where [`Identity::exact`] is true they do not matter.
    pub instruction_set: InstructionSet,
    /// Values are the same, bit for bit, on any instruction set.
    pub exact: bool,
}

/// Which weights a network has.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct WeightsIdentity {
    /// Digest of all weights, in hexadecimal.
    pub digest: String,
    /// The network's variant.
    pub variant: String,
    /// How they came to be, a line each.
    pub history: Vec<String>,
}

impl Identity {
    /// An identity by name only.
    pub fn new(name: impl Into<String>, instruction_set: InstructionSet, exact: bool) -> Self {
        Self { name: name.into(), settings: BTreeMap::new(), weights: None, instruction_set, exact }
    }

    /// The same with one more setting.
    pub fn with(mut self, setting: impl Into<String>, value: impl ToString) -> Self {
        self.settings.insert(setting.into(), value.to_string());
        self
    }

    /// The same with the network's weights.
    pub fn with_weights(mut self, weights: WeightsIdentity) -> Self {
        self.weights = Some(weights);
        self
    }
}
