//! The loss over all viewings that a print is aimed at in.

use pellucid_color::Viewing;
use pellucid_core::Control;
use pellucid_predict::Draw;
use rayon::prelude::*;

use super::DescentTools;
use super::cells::CellGradient;
use super::loss::{Found, Scale};
use crate::layers::Layers;
use crate::problem::shown_in;
use crate::{RefineError, Seen, Setup};

/// What is found of one prediction.
pub(super) struct Loss {
    /// Of every surface voxel, the mean over viewings.
    pub loss: Vec<f32>,
    /// By viewing.
    pub slopes: Vec<Slopes>,
    /// 1 where chroma is missing, `[viewing][scale][point]`.
    pub lacks: Vec<u8>,
}

/// By the colours shown in one viewing.
pub(super) struct Slopes {
    pub gradient: Vec<[f32; 3]>,
    /// With `reach`, how far a full step would move each colour; both empty where they are not asked for.
    pub curvature: Vec<[f32; 3]>,
    pub reach: Vec<[f32; 3]>,
}

impl Loss {
    /// The mean over the surface.
    pub(super) fn mean(&self) -> f64 {
        self.loss.iter().map(|&l| f64::from(l)).sum::<f64>() / self.loss.len().max(1) as f64
    }

    /// What the curvature would come to, were every ink to take its whole range. Of surface voxels with cells: what others
    /// show does not follow from them.
    pub(super) fn expected(&self, layers: &Layers) -> f64 {
        let dot = |a: &[f32; 3], b: &[f32; 3]| (0..3).map(|c| f64::from(a[c] * b[c])).sum::<f64>();
        let each = self.slopes.iter().flat_map(|s| s.curvature.iter().zip(&s.reach).zip(0..));
        each.filter(|(_, point)| layers.occupied(*point) != 0).map(|((c, r), _)| dot(c, r)).sum()
    }
}

impl DescentTools {
    /// The loss and its gradient by the colours shown in every viewing, given where chroma `lacked` in the iterate before,
    /// if there was one; the weights of its `curvature` where asked for.
    pub(super) fn loss(
        &self,
        setup: &Setup<'_>,
        seen: &Seen<'_>,
        lacked: &[u8],
        curvature: bool,
        control: &Control<'_>,
    ) -> Result<Loss, RefineError> {
        let count = seen.shown.len();
        let mut loss = vec![0.0; count];
        let mut slopes = Vec::with_capacity(self.scales.len());
        let mut lacks = Vec::with_capacity(2 * self.scales.len() * count);
        let mut lacked = lacked.chunks(count.max(1));
        for (i, (aim, scales)) in setup.problem.aims().zip(&self.scales).enumerate() {
            let others = (i > 0).then(|| shown_in(aim.viewing, seen.radiance));
            let shown = others.as_deref().unwrap_or(seen.shown);
            let reach = curvature.then(|| reach(aim.viewing, shown));
            let mut found = Found {
                loss,
                lacks: Vec::new(),
                gradient: vec![[0.0; 3]; count],
                curvature: vec![[0.0; 3]; if curvature { count } else { 0 }],
            };
            for (scale, smoother) in scales.iter().zip([seen.smoother, &self.fine]) {
                found.lacks = lacked.next().map(<[u8]>::to_vec).unwrap_or_default();
                scale.add(smoother, &self.low_pass, shown, reach.as_deref(), &mut found, control)?;
                lacks.append(&mut found.lacks);
            }
            loss = found.loss;
            let reach = reach.unwrap_or_default();
            slopes.push(Slopes { gradient: found.gradient, curvature: found.curvature, reach });
        }
        Ok(Loss { loss, slopes, lacks })
    }

    /// What of the mean loss is the random error of one of two predictions of the same labels.
    pub(super) fn noise_between(
        &self,
        setup: &Setup<'_>,
        seen: &Seen<'_>,
        again: &[f32],
        control: &Control<'_>,
    ) -> Result<f64, RefineError> {
        let mut sum = 0.0;
        for (aim, scales) in setup.problem.aims().zip(&self.scales) {
            let both = [seen.radiance, again].map(|radiance| shown_in(aim.viewing, radiance));
            for (scale, smoother) in scales.iter().zip([seen.smoother, &self.fine]) {
                sum += scale.noise(smoother, &self.low_pass, [&both[0], &both[1]], control)?;
            }
        }
        Ok(sum / setup.points.len().max(1) as f64)
    }
}

/// The scales at which the print is looked at in every viewing, which count alike.
pub(super) fn scales(
    setup: &Setup<'_>,
    scale: impl Fn(&[[f32; 3]], f32) -> Result<[Scale; 2], RefineError>,
) -> Result<Vec<[Scale; 2]>, RefineError> {
    let share = 1.0 / setup.problem.aims().count() as f32;
    setup.problem.aims().map(|aim| scale(aim.printable_target, share)).collect()
}

/// Derivatives by inks in place of white, `[point][layer][ink]`, given those by the colours that some points show in each
/// viewing.
pub(super) fn pull(
    setup: &Setup<'_>,
    seen: &Seen<'_>,
    draw: Draw,
    points: &[u32],
    d_shown: impl Fn(usize, u32) -> [f32; 3] + Sync,
    control: &Control<'_>,
) -> Result<Vec<f32>, RefineError> {
    let channels = setup.problem.viewing.channels();
    let mut d_radiance = vec![0.0; points.len() * channels];
    for (i, aim) in setup.problem.aims().enumerate() {
        let rows = d_radiance.par_chunks_exact_mut(channels).zip(points);
        rows.for_each(|(d_radiance, &point)| aim.viewing.pullback(d_shown(i, point), d_radiance));
    }
    let mut cells = CellGradient::new(setup);
    seen.bound
        .pullback(points, draw, &d_radiance, &mut cells, control)
        .map_err(|e| RefineError::predict(seen.iteration, e))?;
    Ok(cells.by_inks())
}

/// How far each shown colour would go, up to a factor, if every ink took its whole range: as of a thick layer by
/// Kubelka and Munk, whose reflectance R changes by 2 R² / (1 - R²) with absorption over scattering.
fn reach(viewing: &Viewing, shown: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let white = viewing.media_white();
    let each = shown.par_iter().map(|shown| {
        std::array::from_fn(|c| {
            let reflectance = (shown[c] * white[c]).clamp(0.02, 0.93);
            2.0 * reflectance * reflectance / (1.0 - reflectance * reflectance) / white[c]
        })
    });
    each.collect()
}
