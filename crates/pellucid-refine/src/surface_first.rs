//! The heuristic of Sumin et al. 2019: corrections surface-first, overflow deeper.

use pellucid_core::{Cancelled, Control};
use pellucid_halftone::Thresholds;
use serde::{Deserialize, Serialize};

use crate::problem::MAX_LABELS;
use crate::residual::{self, decode, encode};
use crate::settings::check_ranges;
use crate::{InkModel, LayerMixtures, Moved, Planned, RefineError, Seen, Setup, Strategy, SurfaceSmoother};

/// Ink coverage up to which highlight layers stay white, and from which they take all ink.
const HIGHLIGHT_COVER: [f32; 2] = [0.2, 0.6];

/// Geometry-aware scattering compensation as far as published (Sumin et al., ACM TOG 38(4), 2019; Rittig et al. 2021,
/// section 2.3). The state is one accumulated residual a surface voxel. Spent surface-first, it asks the top layer for
/// the printable target plus the residual; what the gamut refuses moves one layer deeper. Iteration 0 is the printable
/// target extruded through the coloured depth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SurfaceFirst {
    /// Share of the shortfall added to the residual in the first step, above 0 and at most 4.
    pub gain: f32,
    /// Step i takes `gain / (1 + gain_decay i)`; 0 to 100.
    pub gain_decay: f32,
    /// Depth in mm, 0 to 100, to which the target's own mixture reaches once refined; below is white.
    pub base_mm: f64,
    /// Depth in mm, 0 to 10, of the highlight layers: there, refined halftones keep sparse ink out of white.
    pub veil_mm: f64,
}

impl Default for SurfaceFirst {
    fn default() -> Self {
        Self { gain: 2.0, gain_decay: 0.1, base_mm: 0.4, veil_mm: 0.2 }
    }
}

/// Accumulated residuals.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SurfaceFirstState {
    /// Steps taken; at 0 the whole depth is the target's mixture.
    pub step: u32,
    /// One value a surface voxel, in cube roots of linear RGB.
    #[serde(with = "crate::packed")]
    pub residual: Vec<[f32; 3]>,
}

/// How deep demand spreads at a step.
struct Spread {
    /// Uppermost layers whose base is the target's mixture; that of deeper ones is white.
    base_layers: usize,
    /// Uppermost layers that keep sparse ink out.
    highlight_layers: usize,
}

impl Strategy for SurfaceFirst {
    type State = SurfaceFirstState;
    type Tools = ();
    type Step = SurfaceFirstState;

    fn name(&self) -> &str {
        "surface_first"
    }

    fn settings(&self) -> Vec<(&'static str, f64)> {
        let [gain, decay] = [self.gain, self.gain_decay].map(f64::from);
        vec![("gain", gain), ("gain_decay", decay), ("base_mm", self.base_mm), ("veil_mm", self.veil_mm)]
    }

    fn iterations(&self) -> u32 {
        10
    }

    fn check(&self) -> Result<(), RefineError> {
        check_ranges(&[
            ("gain", self.gain > 0.0 && self.gain <= 4.0, "above 0 and at most 4"),
            ("gain_decay", (0.0..=100.0).contains(&self.gain_decay), "0 to 100"),
            ("base_mm", (0.0..=100.0).contains(&self.base_mm), "0 to 100 mm"),
            ("veil_mm", (0.0..=10.0).contains(&self.veil_mm), "0 to 10 mm"),
        ])
    }

    fn start(&self, setup: &Setup<'_>) -> SurfaceFirstState {
        SurfaceFirstState { step: 0, residual: vec![[0.0; 3]; setup.points.len()] }
    }

    fn check_state(&self, setup: &Setup<'_>, state: &SurfaceFirstState) -> Result<(), RefineError> {
        residual::check(setup, &state.residual)
    }

    fn mixtures<'s>(
        &'s self,
        setup: &'s Setup<'_>,
        state: &'s SurfaceFirstState,
        control: &Control<'_>,
    ) -> Result<Planned<'s>, RefineError> {
        let (mixtures, overflow) = self.layer_mixtures(setup, state, control)?;
        Ok(Planned { mixtures: Box::new(mixtures), overflow })
    }

    fn tools(&self, _: &Setup<'_>, _: &SurfaceSmoother, _: &Control<'_>) -> Result<(), RefineError> {
        Ok(())
    }

    fn plan(
        &self,
        setup: &Setup<'_>,
        (): &(),
        state: &SurfaceFirstState,
        seen: &Seen<'_>,
        _: &Control<'_>,
    ) -> Result<SurfaceFirstState, RefineError> {
        let gain = self.gain / (1.0 + self.gain_decay * state.step as f32);
        let residual = residual::advanced(&state.residual, setup, seen, gain);
        Ok(SurfaceFirstState { step: state.step + 1, residual })
    }

    fn take(&self, _: &Setup<'_>, (): &(), state: &mut SurfaceFirstState, step: SurfaceFirstState) -> Moved {
        *state = step;
        Moved::default()
    }
}

impl SurfaceFirst {
    /// The mixtures of a state, and what no layer could take.
    pub(crate) fn layer_mixtures(
        &self,
        setup: &Setup<'_>,
        state: &SurfaceFirstState,
        control: &Control<'_>,
    ) -> Result<(LayerMixtures, Vec<[f32; 3]>), Cancelled> {
        let spread = self.spread(setup, state.step);
        LayerMixtures::fill(setup, control, |point, rows| {
            spread.mixtures(setup, point, state.residual[point as usize], rows)
        })
    }

    fn spread(&self, setup: &Setup<'_>, step: u32) -> Spread {
        let layers = &setup.layers;
        match step {
            0 => Spread { base_layers: layers.count(), highlight_layers: 0 },
            _ => Spread {
                base_layers: layers.above(self.base_mm).max(1),
                highlight_layers: layers.above(self.veil_mm),
            },
        }
    }
}

impl Spread {
    /// Writes the cumulative shares of every layer of a surface voxel, `[layer][label]` without the last label.
    /// Returns what the layers could not take of the residual.
    fn mixtures(&self, setup: &Setup<'_>, point: u32, residual: [f32; 3], rows: &mut [u16]) -> [f32; 3] {
        let ink = setup.problem.ink;
        let labels = ink.labels().len();
        let target = encode(setup.problem.printable_target[point as usize]);
        let occupied = setup.layers.occupied(point);
        let mut overflow = residual;
        let mut fractions = [0.0; MAX_LABELS];
        let fractions = &mut fractions[..labels];
        // A layer without voxels would swallow its share of the demand.
        let rows = rows.chunks_exact_mut(labels - 1).enumerate().filter(|(l, _)| occupied >> l & 1 == 1);
        for (layer, row) in rows {
            let base = if layer < self.base_layers { target } else { [1.0; 3] };
            let wanted: [f32; 3] = std::array::from_fn(|c| base[c] + overflow[c]);
            let mut got = ink.fractions(decode(wanted), fractions);
            if layer < self.highlight_layers {
                got = thin_out(ink, fractions).unwrap_or(got);
            }
            let got = encode(got);
            overflow = std::array::from_fn(|c| wanted[c] - got[c]);
            Thresholds::write(fractions, row);
        }
        overflow
    }
}

/// Thins sparse ink out of a mixture for the highlight layers, where a single ink voxel in white is seen as a speck;
/// returns the mixture's new colour if it changed. What is taken away is overflow: the layers below, whose specks
/// scattering has blurred, take it up.
fn thin_out(ink: &dyn InkModel, fractions: &mut [f32]) -> Option<[f32; 3]> {
    let (white, inks) = fractions.split_last_mut()?;
    let covered: f32 = inks.iter().sum();
    if covered >= HIGHLIGHT_COVER[1] || covered <= 0.0 {
        return None;
    }
    let keep = ((covered - HIGHLIGHT_COVER[0]) / (HIGHLIGHT_COVER[1] - HIGHLIGHT_COVER[0])).max(0.0);
    inks.iter_mut().for_each(|f| *f *= keep);
    *white = 1.0 - covered * keep;
    Some(ink.color(fractions))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Layers, Problem};
    use pellucid_color::{MediaWhite, Viewing};
    use pellucid_predict::Object;
    use pellucid_voxel::{
        Frame, LabelGrid, MaterialTable, NearestSurface, Pitch, Surface, SurfaceOptions, Tile,
    };
    use proptest::prelude::*;

    const TAKES: [f32; 3] = [0.9, 0.8, 0.7];

    /// Cyan, magenta and yellow, each of which darkens one channel in proportion.
    struct Inks;

    impl InkModel for Inks {
        fn labels(&self) -> &[u8] {
            &[1, 2, 3, 5]
        }
        fn fractions(&self, rgb: [f32; 3], fractions: &mut [f32]) -> [f32; 3] {
            let wanted: [f32; 3] = std::array::from_fn(|c| ((1.0 - rgb[c]) / TAKES[c]).clamp(0.0, 1.0));
            let scale = wanted.iter().sum::<f32>().max(1.0);
            (0..3).for_each(|c| fractions[c] = wanted[c] / scale);
            fractions[3] = (1.0 - wanted.iter().sum::<f32>() / scale).max(0.0);
            self.color(fractions)
        }
        fn color(&self, fractions: &[f32]) -> [f32; 3] {
            std::array::from_fn(|c| 1.0 - TAKES[c] * fractions[c])
        }
    }

    struct Ground {
        object: Object,
        nearest: NearestSurface,
        viewing: Viewing,
    }

    /// A block of 0.1 mm voxels: of 12 layers in 0.8 mm every third is thinner than what lies between two voxels.
    fn ground() -> Ground {
        let frame = Frame::new([0.0; 3], Pitch::new([0.1; 3]).unwrap(), [24, 24, 24]).unwrap();
        let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(5));
        let control = Control::none();
        let surface = Surface::extract(&grid, &SurfaceOptions::default(), &control).unwrap();
        let nearest = NearestSurface::build(&grid, &surface, 0.8, &control).unwrap();
        let object = Object::new(surface, MaterialTable::cmykw(), 1.5).unwrap();
        Ground { object, nearest, viewing: Viewing::rgb(MediaWhite::new([0.7, 0.8, 0.6]).unwrap()) }
    }

    fn setup<'a>(ground: &'a Ground, target: &'a [[f32; 3]]) -> Setup<'a> {
        let Ground { object, nearest, viewing } = ground;
        let layers = Layers::find(0.8, 12, object.surface(), nearest, &Control::none()).unwrap();
        let problem =
            Problem { object, nearest, ink: &Inks, viewing, target, printable_target: target, further: &[] };
        Setup { problem, layers, points: object.points(), seed: 0, iterations: 1 }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn demand_is_conserved(
            target in prop::array::uniform3(0.3f32..1.0),
            residual in prop::array::uniform3(-1.5f32..1.5),
            veil_mm in 0.0f64..0.4,
        ) {
            let ground = ground();
            let targets = vec![target; ground.object.surface().len()];
            let setup = setup(&ground, &targets);
            let strategy = SurfaceFirst { veil_mm, ..SurfaceFirst::default() };
            let spread = strategy.spread(&setup, 1);
            let point = ground.object.surface().index_of([12, 12, 0]).unwrap();
            let mut rows = vec![0; 12 * 3];
            let overflow = spread.mixtures(&setup, point, residual, &mut rows);
            // What was got beyond the base by layers that have voxels, and the overflow, are the residual.
            let occupied = setup.layers.occupied(point);
            prop_assert!(occupied.count_ones() < 12, "some layers are empty");
            let mut found = overflow;
            for (layer, row) in rows.chunks_exact(3).enumerate().filter(|(l, _)| occupied >> l & 1 == 1) {
                let share = |i: usize| f32::from(row[i]) / 65535.0;
                let fractions = [share(0), share(1) - share(0), share(2) - share(1), 1.0 - share(2)];
                let got = encode(Inks.color(&fractions));
                let base = if layer < spread.base_layers { encode(target) } else { [1.0; 3] };
                (0..3).for_each(|c| found[c] += got[c] - base[c]);
            }
            // Shares are rounded to 1/65535, in a dozen layers.
            prop_assert!((0..3).all(|c| (found[c] - residual[c]).abs() < 2e-3), "{found:?} {residual:?}");
        }

        #[test]
        fn a_greater_demand_never_gives_a_darker_layer(
            target in prop::array::uniform3(0.3f32..1.0), less in -1.0f32..1.0, more in 0.0f32..1.0,
        ) {
            let ground = ground();
            let targets = vec![target; ground.object.surface().len()];
            let setup = setup(&ground, &targets);
            let strategy = SurfaceFirst { veil_mm: 0.0, ..SurfaceFirst::default() };
            let spread = strategy.spread(&setup, 1);
            let point = ground.object.surface().index_of([12, 12, 0]).unwrap();
            let ink = |residual: f32| {
                let mut rows = vec![0; 12 * 3];
                spread.mixtures(&setup, point, [residual, 0.0, 0.0], &mut rows);
                rows.chunks_exact(3).map(|row| u64::from(row[0])).sum::<u64>()
            };
            prop_assert!(ink(less + more) <= ink(less) + 12);
        }
    }
}
