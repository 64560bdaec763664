//! What labels look like, for the eye: every surface voxel without noise, and how far off that is.

use std::borrow::Cow;
use std::sync::Arc;

use pellucid_color::{RenderingIntent, Viewing};
use pellucid_core::Control;
use pellucid_predict::{
    BoundPredictor, Changed, Draw, Identity, Object, Pass, Predictor, predict_all, without_noise,
};
use pellucid_voxel::LabelGrid;

use crate::picture_error::PictureError;
use crate::{PrintError, PrintJob, predictors};

/// Colours as pictures show them: relative to the print's white, or beside a perfect one.
pub(super) fn pictured<'a>(
    colors: &'a [[f32; 3]],
    intent: RenderingIntent,
    viewing: &Viewing,
) -> Cow<'a, [[f32; 3]]> {
    let white = viewing.media_white();
    match intent {
        RenderingIntent::RelativeColorimetric => Cow::Borrowed(colors),
        RenderingIntent::AbsoluteColorimetric => {
            Cow::Owned(colors.iter().map(|rgb| std::array::from_fn(|c| rgb[c] * white[c])).collect())
        }
    }
}

/// Labels as they look.
pub(super) struct Appearance {
    /// Linear RGB of every surface voxel relative to the print's white.
    pub colors: Vec<[f32; 3]>,
    /// How far off they are.
    pub picture: PictureError,
    /// Who predicted them.
    pub predictor: Identity,
}

impl PrintJob {
    /// By [`PrintSettings::judge_spp`](crate::PrintSettings::judge_spp) paths twice, whose noise is taken out.
    pub(super) fn appearance_by_paths(
        &self,
        labels: &LabelGrid,
        object: &Arc<Object>,
        viewing: &Viewing,
        control: &Control<'_>,
    ) -> Result<Appearance, PrintError> {
        let tracer = predictors::monte_carlo(&self.settings, self.settings.judge_spp, &self.team)?;
        let mut bound = tracer.bind(Arc::clone(object))?;
        bound.update(labels, Changed::Unknown, &control.silent())?;
        let half = |pass: u32| {
            let progress = |done: u64, total: u64| control.report(u64::from(pass) * total + done, 3 * total);
            self.seen(&*bound, object, viewing, Pass::Judge(pass), &control.silent().with_progress(&progress))
        };
        let halves = [half(0)?, half(1)?];
        let shown = halves.each_ref().map(Vec::as_slice);
        let colors = without_noise(object, labels, viewing.leading_channels(), shown, &control.silent())?;
        let picture = self.picture_error(&colors, labels, object, viewing, control)?;
        control.report(1, 1);
        Ok(Appearance { colors, picture, predictor: tracer.identity() })
    }

    /// By the network, whose values have no noise, where this build has it and it was trained for such objects;
    /// otherwise by paths.
    pub(super) fn appearance_at_once(
        &self,
        labels: &LabelGrid,
        object: &Arc<Object>,
        viewing: &Viewing,
        control: &Control<'_>,
    ) -> Result<Appearance, PrintError> {
        let Ok(network) = predictors::fitting(&self.settings, object, &self.team, predictors::network)?
        else {
            return self.appearance_by_paths(labels, object, viewing, control);
        };
        let mut bound = network.bind(Arc::clone(object))?;
        bound.update(labels, Changed::Unknown, &control.silent())?;
        let colors = self.seen(&*bound, object, viewing, Pass::Proof, control)?;
        let picture = self.picture_error(&colors, labels, object, viewing, &control.silent())?;
        Ok(Appearance { colors, picture, predictor: network.identity() })
    }

    /// Every surface voxel as one prediction has it.
    fn seen(
        &self,
        bound: &dyn BoundPredictor,
        object: &Object,
        viewing: &Viewing,
        pass: Pass,
        control: &Control<'_>,
    ) -> Result<Vec<[f32; 3]>, PrintError> {
        let (radiance, _) = predict_all(bound, object, Draw::new(self.settings.seed, pass), control)?;
        Ok(radiance.chunks_exact(object.channels()).map(|l| viewing.relative_rgb(l)).collect())
    }

    /// Colours against [`PrintSettings::judge_point_spp`](crate::PrintSettings::judge_point_spp) paths twice at some
    /// surface voxels, spread over their list and so over the surface.
    fn picture_error(
        &self,
        colors: &[[f32; 3]],
        labels: &LabelGrid,
        object: &Arc<Object>,
        viewing: &Viewing,
        control: &Control<'_>,
    ) -> Result<PictureError, PrintError> {
        let (s, silent) = (&self.settings, control.silent());
        let mut precise =
            predictors::monte_carlo(s, s.judge_point_spp, &self.team)?.bind(Arc::clone(object))?;
        precise.update(labels, Changed::Unknown, &silent)?;
        let all = object.points();
        let count = all.len().min(s.judge.points as usize);
        let points: Vec<u32> = (0..count).map(|i| all[i * all.len() / count]).collect();
        let half = |pass: u32| {
            let mut radiance = vec![0.0; points.len() * object.channels()];
            precise.predict(&points, Draw::new(s.seed, Pass::Judge(pass)), &mut radiance, &silent)?;
            Ok::<_, PrintError>(radiance)
        };
        Ok(PictureError::of(colors, &points, &[half(2)?, half(3)?], viewing))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pellucid_color::MediaWhite;

    #[test]
    fn the_absolute_intent_shows_the_prints_own_white() {
        let viewing = Viewing::rgb(MediaWhite::new([0.5, 0.8, 0.4]).unwrap());
        let colors = [[1.0; 3], [0.5, 0.25, 0.0]];
        let shown = |intent| pictured(&colors, intent, &viewing);
        assert_eq!(shown(RenderingIntent::RelativeColorimetric)[..], colors);
        let absolute = shown(RenderingIntent::AbsoluteColorimetric);
        assert_eq!(absolute[..], [[0.5, 0.8, 0.4], [0.25, 0.2, 0.0]]);
    }
}
