//! What neighbours share, points that did not change, channels that repeat.

use std::sync::Arc;

use pellucid::predict::{
    BoundPredictor, Changed, Draw, MonteCarlo, Network, Object, Pass, Predictor, Sharing, predict_all,
};
use pellucid::voxel::Control;
use pellucid_benches::appearance::Error;
use pellucid_benches::study::stopwatch::seconds;

use super::scene::Scene;
use super::{Saving, greatest};

const DRAW: Draw = Draw::new(0, Pass::Loop(0));
/// Points that the network is run for one by one.
const POINTS: usize = 2000;

pub fn savings(scene: &Scene, control: &Control<'_>) -> Result<Vec<Saving>, Error> {
    let network = Network::shipped()?;
    Ok(vec![
        shared(scene, &network, control)?,
        coarse_levels(scene, &network, control)?,
        unchanged(scene, &network, control)?,
        repeated(scene, &network, "channels that repeat, the network", control)?,
        repeated(scene, &MonteCarlo::new(4)?, "channels that repeat, paths", control)?,
    ])
}

fn bound(object: &Arc<Object>, predictor: &dyn Predictor) -> Result<Box<dyn BoundPredictor>, Error> {
    Ok(predictor.bind(Arc::clone(object))?)
}

/// One evaluation for many points.
fn shared(scene: &Scene, network: &Network, control: &Control<'_>) -> Result<Saving, Error> {
    let some = &scene.near[..scene.near.len().min(POINTS)];
    let channels = scene.object.channels();
    let mut alone = bound(&scene.object, &network.clone().with_sharing(None)?)?;
    alone.update(&scene.labels, Changed::Unknown, control)?;
    let mut each = vec![0.0; some.len() * channels];
    let start = seconds();
    alone.predict(some, DRAW, &mut each, control)?;
    let without = seconds() - start;
    let mut sharing = bound(&scene.object, network)?;
    sharing.update(&scene.labels, Changed::Unknown, control)?;
    let start = seconds();
    let (all, _) = predict_all(&*sharing, &scene.object, DRAW, control)?;
    let with = seconds() - start;
    let own = some.iter().flat_map(|&p| &all[p as usize * channels..][..channels]);
    let squares: f64 = own.zip(&each).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    Ok(Saving {
        what: "the network at points whose neighbours know".into(),
        object: scene.name(),
        unit: "us a point and channel".into(),
        without: 1e6 * without / each.len() as f64,
        with: 1e6 * with / all.len() as f64,
        changes: format!("radiance by {:.4} (root mean square)", (squares / each.len() as f64).sqrt()),
    })
}

/// Coarse levels read for points farther apart, with the network run for as few points either way.
fn coarse_levels(scene: &Scene, network: &Network, control: &Control<'_>) -> Result<Saving, Error> {
    let mut results = Vec::new();
    for sharing in [Sharing { fine_levels: 9, ..Sharing::default() }, Sharing::default()] {
        let mut bound = bound(&scene.object, &network.clone().with_sharing(Some(sharing))?)?;
        bound.update(&scene.labels, Changed::Unknown, control)?;
        let start = seconds();
        let (all, _) = predict_all(&*bound, &scene.object, DRAW, control)?;
        results.push((seconds() - start, all));
    }
    let (each, all) = (&results[0].1, &results[1].1);
    let squares: f64 = each.iter().zip(all).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    Ok(Saving {
        what: "coarse levels of the network at points whose neighbours have read them".into(),
        object: scene.name(),
        unit: "s a prediction".into(),
        without: results[0].0,
        with: results[1].0,
        changes: format!("radiance by {:.4} (root mean square)", (squares / each.len() as f64).sqrt()),
    })
}

/// Points that see no changed tile.
fn unchanged(scene: &Scene, network: &Network, control: &Control<'_>) -> Result<Saving, Error> {
    let mut results = Vec::new();
    for changed in [Changed::Unknown, Changed::Tiles(&scene.changed)] {
        let mut bound = bound(&scene.object, network)?;
        bound.update(&scene.labels, Changed::Unknown, control)?;
        predict_all(&*bound, &scene.object, DRAW, control)?;
        let start = seconds();
        bound.update(&scene.moved, changed, control)?;
        let (all, _) = predict_all(&*bound, &scene.object, DRAW, control)?;
        results.push((seconds() - start, all));
    }
    Ok(Saving {
        what: "the network at points that see no changed tile".into(),
        object: format!("{}, every hundredth mixed tile changed", scene.name()),
        unit: "s a prediction".into(),
        without: results[0].0,
        with: results[1].0,
        changes: greatest(&results[0].1, &results[1].1),
    })
}

/// Three equal channels against what three times one would take.
fn repeated(
    scene: &Scene,
    predictor: &dyn Predictor,
    what: &str,
    control: &Control<'_>,
) -> Result<Saving, Error> {
    let mut results = Vec::new();
    for channels in [1, 3] {
        let table = Scene::gray(channels)?;
        let surface = scene.object.surface().clone();
        let object = Arc::new(Object::new(surface, table, scene.object.refractive_index())?);
        let mut bound = bound(&object, predictor)?;
        bound.update(&scene.labels, Changed::Unknown, control)?;
        let start = seconds();
        let (all, _) = predict_all(&*bound, &object, DRAW, control)?;
        results.push((seconds() - start, all));
    }
    let thrice: Vec<f32> = results[0].1.iter().flat_map(|&l| [l; 3]).collect();
    Ok(Saving {
        what: what.to_owned(),
        object: format!("{}, inks of three equal channels", scene.name()),
        unit: "s a prediction".into(),
        without: 3.0 * results[0].0,
        with: results[1].0,
        changes: greatest(&thrice, &results[1].1),
    })
}
