//! What descent lowers: a perceptual difference of what is shown from what is aimed at, over the surface.

use pellucid_color::space::{lab_derivative_of_linear_rgb, lab_of_linear_rgb};
use pellucid_core::{Cancelled, Control};
use rayon::prelude::*;

use crate::SurfaceSmoother;
use crate::low_pass::LowPass;

/// Differences beyond this count in proportion, not by their square (Huber): a few far outliers do not decide.
const HUBER: f32 = 20.0;
/// Chroma of an aim from which on what is missing of it counts in full: of a grey, noise would be taken for it.
const COLOURED: f32 = 10.0;

/// How differences are weighed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Weights {
    /// Exponent of CIEDE2000's S_C and S_H: 1 forgives differences of saturated colours as it does, 0 not at all.
    pub forgiveness: f32,
    /// How many times more differences of lightness count as far as they are of local contrast.
    pub contrast: f32,
    /// How many times more differences of chroma count where it is missing.
    pub chroma: f32,
}

/// Gradient by a shown colour, and curvature times reach.
type Slopes = ([f32; 3], [f32; 3]);

/// One scale at which the print is looked at.
pub(super) struct Scale {
    /// `[L*, a*, b*]` of the smoothed aim.
    aim: Vec<[f32; 3]>,
    /// By what a* and b* are multiplied, the rows of a 2 x 2 matrix; L* counts as it is.
    rows: Vec<[f32; 4]>,
    weight: f32,
    weights: Weights,
}

/// The loss at every point, and its derivatives.
pub(super) struct Found {
    /// Of every surface voxel.
    pub loss: Vec<f32>,
    /// 1 where the scale that is added next lacked chroma in the iterate before, which is replaced; empty before the first.
    /// By the same prediction, noise that takes chroma away would count more than noise that adds some, and drive the print
    /// past its aim.
    pub lacks: Vec<u8>,
    /// By the shown colours.
    pub gradient: Vec<[f32; 3]>,
    /// A bound of the loss's curvature by the shown colours, given how far each would go; empty where it is not asked for.
    pub curvature: Vec<[f32; 3]>,
}

impl Scale {
    /// Looks through `smoother` at an aim of linear RGB, which counts with `weight`.
    pub(super) fn new(
        smoother: &SurfaceSmoother,
        aim: &[[f32; 3]],
        weight: f32,
        weights: Weights,
        control: &Control<'_>,
    ) -> Result<Self, Cancelled> {
        let smooth = smoother.smooth(aim.to_vec(), control)?;
        let aim: Vec<[f32; 3]> = smooth.par_iter().map(|&rgb| lab(rgb)).collect();
        let rows = aim.par_iter().map(|&lab| weights.rows(lab)).collect();
        Ok(Self { aim, rows, weight, weights })
    }

    /// Adds the loss of shown colours and its gradient; the curvature too where `reach` says how far a full step would move
    /// each shown colour. `smoother` is the one that the aim was looked at through, `low_pass` makes the means that local
    /// contrast leaves out.
    pub(super) fn add(
        &self,
        smoother: &SurfaceSmoother,
        low_pass: &LowPass,
        shown: &[[f32; 3]],
        reach: Option<&[[f32; 3]]>,
        found: &mut Found,
        control: &Control<'_>,
    ) -> Result<(), Cancelled> {
        let smooth = smoother.smooth(shown.to_vec(), control)?;
        let reach = reach.map(|reach| smoother.smooth(reach.to_vec(), control)).transpose()?;
        let reach_of = |i: usize| reach.as_ref().map_or([0.0; 3], |reach| reach[i]);
        let differences = self.differences(&smooth);
        let contrast = low_pass.contrast(differences.iter().map(|d| d[0]).collect(), control)?;
        let lacks = differences.par_iter().map(|d| u8::from(d[1] < 0.0)).collect();
        let lacked = std::mem::replace(&mut found.lacks, lacks);
        let lacked = if lacked.is_empty() { &found.lacks } else { &lacked };
        let points = smooth.par_iter().enumerate().zip(&self.rows).zip(&differences).zip(&contrast);
        let each = points.map(|((((i, &rgb), rows), &difference), &contrast)| {
            let lacking = if lacked[i] != 0 { self.missing_chroma(i) } else { 0.0 };
            self.point(rgb, reach_of(i), rows, difference, [contrast, lacking])
        });
        let (loss, slopes): (Vec<f32>, Vec<Slopes>) = each.unzip();
        let (gradient, curvature): (Vec<_>, Vec<_>) = slopes.into_iter().unzip();
        found.loss.par_iter_mut().zip(loss).for_each(|(sum, loss)| *sum += loss);
        let add = |to: &mut [[f32; 3]], values: Vec<[f32; 3]>| {
            let values = smoother.transposed(values, control)?;
            to.par_iter_mut().zip(values).for_each(|(to, v)| (0..3).for_each(|c| to[c] += v[c]));
            Ok::<(), Cancelled>(())
        };
        add(&mut found.gradient, gradient)?;
        if reach.is_some() { add(&mut found.curvature, curvature) } else { Ok(()) }
    }

    /// What of the loss of one prediction is its random error, summed over all points, given two of the same labels with
    /// independent errors: half the loss of their difference. The limit for outliers is left out.
    pub(super) fn noise(
        &self,
        smoother: &SurfaceSmoother,
        low_pass: &LowPass,
        shown: [&[[f32; 3]]; 2],
        control: &Control<'_>,
    ) -> Result<f64, Cancelled> {
        let [a, b] = shown;
        let [a, b] = [smoother.smooth(a.to_vec(), control)?, smoother.smooth(b.to_vec(), control)?];
        let mut apart = self.differences(&a);
        let others = self.differences(&b);
        apart.par_iter_mut().zip(&others).for_each(|(a, b)| (0..3).for_each(|k| a[k] -= b[k]));
        let contrast = low_pass.contrast(apart.iter().map(|d| d[0]).collect(), control)?;
        let each = apart.iter().zip(&contrast).enumerate();
        let squares = each.map(|(i, (&d, &c))| {
            // Noise takes chroma away as often as it adds some.
            let counted = self.counted(d, [c, 0.5 * self.missing_chroma(i)]);
            (0..3).map(|k| f64::from(d[k] * counted[k])).sum::<f64>()
        });
        Ok(0.5 * f64::from(self.weight) * squares.sum::<f64>())
    }

    /// Weighed differences of smoothed colours from the aim.
    fn differences(&self, smooth: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let points = smooth.par_iter().zip(&self.aim).zip(&self.rows);
        let each = points.map(|((&rgb, aim), rows)| {
            let shown = lab(rgb);
            weighed(rows, std::array::from_fn(|k| shown[k] - aim[k]))
        });
        each.collect()
    }

    /// How many times more a difference of chroma counts where it is missing.
    fn missing_chroma(&self, point: usize) -> f32 {
        let [_, a, b] = self.aim[point];
        self.weights.chroma * (a.hypot(b) / COLOURED).min(1.0)
    }

    /// A weighed difference, with what of lightness's is of local contrast counted more, and chroma's so many times more.
    fn counted(&self, [l, chroma, hue]: [f32; 3], [contrast, lacking]: [f32; 2]) -> [f32; 3] {
        [l + self.weights.contrast * contrast, (1.0 + lacking) * chroma, hue]
    }

    /// Loss, gradient, and curvature times reach at one point, given the weighed difference, what of lightness's is
    /// of local contrast, and how many times more that of chroma counts. Leaving the mean out is taken for a projection:
    /// doing so twice would change nothing.
    fn point(
        &self,
        rgb: [f32; 3],
        reach: [f32; 3],
        rows: &[f32; 4],
        difference: [f32; 3],
        more: [f32; 2],
    ) -> (f32, Slopes) {
        let by_rgb = lab_derivative_of_linear_rgb(rgb);
        let counted = self.counted(difference, more);
        let length = (0..3).map(|k| difference[k] * counted[k]).sum::<f32>().max(0.0).sqrt();
        let (loss, scale) = match length <= HUBER {
            true => (length * length, 1.0),
            false => (HUBER * (2.0 * length - HUBER), HUBER / length),
        };
        // Columns: what a channel does to the weighed difference.
        let columns: [[f32; 3]; 3] =
            std::array::from_fn(|c| weighed(rows, std::array::from_fn(|k| by_rgb[k][c])));
        let along = |c: usize| -> f32 { (0..3).map(|k| columns[c][k] * counted[k]).sum() };
        let gradient = std::array::from_fn(|c| 2.0 * self.weight * scale * along(c));
        let weights = [1.0 + self.weights.contrast, 1.0 + more[1], 1.0];
        let both = |c: usize, d: usize| -> f32 {
            (0..3).map(|k| weights[k] * columns[c][k] * columns[d][k]).sum::<f32>().abs()
        };
        let curvature = std::array::from_fn(|c| {
            2.0 * self.weight * scale * (0..3).map(|d| both(c, d) * reach[d]).sum::<f32>()
        });
        (self.weight * loss, (gradient, curvature))
    }
}

impl Weights {
    /// Weights of a* and b*, turned into chroma and hue, at an aim: S_C and S_H of CIEDE2000 (Sharma et al.
    /// 2005), to a power. Its S_L, which forgives lightness far from the middle, is left out: with it the mean CIEDE2000
    /// itself ends higher.
    fn rows(self, [_, a, b]: [f32; 3]) -> [f32; 4] {
        let chroma = a.hypot(b);
        let (sin, cos) = if chroma > 1e-3 { (b / chroma, a / chroma) } else { (0.0, 1.0) };
        let hue = b.atan2(a).to_degrees();
        let wave = |degrees: f32| degrees.to_radians().cos();
        let t = 1.0 - 0.17 * wave(hue - 30.0) + 0.24 * wave(2.0 * hue) + 0.32 * wave(3.0 * hue + 6.0)
            - 0.2 * wave(4.0 * hue - 63.0);
        let of = |spread: f32| spread.powf(-self.forgiveness);
        let (along, across) = (of(1.0 + 0.045 * chroma), of(1.0 + 0.015 * chroma * t));
        [along * cos, along * sin, -across * sin, across * cos]
    }
}

/// L* as it is, a* and b* by their rows.
fn weighed(rows: &[f32; 4], [l, a, b]: [f32; 3]) -> [f32; 3] {
    [l, rows[0] * a + rows[1] * b, rows[2] * a + rows[3] * b]
}

fn lab(rgb: [f32; 3]) -> [f32; 3] {
    let mut lab = [[0.0; 3]];
    lab_of_linear_rgb(&[rgb], &mut lab);
    lab[0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::low_pass::LOCAL_MM;
    use pellucid_voxel::{Frame, LabelGrid, Pitch, Surface, SurfaceOptions, Tile};

    /// Sums of loss and of the gradient's size over a block's surface whose aim is mid grey and that shows another.
    fn of(contrast: f32, shown: impl Fn([u32; 3]) -> f32) -> (f32, f32) {
        loss([0.3; 3], [contrast, 0.0], |v| [shown(v); 3])
    }

    /// The same of another aim, with weights of contrast and of missing chroma.
    fn loss(aim: [f32; 3], weights: [f32; 2], shown: impl Fn([u32; 3]) -> [f32; 3]) -> (f32, f32) {
        let (loss, gradient, _) = loss_after(None, aim, weights, shown);
        (loss, gradient)
    }

    /// The same after an iterate that lacked chroma everywhere or nowhere, and where this one does.
    fn loss_after(
        lacked: Option<u8>,
        aim: [f32; 3],
        [contrast, chroma]: [f32; 2],
        shown: impl Fn([u32; 3]) -> [f32; 3],
    ) -> (f32, f32, Vec<u8>) {
        let control = Control::none();
        let frame = Frame::new([0.0; 3], Pitch::new([0.1; 3]).unwrap(), [30, 30, 30]).unwrap();
        let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(5));
        let surface = Surface::extract(&grid, &SurfaceOptions::default(), &control).unwrap();
        let smoother = SurfaceSmoother::new(&surface, 0.0, &control).unwrap();
        let low_pass = LowPass::new(&surface, LOCAL_MM, &control).unwrap();
        let weights = Weights { forgiveness: 0.5, contrast, chroma };
        let aim = vec![aim; surface.len()];
        let scale = Scale::new(&smoother, &aim, 1.0, weights, &control).unwrap();
        let shown: Vec<[f32; 3]> = surface.voxels().iter().map(|&v| shown(v)).collect();
        let count = surface.len();
        let mut found = Found {
            loss: vec![0.0; count],
            lacks: lacked.map(|lacked| vec![lacked; count]).unwrap_or_default(),
            gradient: vec![[0.0; 3]; count],
            curvature: vec![[0.0; 3]; count],
        };
        let reach = vec![[1.0; 3]; count];
        scale.add(&smoother, &low_pass, &shown, Some(&reach), &mut found, &control).unwrap();
        (found.loss.iter().sum(), found.gradient.iter().flatten().map(|g| g.abs()).sum(), found.lacks)
    }

    #[test]
    fn contrast_weighs_what_is_not_common_to_a_millimetre() {
        let common = |_: [u32; 3]| 0.33;
        let checks = |v: [u32; 3]| if (v[0] + v[1] + v[2]).is_multiple_of(2) { 0.33 } else { 0.27 };
        let ratio = |shown: &dyn Fn([u32; 3]) -> f32| {
            let (plain, weighed) = (of(0.0, shown), of(2.0, shown));
            [weighed.0 / plain.0, weighed.1 / plain.1]
        };
        let [common, checks] = [ratio(&common), ratio(&checks)];
        // A constant stays under smoothing to rounding.
        assert!(common.iter().all(|r| (r - 1.0).abs() < 1e-3), "{common:?}");
        // Of checks, whose 0.33 and 0.27 do not lie at equal distance from the aim in L*, a small mean is left.
        assert!(checks.iter().all(|r| (r - 3.0).abs() < 0.05), "{checks:?}");
    }
    #[test]
    fn missing_chroma_counts_more_than_what_is_too_much() {
        let (aim, grey) = ([0.4, 0.25, 0.1], [0.27; 3]);
        // On the line from grey to the aim: less of its colour, and more.
        let shown =
            |share: f32| move |_: [u32; 3]| std::array::from_fn(|c| grey[c] + share * (aim[c] - grey[c]));
        let ratio = |aim, share| loss(aim, [0.0, 1.0], shown(share)).0 / loss(aim, [0.0; 2], shown(share)).0;
        let [less, more] = [0.8, 1.2].map(|share| ratio(aim, share));
        assert!(less > 1.7 && less <= 2.0, "{less}");
        assert!((more - 1.0).abs() < 1e-6, "{more}");
        // A grey has no colour to miss.
        assert!((ratio([0.3; 3], 0.8) - 1.0).abs() < 0.01);

        // What the iterate before lacked decides.
        let after = |lacked, weight: f32, share| loss_after(Some(lacked), aim, [0.0, weight], shown(share));
        let ratio = |lacked, share| after(lacked, 1.0, share).0 / after(lacked, 0.0, share).0;
        assert!(ratio(1, 1.2) > 1.7 && (ratio(0, 0.8) - 1.0).abs() < 1e-6);
        assert!(after(0, 1.0, 0.8).2.iter().all(|&l| l == 1) && after(1, 1.0, 1.2).2.iter().all(|&l| l == 0));
    }
}
