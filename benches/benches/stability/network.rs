//! The shipped network where it was not trained: how wrong it is, and whether it says so.

use std::sync::Arc;

use pellucid::predict::{Changed, Draw, MonteCarlo, Network, Object, Pass, Predictor};
use pellucid::voxel::{Control, Pitch, Surface, SurfaceOptions};

use super::Error;
use super::case::Case;
use super::scene::{Row, Solid, index};
use super::tracer::WHITE;

pub const PART: &str = "network";

/// Surface voxels compared.
const POINTS: usize = 40;
const PATHS: u32 = 2048;

fn case(name: &str, measured: &'static str, found: f64, bound: Option<f64>) -> Case {
    Case { part: PART, name: name.to_owned(), measured, found, bound }
}

/// Errors against paths, the values' range, and the share of values that are reported as outside training.
pub fn cases(control: &Control<'_>) -> Result<Vec<Case>, Error> {
    let times = |factor: f64| (WHITE.0 * factor, WHITE.1 * factor, WHITE.2);
    let rows: [(&str, Row); 10] = [
        ("white", WHITE),
        ("white, 10 times as dense", times(10.0)),
        ("white, 1000 times as dense", times(1000.0)),
        ("white, a tenth as dense", times(0.1)),
        ("white, a thousandth as dense", times(1e-3)),
        ("clear", (0.0, 0.0, 0.4)),
        ("albedo exactly 0", (0.0, 50.0, 0.4)),
        ("albedo exactly 1", (9.0, 0.0, 0.4)),
        ("g = 0.95", (9.0, 0.05, 0.95)),
        ("extinction 1e5 per mm", (5e4, 5e4, 0.4)),
    ];
    let mut found = Vec::new();
    for (name, row) in rows {
        let [rmse, beyond, outside] = compare(row, control)?;
        found.push(case(name, "RMSE against paths", rmse, None));
        found.push(case(name, "beyond 0 to 1", beyond, Some(0.05)));
        found.push(case(name, "share of values said to be outside training", outside, None));
    }
    Ok(found)
}

/// RMSE, how far values leave 0 to 1, and the share that is said to be outside training.
fn compare(row: Row, control: &Control<'_>) -> Result<[f64; 3], Error> {
    // The network knows no other pitch, and says so.
    let solid =
        Solid { pitch_mm: Pitch::j750().mm(), voxels: [48, 24, 74], ..Solid::of([2.0; 3], row, index(1.5)?) };
    let labels = solid.grid()?;
    let surface = Surface::extract(&labels, &SurfaceOptions::default(), control)?;
    let object = Arc::new(Object::new(surface, solid.materials()?, 1.5)?);
    let step = (object.surface().len() / POINTS).max(1);
    let points: Vec<u32> = object.points().into_iter().step_by(step).collect();
    let predicted = |predictor: &dyn Predictor| -> Result<(Vec<f32>, u64), Error> {
        let mut bound = predictor.bind(object.clone())?;
        bound.update(&labels, Changed::Unknown, control)?;
        let mut out = vec![0.0; points.len()];
        let seen = bound.predict(&points, Draw::new(0, Pass::Loop(0)), &mut out, control)?;
        Ok((out, seen.outside_training))
    };
    let (network, outside) = predicted(&Network::shipped()?)?;
    let (paths, _) = predicted(&MonteCarlo::new(PATHS)?)?;
    let squares = network.iter().zip(&paths).map(|(a, b)| f64::from(a - b).powi(2));
    let rmse = (squares.sum::<f64>() / points.len() as f64).sqrt();
    let beyond = |v: &f32| {
        if v.is_finite() { f64::from(*v - 1.0).max(-f64::from(*v)).max(0.0) } else { f64::INFINITY }
    };
    Ok([rmse, network.iter().map(beyond).fold(0.0, f64::max), outside as f64 / points.len() as f64])
}
