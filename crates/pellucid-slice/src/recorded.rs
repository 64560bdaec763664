//! Settings of other programs inside a manifest.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::{SliceError, json};

/// Anything that serialises, kept as it stands in a manifest: what a program needs to make a print again.
///
/// ```
/// use pellucid_slice::Recorded;
/// let recorded = Recorded::of(&("paths", 16, 1.5))?;
/// assert_eq!(recorded.read::<(String, u32, f64)>()?, ("paths".into(), 16, 1.5));
/// # Ok::<(), pellucid_slice::SliceError>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Recorded(Value);

impl Recorded {
    /// Records a value. Numbers come back exactly, those that are not finite as nothing.
    ///
    /// # Errors
    /// [`SliceError::Invalid`] when JSON cannot hold it, such as a map with keys that are no strings.
    pub fn of(value: &impl Serialize) -> Result<Self, SliceError> {
        match serde_json::to_value(value) {
            Ok(value) => Ok(Self(value)),
            Err(error) => Err(SliceError::invalid("recorded settings", error.to_string())),
        }
    }

    /// The value as it was recorded.
    ///
    /// # Errors
    /// [`SliceError::Invalid`] naming the field that is not what it should be.
    pub fn read<T: DeserializeOwned>(&self) -> Result<T, SliceError> {
        json::convert("recorded settings", &self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct Settings {
        seed: u64,
        weights: Vec<f32>,
        intent: Option<String>,
        index: f64,
    }

    #[test]
    fn settings_come_back_exactly_and_errors_name_the_field() {
        let settings =
            Settings { seed: u64::MAX, weights: vec![0.1, -3e-7, f32::MAX], intent: None, index: 1.0 / 3.0 };
        let text = serde_json::to_string(&Recorded::of(&settings).unwrap()).unwrap();
        let back: Recorded = serde_json::from_str(&text).unwrap();
        assert_eq!(back.read::<Settings>().unwrap(), settings);
        let wrong = Recorded::of(&serde_json::json!({"seed": 1, "weights": [1, "x"]})).unwrap();
        let error = wrong.read::<Settings>().unwrap_err().to_string();
        assert!(
            error.contains("recorded settings, weights[1]: found text \"x\" where a number is expected"),
            "{error}"
        );
        assert!(Recorded::of(&std::collections::BTreeMap::from([([1u8, 2], 3)])).is_err());
    }
}
