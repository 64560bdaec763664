//! The fourth artefact: what fresh paths say of the labels before and after, and what they look like.

use pellucid_core::Control;
use pellucid_predict::Predictor;
use pellucid_proof::{Picture, View, Visibility};
use pellucid_refine::{Evaluation, Judge, JudgeInput};
use pellucid_voxel::LabelGrid;
use serde::{Deserialize, Serialize};

use crate::job::{Aimed, Refined};
use crate::report::PredictionError;
use crate::stage::Stage;
use crate::workspace::JUDGED;
use crate::{Monitor, PrintError, PrintJob, Workspace, predictors};

/// Judged labels.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Judged {
    /// Errors before and after.
    pub evaluation: Evaluation,
    /// How far the network alone is off on the labels to print; absent with the path tracer, whose only error is
    /// noise.
    pub prediction: Option<PredictionError>,
    /// Appearance in each view of the proof.
    pub views: Vec<ProofView>,
}

/// What one view of the proof shows; colours are media-relative linear RGB.
#[derive(Clone, Debug)]
pub struct ProofView {
    /// The view's name.
    pub name: String,
    /// Target, unrefined and refined appearance.
    pub pictures: [Picture; 3],
}

/// What the judge saw: kept by the workspace.
#[derive(Serialize, Deserialize)]
struct Verdict {
    evaluation: Evaluation,
    prediction: Option<PredictionError>,
    /// Of every surface voxel, before and after.
    #[serde(skip)]
    appearance: [Vec<[f32; 3]>; 2],
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
        let views =
            monitor.run(Stage::Proof, |c| self.proof(aimed, &refined.labels, &verdict.appearance, c))?;
        Ok(Judged { evaluation: verdict.evaluation, prediction: verdict.prediction, views })
    }

    fn verdict(
        &self,
        aimed: &Aimed,
        refined: &Refined,
        control: &Control<'_>,
    ) -> Result<Verdict, PrintError> {
        let s = &self.settings;
        let judge = Judge::new(JudgeInput::from(aimed.problem()), s.judge, s.seed, control)?;
        let tracer = predictors::monte_carlo(s, s.judge_spp)?;
        let capabilities = tracer.supports(&aimed.object)?;
        let mut bound = tracer.bind(aimed.object.clone())?;
        let half = |from: u64| move |done: u64, total: u64| control.report(from * total + done, 2 * total);
        let (first, second) = (half(0), half(1));
        let silent = control.silent();
        let before =
            judge.judge(&refined.unrefined, &mut *bound, capabilities, &silent.with_progress(&first))?;
        let after =
            judge.judge(&refined.labels, &mut *bound, capabilities, &silent.with_progress(&second))?;
        let prediction = match self.network_alone(aimed, &refined.labels, judge.points(), &silent)? {
            Some(radiance) => Some(PredictionError::of(&after.prediction_error(&radiance)?)),
            None => None,
        };
        Ok(Verdict {
            evaluation: Evaluation { unrefined: before.errors, refined: after.errors },
            prediction,
            appearance: [before.appearance, after.appearance],
        })
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
        use pellucid_predict::{Changed, Draw, Pass};

        if self.settings.predictor != crate::PredictorKind::Rpnn {
            return Ok(None);
        }
        let mut bound = predictors::network(&self.settings)?.bind(aimed.object.clone())?;
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

    fn proof(
        &self,
        aimed: &Aimed,
        labels: &LabelGrid,
        appearance: &[Vec<[f32; 3]>; 2],
        control: &Control<'_>,
    ) -> Result<Vec<ProofView>, PrintError> {
        let surface = aimed.object.surface();
        let views = View::front_and_back();
        let total = views.len() as u64;
        let mut shown = Vec::new();
        for (done, view) in views.into_iter().enumerate() {
            control.report(done as u64, total);
            let seen =
                Visibility::trace(labels, surface, &view, self.settings.proof_edge, &control.silent())?;
            let [before, after] = appearance;
            let shade = |colors: &[[f32; 3]]| seen.shade(colors, &control.silent());
            let pictures = [shade(&aimed.target)?, shade(before)?, shade(after)?];
            shown.push(ProofView { name: view.name().to_owned(), pictures });
        }
        Ok(shown)
    }
}

impl Verdict {
    /// The length of the errors as JSON, them, and both appearances as little-endian numbers.
    fn to_bytes(&self) -> Vec<u8> {
        let errors = serde_json::to_vec(self).unwrap_or_default();
        let mut bytes = (errors.len() as u64).to_le_bytes().to_vec();
        bytes.extend(errors);
        bytes.extend(self.appearance.iter().flatten().flatten().flat_map(|v| v.to_le_bytes()));
        bytes
    }

    /// `None` when the bytes are not those of a verdict over `points` surface voxels: the judge then judges again.
    fn from_bytes(bytes: &[u8], points: usize) -> Option<Self> {
        let (length, rest) = bytes.split_first_chunk::<8>()?;
        let (errors, appearance) =
            rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
        let mut verdict: Self = serde_json::from_slice(errors).ok()?;
        let (values, []) = appearance.as_chunks::<4>() else { return None };
        let (colors, []) = values.as_chunks::<3>() else { return None };
        if colors.len() != 2 * points {
            return None;
        }
        let (before, after) = colors.split_at(points);
        verdict.appearance =
            [before, after].map(|c| c.iter().map(|rgb| rgb.map(f32::from_le_bytes)).collect());
        Some(verdict)
    }
}
