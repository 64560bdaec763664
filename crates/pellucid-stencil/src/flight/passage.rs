//! A flight from segment to segment.

use super::march::Segment;
use super::optics::{LANES, Lanes, Optics, exp_of_minus};
use super::{FLIGHT_BINS, FLIGHT_DEPTHS_MM, FirstFlight};

/// Transmittance below which a flight counts as ended: what is left of it collides where it is.
const OPAQUE: f32 = 1e-4;

/// How far a flight has come.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Depth {
    mm: f32,
    /// The bin that it lies in.
    pub bin: usize,
}

/// Part of a segment within one bin.
pub(super) struct Part {
    pub length: f32,
    pub bin: usize,
    /// Whether it ends at the bin's edge; what is left of the segment, nothing perhaps, lies in the next bin.
    pub ends: bool,
}

impl Depth {
    /// Goes on by as much of `left` as lies within the bin.
    #[inline]
    pub(super) fn advance(&mut self, left: &mut f32) -> Part {
        let bin = self.bin;
        if bin < FLIGHT_BINS - 1 {
            let to_edge = FLIGHT_DEPTHS_MM[bin] as f32 - self.mm;
            if *left >= to_edge {
                self.mm += to_edge;
                *left -= to_edge;
                self.bin += 1;
                return Part { length: to_edge, bin, ends: true };
            }
        }
        self.mm += *left;
        Part { length: std::mem::take(left), bin, ends: false }
    }
}

/// A flight under way, in the channels of a group: segments of one material are taken together.
pub(super) struct Passage<'a> {
    optics: &'a Optics,
    group: usize,
    transmittance: Lanes,
    masses: [Lanes; FLIGHT_BINS],
    depth: Depth,
    label: u8,
    length: f32,
}

impl<'a> Passage<'a> {
    pub(super) fn new(optics: &'a Optics, group: usize) -> Self {
        Self {
            optics,
            group,
            transmittance: [1.0; LANES],
            masses: [[0.0; LANES]; FLIGHT_BINS],
            depth: Depth::default(),
            label: 0,
            length: 0.0,
        }
    }

    /// Passes a segment; false once nothing is left to follow.
    #[inline]
    pub(super) fn pass(&mut self, segment: Segment) -> bool {
        self.enter(segment.label) && self.go(segment.length)
    }

    /// Comes to a material; false where nothing is left that could pass into it.
    #[inline]
    pub(super) fn enter(&mut self, label: u8) -> bool {
        if label == self.label {
            return true;
        }
        self.settle(self.depth.bin);
        self.label = label;
        self.transmittance.iter().any(|&t| t >= OPAQUE)
    }

    /// Goes a length through the material; false once nothing is left to follow.
    #[inline]
    pub(super) fn go(&mut self, length: f32) -> bool {
        let mut left = length;
        loop {
            let part = self.depth.advance(&mut left);
            self.length += part.length;
            if !part.ends {
                break;
            }
            self.settle(part.bin);
        }
        // A long way through one material is settled now and then, to see whether it has come to its end.
        if self.length > 0.5 {
            self.settle(self.depth.bin);
            return self.transmittance.iter().any(|&t| t >= OPAQUE);
        }
        true
    }

    /// Attenuates along the length passed in one material and bin.
    fn settle(&mut self, bin: usize) {
        let length = std::mem::take(&mut self.length);
        if self.label == 0 || length <= 0.0 {
            return;
        }
        let (extinction, albedo) = self.optics.of(self.label, self.group);
        let masses = &mut self.masses[bin];
        let passed: Lanes = std::array::from_fn(|l| exp_of_minus(extinction[l] * length));
        for l in 0..LANES {
            let kept = self.transmittance[l] * passed[l];
            masses[l] += (self.transmittance[l] - kept) * albedo[l];
            self.transmittance[l] = kept;
        }
    }

    /// The flights, given the reflectance at the far side where there is one.
    pub(super) fn end(mut self, reflectance: Option<f32>) -> [FirstFlight; LANES] {
        self.settle(self.depth.bin);
        if reflectance.is_none() {
            // Opaque: the little that is left collides here.
            let (_, albedo) = self.optics.of(self.label, self.group);
            for l in 0..LANES {
                self.masses[self.depth.bin][l] += self.transmittance[l] * albedo[l];
                self.transmittance[l] = 0.0;
            }
        }
        let reflectance = reflectance.unwrap_or(0.0);
        std::array::from_fn(|l| FirstFlight {
            masses: std::array::from_fn(|bin| self.masses[bin][l]),
            escaped: self.transmittance[l] * (1.0 - reflectance),
            returned: self.transmittance[l] * reflectance,
        })
    }
}
