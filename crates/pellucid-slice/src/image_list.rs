//! The images of a folder in the order of their layers.

use std::cmp::Ordering;
use std::fs;
use std::path::{Path, PathBuf};

use pellucid_core::{Fault, FileError, files};
use pellucid_voxel::Frame;

use crate::SliceError;

/// Files of a folder whose names match a pattern (`*` stands for any run of characters), in natural order: digits count
/// as numbers, so that `slice_9.png` comes before `slice_10.png`.
///
/// # Errors
/// [`SliceError::Io`] when the folder cannot be read; [`SliceError::Invalid`] when no file matches, or when the names
/// differ in one number only and a number is missing between the first and the last, or there twice: a lost layer
/// would make a shorter print. A list made by hand has no such check. [`SliceError::Unsupported`] for more files than a
/// grid can have layers.
pub fn list_images(folder: impl AsRef<Path>, pattern: &str) -> Result<Vec<PathBuf>, SliceError> {
    let folder = folder.as_ref();
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(FileError::at("read", folder))? {
        let entry = entry.map_err(FileError::at("read", folder))?;
        if let Some(name) = entry.file_name().to_str().filter(|name| files::name_matches(pattern, name))
            && entry.path().is_file()
        {
            names.push(name.to_owned());
        }
        if names.len() > Frame::MAX_EDGE as usize {
            let fault =
                Fault::new(folder.display().to_string(), format!("more than {} images", Frame::MAX_EDGE));
            return Err(SliceError::Unsupported(fault));
        }
    }
    if names.is_empty() {
        let fault = Fault::new(folder.display().to_string(), format!("no file's name matches {pattern:?}"))
            .remedy("give a pattern such as \"*.png\"");
        return Err(SliceError::Invalid(fault));
    }
    names.sort_by(|a, b| natural_order(a, b));
    check_numbers(folder, &names)?;
    Ok(names.iter().map(|name| folder.join(name)).collect())
}

/// Looks for numbers that are missing or there twice among sorted names that differ in one number only.
fn check_numbers(folder: &Path, names: &[String]) -> Result<(), SliceError> {
    let Some(parts) = names.iter().map(|name| numbered(name)).collect::<Option<Vec<_>>>() else {
        return Ok(());
    };
    if parts.iter().any(|p| (p.0, p.2) != (parts[0].0, parts[0].2)) {
        return Ok(());
    }
    for (pair, names) in parts.windows(2).zip(names.windows(2)) {
        let what = match pair[1].1 - pair[0].1 {
            1 => continue,
            0 => "have the same number",
            _ => "follow each other: layers between them are missing",
        };
        let fault = Fault::new(folder.display().to_string(), format!("{} and {} {what}", names[0], names[1]))
            .remedy("give the list of files if that is right");
        return Err(SliceError::Invalid(fault));
    }
    Ok(())
}

/// A name parted at its last number.
fn numbered(name: &str) -> Option<(&str, u64, &str)> {
    let end = name.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = name[..end].rfind(|c: char| !c.is_ascii_digit()).map_or(0, |at| {
        // Past a character that may have several bytes.
        at + name[at..].chars().next().map_or(1, char::len_utf8)
    });
    Some((&name[..start], name[start..end].parse().ok()?, &name[end..]))
}

/// Compares names with runs of digits as numbers; names of equal numbers by their text.
fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut x, mut y) = (a.as_bytes(), b.as_bytes());
    while let (Some(&p), Some(&q)) = (x.first(), y.first()) {
        let order = if p.is_ascii_digit() && q.is_ascii_digit() {
            let (m, n) = (take_number(&mut x), take_number(&mut y));
            m.len().cmp(&n.len()).then_with(|| m.cmp(n))
        } else {
            (x, y) = (&x[1..], &y[1..]);
            p.cmp(&q)
        };
        if order.is_ne() {
            return order;
        }
    }
    x.len().cmp(&y.len()).then_with(|| a.cmp(b))
}

/// Takes a run of digits off the front and returns it without leading zeros.
fn take_number<'a>(text: &mut &'a [u8]) -> &'a [u8] {
    let end = text.iter().position(|b| !b.is_ascii_digit()).unwrap_or(text.len());
    let (digits, rest) = text.split_at(end);
    *text = rest;
    let zeros = digits.iter().position(|&b| b != b'0').unwrap_or(digits.len());
    &digits[zeros..]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_sort_as_numbers() {
        let sorted = [
            "2",
            "10",
            "a",
            "s1",
            "s01b",
            "s2x9",
            "s2x10",
            "s03",
            "s10",
            "s99999999999999999999999",
            "s100000000000000000000000",
            "ü1",
        ];
        let mut names = sorted;
        names.reverse();
        names.sort_by(|a, b| natural_order(a, b));
        assert_eq!(names, sorted);
    }

    #[test]
    fn a_lost_or_doubled_layer_is_told() {
        let temp = tempfile::tempdir().unwrap();
        let list = |names: &[&str], pattern: &str| {
            let folder = tempfile::tempdir_in(temp.path()).unwrap();
            fs::create_dir(folder.path().join("x_3.png")).unwrap();
            for name in names {
                fs::write(folder.path().join(name), "").unwrap();
            }
            list_images(folder.path(), pattern)
                .map(|files| {
                    files
                        .iter()
                        .map(|f| f.file_name().unwrap().to_str().unwrap().to_owned())
                        .collect::<Vec<_>>()
                })
                .map_err(|e| e.to_string())
        };
        assert_eq!(
            list(&["x_10.png", "x_9.png", "x_11.png", "note.txt"], "*.png").unwrap(),
            ["x_9.png", "x_10.png", "x_11.png"]
        );
        let lost = list(&["x_1.png", "x_2.png", "x_4.png"], "*.png").unwrap_err();
        assert!(lost.contains("x_2.png and x_4.png follow each other"), "{lost}");
        let doubled = list(&["x_1.png", "x_01.png"], "*.png").unwrap_err();
        assert!(doubled.contains("have the same number"), "{doubled}");
        assert!(list(&["x_1.png"], "y*").unwrap_err().contains("no file's name matches \"y*\""));
        // Names that differ in more than their last number are in natural order, and nothing more is known.
        assert_eq!(list(&["b7.png", "a1.png", "a5.png"], "*.png").unwrap(), ["a1.png", "a5.png", "b7.png"]);
        assert_eq!(list(&["top.png", "low.png"], "*.png").unwrap(), ["low.png", "top.png"]);
        assert!(matches!(list_images(temp.path().join("none"), "*"), Err(SliceError::Io(_))));
    }
}
