//! Numbers as bytes that compress well, and bytes as text.

use std::io::{self, Write};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::DeflateEncoder;

/// Differences of one number to the next, those below 0 folded in between, as planes: all lowest bytes, then the next.
pub(super) fn planes(values: impl Iterator<Item = u32>, bytes: usize, out: &mut Vec<u8>) {
    let mut last = 0u32;
    let steps = values.map(|value| {
        let step = value.wrapping_sub(last) as i32;
        last = value;
        ((step << 1) ^ (step >> 31)) as u32
    });
    let steps: Vec<u32> = steps.collect();
    for byte in 0..bytes {
        out.extend(steps.iter().map(|step| (step >> (8 * byte)) as u8));
    }
}

/// Differences of bytes, modulo 256.
pub(super) fn byte_plane(values: impl Iterator<Item = u8>, out: &mut Vec<u8>) {
    let mut last = 0u8;
    out.extend(values.map(|value| {
        let step = value.wrapping_sub(last);
        last = value;
        step
    }));
}

/// DEFLATE (RFC 1951) without a header.
pub(super) fn deflate(bytes: &[u8]) -> io::Result<Vec<u8>> {
    let mut encoder = DeflateEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes)?;
    encoder.finish()
}

/// Base 64 (RFC 4648).
pub(super) fn base64(bytes: &[u8]) -> String {
    STANDARD.encode(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn unfolded(planes: &[u8], bytes: usize) -> Vec<u32> {
        let count = planes.len() / bytes;
        let mut last = 0u32;
        (0..count)
            .map(|i| {
                let step = (0..bytes).map(|b| u32::from(planes[b * count + i]) << (8 * b)).sum::<u32>();
                last = last.wrapping_add((step >> 1) ^ (step & 1).wrapping_neg());
                last
            })
            .collect()
    }

    proptest! {
        #[test]
        fn planes_come_back(values in proptest::collection::vec(any::<u32>(), 0..50)) {
            let mut out = Vec::new();
            planes(values.iter().copied(), 4, &mut out);
            prop_assert_eq!(unfolded(&out, 4), values);
        }
    }

    #[test]
    fn differences_of_16_bits_need_three_bytes_at_most() {
        let values = [0, 65_535, 0, 32_768, 3];
        let mut out = Vec::new();
        planes(values.into_iter(), 3, &mut out);
        assert_eq!(unfolded(&out, 3), values);
        let mut bytes = Vec::new();
        byte_plane([5, 5, 4, 255].into_iter(), &mut bytes);
        assert_eq!(bytes, [5, 0, 255, 251]);
    }

    #[test]
    fn deflated_bytes_come_back() {
        use std::io::Read;
        let bytes: Vec<u8> = (0..5000u32).map(|i| (i / 7) as u8).collect();
        let packed = deflate(&bytes).unwrap();
        let mut back = Vec::new();
        flate2::read::DeflateDecoder::new(&packed[..]).read_to_end(&mut back).unwrap();
        assert!(back == bytes && packed.len() < 1000);
        assert_eq!(base64(b"Many hands"), "TWFueSBoYW5kcw==");
    }
}
