//! Reading JSON, with errors that name the field and the place in plain words.

use pellucid_core::{Fault, json::plain};
use serde::de::DeserializeOwned;

use crate::SliceError;

/// Reads a value from JSON text; errors name `subject`, the field, what it must be, and line and column.
pub(crate) fn parse<T: DeserializeOwned>(subject: &str, text: &str) -> Result<T, SliceError> {
    let mut deserializer = serde_json::Deserializer::from_str(text);
    let value = serde_path_to_error::deserialize(&mut deserializer)
        .map_err(|e| invalid(subject, &e.path().to_string(), e.inner()))?;
    deserializer.end().map_err(|e| invalid(subject, ".", &e))?;
    Ok(value)
}

/// A value that was read before, such as a part of a file, as a type of its own.
pub(crate) fn convert<T: DeserializeOwned>(
    subject: &str,
    value: &serde_json::Value,
) -> Result<T, SliceError> {
    serde_path_to_error::deserialize(value).map_err(|e| invalid(subject, &e.path().to_string(), e.inner()))
}

fn invalid(subject: &str, path: &str, error: &serde_json::Error) -> SliceError {
    // The path of the whole text is a dot, and a place that cannot be told a question mark.
    let field = match path {
        "." | "?" => subject.to_owned(),
        path => format!("{subject}, {}", path.trim_end_matches(".?")),
    };
    SliceError::Invalid(Fault::new(field, plain(error)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[derive(Debug, serde::Deserialize)]
    #[serde(rename_all = "snake_case")]
    enum Kind {
        Left,
    }

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    #[allow(dead_code, reason = "only what cannot be read is looked at")]
    struct Example {
        count: usize,
        colors: BTreeMap<String, [u8; 4]>,
        edge: Option<f64>,
        kind: Option<Kind>,
    }

    #[test]
    fn errors_name_field_kind_and_place_without_speaking_rust() {
        for (text, words) in [
            (
                "{\"count\": \"a\"}",
                "thing, count: found text \"a\" where a whole number, 0 or more, is expected (line 1, column 13)",
            ),
            (
                "{\"count\": -3}",
                "thing, count: found the number -3 where a whole number, 0 or more, is expected",
            ),
            (
                "{\"colors\": {\"cyan\":\n [1, 2, 300, 255]}}",
                "thing, colors.cyan[2]: found the number 300 where a whole number from 0 to 255 is expected (line 2, column 11)",
            ),
            (
                "{\"colors\": {\"cyan\": [1, 2]}}",
                "thing, colors.cyan: found 2 values where a list of 4 values is expected",
            ),
            (
                "{\"colors\": {\"cyan\": [1, 2, 3, 4, 5]}}",
                "thing, colors.cyan: something follows where it should end",
            ),
            ("{\"colors\": []}", "thing, colors: found a list where an object is expected"),
            ("{\"edge\": true}", "thing, edge: found the truth value true where a number is expected"),
            ("{\"kind\": \"up\"}", "thing, kind: found \"up\" where \"left\" is expected"),
            ("{\"kind\": 3}", "thing, kind: "),
            ("{\"cuont\": 1}", "unknown field \"cuont\", expected one of \"count\""),
            ("{\"count\": 1}", "thing: the field \"colors\" is missing"),
            ("{\"count\": 1, \"count\": 2}", "duplicate field \"count\""),
            ("[]", "thing: "),
            ("{\"count\": 1", "the text ends within an object (line 1, column 11)"),
            (
                "{\"count\": 1, \"colors\": {}} x",
                "thing: something follows where it should end (line 1, column 28)",
            ),
        ] {
            let error = parse::<Example>("thing", text).unwrap_err().to_string();
            assert!(error.contains(words), "{text}: {error}");
            for rust in ["usize", "u8", "f64", "struct", "EOF", "expected u"] {
                assert!(!error.contains(rust), "{text}: {error}");
            }
        }
    }
}
