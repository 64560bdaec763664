//! Random numbers addressed by (seed, domain, item, sample), never by the order of work.
//!
//! The mixing function is SplitMix64's finaliser (Steele, Lea & Flood 2014); streams are PCG's (O'Neill 2014).

use rand_pcg::Pcg64;

/// What random numbers are for. Equal seeds give unrelated numbers in different domains.
///
/// ```
/// use pellucid_core::random::{Domain, hash};
/// const ANCHOR: Domain = Domain::new("anchor");
/// const PROOF: Domain = Domain::new("proof");
/// assert_ne!(hash(1, ANCHOR, 2, 3), hash(1, PROOF, 2, 3));
/// assert_eq!(hash(1, ANCHOR, 2, 3), hash(1, Domain::new("anchor"), 2, 3));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Domain(u64);

impl Domain {
    /// The domain of a name: FNV-1a of its bytes.
    pub const fn new(name: &str) -> Self {
        let bytes = name.as_bytes();
        let mut hash = 0xcbf2_9ce4_8422_2325_u64;
        let mut i = 0;
        while i < bytes.len() {
            hash = (hash ^ bytes[i] as u64).wrapping_mul(0x0100_0000_01b3);
            i += 1;
        }
        Self(hash)
    }

    /// The domain of pass `n` of this one: an iteration, or a half of the paths.
    pub const fn pass(self, n: u32) -> Self {
        Self(mix(self.0 ^ (n as u64).wrapping_mul(GOLDEN)))
    }
}

const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// SplitMix64's finaliser: a bijection whose every output bit depends on every input bit.
pub const fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// 64 random bits of an address.
pub const fn hash(seed: u64, domain: Domain, item: u64, sample: u64) -> u64 {
    let a = mix(seed.wrapping_add(GOLDEN) ^ domain.0);
    let b = mix(a.wrapping_add(item.wrapping_mul(GOLDEN)).wrapping_add(GOLDEN));
    mix(b.wrapping_add(sample.wrapping_mul(GOLDEN)).wrapping_add(GOLDEN))
}

/// A number of an address, uniform in 0..1.
pub const fn uniform(seed: u64, domain: Domain, item: u64, sample: u64) -> f64 {
    (hash(seed, domain, item, sample) >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}

/// A generator of its own for an item. All of its state is hashed: were the lower half the same for all items, their
/// numbers would not be uniform from item to item.
pub fn stream(seed: u64, domain: Domain, item: u64) -> Pcg64 {
    let word = |k: u64| u128::from(hash(seed, domain, item, k));
    Pcg64::new(word(0) << 64 | word(1), u128::from(domain.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::Rng;

    #[test]
    fn addresses_that_differ_in_one_part_differ_in_half_their_bits() {
        let [a, b] = ["a", "b"].map(Domain::new);
        let base = hash(1, a, 2, 3);
        for other in
            [hash(2, a, 2, 3), hash(1, b, 2, 3), hash(1, a, 3, 2), hash(1, a, 2, 4), hash(1, a.pass(1), 2, 3)]
        {
            assert!((16..48).contains(&(base ^ other).count_ones()), "{base:x} {other:x}");
        }
        assert_ne!(stream(1, a, 2).next_u64(), stream(1, a, 3).next_u64());
        assert_eq!(stream(1, a, 2).next_u64(), stream(1, a, 2).next_u64());
    }

    #[test]
    fn the_numbers_of_neighbouring_streams_are_uniform() {
        let items = 40_000;
        let mut sums = [0.0; 8];
        for item in 0..items {
            let mut stream = stream(3, Domain::new("test"), item);
            sums.iter_mut().for_each(|sum| *sum += f64::from(stream.next_u32()) / 4_294_967_296.0);
        }
        // Standard errors of a mean of uniform numbers: 1 / sqrt(12 n).
        let off = sums.map(|sum| (sum / items as f64 - 0.5) * (12.0 * items as f64).sqrt());
        assert!(off.iter().all(|v| v.abs() < 4.0), "{off:?}");
    }

    #[test]
    fn neighbouring_items_are_uniform_and_uncorrelated() {
        let n = 100_000u64;
        let values: Vec<f64> = (0..n).map(|i| uniform(7, Domain::new("test"), i, 0) - 0.5).collect();
        let mean = values.iter().sum::<f64>() / n as f64;
        let lag: f64 = values.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / n as f64;
        // Standard errors: 0.289 and 1/12 over the root of n; four of each.
        assert!(mean.abs() < 4.0 * 0.289 / (n as f64).sqrt(), "{mean}");
        assert!(lag.abs() < 4.0 / 12.0 / (n as f64).sqrt(), "{lag}");
    }
}
