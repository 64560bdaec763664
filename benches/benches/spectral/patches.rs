//! Spectra of six patches of a print, as predicted and as many paths have them (Rittig et al. 2021, Figure 13).

use pellucid::color::space::{Lab, Lch};
use pellucid::color::{Viewing, delta_e_2000};
use pellucid::job::Aimed;
use pellucid::predict::{BoundPredictor, Changed, Draw, MonteCarlo, Network, Pass, Predictor};
use pellucid::refine::SurfaceSmoother;
use pellucid::voxel::Control;

use super::prediction::viewings;
use super::{Error, Subject, halftone, table};

/// Radius of a patch in mm, and deviation of the Gaussian that targets are smoothed by to find one of an even colour.
const RADIUS_MM: f64 = 0.15;
/// Paths a point and band of the comparison.
const PATHS: u32 = 512;

/// Mean spectra of a patch.
pub struct Patch {
    pub name: &'static str,
    pub points: usize,
    /// Wavelengths in nm, and mean radiances by many paths and by the network.
    pub nm: Vec<f64>,
    pub paths: Vec<f64>,
    pub network: Vec<f64>,
    /// CIEDE2000 between both under each of the study's lights.
    pub delta_e: Vec<f64>,
}

/// What makes a colour the one that a patch is taken about.
type Merit = fn(Lch) -> f64;

/// Degrees between a hue and another.
fn off(hue: f64, wanted: f64) -> f64 {
    ((hue - wanted + 180.0).rem_euclid(360.0) - 180.0).abs()
}

const WANTED: [(&str, Merit); 6] = [
    ("lightest", |c| c.l),
    ("darkest", |c| -c.l),
    ("red", |c| c.c - off(c.h, 35.0)),
    ("yellow", |c| c.c - off(c.h, 90.0)),
    ("green", |c| c.c - off(c.h, 150.0)),
    ("blue", |c| c.c - off(c.h, 280.0)),
];

/// The patches of a model's unrefined halftone in 31 bands.
pub fn patches(subject: &Subject) -> Result<Vec<Patch>, Error> {
    let control = Control::none();
    let (labels, aimed) = halftone(subject, table("cmykw-spectral.json")?)?;
    let object = &aimed.object;
    let channels = object.channels();
    let viewings = viewings(object, channels)?;
    let nm: Vec<f64> = object
        .materials()
        .channel_names()
        .iter()
        .filter_map(|name| name.strip_suffix(" nm").and_then(|n| n.parse().ok()))
        .collect();
    let smoother = SurfaceSmoother::new(object.surface(), RADIUS_MM, &control)?;
    let smooth = smoother.smooth(aimed.printable_target.clone(), &control)?;
    let bound = |predictor: &dyn Predictor| -> Result<Box<dyn BoundPredictor>, Error> {
        let mut bound = predictor.bind(object.clone())?;
        bound.update(&labels, Changed::Unknown, &control)?;
        Ok(bound)
    };
    let (by_paths, by_network) = (bound(&MonteCarlo::new(PATHS)?)?, bound(&Network::shipped()?)?);
    let mut found = Vec::new();
    for (name, merit) in WANTED {
        let points = about(&aimed, &smooth, merit);
        let mean = |bound: &dyn BoundPredictor| -> Result<Vec<f64>, Error> {
            let mut out = vec![0.0; points.len() * channels];
            bound.predict(&points, Draw::new(11, Pass::Trial), &mut out, &control)?;
            let sum = |c: usize| out[c..].iter().step_by(channels).map(|&v| f64::from(v)).sum::<f64>();
            Ok((0..channels).map(|c| sum(c) / points.len() as f64).collect())
        };
        let (paths, network) = (mean(&*by_paths)?, mean(&*by_network)?);
        let lab = |viewing: &Viewing, spectrum: &[f64]| {
            let radiance: Vec<f32> = spectrum.iter().map(|&v| v as f32).collect();
            Lab::from_linear_rgb(viewing.relative_rgb(&radiance).map(f64::from))
        };
        let delta_e = viewings.iter().map(|v| delta_e_2000(lab(v, &paths), lab(v, &network))).collect();
        found.push(Patch { name, points: points.len(), nm: nm.clone(), paths, network, delta_e });
    }
    Ok(found)
}

/// Surface voxels about the one whose smoothed target has the most merit.
fn about(aimed: &Aimed, targets: &[[f32; 3]], merit: Merit) -> Vec<u32> {
    let surface = aimed.object.surface();
    let value = |rgb: &[f32; 3]| merit(Lab::from_linear_rgb(rgb.map(f64::from)).to_lch());
    let best = (0..targets.len()).max_by(|&a, &b| value(&targets[a]).total_cmp(&value(&targets[b])));
    let middle = surface.position_mm(best.unwrap_or(0) as u32);
    let near = |point: &u32| {
        let at = surface.position_mm(*point);
        (0..3).map(|a| (at[a] - middle[a]).powi(2)).sum::<f64>() <= RADIUS_MM * RADIUS_MM
    };
    (0..surface.len() as u32).filter(near).collect()
}
