//! The counterparts of the paper's objects: unrefined prints, predicted once.

use pellucid::voxel::Control;
use pellucid_benches::prints::unrefined;

use super::Error;
use super::finished::Finished;
use super::object::Case;
use super::scores::{Labels, Row};

/// The models, in the order of the report.
const MODELS: [&str; 8] =
    ["showcase", "wedge", "bone", "octostar", "plane", "vase-handle", "vase-hollow", "tubes"];
/// The model of small studies, and its height.
const SMALL: (&str, f64) = ("octostar", 12.0);
/// Surface points of a model that are judged, and of a small study's.
const POINTS: [usize; 2] = [600, 150];
/// Standard error of their references.
const STD_ERROR: [f32; 2] = [0.003, 0.01];

/// The models to judge, and heights other than their own.
pub fn chosen(full: bool) -> Vec<(&'static str, Option<f64>)> {
    match full {
        true => MODELS.map(|name| (name, None)).to_vec(),
        false => vec![(SMALL.0, Some(SMALL.1))],
    }
}

/// A model as `prepare` halftones it before the first correction, for the default printer and inks.
pub fn case(name: &str, height_mm: Option<f64>, control: &Control<'_>) -> Result<Case, Error> {
    println!("placing {name}");
    let (aimed, labels) = unrefined(name, height_mm, control)?;
    Ok(Case { name: name.to_owned(), object: aimed.object, labels, viewing: aimed.viewing })
}

/// A row for every network.
pub fn judge(
    case: &Case,
    networks: &[&Finished],
    full: bool,
    control: &Control<'_>,
) -> Result<Vec<Row>, Error> {
    let size = usize::from(!full);
    let all = case.object.surface().len();
    let wanted = POINTS[size].min(all);
    // Every n-th surface voxel: an even sample of the surface.
    let points: Vec<u32> = (0..wanted).map(|i| (i * all / wanted) as u32).collect();
    let (radiance, std_error) = case.reference(&points, STD_ERROR[size], control)?;
    let labels = Labels { radiance: &radiance, std_error: &std_error, viewing: &case.viewing };
    networks
        .iter()
        .map(|network| {
            let predicted = case.predicted(network, &points, control)?;
            Ok(Row::of(&case.name, "", network, &predicted, &labels))
        })
        .collect()
}
