//! Lower envelopes of parabolas on integers: one axis of a separable distance transform.
//!
//! Meijster, Roerdink and Hesselink (2000), "A general algorithm for computing distance
//! transforms in linear time", with a weight for the axis and an arbitrary set of sites.

/// A parabola `height + weight * (x - position)^2` of the envelope.
#[derive(Clone, Copy)]
struct Site {
    position: i64,
    height: i64,
    /// First x where this parabola is the lowest.
    start: i64,
}

/// The lower envelope of parabolas over x in `0..length`. Where parabolas tie, the one pushed
/// first wins.
pub(crate) struct Envelope {
    weight: i64,
    length: i64,
    sites: Vec<Site>,
}

impl Envelope {
    /// An empty envelope. `weight` is positive, and `weight` times the square of any distance
    /// between a site and an x must stay below 2^60.
    pub(crate) fn new(weight: i64, length: usize) -> Self {
        Self { weight, length: length as i64, sites: Vec::new() }
    }

    /// Forgets all sites.
    pub(crate) fn clear(&mut self) {
        self.sites.clear();
    }

    /// True when no site was pushed since [`Envelope::clear`].
    pub(crate) fn is_empty(&self) -> bool {
        self.sites.is_empty()
    }

    /// Adds a site past all earlier ones, which may lie outside `0..length`.
    #[inline]
    pub(crate) fn push(&mut self, position: i64, height: i64) {
        let w = self.weight;
        let at = |x: i64, p: i64, h: i64| h + w * (x - p) * (x - p);
        while let Some(top) = self.sites.last() {
            debug_assert!(top.position < position);
            if at(top.start, top.position, top.height) > at(top.start, position, height) {
                self.sites.pop();
                continue;
            }
            // The last x where the earlier parabola is not above the new one.
            let gap = position - top.position;
            let rise = height - top.height + w * gap * (position + top.position);
            let start = rise.div_euclid(2 * w * gap) + 1;
            if start < self.length {
                self.sites.push(Site { position, height, start });
            }
            return;
        }
        self.sites.push(Site { position, height, start: 0 });
    }

    /// Calls `visit(x, position, value)` for each x in `0..length`, ascending, with the lowest
    /// parabola's position and value, where the value is at most `limit`.
    #[inline]
    pub(crate) fn visit(&self, limit: i64, mut visit: impl FnMut(usize, i64)) {
        for (i, site) in self.sites.iter().enumerate() {
            let end = self.sites.get(i + 1).map_or(self.length, |next| next.start);
            for x in site.start..end {
                if site.height + self.weight * (x - site.position) * (x - site.position) <= limit {
                    visit(x as usize, site.position);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn agrees_with_the_minimum_and_its_tie_rule(
            weight in prop_oneof![1i64..5, 900i64..9000],
            length in 1usize..40,
            first in -30i64..10,
            steps in prop::collection::vec((1i64..8, prop_oneof![0i64..4, 0i64..100_000]), 0..30),
            limit in prop_oneof![0i64..50, 0i64..1_000_000],
        ) {
            let mut envelope = Envelope::new(weight, length);
            let mut sites = Vec::new();
            let mut position = first;
            for (step, height) in steps {
                envelope.push(position, height);
                sites.push((position, height));
                position += step;
            }
            let mut found = vec![None; length];
            envelope.visit(limit, |x, p| found[x] = Some(p));
            for x in 0..length {
                let value = |&(p, h): &(i64, i64)| h + weight * (x as i64 - p).pow(2);
                let best = sites.iter().min_by_key(|s| (value(s), s.0)).filter(|s| value(s) <= limit);
                prop_assert_eq!(found[x], best.map(|s| s.0));
            }
        }
    }
}
