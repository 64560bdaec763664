//! Whole refinements of small solids whose aims are out of reach, flat, or noise.

use pellucid::refine::Effort;
use pellucid::voxel::{Frame, LabelGrid};
use pellucid::{Monitor, PrintJob, PrintSettings, StrategyKind, Workspace};

use super::Error;
use super::case::Case;

pub const PART: &str = "refinement";

/// A solid and its colours, linear RGB.
struct Aim {
    name: &'static str,
    size_mm: [f64; 3],
    color: fn([u32; 3]) -> [f32; 3],
}

/// A hash of a voxel as a colour.
fn noise([x, y, z]: [u32; 3]) -> [f32; 3] {
    let mut h = (x * 73_856_093) ^ (y.wrapping_mul(19_349_663)) ^ (z.wrapping_mul(83_492_791));
    std::array::from_fn(|_| {
        h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d) ^ 0x9e37_79b9;
        (h >> 8) as f32 / (1 << 24) as f32
    })
}

const AIMS: [Aim; 8] = [
    Aim { name: "pure black", size_mm: [1.5; 3], color: |_| [0.0; 3] },
    Aim { name: "pure white", size_mm: [1.5; 3], color: |_| [1.0; 3] },
    Aim { name: "neon green, out of gamut everywhere", size_mm: [1.5; 3], color: |_| [0.0, 1.0, 0.0] },
    Aim { name: "neon blue, out of gamut everywhere", size_mm: [1.5; 3], color: |_| [0.0, 0.0, 1.0] },
    Aim { name: "noise of single voxels", size_mm: [1.5; 3], color: noise },
    Aim {
        name: "checks of 0.2 mm, black and white",
        size_mm: [1.5; 3],
        color: |[x, y, z]| if (x / 5 + y / 2 + z / 7) % 2 == 0 { [0.0; 3] } else { [1.0; 3] },
    },
    Aim { name: "sheet of 0.1 mm, red", size_mm: [3.0, 3.0, 0.1], color: |_| [0.6, 0.05, 0.05] },
    Aim { name: "one voxel, red", size_mm: [0.04, 0.08, 0.02], color: |_| [0.6, 0.05, 0.05] },
];

/// What refinement ends at against what it began with, and whether descent's loss ends at its least.
pub fn cases(full: bool) -> Result<Vec<Case>, Error> {
    let mut found = Vec::new();
    for aim in &AIMS {
        for strategy in [StrategyKind::SurfaceFirst, StrategyKind::Descent] {
            found.extend(refined(aim, strategy, full)?);
        }
    }
    Ok(found)
}

fn refined(aim: &Aim, strategy: StrategyKind, full: bool) -> Result<Vec<Case>, Error> {
    let mut settings = PrintSettings {
        strategy,
        judge: Effort { points: 400, point_passes: 2, surface_passes: 8 },
        proof_edge: 16,
        ..PrintSettings::default()
    };
    if !full {
        settings.refine.iterations = Some(if strategy == StrategyKind::Descent { 15 } else { 8 });
    }
    let job = PrintJob::new(settings)?;
    let pitch = job.settings().printer.pitch();
    let size = std::array::from_fn(|a| (aim.size_mm[a] / pitch.mm()[a]).round().max(1.0) as u32);
    let solid = LabelGrid::from_fn(Frame::new([0.0; 3], pitch, size)?, |_| 1);
    let prepared = job.prepare_volume("solid", &solid, aim.color, &Workspace::none(), &Monitor::silent())?;
    let evaluation = &prepared.judged.evaluation;
    let error = |state: &pellucid::refine::StateErrors| state.at_0_1_mm.printable.mean;
    let worse = error(&evaluation.refined) - error(&evaluation.unrefined);
    let name = format!("{}, {}", aim.name, strategy.name());
    let case =
        |measured, found, bound| Case { part: PART, name: name.clone(), measured, found, bound: Some(bound) };
    let mut found = vec![case("judged mean dE2000 at 0.1 mm, refined less unrefined", worse, 0.2)];
    let losses: Vec<f64> = prepared.refined.report.iterations.iter().filter_map(|i| i.loss).collect();
    if let (Some(last), Some(least)) = (losses.last(), losses.iter().copied().reduce(f64::min)) {
        // Paths make losses noisy, which counts where they are small.
        found.push(case(
            "last loss less the least, over the first",
            (last - least) / losses[0].max(1.0),
            0.1,
        ));
    }
    Ok(found)
}
