//! How much memory a job will take, told before it starts.

use pellucid_core::{Bytes, Fault};
use pellucid_mesh::{Model, Placement, SolidSize};
use pellucid_voxel::TILE_VOXELS;

use crate::job::{MOST_BY_NETWORK, sections};
use crate::{PredictorKind, PrintError, PrintJob, StrategyKind};

/// Bytes of a job on a next to empty object: colour tables, threads, program.
const FIXED: f64 = 60e6;
/// Bytes of a tile of the box that is all the same: its entries in two grids of labels and in two tables.
const TILE: f64 = 40.0;

/// What a job is expected to take.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct MemoryNeed {
    /// Voxels of the surface.
    pub surface_voxels: u64,
    /// Voxels within the coloured depth.
    pub coloured_voxels: u64,
    /// Most bytes that are in use at a time, to within a quarter or so.
    pub bytes: Bytes,
}

/// Bytes of a surface voxel, of one of its channels and of a coloured voxel, by fits to the study `size`: of refinement
/// and what follows by strategy. Where the network is left out of the proof, they say too much of the heuristic.
const HEURISTIC: [f64; 3] = [760.0, 8.0, 17.0];
const DESCENT: [f64; 3] = [1105.0, 12.0, 18.5];
/// What descent takes more where the network tells changes between averaged paths: 0.96 to 1.05 KB of a surface voxel on two
/// objects of 8 mm and one of 20 mm.
const AVERAGED: [f64; 3] = [780.0, 72.0, 0.0];
/// Of what is there beside a section that is refined.
const PLACED: [f64; 3] = [120.0, 0.0, 3.0];
/// Of the judge of a print that was refined in sections, and of one that is too large for the network's pictures.
const JUDGE: [f64; 3] = [760.0, 8.0, 13.0];
const JUDGE_BY_PATHS: [f64; 3] = [565.0, 8.0, 5.0];
/// Parts of the height in which surface voxels are counted.
const LAYERS: usize = 200;
/// Heights of sections in mm that are offered where the print as a whole takes too much.
const OFFERED_MM: [f64; 4] = [40.0, 20.0, 10.0, 5.0];

/// What the need follows from, at one size.
#[derive(Clone)]
struct Extent {
    solid: SolidSize,
    box_mm3: f64,
    height_mm: f64,
    /// Shares of the surface by height.
    layers: Vec<f64>,
}

impl Extent {
    /// The same object so many times as large.
    fn times(&self, factor: f64) -> Self {
        let solid = self.solid.times(factor);
        let (box_mm3, height_mm) = (self.box_mm3 * factor.powi(3), self.height_mm * factor);
        Self { solid, box_mm3, height_mm, layers: self.layers.clone() }
    }

    /// The most that some millimetres of height have of the surface, as a share.
    fn most_within(&self, mm: f64) -> f64 {
        let layers = (mm / self.height_mm * self.layers.len() as f64).ceil() as usize;
        let share = |layers: &[f64]| layers.iter().sum::<f64>();
        self.layers.windows(layers.clamp(1, self.layers.len())).map(share).fold(0.0, f64::max).min(1.0)
    }
}

impl PrintJob {
    /// What [`PrintJob::prepare`] will take for a model, by the size of its surface and solid: as measured by the study
    /// `size`. Cheap: looks at the triangles alone.
    ///
    /// # Errors
    /// [`PrintError::Mesh`] when the model cannot be placed at the job's scale.
    pub fn memory_need(&self, model: &Model) -> Result<MemoryNeed, PrintError> {
        Ok(self.need_by(self.settings().strategy, self.settings().section_mm, &self.extent(model)?))
    }

    /// [`PrintJob::memory_need`] where it is within a limit.
    ///
    /// # Errors
    /// As there; [`PrintError::Unsupported`] past the limit, which tells what size, sections and strategy would do.
    pub fn check_memory(&self, model: &Model, limit: Bytes) -> Result<MemoryNeed, PrintError> {
        let (strategy, sections) = (self.settings().strategy, self.settings().section_mm);
        let extent = &self.extent(model)?;
        let need = self.need_by(strategy, sections, extent);
        if need.bytes <= limit {
            return Ok(need);
        }
        let mut remedies = Vec::new();
        let lower = |mm: &f64| *mm < sections.unwrap_or(extent.height_mm);
        let fits = |mm: &f64| self.need_by(strategy, Some(*mm), extent).bytes <= limit;
        if let Some(mm) = OFFERED_MM.into_iter().filter(lower).find(fits) {
            let then = self.need_by(strategy, Some(mm), extent).bytes;
            remedies.push(format!("refine it in sections of {mm} mm (--section-mm {mm}: {then})"));
        }
        if let Some(part) = self.part_within(extent, limit) {
            let told = (10.0 * extent.height_mm * part).floor() / 10.0;
            remedies.push(format!("print it at most {told:.1} mm high (--height-mm)"));
        }
        let quick = self.need_by(StrategyKind::SurfaceFirst, sections, extent).bytes;
        if strategy == StrategyKind::Descent && quick <= limit {
            remedies.push(format!("choose the strategy {} ({quick})", StrategyKind::SurfaceFirst.name()));
        }
        remedies.push("allow more (--memory)".to_owned());
        let reason = format!("the job would take about {}, and {limit} are allowed", need.bytes);
        Err(PrintError::Unsupported(Fault::new("memory", reason).remedy(remedies.join("; or "))))
    }

    fn extent(&self, model: &Model) -> Result<Extent, PrintError> {
        let placement = Placement::new(model, self.settings().scale)?;
        let (pitch, extent_mm) = (self.settings().printer.pitch(), placement.extent_mm());
        let solid = SolidSize::of(model, &placement, pitch);
        let mut layers = SolidSize::surface_voxels_by_layer(model, &placement, pitch, LAYERS);
        layers.iter_mut().for_each(|voxels| *voxels /= solid.surface_voxels.max(f64::MIN_POSITIVE));
        Ok(Extent { solid, box_mm3: extent_mm.iter().product(), height_mm: extent_mm[2], layers })
    }

    /// Which part of the size is within a limit; none where a tenth is not.
    fn part_within(&self, extent: &Extent, limit: Bytes) -> Option<f64> {
        let (strategy, sections) = (self.settings().strategy, self.settings().section_mm);
        let fits = |part: f64| self.need_by(strategy, sections, &extent.times(part)).bytes <= limit;
        let [mut low, mut high] = [0.1, 1.0];
        if !fits(low) {
            return None;
        }
        for _ in 0..20 {
            let middle = 0.5 * (low + high);
            if fits(middle) { low = middle } else { high = middle }
        }
        Some(low)
    }

    fn need_by(&self, strategy: StrategyKind, section_mm: Option<f64>, extent: &Extent) -> MemoryNeed {
        let s = self.settings();
        let Extent { solid, box_mm3, .. } = extent;
        let voxel_mm3 = s.printer.pitch().volume_mm3();
        let coloured_mm3 = solid.volume_mm3.min(solid.area_mm2 * s.refine.coloured_depth_mm);
        let coloured_voxels = coloured_mm3 / voxel_mm3;
        let of = |[surface, channel, coloured]: [f64; 3], share: f64| {
            let voxel = surface + s.materials.channels() as f64 * channel;
            share * (solid.surface_voxels * voxel + coloured_voxels * coloured)
        };
        let refined = match strategy {
            StrategyKind::SurfaceFirst | StrategyKind::SurfaceColor => HEURISTIC,
            StrategyKind::Descent if s.predictor == PredictorKind::Rpnn => {
                std::array::from_fn(|i| DESCENT[i] + AVERAGED[i])
            }
            StrategyKind::Descent => DESCENT,
        };
        let most = match section_mm {
            None => of(refined, 1.0),
            Some(mm) => {
                let seen = extent.most_within(mm + 2.0 * sections::margin_mm(s.refine.coloured_depth_mm));
                let by_network = solid.surface_voxels <= MOST_BY_NETWORK as f64;
                let judge = if by_network { JUDGE } else { JUDGE_BY_PATHS };
                of(judge, 1.0).max(of(PLACED, 1.0) + of(refined, seen))
            }
        };
        let bytes = FIXED + most + box_mm3 / voxel_mm3 / TILE_VOXELS as f64 * TILE;
        MemoryNeed {
            surface_voxels: solid.surface_voxels as u64,
            coloured_voxels: coloured_voxels as u64,
            bytes: Bytes(bytes as u64),
        }
    }
}

#[cfg(all(test, feature = "obj"))]
mod tests {
    use super::*;
    use crate::PrintSettings;
    use pellucid_mesh::{ImportLimits, Scale, import_slice};

    fn block() -> Model {
        let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nv 0 0 1\nv 1 0 1\nv 0 1 1\nv 1 1 1\n";
        let faces = "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";
        let bytes = format!("{corners}{faces}");
        import_slice("block.obj", bytes.as_bytes(), None, &ImportLimits::default()).unwrap()
    }

    fn job(height_mm: f64, strategy: StrategyKind) -> PrintJob {
        let scale = Scale::HeightMm(height_mm);
        PrintJob::new(PrintSettings { scale, strategy, ..PrintSettings::default() }).unwrap()
    }

    #[test]
    fn the_need_grows_with_surface_and_solid() {
        let model = block();
        let need = |mm, strategy| job(mm, strategy).memory_need(&model).unwrap();
        let [small, large] = [20.0, 40.0].map(|mm| need(mm, StrategyKind::Descent));
        assert_eq!(small.surface_voxels * 4 / 100, large.surface_voxels / 100);
        let growth = (large.bytes.0 as f64 - FIXED) / (small.bytes.0 as f64 - FIXED);
        assert!((4.0..8.0).contains(&growth), "{growth}");
        assert!(need(40.0, StrategyKind::SurfaceFirst).bytes < large.bytes);
    }

    #[cfg(feature = "weights")]
    #[test]
    fn the_network_between_averaged_paths_is_counted() {
        let plain = job(20.0, StrategyKind::Descent);
        let settings = PrintSettings { predictor: PredictorKind::Rpnn, ..plain.settings().clone() };
        let need = |job: &PrintJob| job.memory_need(&block()).unwrap();
        let [plain, averaged] = [need(&plain), need(&PrintJob::new(settings).unwrap())];
        let more = (averaged.bytes.0 - plain.bytes.0) / plain.surface_voxels;
        assert_eq!(more, 780 + 3 * 72);
    }

    #[test]
    fn sections_need_less_and_are_told_of() {
        let model = block();
        let of = |section_mm| {
            let settings =
                PrintSettings { section_mm, ..job(60.0, StrategyKind::Descent).settings().clone() };
            PrintJob::new(settings).unwrap()
        };
        let need = |section_mm| of(section_mm).memory_need(&model).unwrap().bytes;
        assert!(need(Some(10.0)) < need(Some(20.0)) && need(Some(20.0)) < need(None));
        let limit = need(Some(20.0));
        let told = of(None).check_memory(&model, limit).unwrap_err().to_string();
        assert!(told.contains(&format!("in sections of 20 mm (--section-mm 20: {limit})")), "{told}");
        // A job in sections is told of lower ones.
        let told = of(Some(20.0)).check_memory(&model, need(Some(10.0))).unwrap_err().to_string();
        assert!(told.contains("(--section-mm 10: "), "{told}");
    }

    #[test]
    fn what_is_told_to_do_does() {
        let model = block();
        let too_large = job(60.0, StrategyKind::Descent);
        let need = too_large.memory_need(&model).unwrap();
        assert_eq!(too_large.check_memory(&model, need.bytes).unwrap(), need);
        let heuristic = job(60.0, StrategyKind::SurfaceFirst).memory_need(&model).unwrap().bytes;
        let Err(PrintError::Unsupported(fault)) = too_large.check_memory(&model, heuristic) else { panic!() };
        assert!(fault.remedy.contains(&format!("the strategy surface-first ({heuristic})")), "{fault}");
        let millimetres = fault.remedy.split_once("at most ").unwrap().1.split_once(" mm").unwrap().0;
        let millimetres: f64 = millimetres.parse().unwrap();
        assert!(job(millimetres, StrategyKind::Descent).check_memory(&model, heuristic).is_ok());
        assert!(job(millimetres + 0.2, StrategyKind::Descent).check_memory(&model, heuristic).is_err());
        let least = too_large.check_memory(&model, Bytes(1 << 20)).unwrap_err().to_string();
        assert!(!least.contains("--height-mm") && least.ends_with("allow more (--memory)"), "{least}");
    }
}
