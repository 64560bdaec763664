//! Seconds of one prediction of a whole model: the paper's Table 1 for the counterparts of its objects.

use pellucid::predict::{
    Changed, Corrected, Correction, Draw, MonteCarlo, Network, Pass, Predictor, predict_all,
};
use pellucid::voxel::{Control, near_order};
use pellucid_benches::appearance::Error;
use pellucid_benches::prints::unrefined;
use pellucid_benches::study::stopwatch::{seconds, time};
use serde::{Deserialize, Serialize};

/// Paths a point and channel that the network is compared with, as in the paper.
const PATHS: u32 = 512;
/// Spread points on which those are timed.
const TRACED: usize = 400;
const DRAW: Draw = Draw::new(3, Pass::Loop(0));

/// One model.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Line {
    /// Its name.
    pub model: String,
    /// Surface points.
    pub points: usize,
    /// Processor seconds of all points by the network, by the corrected network, and by [`PATHS`] paths.
    pub seconds: [f64; 3],
}

/// The models, and heights other than their own.
pub fn models(full: bool) -> Vec<(&'static str, Option<f64>)> {
    match full {
        true => ["showcase", "wedge", "bone", "octostar", "plane", "vase-handle", "vase-hollow", "tubes"]
            .map(|model| (model, None))
            .to_vec(),
        false => vec![("octostar", Some(6.0))],
    }
}

/// Times the predictions of a model's halftone before refinement.
pub fn measure(model: &str, height_mm: Option<f64>, control: &Control<'_>) -> Result<Line, Error> {
    println!("table one: {model}");
    let (aimed, labels) = unrefined(model, height_mm, control)?;
    let object = &aimed.object;
    let whole = |predictor: &dyn Predictor| -> Result<f64, Error> {
        let mut bound = predictor.bind(object.clone())?;
        bound.update(&labels, Changed::Unknown, control)?;
        let start = seconds();
        bound.update(&labels, Changed::Tiles(&[]), control)?;
        predict_all(&*bound, object, DRAW, control)?;
        Ok(seconds() - start)
    };
    let network = Network::shipped()?;
    let corrected = Corrected::new(network.clone(), MonteCarlo::new(8)?, Correction::default())?;
    let (network, corrected) = (whole(&network)?, whole(&corrected)?);

    let mut bound = MonteCarlo::new(PATHS)?.bind(object.clone())?;
    bound.update(&labels, Changed::Unknown, control)?;
    let order = near_order(object.surface().voxels());
    let some: Vec<u32> = order.iter().copied().step_by((order.len() / TRACED).max(1)).collect();
    let mut out = vec![0.0; some.len() * object.channels()];
    let (_, spent) = time(|| bound.predict(&some, DRAW, &mut out, control))?;
    let paths = spent * order.len() as f64 / some.len() as f64;
    Ok(Line { model: model.into(), points: order.len(), seconds: [network, corrected, paths] })
}
