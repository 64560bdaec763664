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
    // What stands before serde's own words, such as the name of a field, is kept.
    let own =
        ["invalid type: ", "invalid value: ", "invalid length "].iter().filter_map(|w| text.find(w)).min();
    let (before, own) = text.split_at(own.unwrap_or(0));
    let mut text = format!("{before}{}", words(own));
    if error.line() > 0 {
        text.push_str(&format!(" (line {}, column {})", error.line(), error.column()));
    }
    text
}

fn words(text: &str) -> String {
    // The wanted kind comes last: what was found may hold any text.
    let parted = |start: &str| text.strip_prefix(start).and_then(|rest| rest.rsplit_once(", expected "));
    if let Some((found, wanted)) = parted("invalid type: ").or_else(|| parted("invalid value: ")) {
        return format!("found {} where {} is expected", kind(found), wanted_kind(wanted));
    }
    if let Some((length, wanted)) = parted("invalid length ") {
        return format!("found {length} values where {} is expected", wanted_kind(wanted));
    }
    if let Some((found, wanted)) = parted("unknown variant ") {
        return format!("found {found} where {wanted} is expected").replace('`', "\"");
    }
    if let Some(field) = text.strip_prefix("missing field ") {
        return format!("the field {field} is missing").replace('`', "\"");
    }
    match text {
        "trailing characters" => "something follows where it should end".to_owned(),
        _ => text.replace("EOF while parsing", "the text ends within").replace('`', "\""),
    }
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
        "string or map" | "variant identifier" => "one of the known names".to_owned(),
        other => {
            let count =
                ["an array of length ", "a tuple of size "].iter().find_map(|k| other.strip_prefix(k));
            match (other.strip_prefix("struct "), count) {
                (Some(name), _) => format!("an object ({name})"),
                (_, Some(count)) => format!("a list of {count} values"),
                _ => other.replace('`', "\""),
            }
        }
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
        let short = serde_json::from_str::<[u8; 4]>("[1, 2]").unwrap_err();
        assert_eq!(plain(&short), "found 2 values where a list of 4 values is expected (line 1, column 6)");
        let long = serde_json::from_str::<[u8; 1]>("[1, 2]").unwrap_err();
        assert!(plain(&long).starts_with("something follows where it should end"), "{}", plain(&long));
        let fooling = serde_json::from_str::<u8>("\", expected usize at line 9\"").unwrap_err();
        assert!(
            plain(&fooling).ends_with("where a whole number from 0 to 255 is expected (line 1, column 28)")
        );
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
