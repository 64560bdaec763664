//! Which predictor is ahead on an object, by trial.
//!
//! What a predictor costs and how far it errs depend on the machine, the inks, and how much of the object is thick and
//! white. So each is tried on the unrefined halftone of the object at hand: the time that the whole surface takes, and the
//! error of some patches of the surface, each averaged as the refinement averages neighbours, against many paths.

use std::sync::Arc;
use std::time::Instant;

use pellucid_core::{Control, Domain, random};
use pellucid_predict::{Changed, Draw, Object, Pass, Predictor, predict_all};
use pellucid_refine::Refinement;
use pellucid_voxel::LabelGrid;
use serde::{Deserialize, Serialize};

use crate::job::Aimed;
use crate::{PredictorKind, PrintError, PrintJob, predictors};

/// Patches of the surface on which errors are taken.
const PATCHES: u64 = 48;
/// Radius of a patch in mm: about what a viewer's eye blends.
const RADIUS_MM: f64 = 0.1;
/// Paths a point and channel of the comparison.
const PATHS: u32 = 256;
const PATCH: Domain = Domain::new("patch of a trial");

/// One predictor's trial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// The predictor.
    pub predictor: PredictorKind,
    /// Seconds that a prediction of the whole surface took.
    pub seconds: f64,
    /// Root mean square error of the mean linear radiance of a patch, the comparison's own noise included.
    pub error: f64,
}

/// What was tried, and what came of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Choice {
    /// The predictor with the least time for equal error, if errors fell as paths' do.
    pub chosen: PredictorKind,
    /// Why, for people: what the trials found, or why the network does not fit.
    #[serde(default)]
    pub reason: String,
    /// The trials; none where there is nothing to choose from.
    pub trials: Vec<Trial>,
}

impl Choice {
    fn of(trials: Vec<Trial>) -> Self {
        let cost = |t: &Trial| t.seconds * t.error * t.error;
        let best = trials.iter().min_by(|a, b| cost(a).total_cmp(&cost(b)));
        let chosen = best.map_or(PredictorKind::MonteCarlo, |t| t.predictor);
        let pass = |t: &Trial| {
            format!("{} takes {:.1} s at an error of {:.3}", t.predictor.name(), t.seconds, t.error)
        };
        let passes: Vec<String> = trials.iter().map(pass).collect();
        let reason = format!("it takes least time for equal error: over the surface {}", passes.join(", "));
        Self { chosen, reason, trials }
    }

    /// The path tracer for descent, without a trial: one pass says nothing of what averaged passes come to, and in all they
    /// are ahead on some objects only (docs/results/descent).
    fn of_descent() -> Self {
        let reason =
            "with descent the network is ahead on some objects only, and takes more memory".to_owned();
        Self { chosen: PredictorKind::MonteCarlo, reason, trials: Vec::new() }
    }

    /// The path tracer, since the network does not fit.
    fn without_network(reason: &str) -> Self {
        let reason = format!("the network does not fit: {reason}");
        Self { chosen: PredictorKind::MonteCarlo, reason, trials: Vec::new() }
    }
}

/// Some patches of a surface.
struct Patches {
    /// All their points, ascending, each once.
    points: Vec<u32>,
    /// Positions in `points` of each patch's.
    members: Vec<Vec<u32>>,
}

impl Patches {
    /// Patches about points that the seed chooses.
    fn new(object: &Object, seed: u64) -> Self {
        let surface = object.surface();
        let count = surface.len() as u64;
        let mm = surface.frame().pitch().mm();
        let reach = mm.map(|mm| (RADIUS_MM / mm).ceil() as i64);
        let about = |i: u64| -> Vec<u32> {
            let middle = (random::hash(seed, PATCH, i, 0) % count.max(1)) as u32;
            let voxel = surface.voxels()[middle as usize].map(i64::from);
            let mut found = Vec::new();
            for z in -reach[2]..=reach[2] {
                for y in -reach[1]..=reach[1] {
                    for x in -reach[0]..=reach[0] {
                        let step = [x, y, z];
                        let distance = (0..3).map(|a| (step[a] as f64 * mm[a]).powi(2)).sum::<f64>();
                        let near: [Option<u32>; 3] =
                            std::array::from_fn(|a| u32::try_from(voxel[a] + step[a]).ok());
                        if let ([Some(x), Some(y), Some(z)], true) = (near, distance <= RADIUS_MM * RADIUS_MM)
                        {
                            found.extend(surface.index_of([x, y, z]));
                        }
                    }
                }
            }
            found
        };
        let patches: Vec<Vec<u32>> =
            (0..PATCHES).filter(|_| count > 0).map(about).filter(|p| !p.is_empty()).collect();
        let mut points: Vec<u32> = patches.concat();
        points.sort_unstable();
        points.dedup();
        let place = |p: &u32| points.partition_point(|q| q < p) as u32;
        let members = patches.iter().map(|patch| patch.iter().map(place).collect()).collect();
        Self { points, members }
    }

    /// Mean radiance of each patch, `[patch][channel]`, from that of the points.
    fn means(&self, radiance: &[f32], channels: usize) -> Vec<f64> {
        let mean = |patch: &Vec<u32>, c: usize| {
            let sum: f64 = patch.iter().map(|&i| f64::from(radiance[i as usize * channels + c])).sum();
            sum / patch.len() as f64
        };
        self.members
            .iter()
            .flat_map(|patch| (0..channels).map(move |c| (patch, c)))
            .map(|(p, c)| mean(p, c))
            .collect()
    }
}

impl PrintJob {
    /// Tries the predictors that this build and the settings have on an object. The choice depends on the machine; a
    /// job keeps it, and its record names what was chosen. For descent it is paths without a trial ([`PredictorKind::of`]). A
    /// network that was not trained for the job's voxels, boundary or materials is not tried: paths are taken, and
    /// [`Choice::reason`] says so.
    ///
    /// # Errors
    /// [`PrintError::Predict`], [`PrintError::Refine`], [`PrintError::Cancelled`].
    pub fn choose(&self, aimed: &Aimed, control: &Control<'_>) -> Result<Choice, PrintError> {
        if PredictorKind::Auto.of(self.settings().strategy) == PredictorKind::MonteCarlo {
            return Ok(Choice::of_descent());
        }
        let settings = crate::PrintSettings { predictor: PredictorKind::Rpnn, ..self.settings().clone() };
        let network = match predictors::fitting(&settings, &aimed.object, self.team(), predictors::predictor)?
        {
            Err(fault) => return Ok(Choice::without_network(&fault.to_string())),
            Ok(network) => network,
        };
        let paths = crate::PrintSettings { predictor: PredictorKind::MonteCarlo, ..self.settings().clone() };
        let candidates = [
            (PredictorKind::MonteCarlo, predictors::predictor(&paths, self.team())?),
            (PredictorKind::Rpnn, network),
        ];
        let part = self.tried_on(aimed, &control.silent())?;
        let aimed = part.as_ref().unwrap_or(aimed);
        let labels = self.halftone(aimed, control)?.0;
        let patches = Patches::new(&aimed.object, self.settings().seed);
        let channels = aimed.object.channels();
        let truth = {
            let mut bound = predictors::monte_carlo(self.settings(), PATHS, self.team())?
                .bind(Arc::clone(&aimed.object))?;
            bound.update(&labels, Changed::Unknown, &control.silent())?;
            let mut radiance = vec![0.0; patches.points.len() * channels];
            let draw = Draw::new(self.settings().seed, Pass::Trial);
            bound.predict(&patches.points, draw, &mut radiance, &control.silent())?;
            patches.means(&radiance, channels)
        };
        let mut trials = Vec::new();
        for (i, (predictor, candidate)) in candidates.iter().enumerate() {
            control.report(i as u64, candidates.len() as u64);
            let mut bound = candidate.bind(Arc::clone(&aimed.object))?;
            let start = Instant::now();
            bound.update(&labels, Changed::Unknown, &control.silent())?;
            let draw = Draw::new(self.settings().seed, Pass::Loop(0));
            let (all, _) = predict_all(&*bound, &aimed.object, draw, &control.silent())?;
            let seconds = start.elapsed().as_secs_f64();
            let of_points: Vec<f32> = patches
                .points
                .iter()
                .flat_map(|&p| all[p as usize * channels..][..channels].iter().copied())
                .collect();
            let means = patches.means(&of_points, channels);
            let squares: f64 = means.iter().zip(&truth).map(|(a, b)| (a - b) * (a - b)).sum();
            let error = (squares / means.len().max(1) as f64).sqrt();
            trials.push(Trial { predictor: *predictor, seconds, error });
        }
        self.as_the_first(Choice::of(trials))
    }

    /// The choice of a team's first member: times differ from one to the next.
    fn as_the_first(&self, own: Choice) -> Result<Choice, PrintError> {
        let mut bytes = serde_json::json!(own).to_string().into_bytes();
        self.team().copy_first(&mut bytes);
        serde_json::from_slice(&bytes)
            .map_err(|e| PrintError::invalid("choice of the team", pellucid_core::json::plain(&e)))
    }

    /// The halftone that refinement starts from, and the share of the surface whose colour is out of reach.
    pub(crate) fn halftone(
        &self,
        aimed: &Aimed,
        control: &Control<'_>,
    ) -> Result<(LabelGrid, f64), PrintError> {
        let (settings, strategy) = (self.settings().refine.clone(), self.settings().surface_first.clone());
        let refinement = Refinement::new(aimed.problem(), strategy, settings, control)?;
        let labels = refinement.unrefined(&aimed.solid, &control.silent())?;
        Ok((labels, refinement.report().out_of_gamut))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_time_for_equal_error_wins() {
        let trial = |predictor, seconds, error| Trial { predictor, seconds, error };
        let (mc, rpnn) = (PredictorKind::MonteCarlo, PredictorKind::Rpnn);
        assert_eq!(Choice::of(vec![trial(mc, 4.0, 0.02), trial(rpnn, 1.0, 0.02)]).chosen, rpnn);
        assert_eq!(Choice::of(vec![trial(mc, 4.0, 0.02), trial(rpnn, 1.0, 0.05)]).chosen, mc);
        assert_eq!(Choice::of(vec![trial(mc, 4.0, 0.02)]).chosen, mc);
        let none = Choice::without_network("pitch: 0.1 mm");
        assert!(none.chosen == mc && none.reason.contains("does not fit: pitch"), "{}", none.reason);
    }
}
