//! Digests that tell data apart: FNV-1a with 128 bits. They find what differs by chance, not what somebody forged.

/// A running digest.
///
/// ```
/// use pellucid_core::Digest;
/// let mut whole = Digest::new();
/// whole.add(b"ab");
/// let mut parts = Digest::new();
/// parts.add(b"a");
/// parts.add(b"b");
/// assert_eq!(whole, parts);
/// assert_eq!(whole.hex().len(), 32);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Digest(u128);

impl Digest {
    /// Of nothing yet.
    pub fn new() -> Self {
        Self(0x6c62_272e_07bb_0142_62b8_2175_6295_c58d)
    }

    /// Adds bytes.
    pub fn add(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u128::from(*byte)).wrapping_mul(0x0100_0000_0000_0000_0000_013b);
        }
    }

    /// 32 hexadecimal digits.
    pub fn hex(self) -> String {
        format!("{:032x}", self.0)
    }

    /// The lower half of its bits.
    pub(crate) fn low(self) -> u64 {
        self.0 as u64
    }
}

impl Default for Digest {
    fn default() -> Self {
        Self::new()
    }
}
