//! Halftones compared: the blue-noise mask that refinements use, and three kinds of error diffusion.
//!
//! `cargo bench -p pellucid-benches --bench halftone`: small, in minutes; `-- --full` for `docs/results/halftone`.

mod grain;
mod methods;
mod plate;
mod report;

use clap::Parser;
use grain::Look;
use methods::{Method, ORDER};
use pellucid::color::Viewing;
use pellucid::color::mixture::MixtureModel;
use pellucid::color::mixture::inverse::{Inverse, MatchOptions};
use pellucid::color::space::srgb_decode;
use pellucid::color::spectrum::Illuminant;
use pellucid::voxel::{Control, LabelGrid, Material, MaterialTable};
use pellucid_benches::appearance::Error;
use pellucid_benches::study::stopwatch::time;
use pellucid_benches::study::{Record, Study, StudySettings};
use plate::Plate;

const INDEX: f64 = 1.5;
/// Of the mixture's inks, how much more each is when the flips of a small change are counted.
const CHANGE: f32 = 1.02;
/// Colours in sRGB.
const COLORS: [(&str, [u8; 3]); 6] = [
    ("light grey", [205, 205, 205]),
    ("grey", [119, 119, 119]),
    ("skin", [225, 180, 155]),
    ("sky", [150, 190, 225]),
    ("leaf", [95, 140, 65]),
    ("dark red", [140, 40, 45]),
];

/// Halftones compared
#[derive(Parser)]
struct Args {
    #[command(flatten)]
    study: StudySettings,
}

/// A method on a plate in one colour.
pub struct Row {
    /// Direction of the plate.
    pub plate: &'static str,
    /// The mixture's colour.
    pub color: &'static str,
    /// How it was halftoned.
    pub method: &'static str,
    /// At each of [`grain::VIEWED_MM`].
    pub grain: [f64; 3],
    /// CIEDE2000 of the mean colour to the mixture's.
    pub shift: f64,
    /// Voxels that a small change of the mixture changes, over the fewest that could.
    pub flips: f64,
    /// Voxels of the skin in a second.
    pub rate: f64,
}

fn main() -> Result<(), Error> {
    let args = Args::parse();
    let control = Control::none();
    let full = args.study.full;
    let paths = if full { 128 } else { 48 };
    let mut record = Record::now("halftone", rayon::current_num_threads());
    record.add("paths", format!("two sets of {paths} a point and channel"));
    record.add("printer", "42.3 x 84.7 x 27 micrometres");
    let study = Study::new("halftone", env!("CARGO_TARGET_TMPDIR"), &args.study, record)?;
    let materials = MaterialTable::cmykw();
    let model = MixtureModel::new(&materials, "white", INDEX)?;
    let inverse = Inverse::new(&model, MatchOptions::default());
    let viewing = Viewing::of_print(&materials, "white", INDEX, Illuminant::D65)?;
    let methods = methods::all(&control)?;
    let plates = Plate::all()?;
    let (plates, colors) = if full { (&plates[..], &COLORS[..]) } else { (&plates[..2], &COLORS[1..3]) };
    let mut rows = Vec::new();
    let mut looks: Vec<Vec<Look>> = methods.iter().map(|_| Vec::new()).collect();
    for plate in plates {
        for &(color, srgb) in colors {
            let found = inverse.find(srgb.map(|code| srgb_decode(f64::from(code) / 255.0)));
            let mixture = ORDER.map(|label| found.fractions[usize::from(label) - 1]);
            let table = with_mixture(&materials, &found.fractions)?;
            let even = plate.labels(|_| table.len() as u8);
            let even = grain::look(plate, &even, &table, &viewing, paths, &control)?;
            for ((method, how), looks) in methods.iter().zip(&mut looks) {
                let (labels, seconds) = time(|| how.labels(plate, &mixture, &control))?;
                let look = grain::look(plate, &labels, &materials, &viewing, paths, &control)?;
                rows.push(Row {
                    plate: plate.name,
                    color,
                    method,
                    grain: look.grain(&even),
                    shift: look.shift(&even),
                    flips: flips(how, plate, &mixture, &labels, &control)?,
                    rate: plate.skin_voxels() as f64 / seconds,
                });
                println!("{}", report::cells(&rows[rows.len() - 1]).join(", "));
                if color == "grey" || color == "skin" {
                    looks.push(look);
                }
            }
        }
    }
    report::pictures(study.folder(), &looks, &control)?;
    study.write("Halftones", &report::markdown(&rows), &report::table(&rows), &report::plot(&rows))?;
    Ok(())
}

/// The materials, and one more that is their homogeneous mixture.
fn with_mixture(materials: &MaterialTable, fractions: &[f32]) -> Result<MaterialTable, Error> {
    let all = materials.materials();
    let mean = |of: &dyn Fn(&Material) -> f32| all.iter().zip(fractions).map(|(m, f)| f * of(m)).sum::<f32>();
    let channels = 0..materials.channels();
    let mixture = Material {
        name: "mixture".into(),
        sigma_s: channels.clone().map(|c| mean(&|m| m.sigma_s[c])).collect(),
        sigma_a: channels.map(|c| mean(&|m| m.sigma_a[c])).collect(),
        // All of these have one mean cosine.
        g: all[0].g.clone(),
    };
    let all = all.iter().cloned().chain([mixture]).collect();
    Ok(MaterialTable::over(materials.spectrum().clone(), all)?)
}

/// Share of the skin that changes with a little more of each ink, over the change of the mixture.
fn flips(
    method: &Method,
    plate: &Plate,
    mixture: &[f32; 5],
    labels: &LabelGrid,
    control: &Control<'_>,
) -> Result<f64, Error> {
    let mut more = mixture.map(|share| share * CHANGE);
    let inks: f32 = more[..4].iter().sum();
    more[4] = (1.0 - inks).max(0.0);
    let total: f32 = more.iter().sum();
    more.iter_mut().for_each(|share| *share /= total);
    let least: f32 = 0.5 * mixture.iter().zip(&more).map(|(a, b)| (a - b).abs()).sum::<f32>();
    let changed = method.labels(plate, &more, control)?;
    let [sx, sy, sz] = plate.frame.size();
    let all = (0..sz).flat_map(|z| (0..sy).flat_map(move |y| (0..sx).map(move |x| [x, y, z])));
    let flipped = all.filter(|&voxel| labels.get(voxel) != changed.get(voxel)).count();
    Ok(flipped as f64 / (f64::from(least) * plate.skin_voxels() as f64).max(1.0))
}
