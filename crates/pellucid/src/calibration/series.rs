//! Which layers a chart has, in mm: chosen so that one reading each at 1 % tells what matters of a resin to 5 %.

use pellucid_color::ColorError;
use pellucid_color::calibration::{Patch, Stack, StackLayer};

use super::ChartSettings;

/// The white layer that inks lie in and on, over black. So thin that light which entered through a neighbouring patch
/// does not come out again in the middle of one; thick white would let it come from 5 mm away.
pub(super) const BED_MM: f64 = 0.81;
/// White as deep as what makes its absorption show.
pub(super) const DEEP_MM: f64 = 5.994;
/// Black below everything.
const BASE_MM: f64 = 1.35;

const WHITE_OVER_BLACK_MM: [f64; 4] = [0.108, 0.243, 0.486, BED_MM];
const BLACK_OVER_WHITE_MM: [f64; 4] = [0.027, 0.054, 0.108, 0.216];
const INK_OVER_WHITE_MM: [f64; 4] = [0.054, 0.135, 0.27, 0.54];
const INK_OVER_BLACK_MM: [f64; 3] = [0.135, 0.27, 0.81];
const MIXTURE_MM: f64 = 0.54;
/// Readings of the deep white, and patches of bare black: their noise is what limits the fit.
pub(super) const DEEP_READINGS: usize = 9;
const BLACK_PATCHES: usize = 4;

/// Lengths in whole layers of a printer.
pub(super) struct Layers {
    layer_mm: f64,
}

impl Layers {
    pub fn new(layer_mm: f64) -> Self {
        Self { layer_mm }
    }

    /// Layers nearest to a length, at least one.
    pub fn count(&self, mm: f64) -> u32 {
        (mm / self.layer_mm).round().max(1.0) as u32
    }

    /// The length of so many layers, without the last binary digits.
    pub fn mm(&self, count: u32) -> f64 {
        (f64::from(count) * self.layer_mm * 1e6).round() / 1e6
    }

    /// Layers of the whole chart.
    pub fn total(&self) -> u32 {
        self.count(DEEP_MM) + self.count(BASE_MM)
    }

    fn over_black(&self, parts: Vec<(String, f64)>, mm: f64, black: &str) -> Result<Stack, ColorError> {
        Stack::new(vec![
            StackLayer::new(parts, self.mm(self.count(mm)))?,
            StackLayer::pure(black, f64::INFINITY)?,
        ])
    }

    /// A layer sunk into the white bed.
    fn over_bed(
        &self,
        parts: Vec<(String, f64)>,
        mm: f64,
        settings: &ChartSettings,
    ) -> Result<Stack, ColorError> {
        let (bed, own) = (self.count(BED_MM), self.count(mm));
        if own >= bed {
            return self.over_black(parts, mm, &settings.black);
        }
        Stack::new(vec![
            StackLayer::new(parts, self.mm(own))?,
            StackLayer::pure(&settings.white, self.mm(bed - own))?,
            StackLayer::pure(&settings.black, f64::INFINITY)?,
        ])
    }
}

/// The deep white's stack.
pub(super) fn deep(layers: &Layers, settings: &ChartSettings) -> Result<Stack, ColorError> {
    layers.over_black(vec![(settings.white.clone(), 1.0)], DEEP_MM, &settings.black)
}

/// All other patches, in the order in which they stand on the chart, without names: white, black and every ink, then
/// mixtures that check.
pub(super) fn patches(layers: &Layers, settings: &ChartSettings) -> Result<Vec<Patch>, ColorError> {
    let pure = |name: &str| vec![(name.to_owned(), 1.0)];
    let (white, black) = (settings.white.as_str(), settings.black.as_str());
    let mut stacks = Vec::new();
    for mm in WHITE_OVER_BLACK_MM {
        stacks.push(layers.over_black(pure(white), mm, black)?);
    }
    for mm in BLACK_OVER_WHITE_MM {
        stacks.push(layers.over_bed(pure(black), mm, settings)?);
    }
    for ink in &settings.inks {
        stacks.push(Stack::new(vec![StackLayer::pure(black, f64::INFINITY)?])?);
        for mm in INK_OVER_WHITE_MM {
            stacks.push(layers.over_bed(pure(ink), mm, settings)?);
        }
        for mm in INK_OVER_BLACK_MM {
            stacks.push(layers.over_black(pure(ink), mm, black)?);
        }
    }
    for _ in settings.inks.len()..BLACK_PATCHES {
        stacks.push(Stack::new(vec![StackLayer::pure(black, f64::INFINITY)?])?);
    }
    let mut patches: Vec<Patch> =
        stacks.into_iter().map(|stack| Patch { id: String::new(), stack, check: false }).collect();
    for parts in mixtures(settings) {
        let stack = layers.over_bed(parts, MIXTURE_MM, settings)?;
        patches.push(Patch { id: String::new(), stack, check: true });
    }
    Ok(patches)
}

/// Tints of every ink, pairs of inks, and greys.
fn mixtures(settings: &ChartSettings) -> Vec<Vec<(String, f64)>> {
    let inks = &settings.inks;
    let mut mixtures = Vec::new();
    let mut add = |parts: Vec<(&String, f64)>| {
        let rest = 1.0 - parts.iter().map(|(_, share)| share).sum::<f64>();
        let mut parts: Vec<(String, f64)> =
            parts.into_iter().map(|(name, share)| (name.clone(), share)).collect();
        if rest > 1e-9 {
            parts.push((settings.white.clone(), rest));
        }
        mixtures.push(parts);
    };
    for ink in inks {
        add(vec![(ink, 0.15)]);
    }
    for (i, a) in inks.iter().enumerate() {
        for b in &inks[i + 1..] {
            add(vec![(a, 0.5), (b, 0.5)]);
        }
    }
    add(vec![(&settings.black, 0.05)]);
    if let [a, b, c, ..] = inks.as_slice() {
        add(vec![(a, 0.1), (b, 0.1), (c, 0.1)]);
        add(vec![(a, 0.3), (b, 0.3), (c, 0.3), (&settings.black, 0.1)]);
    }
    mixtures
}
