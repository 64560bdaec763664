//! What materials do to a flight.

use pellucid_voxel::MaterialTable;

/// Channels that are computed together.
pub(super) const LANES: usize = 4;

/// A value for each of some channels.
pub(super) type Lanes = [f32; LANES];

/// Extinction in 1/mm and albedo of each label, in channels four at a time; label 0 is air.
#[derive(Clone, Debug)]
pub(super) struct Optics {
    extinction: Vec<Lanes>,
    albedo: Vec<Lanes>,
    groups: usize,
}

impl Optics {
    pub(super) fn new(materials: &MaterialTable) -> Self {
        let channels = materials.channels();
        let groups = channels.div_ceil(LANES);
        let mut optics =
            Self { extinction: vec![[0.0; LANES]; groups], albedo: vec![[0.0; LANES]; groups], groups };
        for m in materials.materials() {
            for group in 0..groups {
                // Lanes past the last channel repeat it, so that they end when it does.
                let lane = |of: &dyn Fn(usize) -> f32| -> Lanes {
                    std::array::from_fn(|l| of((group * LANES + l).min(channels - 1)))
                };
                let extinction = |c: usize| m.sigma_s[c] + m.sigma_a[c];
                let albedo = |c: usize| {
                    let sum = extinction(c);
                    if sum > 0.0 { m.sigma_s[c] / sum } else { 0.0 }
                };
                optics.extinction.push(lane(&extinction));
                optics.albedo.push(lane(&albedo));
            }
        }
        optics
    }

    /// Extinction and albedo of a label in the channels of a group.
    #[inline]
    pub(super) fn of(&self, label: u8, group: usize) -> (&Lanes, &Lanes) {
        let at = usize::from(label) * self.groups + group;
        (&self.extinction[at], &self.albedo[at])
    }

    /// Number of materials.
    pub(super) fn materials(&self) -> usize {
        self.extinction.len() / self.groups - 1
    }
}

/// `exp(-x)` for x of 0 or more, to 2 units in the last place, the same on every machine; 0 past 87.
#[inline]
pub(super) fn exp_of_minus(x: f32) -> f32 {
    // Added to a number of less than 2^22, leaves it rounded in the last bits.
    const ROUND: f32 = 12_582_912.0;
    // ln 2 in two parts, the first of few bits, so that the remainder is exact (Cody and Waite 1980).
    const HIGH: f32 = 0.693_359_4;
    const LOW: f32 = -2.121_944_4e-4;
    let y = -x.min(87.0);
    let shifted = y * std::f32::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = y - n * HIGH - n * LOW;
    // Taylor's series on |r| of ln 2 / 2 and less.
    let p = 1.0 + r * (1.0 + r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r / 720.0)))));
    let scale = f32::from_bits((shifted.to_bits() << 23).wrapping_add(1f32.to_bits()));
    if x > 87.0 { 0.0 } else { p * scale }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_is_exact_to_a_few_units() {
        let mut x = 0.0f32;
        while x < 90.0 {
            let exact = (-f64::from(x)).exp();
            let got = f64::from(exp_of_minus(x));
            assert!((got - exact).abs() <= 4e-7 * exact + 1e-37, "{x}: {got} {exact}");
            x = x * 1.001 + 1e-4;
        }
        assert_eq!((exp_of_minus(0.0), exp_of_minus(1e30), exp_of_minus(f32::INFINITY)), (1.0, 0.0, 0.0));
    }
}
