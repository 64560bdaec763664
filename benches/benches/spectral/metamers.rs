//! What mixtures allow: equal colours under D65 by little black and by much, and how constant each is.

use pellucid::color::constancy;
use pellucid::color::mixture::MixtureModel;
use pellucid::color::mixture::inverse::{Inverse, MatchOptions};
use pellucid::color::space::Lab;
use pellucid::color::spectrum::Illuminant;

use super::{Error, table};

/// Farthest, in CIEDE2000, from a wanted colour that a mixture still counts as giving it.
const EQUAL: f64 = 0.5;
/// Costs of black over that of the other inks, from "as much as can be" to "none that can be spared".
const COSTS: [f64; 9] = [1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1e3, 1e4];
/// Hues of a ring of colours.
const HUES: u32 = 12;

/// Colours of one chroma: means over those that the inks give.
pub struct Ring {
    pub chroma: f64,
    pub colours: usize,
    /// Mean share of black with the least of it, by default, with the most.
    pub black: [f64; 3],
    /// Mean inconstancy from D65 to A of the same three.
    pub inconstancy: [f64; 3],
    /// Mean of the least inconstancy that any equal mixture has.
    pub least: f64,
}

/// One way of giving a colour.
#[derive(Clone, Copy)]
struct Way {
    black: f64,
    inconstancy: f64,
}

/// Thick blocks of homogeneous mixtures: greys, and rings of hues about them, of lightness 20 to 90.
pub fn rings() -> Result<Vec<Ring>, Error> {
    let table = table("cmykw-spectral.json")?;
    let [day, lamp] =
        [Illuminant::D65, Illuminant::A].map(|light| MixtureModel::under(&table, "white", 1.5, light));
    let (model, lamp) = (day?, lamp?.viewing());
    let day = model.viewing();
    let black = model.names().iter().position(|name| name == "black").ok_or("no black among the inks")?;
    let inverse = |black_cost| Inverse::new(&model, MatchOptions { black_cost, ..MatchOptions::default() });
    let (default, others) = (inverse(MatchOptions::default().black_cost), COSTS.map(inverse));
    let way = |inverse: &Inverse<'_>, rgb: [f64; 3]| {
        let found = inverse.find(rgb);
        let mut radiance = vec![0.0; table.channels()];
        model.radiance(&found.fractions, &mut radiance);
        let radiance: Vec<f32> = radiance.iter().map(|&v| v as f32).collect();
        let inconstancy = constancy::inconstancy(&day, &lamp, &radiance);
        (found.delta_e <= EQUAL).then(|| Way { black: f64::from(found.fractions[black]), inconstancy })
    };
    let mut found = Vec::new();
    for chroma in [0.0, 10.0, 20.0, 40.0] {
        let mut ways: Vec<(Way, Vec<Way>)> = Vec::new();
        for hue in 0..if chroma == 0.0 { 1 } else { HUES } {
            for l in (20..=90).step_by(5) {
                let angle = f64::from(hue) / f64::from(HUES) * std::f64::consts::TAU;
                let lab = Lab { l: f64::from(l), a: chroma * angle.cos(), b: chroma * angle.sin() };
                let rgb = lab.to_linear_rgb();
                let Some(own) = way(&default, rgb) else { continue };
                ways.push((own, others.iter().filter_map(|inverse| way(inverse, rgb)).collect()));
            }
        }
        found.push(Ring::of(chroma, &ways));
    }
    Ok(found)
}

impl Ring {
    /// Of colours' default ways, and all others.
    fn of(chroma: f64, ways: &[(Way, Vec<Way>)]) -> Self {
        let mean = |of: &dyn Fn(Way, &[Way]) -> f64| {
            ways.iter().map(|(own, others)| of(*own, others)).sum::<f64>() / ways.len().max(1) as f64
        };
        let least =
            |own: Way, others: &[Way]| others.iter().fold(own, |a, &b| if b.black < a.black { b } else { a });
        let most =
            |own: Way, others: &[Way]| others.iter().fold(own, |a, &b| if b.black > a.black { b } else { a });
        Self {
            chroma,
            colours: ways.len(),
            black: [
                mean(&|own, others| least(own, others).black),
                mean(&|own, _| own.black),
                mean(&|own, others| most(own, others).black),
            ],
            inconstancy: [
                mean(&|own, others| least(own, others).inconstancy),
                mean(&|own, _| own.inconstancy),
                mean(&|own, others| most(own, others).inconstancy),
            ],
            least: mean(&|own, others| {
                others.iter().fold(own.inconstancy, |low, way| low.min(way.inconstancy))
            }),
        }
    }
}
