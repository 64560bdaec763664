//! Errors of JSON files in words for people who do not write Rust.

/// What a JSON error says, without the names of Rust's types, with line and column. What stands before serde's own
/// words, such as the name of a field, is kept.
///
/// ```
/// use pellucid_core::json::plain;
/// let error = serde_json::from_str::<Vec<u32>>("[1, \"two\"]").unwrap_err();
/// assert_eq!(plain(&error), "found text \"two\" where a whole number, 0 or more, is expected (line 1, column 9)");
/// ```
pub fn plain(error: &serde_json::Error) -> String {
    let full = error.to_string();
    let text = full.rsplit_once(" at line ").map_or(full.as_str(), |(text, _)| text);
    let mismatch = ["invalid type: ", "invalid value: "].iter().find_map(|words| text.split_once(words));
    let mut text = match mismatch {
        Some((before, rest)) => match rest.split_once(", expected ") {
            Some((found, wanted)) => {
                format!("{before}found {} where {} is expected", kind(found), wanted_kind(wanted))
            }
            None => format!("{before}{rest}"),
        },
        None => text.replace("EOF while parsing", "the text ends within").replace('`', "\""),
    };
    if error.line() > 0 {
        text.push_str(&format!(" (line {}, column {})", error.line(), error.column()));
    }
    text
}

/// What was found.
fn kind(found: &str) -> String {
    for (rust, plain) in [
        ("string ", "text "),
        ("integer ", "the number "),
        ("floating point ", "the number "),
        ("boolean ", "the truth value "),
    ] {
        if let Some(rest) = found.strip_prefix(rust) {
            return format!("{plain}{}", rest.replace('`', ""));
        }
    }
    match found {
        "null" | "unit value" => "nothing (null)".to_owned(),
        "map" => "an object".to_owned(),
        "sequence" => "a list".to_owned(),
        other => other.replace('`', "\""),
    }
}

/// What was expected, by the name of the Rust type that serde gives.
fn wanted_kind(wanted: &str) -> String {
    match wanted {
        "u8" => "a whole number from 0 to 255".to_owned(),
        "u16" | "u32" | "u64" | "u128" | "usize" => "a whole number, 0 or more,".to_owned(),
        "i8" | "i16" | "i32" | "i64" | "i128" | "isize" => "a whole number".to_owned(),
        "f32" | "f64" => "a number".to_owned(),
        "a string" | "string" | "str" => "text".to_owned(),
        "a boolean" | "bool" => "true or false".to_owned(),
        "a sequence" => "a list".to_owned(),
        "a map" => "an object".to_owned(),
        other => match other.strip_prefix("struct ") {
            Some(name) => format!("an object ({name})"),
            None => other.replace('`', "\""),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn types_of_the_language_are_not_named() {
        let errors = [
            serde_json::from_str::<usize>("-1").unwrap_err(),
            serde_json::from_str::<[f64; 3]>("[1, 2, null]").unwrap_err(),
            serde_json::from_str::<bool>("{}").unwrap_err(),
            serde_json::from_str::<String>("7").unwrap_err(),
            serde_json::from_str::<u8>("300").unwrap_err(),
        ];
        for error in errors {
            let text = plain(&error);
            for name in ["usize", "f64", "u8", "bool ", "struct", "invalid type", "`"] {
                assert!(!text.contains(name), "{text}");
            }
            assert!(text.contains("line 1"), "{text}");
        }
        let broken = serde_json::from_str::<serde_json::Value>("{ \"a\": ").unwrap_err();
        assert_eq!(plain(&broken), "the text ends within a value (line 1, column 7)");
        let named = <serde_json::Error as serde::de::Error>::custom(
            "material 2: g: invalid type: null, expected f64 at line 3 column 4",
        );
        assert_eq!(
            plain(&named),
            "material 2: g: found nothing (null) where a number is expected (line 3, column 4)"
        );
    }
}
