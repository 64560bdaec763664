//! Fractions of a colour: the exact inverse, which is the gamut mapping too.

use super::simplex::Quadratic;
use super::{Fractions, MAX_MATERIALS, MixtureModel};
use crate::delta_e::delta_e_2000;
use crate::space::{LMS_TO_OKLAB, Lab, RGB_TO_LMS, apply};

/// How colours are matched, and which of several equal mixtures is taken.
///
/// A colour outside the gamut goes to the printable one that is nearest in Oklab with unequal
/// weights along lightness, chroma and hue of the target. Oklab because its lines of equal hue
/// are straight where Lab's bend (blue turns purple when desaturated in Lab); hue weighs most
/// because a hue shift is what an eye objects to first, then lightness, which carries the
/// texture's detail, then chroma (Morovič 2008; CIE 156).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct MatchOptions {
    /// Weight of squared lightness differences.
    pub lightness: f64,
    /// Weight of squared chroma differences.
    pub chroma: f64,
    /// Weight of squared hue differences, of targets that are not near grey.
    pub hue: f64,
    /// How much more a unit of a material named `black` costs than of a coloured one when several
    /// mixtures give the colour: black dots show most in light tones. 1 treats it like the others.
    pub black_cost: f64,
}

impl Default for MatchOptions {
    fn default() -> Self {
        Self { lightness: 1.0, chroma: 2.0, hue: 16.0, black_cost: 4.0 }
    }
}

/// Cost of squared fractions against squared Oklab units (lightness 100): small enough to leave
/// the colour alone (below 0.01), large enough to make the mixture unique.
const CHOICE: f64 = 1e-3;
/// Oklab chroma (on the same scale) at which hue reaches half its weight.
const GREY: f64 = 2.0;
const ITERATIONS: usize = 40;
/// A thin slab shows one colour both by little scattering and by much: several basins. Of a thick
/// print only the ratios count, colours of equal albedo are linear in the fractions, and there is
/// one basin.
const SLAB_ATTEMPTS: usize = 3;
/// Value below which a match needs no further attempt, in squared Oklab units.
const MATCHED: f64 = 5e-3;
/// Steps of the quadratically spaced grid of starts, per material.
const START_STEPS: usize = 6;

/// Finds fractions for colours: Gauss-Newton on the simplex from the best of a coarse grid.
pub struct Inverse<'a> {
    model: &'a MixtureModel,
    options: MatchOptions,
    cost: [f64; MAX_MATERIALS],
    starts: Vec<([f64; MAX_MATERIALS], [f64; 3])>,
}

/// A colour's mixture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    /// Fractions by material, label order.
    pub fractions: Fractions,
    /// Linear RGB of the mixture relative to the media white.
    pub rgb: [f64; 3],
    /// CIEDE2000 between the wanted colour and the mixture's.
    pub delta_e: f64,
}

impl<'a> Inverse<'a> {
    /// Prepares the grid of starts.
    pub fn new(model: &'a MixtureModel, options: MatchOptions) -> Self {
        let mut cost = [1.0; MAX_MATERIALS];
        cost[model.white()] = 0.0;
        for (cost, name) in cost.iter_mut().zip(model.names()) {
            if name == "black" {
                *cost = options.black_cost;
            }
        }
        let starts = fraction_grid(model.materials(), model.white(), START_STEPS)
            .into_iter()
            .map(|x| {
                let rgb = model.rgb_of(&x, None);
                let white = model.media_white();
                (x, oklab([rgb[0] / white[0], rgb[1] / white[1], rgb[2] / white[2]]))
            })
            .collect();
        Self { model, options, cost, starts }
    }

    /// The mixture nearest to a linear RGB colour relative to the media white; components that
    /// are not finite count as 0.
    ///
    /// ```
    /// use pellucid_color::mixture::{MixtureModel, inverse::{Inverse, MatchOptions}};
    /// use pellucid_voxel::MaterialTable;
    /// let model = MixtureModel::new(&MaterialTable::cmykw(), "white", 1.5)?;
    /// let inverse = Inverse::new(&model, MatchOptions::default());
    /// let found = inverse.find([0.5, 0.3, 0.2]);
    /// assert!(found.delta_e < 0.05);
    /// # Ok::<(), pellucid_color::ColorError>(())
    /// ```
    pub fn find(&self, rgb: [f64; 3]) -> Match {
        let rgb = rgb.map(|v| if v.is_finite() { v } else { 0.0 });
        let target = Target::new(oklab(rgb), &self.options);
        let mut tried: [Option<[f64; MAX_MATERIALS]>; SLAB_ATTEMPTS] = [None; SLAB_ATTEMPTS];
        let mut x = [0.0; MAX_MATERIALS];
        x[self.model.white()] = 1.0;
        let mut lowest = f64::INFINITY;
        for attempt in 0..if self.model.thickness_mm().is_finite() { SLAB_ATTEMPTS } else { 1 } {
            let Some(start) = self.best_start(&target, &tried[..attempt]) else {
                break;
            };
            tried[attempt] = Some(start);
            let (found, value) = self.descend(&target, start);
            if value < lowest {
                (x, lowest) = (found, value);
            }
            if lowest < MATCHED {
                break;
            }
        }
        let fractions = Fractions::from_f64(&x, self.model.materials());
        let reached = self.model.relative_rgb(&fractions);
        let delta_e = delta_e_2000(Lab::from_linear_rgb(rgb), Lab::from_linear_rgb(reached));
        Match { fractions, rgb: reached, delta_e }
    }

    /// The grid's mixture nearest to the target, of those unlike the ones tried already.
    fn best_start(
        &self,
        target: &Target,
        tried: &[Option<[f64; MAX_MATERIALS]>],
    ) -> Option<[f64; MAX_MATERIALS]> {
        let mut best = f64::INFINITY;
        let mut start = None;
        for (x, colour) in &self.starts {
            let value = target.distance2(colour);
            let apart =
                |other: &[f64; MAX_MATERIALS]| x.iter().zip(other).map(|(a, b)| (a - b).abs()).sum::<f64>();
            if value < best && tried.iter().flatten().all(|other| apart(other) > 0.5) {
                (best, start) = (value, Some(*x));
            }
        }
        start
    }

    /// Damped Gauss-Newton; each step is a least-squares problem on the simplex.
    fn descend(&self, target: &Target, start: [f64; MAX_MATERIALS]) -> ([f64; MAX_MATERIALS], f64) {
        let count = self.model.materials();
        let mut x = start;
        let mut damping = 0.0;
        let (mut colour, mut slope) = self.colour(&x);
        let mut value = target.distance2(&colour) + self.choice_cost(&x);
        for _ in 0..ITERATIONS {
            let mut quadratic = Quadratic::new(count);
            for (axis, weight) in target.axes.iter().zip(target.weights) {
                let mut row = [0.0; MAX_MATERIALS];
                let mut wanted = 0.0;
                for k in 0..3 {
                    wanted += axis[k] * (target.colour[k] - colour[k]);
                    for i in 0..count {
                        row[i] += axis[k] * slope[k][i];
                    }
                }
                let at: f64 = (0..count).map(|i| row[i] * x[i]).sum();
                quadratic.add_squared(&row, wanted + at, weight);
            }
            for i in 0..count {
                quadratic.hessian[i][i] += CHOICE * self.cost[i];
                let hold = damping * (1e-9 + quadratic.hessian[i][i]);
                quadratic.hessian[i][i] += hold;
                quadratic.linear[i] += hold * x[i];
            }
            let next = quadratic.minimise_on_simplex(&x);
            let moved = (0..count).map(|i| (next[i] - x[i]).abs()).fold(0.0, f64::max);
            let (next_colour, next_slope) = self.colour(&next);
            let next_value = target.distance2(&next_colour) + self.choice_cost(&next);
            if next_value < value {
                let gain = value - next_value;
                (x, colour, slope, value) = (next, next_colour, next_slope, next_value);
                damping *= 0.1;
                if moved < 1e-9 || gain < 1e-13 {
                    break;
                }
            } else {
                if moved < 1e-9 || damping > 1e6 {
                    break;
                }
                damping = if damping < 1e-6 { 1e-3 } else { damping * 8.0 };
            }
        }
        (x, value)
    }

    fn choice_cost(&self, x: &[f64; MAX_MATERIALS]) -> f64 {
        CHOICE * x.iter().zip(&self.cost).map(|(x, cost)| cost * x * x).sum::<f64>()
    }

    /// Oklab of a mixture relative to the media white, and its derivatives.
    fn colour(&self, x: &[f64; MAX_MATERIALS]) -> ([f64; 3], [[f64; MAX_MATERIALS]; 3]) {
        let mut jacobian = [[0.0; MAX_MATERIALS]; 3];
        let white = self.model.media_white();
        let rgb = self.model.rgb_of(x, Some(&mut jacobian));
        let lms = apply(&RGB_TO_LMS, std::array::from_fn(|i| rgb[i] / white[i])).map(|v| v.max(1e-12));
        let root = lms.map(f64::cbrt);
        let mut slope = [[0.0; MAX_MATERIALS]; 3];
        for i in 0..self.model.materials() {
            let d_rgb = std::array::from_fn(|k| jacobian[k][i] / white[k]);
            let d_lms = apply(&RGB_TO_LMS, d_rgb);
            let d_root = std::array::from_fn(|k| d_lms[k] / (3.0 * root[k] * root[k]));
            let d_lab = apply(&LMS_TO_OKLAB, d_root);
            for k in 0..3 {
                slope[k][i] = 100.0 * d_lab[k];
            }
        }
        (apply(&LMS_TO_OKLAB, root).map(|v| 100.0 * v), slope)
    }
}

/// Oklab with lightness 0 to 100.
fn oklab(rgb: [f64; 3]) -> [f64; 3] {
    apply(&LMS_TO_OKLAB, apply(&RGB_TO_LMS, rgb).map(f64::cbrt)).map(|v| 100.0 * v)
}

/// A wanted colour with the axes lightness, chroma and hue there and their weights.
struct Target {
    colour: [f64; 3],
    axes: [[f64; 3]; 3],
    weights: [f64; 3],
}

impl Target {
    fn new(colour: [f64; 3], options: &MatchOptions) -> Self {
        let chroma = colour[1].hypot(colour[2]);
        let (cos, sin) = if chroma > 0.0 { (colour[1] / chroma, colour[2] / chroma) } else { (1.0, 0.0) };
        // Near grey hue has no meaning: there both directions weigh as chroma does.
        let hueness = chroma * chroma / (chroma * chroma + GREY * GREY);
        let hue = options.chroma + hueness * (options.hue - options.chroma);
        Self {
            colour,
            axes: [[1.0, 0.0, 0.0], [0.0, cos, sin], [0.0, -sin, cos]],
            weights: [options.lightness, options.chroma, hue],
        }
    }

    fn distance2(&self, colour: &[f64; 3]) -> f64 {
        let d: [f64; 3] = std::array::from_fn(|k| colour[k] - self.colour[k]);
        let along = |axis: &[f64; 3]| axis[0] * d[0] + axis[1] * d[1] + axis[2] * d[2];
        self.axes.iter().zip(self.weights).map(|(axis, weight)| weight * along(axis).powi(2)).sum()
    }
}

/// Mixtures on quadratically spaced steps (i / (steps - 1))² of every material but the white,
/// which takes the rest; those that would exceed 1 are left out.
pub(crate) fn fraction_grid(count: usize, white: usize, steps: usize) -> Vec<[f64; MAX_MATERIALS]> {
    let level = |i: usize| {
        let t = i as f64 / (steps - 1) as f64;
        t * t
    };
    let mut out = Vec::new();
    let mut digits = [0_usize; MAX_MATERIALS];
    loop {
        let mut x = [0.0; MAX_MATERIALS];
        for i in (0..count).filter(|&i| i != white) {
            x[i] = level(digits[i]);
        }
        let used: f64 = x.iter().sum();
        if used <= 1.0 + 1e-12 {
            x[white] = (1.0 - used).max(0.0);
            out.push(x);
        }
        let mut place = 0;
        loop {
            if place == count {
                return out;
            }
            if place != white {
                digits[place] += 1;
                if digits[place] < steps {
                    break;
                }
                digits[place] = 0;
            }
            place += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use pellucid_voxel::MaterialTable;

    use super::*;
    use crate::space::Oklab;

    #[test]
    fn grid_is_quadratic_and_complete() {
        let grid = fraction_grid(3, 2, 3);
        // Steps 0, 1/4, 1 of two materials, sums up to 1.
        assert_eq!(grid.len(), 6);
        for x in &grid {
            assert!((x.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
        assert!(grid.iter().any(|x| x[0] == 0.25 && x[1] == 0.25 && x[2] == 0.5));
    }

    /// Gamut mapping finds the nearest printable colour: no mixture of a dense grid is nearer.
    #[test]
    fn nothing_on_a_dense_grid_is_nearer() {
        let thick = MixtureModel::new(&MaterialTable::cmykw(), "white", 1.5).unwrap();
        let options = MatchOptions::default();
        let dense = fraction_grid(5, 4, 13);
        for model in [thick.with_thickness(0.1).unwrap(), thick.with_thickness(0.4).unwrap(), thick] {
            let inverse = Inverse::new(&model, options);
            let colours: Vec<[f64; 3]> = dense.iter().map(|x| inverse.colour(x).0).collect();
            for i in 0..216 {
                let rgb = [i % 6, i / 6 % 6, i / 36].map(|v| (v as f64 / 5.0).powi(3));
                let target = Target::new(oklab(rgb), &options);
                let ours = target.distance2(&oklab(inverse.find(rgb).rgb)).sqrt();
                let best = colours.iter().map(|c| target.distance2(c)).fold(f64::INFINITY, f64::min).sqrt();
                assert!(ours < best + 0.1, "{} mm, {rgb:?}: {ours} against {best}", model.thickness_mm());
            }
        }
    }

    #[test]
    fn mapping_keeps_hue_and_is_idempotent() {
        let model = MixtureModel::new(&MaterialTable::cmykw(), "white", 1.5).unwrap();
        let inverse = Inverse::new(&model, MatchOptions::default());
        let (mut total, mut counted) = (0.0, 0);
        for i in 0..343 {
            let rgb = [i % 7, i / 7 % 7, i / 49].map(|v| (v as f64 / 6.0).powi(2));
            let found = inverse.find(rgb);
            let again = inverse.find(found.rgb);
            assert!(again.delta_e < 0.1, "{rgb:?}: {again:?}");
            let (a, b) = (Oklab::from_linear_rgb(rgb), Oklab::from_linear_rgb(found.rgb));
            if found.delta_e > 1.0 && a.chroma() > 0.05 && b.chroma() > 0.03 {
                let turn = (a.hue() - b.hue()).abs();
                let turn = turn.min(360.0 - turn);
                assert!(turn < 10.0, "{rgb:?} {found:?}: {turn}");
                total += turn;
                counted += 1;
            }
        }
        assert!(counted > 100);
        assert!(total / f64::from(counted) < 2.5, "{}", total / f64::from(counted));
    }

    #[test]
    fn black_cost_moves_greys_between_black_and_coloured_inks() {
        let model = MixtureModel::new(&MaterialTable::cmykw(), "white", 1.5).unwrap();
        let black = |black_cost: f64| {
            let options = MatchOptions { black_cost, ..MatchOptions::default() };
            let found = Inverse::new(&model, options).find([0.3; 3]);
            assert!(found.delta_e < 0.05);
            found.fractions[3]
        };
        let (dear, usual, cheap) = (black(100.0), black(4.0), black(0.01));
        assert!(dear < 0.5 * usual && usual < 0.8 * cheap, "{dear} {usual} {cheap}");
    }

    #[test]
    fn odd_colours_still_get_a_mixture() {
        let model = MixtureModel::new(&MaterialTable::cmykw(), "white", 1.5).unwrap();
        let inverse = Inverse::new(&model, MatchOptions::default());
        for rgb in [[f64::NAN; 3], [f64::INFINITY, 0.0, -3.0], [-5.0; 3], [1e6, 0.0, 0.0]] {
            let found = inverse.find(rgb);
            assert!((found.fractions.iter().sum::<f32>() - 1.0).abs() < 1e-5, "{found:?}");
        }
    }
}
