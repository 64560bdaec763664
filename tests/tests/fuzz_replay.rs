//! What fuzzing starts from and what it found, read again by every reader: nothing panics, and refusals say something.

use std::fs;
use std::path::{Path, PathBuf};

use pellucid::core::random::mix;
use pellucid_tests::readers::READERS;

/// Damaged copies of every seed.
const MUTANTS: u64 = 100;

fn inputs(kind: &str, reader: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz").join(kind).join(reader);
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let mut paths: Vec<_> = entries.map(|entry| entry.expect("the folder can be read").path()).collect();
    paths.sort();
    paths
}

/// Reads an input; whether it was taken.
fn read(path: &Path, read: fn(&[u8]) -> pellucid_tests::readers::Outcome) -> bool {
    let bytes = fs::read(path).expect("the input can be read");
    match read(&bytes) {
        Ok(()) => true,
        Err(error) => {
            assert!(!error.to_string().trim().is_empty(), "{}: refused without a word", path.display());
            false
        }
    }
}

#[test]
fn seeds_are_read() {
    for reader in READERS {
        let taken = inputs("seeds", reader.name).iter().filter(|path| read(path, reader.read)).count();
        assert!(taken > 0, "{}: no seed is sound", reader.name);
    }
}

#[test]
fn what_once_broke_a_reader_is_refused_or_read() {
    for reader in READERS {
        inputs("regressions", reader.name).iter().for_each(|path| {
            read(path, reader.read);
        });
    }
}

#[test]
fn damaged_seeds_are_refused_or_read() {
    for reader in READERS {
        for (number, path) in inputs("seeds", reader.name).iter().enumerate() {
            let bytes = fs::read(path).expect("the seed can be read");
            for cut in 0..16 {
                let _ = (reader.read)(&bytes[..bytes.len() * cut / 16]);
            }
            for mutant in 0..MUTANTS {
                let _ = (reader.read)(&damaged(&bytes, mix(mutant ^ (number as u64) << 32)));
            }
        }
    }
}

/// A seed with one to four changes: a bit, a byte, a digit, a stretch left out or written twice.
fn damaged(seed: &[u8], random: u64) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    for change in 0..=random % 4 {
        let draw = mix(random.wrapping_add(change));
        let at = draw as usize % bytes.len().max(1);
        let end = (at + 1 + (draw >> 40) as usize % 8).min(bytes.len());
        match draw >> 56 & 7 {
            _ if bytes.is_empty() => {}
            0 => bytes[at] ^= 1 << (draw >> 48 & 7),
            1 => bytes[at] = 0xff,
            2 => bytes[at] = b'9',
            3 => bytes[at] = b'-',
            4 => drop(bytes.drain(at..end)),
            5 => bytes.extend_from_within(at..end),
            6 => bytes[at..end].fill(0),
            _ => bytes[at] = (draw >> 32) as u8,
        }
    }
    bytes
}
