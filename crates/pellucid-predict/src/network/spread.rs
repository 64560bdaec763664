//! Derivatives by stencils, spread over the voxels that the stencils are means of.

use std::ops::Range;

use pellucid_core::Control;
use pellucid_stencil::{Coefficients, Region, Scatter, StencilSpec};
use pellucid_voxel::{AIR, LabelGrid};

use crate::{MaterialGradient, PredictError};

/// Most bytes of derivatives by stencils that are held before they are spread, and of the table that takes them.
const MOST_BYTES: usize = 256 << 20;

/// Derivatives by the stencils of some voxels.
pub(super) struct Source {
    pub spec: StencilSpec,
    pub voxels: Vec<[u32; 3]>,
    /// As [`Scatter::add`] takes them.
    pub derivatives: Vec<f32>,
}

/// Collects sources and adds them to a gradient, part by part of its region.
pub(super) struct Spread<'a> {
    coefficients: &'a Coefficients,
    labels: &'a LabelGrid,
    out: &'a mut dyn MaterialGradient,
    parts: Vec<Region>,
    sources: Vec<Source>,
    held: usize,
    most: usize,
    progress: &'a Control<'a>,
    done: u64,
    total: u64,
}

impl<'a> Spread<'a> {
    /// Reports to `control` the voxels whose derivatives are known, and those whose are spread, of `total` of either.
    pub fn new(
        coefficients: &'a Coefficients,
        labels: &'a LabelGrid,
        out: &'a mut dyn MaterialGradient,
        total: usize,
        control: &'a Control<'a>,
    ) -> Self {
        Self::within(coefficients, labels, out, total, control, MOST_BYTES)
    }

    fn within(
        coefficients: &'a Coefficients,
        labels: &'a LabelGrid,
        out: &'a mut dyn MaterialGradient,
        total: usize,
        control: &'a Control<'a>,
        most: usize,
    ) -> Self {
        let voxels = most / (size_of::<f64>() * coefficients.materials());
        let parts = parts(wanted(labels, out), voxels);
        let (sources, total) = (Vec::new(), 2 * total as u64);
        Self { coefficients, labels, out, parts, sources, held: 0, most, progress: control, done: 0, total }
    }

    /// How many rows of values there is room for in a source.
    pub fn room(&self, row: usize) -> usize {
        (self.most / 2 / (size_of::<f32>() * row)).max(1)
    }

    /// What asks to stop.
    pub fn control(&self) -> Control<'a> {
        self.progress.silent()
    }

    /// What the derivatives of more voxels are reported to while they are found.
    pub fn reporting<R>(&mut self, voxels: usize, find: impl FnOnce(&Control<'_>) -> R) -> R {
        let (before, total, progress) = (self.done, self.total, self.progress);
        let report = |done: u64, _: u64| progress.report(before + done, total);
        let found = find(&progress.silent().with_progress(&report));
        self.done += voxels as u64;
        found
    }

    /// Takes a source, and spreads what is held when that is much.
    pub fn take(&mut self, source: Source) -> Result<(), PredictError> {
        self.held += size_of::<f32>() * source.derivatives.len();
        self.sources.push(source);
        if self.held > self.most / 2 { self.flush() } else { Ok(()) }
    }

    /// Spreads what is held.
    pub fn flush(&mut self) -> Result<(), PredictError> {
        let sources = std::mem::take(&mut self.sources);
        self.held = 0;
        let voxels = sources.iter().map(|s| s.voxels.len() as u64).sum::<u64>();
        if voxels == 0 {
            return Ok(());
        }
        let control = self.progress.silent();
        let largest = self.parts.iter().map(Region::voxels).max().unwrap_or(0);
        let mut table = vec![0.0; largest * self.coefficients.materials()];
        for (i, part) in self.parts.iter().enumerate() {
            let table = &mut table[..part.voxels() * self.coefficients.materials()];
            let mut scatter = Scatter::new(self.coefficients, *part, table)?;
            for source in &sources {
                scatter.add(&source.spec, &source.voxels, &source.derivatives, &control)?;
            }
            scatter.finish(&control)?;
            add(self.labels, *part, table, self.out, &control)?;
            let done = voxels * (i as u64 + 1) / self.parts.len() as u64;
            self.progress.report(self.done + done, self.total);
        }
        self.done += voxels;
        Ok(())
    }
}

/// The voxels of the grid that a gradient wants; none along an axis where it wants none.
pub(super) fn wanted(labels: &LabelGrid, out: &dyn MaterialGradient) -> [Range<u32>; 3] {
    let [low, end] = out.region().unwrap_or([[0; 3], labels.size()]);
    std::array::from_fn(|a| low[a]..end[a].min(labels.size()[a]).max(low[a]))
}

/// Cuts voxels into boxes of at most so many, of whole layers or, where a layer is too large, of whole rows.
fn parts(wanted: [Range<u32>; 3], most: usize) -> Vec<Region> {
    let [x, y, z] = wanted;
    let [nx, ny] = [x.len(), y.len()];
    if nx * ny * z.len() == 0 {
        return Vec::new();
    }
    let rows = (most / nx).clamp(1, ny);
    let layers = if rows == ny { (most / (nx * ny)).max(1) } else { 1 };
    let low = |z: u32, y: u32| [x.start, y, z].map(i64::from);
    z.clone()
        .step_by(layers)
        .flat_map(|first| y.clone().step_by(rows).map(move |row| (first, row)))
        .map(|(first, row)| Region {
            low: low(first, row),
            size: [nx as u32, (y.end - row).min(rows as u32), (z.end - first).min(layers as u32)],
        })
        .collect()
}

/// Adds a table `[material][z][y][x]` where there is something solid.
fn add(
    labels: &LabelGrid,
    part: Region,
    table: &[f64],
    out: &mut dyn MaterialGradient,
    control: &Control<'_>,
) -> Result<(), PredictError> {
    let low = part.low.map(|v| v as u32);
    let [sx, sy, sz] = part.size;
    let mut at = 0;
    for z in low[2]..low[2] + sz {
        for y in low[1]..low[1] + sy {
            control.check()?;
            for x in low[0]..low[0] + sx {
                if labels.get([x, y, z]) != AIR {
                    for (label, table) in (1..=u8::MAX).zip(table.chunks_exact(part.voxels())) {
                        let value = table[at] as f32;
                        if value != 0.0 {
                            out.add([x, y, z], label, value);
                        }
                    }
                }
                at += 1;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    use pellucid_stencil::Features;
    use pellucid_voxel::{Frame, MaterialTable, Pitch};

    #[derive(Default)]
    struct Sums {
        values: HashMap<([u32; 3], u8), f64>,
        region: Option<[[u32; 3]; 2]>,
    }

    impl MaterialGradient for Sums {
        fn add(&mut self, voxel: [u32; 3], label: u8, derivative: f32) {
            *self.values.entry((voxel, label)).or_default() += f64::from(derivative);
        }

        fn region(&self) -> Option<[[u32; 3]; 2]> {
            self.region
        }
    }

    fn grid() -> LabelGrid {
        let frame = Frame::new([0.0; 3], Pitch::j750(), [14, 9, 20]).unwrap();
        LabelGrid::from_fn(frame, |[x, y, z]| if x < 2 { 0 } else { 1 + ((x + y + z) % 5) as u8 })
    }

    /// Two sources of different specs.
    fn sources(coefficients: &Coefficients) -> Vec<Source> {
        let voxels = vec![[3, 4, 5], [12, 8, 19], [7, 0, 1]];
        [2, 9]
            .map(|levels| {
                let spec = StencilSpec::new([5, 3, 9], levels).unwrap();
                let count = voxels.len() * coefficients.values_per_point(&spec);
                let derivatives = (0..count).map(|i| (i * 7919 % 1009) as f32 * 1e-3 - 0.5).collect();
                Source { spec, voxels: voxels.clone(), derivatives }
            })
            .into()
    }

    fn spread(most: usize, region: Option<[[u32; 3]; 2]>) -> Sums {
        let labels = grid();
        let coefficients = Coefficients::all(&MaterialTable::cmykw(), Features::ScatterAbsorb).unwrap();
        let mut sums = Sums { region, ..Sums::default() };
        let control = Control::none();
        let mut spread = Spread::within(&coefficients, &labels, &mut sums, 6, &control, most);
        for source in sources(&coefficients) {
            spread.take(source).unwrap();
        }
        spread.flush().unwrap();
        sums
    }

    #[test]
    fn little_memory_gives_the_same_sums_as_much() {
        let whole = spread(MOST_BYTES, None).values;
        assert_eq!(whole.len(), 12 * 9 * 20 * 5);
        // Some layers at a time, some rows, single rows; and sources one by one.
        for most in [40 * 14 * 9 * 3, 40 * 14 * 4, 1] {
            let parts = spread(most, None).values;
            assert_eq!(parts.len(), whole.len());
            for (at, value) in &parts {
                // Sums of f32 roundings of two sources.
                assert!((value - whole[at]).abs() < 1e-6 * (1.0 + whole[at].abs()), "{most} {at:?}");
            }
        }
        let region = [[5, 2, 3], [9, 99, 11]];
        let some = spread(40 * 14 * 9 * 3, Some(region)).values;
        assert_eq!(some.len(), 4 * 7 * 8 * 5);
        assert!(some.iter().all(|(at, v)| (v - whole[at]).abs() < 1e-6 * (1.0 + v.abs())));
        assert!(spread(1 << 20, Some([[5, 2, 3], [4, 9, 9]])).values.is_empty());
        assert!(spread(1 << 20, Some([[50, 2, 3], [60, 9, 9]])).values.is_empty());
    }

    #[test]
    fn parts_tile_what_is_wanted() {
        for most in [1, 7, 12, 35, 36, 100, 10_000] {
            let parts = parts([2..6, 1..10, 5..16], most);
            let voxels: usize = parts.iter().map(Region::voxels).sum();
            assert_eq!(voxels, 4 * 9 * 11, "{most}");
            assert!(parts.iter().all(|p| p.voxels() <= most.max(4)), "{most}");
            let mut lows: Vec<_> = parts.iter().map(|p| p.low).collect();
            lows.dedup();
            assert_eq!(lows.len(), parts.len());
        }
    }
}
