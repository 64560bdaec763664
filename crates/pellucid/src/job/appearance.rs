//! What labels look like, for the eye: every surface voxel without noise, and how far off that is.

use std::borrow::Cow;
use std::sync::Arc;

use pellucid_color::{RenderingIntent, Viewing};
use pellucid_core::Control;
use pellucid_predict::{BoundPredictor, Changed, Draw, Identity, Object, Pass, Predictor, without_noise};
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

/// Values that are predicted at a time: many bands of a large surface would take hundreds of bytes a voxel more.
const PART_VALUES: usize = 1 << 20;

/// Surfaces of more voxels are shown by paths alone: what the network keeps of them would be most of a job's memory.
pub(crate) const MOST_BY_NETWORK: usize = 4_000_000;

/// Labels as they look.
pub(super) struct Appearance {
    /// Linear RGB of every surface voxel relative to the print's white.
    pub colors: Vec<[f32; 3]>,
    /// How far off they are.
    pub picture: PictureError,
    /// Who predicted them.
    pub predictor: Identity,
}

/// Labels as the network has them.
struct ByNetwork {
    colors: Vec<[f32; 3]>,
    predictor: Identity,
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
        let colors = self.for_the_eye(labels, object, viewing, &halves, control)?;
        let picture = self.picture_error(&colors, labels, object, viewing, control)?;
        control.report(1, 1);
        Ok(Appearance { colors, picture, predictor: tracer.identity() })
    }

    /// Two halves of paths, linear RGB relative to the print's white, without noise: by the network, whose own error they
    /// tell, where it fits the object and that is not too large; otherwise by themselves.
    pub(super) fn for_the_eye(
        &self,
        labels: &LabelGrid,
        object: &Arc<Object>,
        viewing: &Viewing,
        halves: &[Vec<[f32; 3]>; 2],
        control: &Control<'_>,
    ) -> Result<Vec<[f32; 3]>, PrintError> {
        let silent = control.silent();
        let guess = match object.surface().len() <= MOST_BY_NETWORK {
            true => self.by_network(labels, object, viewing, &silent)?.map(|network| network.colors),
            false => None,
        };
        let halves = halves.each_ref().map(Vec::as_slice);
        Ok(without_noise(object, labels, viewing.leading_channels(), halves, guess.as_deref(), &silent)?)
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
        let Some(ByNetwork { colors, predictor }) = self.by_network(labels, object, viewing, control)? else {
            return self.appearance_by_paths(labels, object, viewing, control);
        };
        let picture = self.picture_error(&colors, labels, object, viewing, &control.silent())?;
        Ok(Appearance { colors, picture, predictor })
    }

    /// Every surface voxel as the network has it, where this build has one that was trained for such objects.
    fn by_network(
        &self,
        labels: &LabelGrid,
        object: &Arc<Object>,
        viewing: &Viewing,
        control: &Control<'_>,
    ) -> Result<Option<ByNetwork>, PrintError> {
        let Ok(network) = predictors::fitting(&self.settings, object, &self.team, predictors::network)?
        else {
            return Ok(None);
        };
        let mut bound = network.bind(Arc::clone(object))?;
        bound.update(labels, Changed::Unknown, &control.silent())?;
        let colors = self.seen(&*bound, object, viewing, Pass::Proof, control)?;
        Ok(Some(ByNetwork { colors, predictor: network.identity() }))
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
        let (points, channels) = (object.points(), object.channels());
        let mut colors = Vec::with_capacity(points.len());
        let mut radiance = Vec::new();
        for part in points.chunks((PART_VALUES / channels).max(1)) {
            let (done, total) = (colors.len() as u64, points.len() as u64);
            let progress = |in_part: u64, of: u64| {
                control.report(done + part.len() as u64 * in_part.min(of) / of.max(1), total);
            };
            let control = control.silent().with_progress(&progress);
            radiance.clear();
            radiance.resize(part.len() * channels, 0.0);
            bound.predict(part, Draw::new(self.settings.seed, pass), &mut radiance, &control)?;
            colors.extend(radiance.chunks_exact(channels).map(|l| viewing.relative_rgb(l)));
        }
        Ok(colors)
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

    /// On a halftoned ball as those that the network was trained with, where paths find nothing of its error.
    #[cfg(feature = "weights")]
    #[test]
    fn network_and_paths_together_are_as_close_as_the_better() {
        use crate::PrintSettings;
        use pellucid_voxel::{Frame, Surface, SurfaceOptions};

        let settings = PrintSettings { judge_spp: 2, judge_point_spp: 64, ..PrintSettings::default() };
        let job = PrintJob::new(settings).unwrap();
        let s = job.settings();
        let frame = Frame::new([0.0; 3], s.printer.pitch(), [96, 48, 150]).unwrap();
        let labels = LabelGrid::from_fn(frame, |v| {
            let inside = (0..3).map(|a| (2.0 * f64::from(v[a]) / f64::from(frame.size()[a]) - 1.0).powi(2));
            if inside.sum::<f64>() > 0.9 {
                return 0;
            }
            // White with more ink to one side, as if by a mask.
            let thin = pellucid_core::random::hash(3, pellucid_core::Domain::new("test"), u64::from(v[0]), {
                u64::from(v[1]) << 32 | u64::from(v[2])
            });
            if thin % 96 < u64::from(v[0]) { 1 + (thin / 96 % 4) as u8 } else { 5 }
        });
        let control = Control::none();
        let surface = Surface::extract(&labels, &SurfaceOptions::default(), &control).unwrap();
        let viewing = Viewing::of_print(&s.materials, "white", s.refractive_index, s.illuminant).unwrap();
        let object = Arc::new(Object::new(surface, s.materials.clone(), s.refractive_index).unwrap());
        let shown = job.appearance_by_paths(&labels, &object, &viewing, &control).unwrap();
        let network = job.appearance_at_once(&labels, &object, &viewing, &control).unwrap();
        let mut bound =
            predictors::monte_carlo(s, s.judge_spp, &job.team).unwrap().bind(Arc::clone(&object)).unwrap();
        bound.update(&labels, Changed::Unknown, &control).unwrap();
        let halves =
            [0, 1].map(|pass| job.seen(&*bound, &object, &viewing, Pass::Judge(pass), &control).unwrap());
        let halves = halves.each_ref().map(Vec::as_slice);
        let leading = viewing.leading_channels();
        let paths = without_noise(&object, &labels, leading, halves, None, &control).unwrap();
        let paths = job.picture_error(&paths, &labels, &object, &viewing, &control).unwrap();
        let rmse = [&shown.picture, &network.picture, &paths].map(|p| p.rmse);
        assert!(rmse[0] < 1.1 * rmse[1] && rmse[0] < 0.7 * rmse[2], "{rmse:?}");
    }
}
