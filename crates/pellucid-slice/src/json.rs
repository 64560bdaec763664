//! Reading JSON, with errors that name the field and the place in plain words.

use pellucid_core::Fault;
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
    let text = error.to_string();
    let reason = plain(text.rfind(" at line ").map_or(&text, |at| &text[..at]));
    let place = match error.line() {
        0 => String::new(),
        line => format!(" (line {line}, column {})", error.column()),
    };
    SliceError::Invalid(Fault::new(field, reason + &place))
}

/// A message of serde's in the words of who writes JSON, not of who reads it.
fn plain(message: &str) -> String {
    let wrong = message.strip_prefix("invalid type: ").or_else(|| message.strip_prefix("invalid value: "));
    if let Some((found, wanted)) = wrong.and_then(|rest| rest.rsplit_once(", expected ")) {
        return format!("is {}, and must be {}", plain_value(found), plain_kind(wanted));
    }
    if let Some((length, wanted)) =
        message.strip_prefix("invalid length ").and_then(|rest| rest.split_once(", expected "))
    {
        return format!("has {length} values, and must be {}", plain_kind(wanted));
    }
    if let Some((found, wanted)) =
        message.strip_prefix("unknown variant ").and_then(|rest| rest.split_once(", expected "))
    {
        return format!("is {found}, and must be {wanted}");
    }
    if let Some(field) = message.strip_prefix("missing field ") {
        return format!("has no field {field}");
    }
    match message {
        "trailing characters" => "something follows where it should end".into(),
        _ => message.replace("EOF while parsing", "the text ends within"),
    }
}

/// What was found.
fn plain_value(found: &str) -> String {
    match found {
        "map" => "an object".into(),
        "sequence" => "a list".into(),
        _ => ["integer ", "floating point ", "boolean ", "string "]
            .iter()
            .find_map(|kind| found.strip_prefix(kind))
            .unwrap_or(found)
            .trim_matches('`')
            .into(),
    }
}

/// What is wanted.
fn plain_kind(wanted: &str) -> String {
    let list = ["an array of length ", "a tuple of size "].iter().find_map(|kind| wanted.strip_prefix(kind));
    match wanted {
        "u8" => "a whole number from 0 to 255".into(),
        "u16" => "a whole number from 0 to 65535".into(),
        "u32" => "a whole number from 0 to 4294967295".into(),
        "u64" | "usize" => "a whole number of at least 0".into(),
        "i8" | "i16" | "i32" | "i64" | "isize" => "a whole number".into(),
        "f32" | "f64" => "a number".into(),
        "a map" => "an object".into(),
        "a sequence" => "a list".into(),
        "string or map" | "variant identifier" => "one of the known names".into(),
        _ if wanted.starts_with("struct ") => "an object".into(),
        _ => list.map_or_else(|| wanted.to_owned(), |n| format!("a list of {n} values")),
    }
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
                "thing, count: is \"a\", and must be a whole number of at least 0 (line 1, column 13)",
            ),
            ("{\"count\": -3}", "thing, count: is -3, and must be a whole number of at least 0"),
            (
                "{\"colors\": {\"cyan\":\n [1, 2, 300, 255]}}",
                "thing, colors.cyan[2]: is 300, and must be a whole number from 0 to 255 (line 2, column 11)",
            ),
            (
                "{\"colors\": {\"cyan\": [1, 2]}}",
                "thing, colors.cyan: has 2 values, and must be a list of 4 values",
            ),
            (
                "{\"colors\": {\"cyan\": [1, 2, 3, 4, 5]}}",
                "thing, colors.cyan: something follows where it should end",
            ),
            ("{\"colors\": []}", "thing, colors: is a list, and must be an object"),
            ("{\"edge\": true}", "thing, edge: is true, and must be a number"),
            ("{\"kind\": \"up\"}", "thing, kind: is `up`, and must be `left`"),
            ("{\"kind\": 3}", "thing, kind: "),
            ("{\"cuont\": 1}", "unknown field `cuont`, expected one of `count`"),
            ("{\"count\": 1}", "thing: has no field `colors`"),
            ("{\"count\": 1, \"count\": 2}", "duplicate field `count`"),
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
