//! How much memory a job will take, told before it starts.

use pellucid_core::{Bytes, Fault};
use pellucid_mesh::{Model, Placement, SolidSize};
use pellucid_voxel::TILE_VOXELS;

use crate::{PrintError, PrintJob, StrategyKind};

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

/// What the need follows from, at one size.
#[derive(Clone, Copy)]
struct Extent {
    solid: SolidSize,
    box_mm3: f64,
}

impl Extent {
    /// The same object so many times as large.
    fn times(self, factor: f64) -> Self {
        let solid = self.solid.times(factor);
        Self { solid, box_mm3: self.box_mm3 * factor.powi(3) }
    }
}

impl PrintJob {
    /// What [`PrintJob::prepare`] will take for a model, by the size of its surface and solid: as measured by the study
    /// `size`. Cheap: looks at every triangle once.
    ///
    /// # Errors
    /// [`PrintError::Mesh`] when the model cannot be placed at the job's scale.
    pub fn memory_need(&self, model: &Model) -> Result<MemoryNeed, PrintError> {
        Ok(self.need_by(self.settings().strategy, self.extent(model)?))
    }

    /// [`PrintJob::memory_need`] where it is within a limit.
    ///
    /// # Errors
    /// As there; [`PrintError::Unsupported`] past the limit, which tells what size and which strategy would do.
    pub fn check_memory(&self, model: &Model, limit: Bytes) -> Result<MemoryNeed, PrintError> {
        let (strategy, extent) = (self.settings().strategy, self.extent(model)?);
        let need = self.need_by(strategy, extent);
        if need.bytes <= limit {
            return Ok(need);
        }
        let height_mm = Placement::new(model, self.settings().scale)?.extent_mm()[2];
        let mut remedies = Vec::new();
        if let Some(part) = self.part_within(extent, limit) {
            let told = (10.0 * height_mm * part).floor() / 10.0;
            remedies.push(format!("print it at most {told:.1} mm high (--height-mm)"));
        }
        let quick = self.need_by(StrategyKind::SurfaceFirst, extent).bytes;
        if strategy == StrategyKind::Descent && quick <= limit {
            remedies.push(format!("choose the strategy {} ({quick})", StrategyKind::SurfaceFirst.name()));
        }
        remedies.push("allow more (--memory)".to_owned());
        let reason = format!("the job would take about {}, and {limit} are allowed", need.bytes);
        Err(PrintError::Unsupported(Fault::new("memory", reason).remedy(remedies.join("; or "))))
    }

    fn extent(&self, model: &Model) -> Result<Extent, PrintError> {
        let placement = Placement::new(model, self.settings().scale)?;
        let solid = SolidSize::of(model, &placement, self.settings().printer.pitch());
        Ok(Extent { solid, box_mm3: placement.extent_mm().iter().product() })
    }

    /// Which part of the size is within a limit; none where a tenth is not.
    fn part_within(&self, extent: Extent, limit: Bytes) -> Option<f64> {
        let fits = |part: f64| self.need_by(self.settings().strategy, extent.times(part)).bytes <= limit;
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

    fn need_by(&self, strategy: StrategyKind, Extent { solid, box_mm3 }: Extent) -> MemoryNeed {
        let s = self.settings();
        // Of a surface voxel, of one of its channels, of a coloured voxel: fits to the study `size`. Where the network is
        // left out of the proof, they say too much of the heuristic.
        let [surface, channel, coloured] = match strategy {
            StrategyKind::SurfaceFirst | StrategyKind::SurfaceColor => [830.0, 8.0, 18.0],
            StrategyKind::Descent => [1250.0, 12.0, 20.0],
        };
        let voxel_mm3 = s.printer.pitch().volume_mm3();
        let coloured_mm3 = solid.volume_mm3.min(solid.area_mm2 * s.refine.coloured_depth_mm);
        let coloured_voxels = coloured_mm3 / voxel_mm3;
        let bytes = FIXED
            + solid.surface_voxels * (surface + s.materials.channels() as f64 * channel)
            + coloured_voxels * coloured
            + box_mm3 / voxel_mm3 / TILE_VOXELS as f64 * TILE;
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
