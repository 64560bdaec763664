//! What the tests share.

use rand_core::Rng;
use rand_pcg::Pcg64Mcg;

/// Numbers to damage files by.
pub struct Random(pub Pcg64Mcg);

impl Random {
    pub fn below(&mut self, n: usize) -> usize {
        (self.0.next_u64() % n.max(1) as u64) as usize
    }

    pub fn pick<'a, T>(&mut self, items: &'a [T]) -> &'a T {
        &items[self.below(items.len())]
    }
}
