//! The fourth artefact: what fresh paths say of the labels before and after, and what they look like.

use pellucid_core::Control;
use pellucid_predict::{Changed, Draw, Pass, Predictor, predict_all};
use pellucid_proof::{Proof, View};
use pellucid_refine::{Aim, Evaluation, Judge, JudgeInput, Judged as Judgement, Viewed};
use pellucid_voxel::LabelGrid;
use serde::{Deserialize, Serialize};

use crate::job::appearance::pictured;
use crate::job::{Aimed, Refined};
use crate::report::{ErrorHistogram, LightErrors, PictureError, PredictionError};
use crate::stage::Stage;
use crate::workspace::JUDGED;
use crate::{Monitor, PrintError, PrintJob, Workspace, predictors};

/// Paths a point and band by which a print is looked at under several lights.
const LIGHT_SPP: u32 = 32;

/// Judged labels.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Judged {
    /// Errors before and after.
    pub evaluation: Evaluation,
    /// How far the network alone is off on the labels to print; absent with the path tracer, whose only error is
    /// noise.
    pub prediction: Option<PredictionError>,
    /// Appearance of every surface voxel before and after, linear RGB relative to the print's white, for the eye: noise
    /// was taken out.
    pub appearance: [Vec<[f32; 3]>; 2],
    /// How far the appearance after is off what many paths say.
    pub picture: PictureError,
    /// Where each is off the target as given, over 0.1 mm: CIEDE2000 in parts, out of gamut, too thin, cross-talk.
    pub error_parts: [Vec<[f32; 3]>; 2],
    /// Errors and inconstancy under all lights, where there are several.
    pub lights: Vec<LightErrors>,
    /// The look under each light but the first.
    pub light_looks: Vec<LightLook>,
    /// Target, unrefined and refined appearance from both sides, linear RGB by
    /// [`PrintSettings::proof_intent`](crate::PrintSettings::proof_intent); and the refined error at
    /// 0.1 mm to the target as given in its parts, out of gamut, too thin and cross-talk.
    pub proof: Proof,
}

/// A print under one more light, smoothed over 0.1 mm of surface: a value a surface voxel.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct LightLook {
    /// Linear RGB before refinement, relative to the print's white under the light.
    pub unrefined: Vec<[f32; 3]>,
    /// The same of the labels to print.
    pub refined: Vec<[f32; 3]>,
    /// CIEDE2000 of these from their look under the first light: colour inconstancy.
    pub inconstancy: Vec<f32>,
}

/// What the judge saw: kept by the workspace.
#[derive(Serialize, Deserialize)]
struct Verdict {
    evaluation: Evaluation,
    prediction: Option<PredictionError>,
    picture: PictureError,
    #[serde(default)]
    lights: Vec<LightErrors>,
    /// One for each light but the first.
    #[serde(skip)]
    light_looks: Vec<LightLook>,
    /// Of every surface voxel, before and after.
    #[serde(skip)]
    appearance: [Vec<[f32; 3]>; 2],
    /// Of every surface voxel, before and after: the error in parts.
    #[serde(skip)]
    parts: [Vec<[f32; 3]>; 2],
}

impl Judged {
    /// How the errors are spread over the surface.
    pub fn error_histogram(&self) -> ErrorHistogram {
        ErrorHistogram::of(self.error_parts.each_ref().map(Vec::as_slice))
    }
}

impl PrintJob {
    /// Judges the labels before and after refinement by fresh paths, and draws the proof. What the judge saw is kept
    /// in `workspace`, and taken up from there.
    ///
    /// # Errors
    /// [`PrintError::Predict`], [`PrintError::Refine`], [`PrintError::Proof`], [`PrintError::Cancelled`].
    pub fn judge(
        &self,
        aimed: &Aimed,
        refined: &Refined,
        workspace: &Workspace,
        monitor: &Monitor<'_>,
    ) -> Result<Judged, PrintError> {
        let points = aimed.object.surface().len();
        let verdict = match workspace.load(JUDGED)?.and_then(|bytes| Verdict::from_bytes(&bytes, points)) {
            Some(verdict) => verdict,
            None => {
                let verdict = monitor.run(Stage::Judge, |c| self.verdict(aimed, refined, c))?;
                workspace.save(JUDGED, || Ok(verdict.to_bytes()))?;
                verdict
            }
        };
        let [before, after] = &verdict.appearance;
        let pictured = |colors| pictured(colors, self.settings.proof_intent, &aimed.viewing);
        let colors = [pictured(&aimed.target), pictured(before), pictured(after)];
        let states = [("target", &colors[0][..]), ("unrefined", &colors[1]), ("refined", &colors[2])];
        let (surface, edge) = (aimed.object.surface(), self.settings.proof_edge);
        let proof = monitor.run(Stage::Proof, |c| {
            let views = View::front_and_back();
            Proof::draw_with_errors(&refined.labels, surface, &views, edge, &states, &verdict.parts[1], c)
        })?;
        Ok(Judged {
            evaluation: verdict.evaluation,
            prediction: verdict.prediction,
            picture: verdict.picture,
            lights: verdict.lights,
            light_looks: verdict.light_looks,
            appearance: verdict.appearance,
            error_parts: verdict.parts,
            proof,
        })
    }

    fn verdict(
        &self,
        aimed: &Aimed,
        refined: &Refined,
        control: &Control<'_>,
    ) -> Result<Verdict, PrintError> {
        let s = &self.settings;
        let judge = Judge::new(JudgeInput::from(aimed.problem()), s.judge, s.seed, control)?
            .with_gamut_target(&aimed.gamut_target, control)?;
        let silent = control.silent();
        let [before, after] = self.judgements(&judge, aimed, refined, control)?;
        let prediction = match self.network_alone(aimed, &refined.labels, judge.points(), &silent)? {
            Some(radiance) => Some(PredictionError::of(&after.prediction_error(&radiance)?)),
            None => None,
        };
        // For the eye only: the stated errors are of the paths themselves.
        let pictured = |labels: &LabelGrid, judgement: &Judgement| {
            self.for_the_eye(labels, &aimed.object, &aimed.viewing, &judgement.shown, &silent)
        };
        let appearance = [pictured(&refined.unrefined, &before)?, pictured(&refined.labels, &after)?];
        let picture = PictureError::of(&appearance[1], &after.points, &after.halves, &aimed.viewing);
        let evaluation = Evaluation { unrefined: before.errors, refined: after.errors };
        let parts =
            [judge.error_parts(&appearance[0], &silent)?, judge.error_parts(&appearance[1], &silent)?];
        let (lights, light_looks) = self.lights(aimed, [&refined.unrefined, &refined.labels], &silent)?;
        Ok(Verdict { evaluation, prediction, picture, lights, light_looks, appearance, parts })
    }

    /// What fresh paths say of the labels before and after.
    fn judgements(
        &self,
        judge: &Judge<'_>,
        aimed: &Aimed,
        refined: &Refined,
        control: &Control<'_>,
    ) -> Result<[Judgement; 2], PrintError> {
        let s = &self.settings;
        // Of one path: efforts make more of them.
        let tracer = predictors::monte_carlo(s, 1, &self.team)?;
        let capabilities = tracer.supports(&aimed.object)?;
        let mut bound = tracer.bind(aimed.object.clone())?;
        let half = |from: u64| move |done: u64, total: u64| control.report(from * total + done, 2 * total);
        let (first, second) = (half(0), half(1));
        let silent = control.silent();
        let mut look = |labels: &LabelGrid, control: Control<'_>| {
            judge.judge_with(labels, &mut *bound, [s.judge_spp, s.judge_point_spp], capabilities, &control)
        };
        Ok([
            look(&refined.unrefined, silent.with_progress(&first))?,
            look(&refined.labels, silent.with_progress(&second))?,
        ])
    }

    /// Labels before and after under all lights, where there are several.
    fn lights(
        &self,
        aimed: &Aimed,
        labels: [&LabelGrid; 2],
        control: &Control<'_>,
    ) -> Result<(Vec<LightErrors>, Vec<LightLook>), PrintError> {
        if aimed.further.is_empty() {
            return Ok(Default::default());
        }
        let problem = aimed.problem();
        let own = Aim { viewing: problem.viewing, printable_target: problem.printable_target };
        let aims: Vec<Aim<'_>> = std::iter::once(own).chain(aimed.further_aims()).collect();
        let mut bound =
            predictors::monte_carlo(&self.settings, LIGHT_SPP, &self.team)?.bind(aimed.object.clone())?;
        let mut look = |labels: &LabelGrid| {
            bound.update(labels, Changed::Unknown, control)?;
            let draw = Draw::new(self.settings.seed, Pass::Proof);
            let (radiance, _) = predict_all(&*bound, &aimed.object, draw, control)?;
            Ok::<_, PrintError>(Viewed::of(aimed.object.surface(), &aims, &radiance, control)?)
        };
        let [before, mut after] = [look(labels[0])?, look(labels[1])?];
        let lights =
            std::iter::once(self.settings.illuminant).chain(aimed.further.iter().map(|f| f.illuminant));
        let errors = lights.zip(&aims).enumerate().map(|(i, (illuminant, aim))| LightErrors {
            illuminant,
            media_white: aim.viewing.media_white(),
            error: [before.errors[i], after.errors[i]],
            inconstancy: [before.inconstancy[i], after.inconstancy[i]],
            wanted_inconstancy: after.wanted_inconstancy[i],
        });
        let errors = errors.collect();
        let maps = std::mem::take(&mut after.maps);
        let looks = before.shown.into_iter().zip(after.shown).zip(maps).skip(1);
        let looks =
            looks.map(|((unrefined, refined), inconstancy)| LightLook { unrefined, refined, inconstancy });
        Ok((errors, looks.collect()))
    }

    /// Radiance of some points by the network without its correction, where the job's predictor has one.
    #[cfg(feature = "rpnn")]
    fn network_alone(
        &self,
        aimed: &Aimed,
        labels: &LabelGrid,
        points: &[u32],
        control: &Control<'_>,
    ) -> Result<Option<Vec<f32>>, PrintError> {
        if self.settings.predictor != crate::PredictorKind::Rpnn {
            return Ok(None);
        }
        let mut bound = predictors::network(&self.settings, &self.team)?.bind(aimed.object.clone())?;
        bound.update(labels, Changed::Unknown, control)?;
        let mut radiance = vec![0.0; points.len() * aimed.object.channels()];
        bound.predict(points, Draw::new(self.settings.seed, Pass::Judge(0)), &mut radiance, control)?;
        Ok(Some(radiance))
    }

    #[cfg(not(feature = "rpnn"))]
    fn network_alone(
        &self,
        _: &Aimed,
        _: &LabelGrid,
        _: &[u32],
        _: &Control<'_>,
    ) -> Result<Option<Vec<f32>>, PrintError> {
        Ok(None)
    }
}

impl Verdict {
    /// The length of the errors as JSON, them, and as little-endian numbers both appearances, the parts, and the looks under
    /// further lights.
    fn to_bytes(&self) -> Vec<u8> {
        let errors = serde_json::to_vec(self).unwrap_or_default();
        let mut bytes = (errors.len() as u64).to_le_bytes().to_vec();
        bytes.extend(errors);
        let mut add = |values: &[f32]| bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
        self.appearance.iter().chain(&self.parts).for_each(|field| add(field.as_flattened()));
        for LightLook { unrefined, refined, inconstancy } in &self.light_looks {
            [unrefined, refined].into_iter().for_each(|field| add(field.as_flattened()));
            add(inconstancy);
        }
        bytes
    }

    /// `None` when the bytes are not those of a verdict over `points` surface voxels: the judge then judges again.
    fn from_bytes(bytes: &[u8], points: usize) -> Option<Self> {
        let (length, rest) = bytes.split_first_chunk::<8>()?;
        let (errors, fields) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
        let mut verdict: Self = serde_json::from_slice(errors).ok()?;
        let (values, []) = fields.as_chunks::<4>() else { return None };
        let looks = verdict.lights.len().saturating_sub(1);
        if values.len() != (4 * 3 + 7 * looks) * points {
            return None;
        }
        let values: Vec<f32> = values.iter().map(|v| f32::from_le_bytes(*v)).collect();
        // From a place on, counted in numbers a surface voxel.
        let field = |from: usize| values[from * points..][..3 * points].as_chunks().0.to_vec();
        verdict.appearance = [field(0), field(3)];
        verdict.parts = [field(6), field(9)];
        let look = |i: usize| {
            let from = 12 + 7 * i;
            let inconstancy = values[(from + 6) * points..][..points].to_vec();
            LightLook { unrefined: field(from), refined: field(from + 3), inconstancy }
        };
        verdict.light_looks = (0..looks).map(look).collect();
        Some(verdict)
    }
}
