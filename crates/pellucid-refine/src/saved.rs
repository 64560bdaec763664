//! A refinement between two steps, as a value that can be stored.

use std::collections::BTreeMap;

use pellucid_core::random::mix;
use pellucid_predict::Learned;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::{RefineError, RefineReport, RefineSettings};

/// First line of a stored refinement.
const HEADER: &str = "pellucid refinement 1";

/// A refinement between two steps: what [`Refinement::resume`](crate::Refinement::resume) needs, without labels, since
/// they follow from the state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Saved<S> {
    /// [`Strategy::name`](crate::Strategy::name).
    pub strategy: String,
    /// [`Strategy::settings`](crate::Strategy::settings).
    pub strategy_settings: BTreeMap<String, f64>,
    /// The loop's settings.
    pub settings: RefineSettings,
    /// [`Object::id`](pellucid_predict::Object::id).
    pub object: u64,
    /// Digest of targets, viewing and inks.
    pub colors: u64,
    /// The next iteration.
    pub iteration: u32,
    /// The state of the next iteration; of the last one when all are done.
    pub state: S,
    /// The state of the best iteration so far.
    pub best: Option<S>,
    /// What happened so far.
    pub report: RefineReport,
    /// What the predictor learned so far.
    #[serde(with = "crate::packed::learned")]
    pub memory: Learned,
}

impl<S: Serialize + DeserializeOwned> Saved<S> {
    /// As bytes: a line of text, a digest, and JSON with long arrays packed. Every number comes back as it was.
    ///
    /// # Errors
    /// [`RefineError::Unsupported`] when the strategy's state does not serialise.
    pub fn to_bytes(&self) -> Result<Vec<u8>, RefineError> {
        let json = serde_json::to_string(self)
            .map_err(|e| RefineError::unsupported("strategy's state", e.to_string()))?;
        Ok(format!("{HEADER}\n{:016x}\n{json}", digest(json.as_bytes())).into_bytes())
    }

    /// From [`Saved::to_bytes`]. Takes memory in proportion to the bytes.
    ///
    /// # Errors
    /// [`RefineError::Invalid`] when the bytes are not of a refinement, or damaged; [`RefineError::Unsupported`] when
    /// another version wrote them.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, RefineError> {
        let invalid = |reason: &str| RefineError::invalid("checkpoint", reason);
        let mut parts = bytes.splitn(3, |&b| b == b'\n');
        let [Some(header), Some(sum), Some(json)] = [parts.next(), parts.next(), parts.next()] else {
            return Err(invalid("is not of a refinement, or cut off"));
        };
        if header != HEADER.as_bytes() {
            return Err(match header.starts_with(b"pellucid refinement ") {
                true => RefineError::unsupported("checkpoint", "is of another version; begin anew"),
                false => invalid("is not of a refinement"),
            });
        }
        if sum != format!("{:016x}", digest(json)).as_bytes() {
            return Err(invalid("is damaged: its digest differs"));
        }
        serde_json::from_slice(json).map_err(|e| invalid(&e.to_string()))
    }
}

fn digest(bytes: &[u8]) -> u64 {
    let (words, rest) = bytes.as_chunks::<8>();
    let start = mix(bytes.len() as u64 + 1);
    let state = words.iter().fold(start, |state, word| {
        mix(state.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ u64::from_le_bytes(*word))
    });
    rest.iter().fold(state, |state, &b| mix(state ^ u64::from(b)))
}
