//! Trained weights of the radiance-predicting neural network, as bytes and nothing else, so that only those who use them
//! load them: `pellucid-rpnn` reads them with its feature `weights`.
#![forbid(unsafe_code)]
#![no_std]

/// A safetensors file with the weights of the paper's proposal (both levels and octants share theirs; Rittig et al. 2021,
/// section 4.3) and an exact first flight. Its metadata say what they were trained for and how.
///
/// ```
/// // Eight bytes tell the length of the header, which is JSON.
/// let (length, rest) = pellucid_weights::SHARED_LEVELS_OCTANTS.split_first_chunk::<8>().unwrap();
/// let header = &rest[..u64::from_le_bytes(*length) as usize];
/// assert!(header.starts_with(b"{\"__metadata__\":"));
/// ```
pub const SHARED_LEVELS_OCTANTS: &[u8] = include_bytes!("shared-levels-octants.safetensors");

/// The README's example, compiled and run by the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
