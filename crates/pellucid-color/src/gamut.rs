//! What a print can show: gamut test and mapping, for thick and for thin parts.

use pellucid_core::ErrorStats;
use pellucid_voxel::Control;
use rayon::prelude::*;

use crate::ColorError;
use crate::cube::ColorCube;
use crate::delta_e::delta_e_2000;
use crate::mixture::inverse::{Inverse, MatchOptions};
use crate::mixture::table::MixtureTable;
use crate::mixture::{Fractions, MixtureModel};
use crate::space::{Lab, luminance};

/// CIEDE2000 up to which a colour counts as printable: the table's own error stays below it.
pub const TOLERANCE: f64 = 1.0;

/// The printable solid of a mixture model, with its inverse tabulated. Colours are linear RGB
/// relative to the media white.
pub struct Gamut {
    model: MixtureModel,
    table: MixtureTable,
    black: f64,
}

/// A colour brought into the gamut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mapped {
    /// The printable colour.
    pub rgb: [f32; 3],
    /// CIEDE2000 between the wanted colour and the printable one.
    pub delta_e: f32,
}

/// How much of a set of colours is printable.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct GamutReport {
    /// Number of colours outside by more than [`TOLERANCE`].
    pub outside: usize,
    /// Differences between the wanted and the printable colours, of all.
    pub difference: ErrorStats,
}

impl Gamut {
    /// Tabulates the inverse of `model` with `nodes` a side
    /// ([`DEFAULT_NODES`](crate::mixture::table::DEFAULT_NODES) is a good choice).
    ///
    /// # Errors
    /// As [`MixtureTable::build`].
    pub fn build(
        model: MixtureModel,
        options: MatchOptions,
        nodes: usize,
        control: &Control<'_>,
    ) -> Result<Self, ColorError> {
        let table = MixtureTable::build(&model, options, nodes, control)?;
        let black = luminance(Inverse::new(&model, options).find([0.0; 3]).rgb);
        Ok(Self { model, table, black })
    }

    /// The forward model.
    pub fn model(&self) -> &MixtureModel {
        &self.model
    }

    /// The tabulated inverse.
    pub fn table(&self) -> &MixtureTable {
        &self.table
    }

    /// Luminance of the darkest print relative to the media white.
    pub fn black(&self) -> f64 {
        self.black
    }

    /// Fractions of the nearest printable colour.
    pub fn fractions(&self, rgb: [f32; 3]) -> Fractions {
        self.table.fractions(rgb)
    }

    /// The nearest printable colour, keeping hue before lightness before chroma
    /// ([`MatchOptions`]).
    pub fn map(&self, rgb: [f32; 3]) -> Mapped {
        let reached = self.model.relative_rgb(&self.table.fractions(rgb));
        mapped(rgb, reached)
    }

    /// [`Self::map`] of many colours in parallel; the shorter length counts.
    pub fn map_all(&self, rgb: &[[f32; 3]], out: &mut [Mapped]) {
        out.par_iter_mut().zip(rgb).with_min_len(256).for_each(|(out, rgb)| *out = self.map(*rgb));
    }

    /// True if the colour is printable within [`TOLERANCE`].
    pub fn contains(&self, rgb: [f32; 3]) -> bool {
        f64::from(self.map(rgb).delta_e) <= TOLERANCE
    }

    /// How much of `colours` is printable.
    ///
    /// # Errors
    /// [`ColorError::Invalid`] when a colour is not finite.
    pub fn report(&self, colours: &[[f32; 3]]) -> Result<GamutReport, ColorError> {
        if let Some(i) = colours.iter().position(|c| c.iter().any(|v| !v.is_finite())) {
            return Err(ColorError::invalid(
                format!("colour {i}"),
                format!("{:?} is not finite", colours[i]),
            ));
        }
        let mut mapped = vec![Mapped { rgb: [0.0; 3], delta_e: 0.0 }; colours.len()];
        self.map_all(colours, &mut mapped);
        let differences: Vec<f32> = mapped.iter().map(|m| m.delta_e).collect();
        let outside = differences.iter().filter(|d| f64::from(**d) > TOLERANCE).count();
        Ok(GamutReport { outside, difference: ErrorStats::of(differences) })
    }
}

fn mapped(wanted: [f32; 3], reached: [f64; 3]) -> Mapped {
    let delta_e =
        delta_e_2000(Lab::from_linear_rgb(wanted.map(f64::from)), Lab::from_linear_rgb(reached)) as f32;
    Mapped { rgb: reached.map(|v| v as f32), delta_e }
}

/// Printable colours over the thickness of a part lit from both sides.
///
/// Below about 2 mm light crosses the part: dark and saturated colours fade and white gains.
/// Targets there are mapped to what a homogeneous slab of that thickness can show, so that the
/// refinement does not chase colours out of reach.
pub struct ThicknessGamut {
    /// Ascending thickness; the last is infinite.
    levels: Vec<Level>,
}

struct Level {
    thickness_mm: f64,
    white: [f64; 3],
    /// Cube roots of the printable colour of each colour, both relative to the level's own white:
    /// the identity inside the gamut, which interpolation keeps exactly. The fourth is padding.
    printable: ColorCube<4>,
}

/// Thicknesses in mm that [`ThicknessGamut`] is tabulated at by default.
pub const DEFAULT_THICKNESSES_MM: [f64; 7] = [0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4];

impl Level {
    fn build(
        model: &MixtureModel,
        options: MatchOptions,
        nodes: usize,
        control: &Control<'_>,
    ) -> Result<Self, ColorError> {
        let inverse = Inverse::new(model, options);
        let white = model.relative_rgb(&Fractions::pure(model.white(), model.materials()));
        let brightest = white.iter().map(|w| model.brightest() / w).fold(1.0, f64::max);
        let printable = ColorCube::build(nodes, brightest, control, |rgb| {
            let found = inverse.find(std::array::from_fn(|i| rgb[i] * white[i])).rgb;
            std::array::from_fn(|i| if i < 3 { (found[i] / white[i]).cbrt() as f32 } else { 0.0 })
        })?;
        Ok(Self { thickness_mm: model.thickness_mm(), white, printable })
    }
}

impl ThicknessGamut {
    /// Tabulates slabs of the given thicknesses (mm, ascending, at most 64) beside the thick
    /// print. 17 nodes a side suffice.
    ///
    /// # Errors
    /// [`ColorError::Invalid`] when the thicknesses are not positive, finite and ascending or the
    /// nodes are not 2 to 129; [`ColorError::Cancelled`].
    pub fn build(
        thick: &MixtureModel,
        thicknesses_mm: &[f64],
        options: MatchOptions,
        nodes: usize,
        control: &Control<'_>,
    ) -> Result<Self, ColorError> {
        if thicknesses_mm.len() > 64 || thicknesses_mm.windows(2).any(|pair| pair[0] >= pair[1]) {
            return Err(ColorError::invalid("thicknesses", "must ascend and be at most 64"));
        }
        let silent = control.silent();
        let total = thicknesses_mm.len() as u64 + 1;
        let mut levels = Vec::with_capacity(thicknesses_mm.len() + 1);
        for &thickness in thicknesses_mm {
            levels.push(Level::build(&thick.with_thickness(thickness)?, options, nodes, &silent)?);
            control.report(levels.len() as u64, total);
        }
        levels.push(Level::build(thick, options, nodes, &silent)?);
        control.report(total, total);
        Ok(Self { levels })
    }

    /// The nearest colour that a slab of the given thickness can show. Between two tabulated
    /// thicknesses their results are blended in the logarithm of the thickness; beyond the
    /// largest finite one the blend to the thick print ends at four times it. A thickness that is
    /// not a number counts as a thick print.
    pub fn map(&self, rgb: [f32; 3], thickness_mm: f64) -> Mapped {
        let (low, high, part) = self.locate(thickness_mm);
        let at = |level: &Level| {
            let roots = level.printable.at(std::array::from_fn(|i| rgb[i] / level.white[i] as f32));
            std::array::from_fn(|i| f64::from(roots[i]).powi(3) * level.white[i])
        };
        let (a, b): ([f64; 3], [f64; 3]) = (at(low), at(high));
        mapped(rgb, std::array::from_fn(|i| a[i] * (1.0 - part) + b[i] * part))
    }

    /// White of a slab of the given thickness relative to the thick print's white.
    pub fn white(&self, thickness_mm: f64) -> [f64; 3] {
        let (low, high, part) = self.locate(thickness_mm);
        std::array::from_fn(|i| low.white[i] * (1.0 - part) + high.white[i] * part)
    }

    fn locate(&self, thickness_mm: f64) -> (&Level, &Level, f64) {
        let last = &self.levels[self.levels.len() - 1];
        let above = self.levels.partition_point(|level| level.thickness_mm < thickness_mm);
        if thickness_mm.is_nan() || above == self.levels.len() {
            return (last, last, 0.0);
        }
        if above == 0 {
            return (&self.levels[0], &self.levels[0], 0.0);
        }
        let (low, high) = (&self.levels[above - 1], &self.levels[above]);
        let end = if high.thickness_mm.is_finite() { high.thickness_mm } else { 4.0 * low.thickness_mm };
        let part = ((thickness_mm / low.thickness_mm).ln() / (end / low.thickness_mm).ln()).clamp(0.0, 1.0);
        (low, high, part)
    }
}

#[cfg(test)]
mod tests {
    use pellucid_voxel::MaterialTable;

    use super::*;

    fn model() -> MixtureModel {
        MixtureModel::new(&MaterialTable::cmykw(), "white", 1.5).unwrap()
    }

    #[test]
    fn tells_inside_from_outside() {
        let gamut = Gamut::build(model(), MatchOptions::default(), 33, &Control::none()).unwrap();
        for inside in [[1.0; 3], [0.5; 3], [0.4, 0.2, 0.15], [0.03; 3], [0.9, 0.85, 0.5]] {
            assert!(gamut.contains(inside), "{inside:?} {:?}", gamut.map(inside));
        }
        for outside in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0; 3], [1.2; 3]] {
            assert!(!gamut.contains(outside), "{outside:?} {:?}", gamut.map(outside));
        }
        assert!((0.005..0.03).contains(&gamut.black()), "{}", gamut.black());
        let report = gamut.report(&[[0.5; 3], [1.0, 0.0, 0.0], [1.0; 3]]).unwrap();
        assert_eq!((report.outside, report.difference.count), (1, 3));
        assert_eq!(report.difference.max as f32, gamut.map([1.0, 0.0, 0.0]).delta_e);
    }

    #[test]
    fn thin_parts_lose_dark_colours_and_gain_light_ones() {
        let model = model();
        let options = MatchOptions::default();
        let gamut = ThicknessGamut::build(&model, &[0.2, 0.8, 3.2], options, 17, &Control::none()).unwrap();
        let mut last = (f64::INFINITY, f64::INFINITY);
        for mm in [0.05, 0.2, 0.3, 0.8, 2.0, 3.2, 6.0, 100.0] {
            let (black, white) = (luminance(gamut.map([0.0; 3], mm).rgb.map(f64::from)), gamut.white(mm)[1]);
            assert!(
                black <= last.0 + 1e-4 && white <= last.1 + 1e-9,
                "{mm} mm: {black} {white} after {last:?}"
            );
            last = (black, white);
        }
        assert_eq!(gamut.map([0.3; 3], 1e3), gamut.map([0.3; 3], f64::NAN));
        assert!(gamut.map([0.3; 3], 1e3).delta_e < 0.01);
        // Absolute white is out of a thick print's reach, not of a thin one's.
        let bright = model.media_white().map(|w| (1.0 / w) as f32 * 0.97);
        assert!(gamut.map(bright, 0.2).delta_e < 1.0, "{:?}", gamut.map(bright, 0.2));
        assert!(gamut.map(bright, 1e3).delta_e > 2.0);
    }

    #[test]
    fn table_of_a_thin_part_agrees_with_its_exact_inverse() {
        let model = model();
        let options = MatchOptions::default();
        let gamut = ThicknessGamut::build(&model, &[0.4], options, 17, &Control::none()).unwrap();
        let slab = model.with_thickness(0.4).unwrap();
        let inverse = Inverse::new(&slab, options);
        let mut errors = Vec::new();
        for i in 0..343 {
            let rgb = [i % 7, i / 7 % 7, i / 49].map(|v| ((v as f64 + 0.3) / 7.0).powi(2));
            let exact = inverse.find(rgb).rgb;
            let ours = gamut.map(rgb.map(|v| v as f32), 0.4).rgb.map(f64::from);
            errors.push(delta_e_2000(Lab::from_linear_rgb(exact), Lab::from_linear_rgb(ours)) as f32);
        }
        let stats = ErrorStats::of(errors);
        // Dark saturated colours have two mappings nearly as good, to a thin black or to a colour;
        // cells between the two blend them.
        assert!(stats.mean < 0.7 && stats.median < 0.15 && stats.p95 < 3.0, "{stats:?}");
    }

    #[test]
    fn refuses_unordered_thicknesses() {
        for bad in [&[1.0, 0.5][..], &[0.0], &[f64::NAN]] {
            let result = ThicknessGamut::build(&model(), bad, MatchOptions::default(), 3, &Control::none());
            assert!(result.is_err(), "{bad:?}");
        }
    }
}
