//! `pellucid validate`: reference radiances against the path tracer.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use pellucid::trace::cases::{Case, VoxelCase, read_cases};
use pellucid::voxel::{Control, Pitch};

use crate::Failure;
use crate::terminal::print;

/// Compares the path tracer with reference radiances
#[derive(clap::Args)]
pub struct Args {
    /// Reference cases in JSON, such as datasets/reference/radiance.json: geometry, medium, point and radiance of each
    cases: PathBuf,
    /// Paths per estimate; by default as many as bring the standard error to 0.0007
    #[arg(long, value_parser = clap::value_parser!(u32).range(2..))]
    spp: Option<u32>,
    /// Seed of the random numbers
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Leave out the estimates in voxels of the printer's pitch
    #[arg(long)]
    no_voxels: bool,
}

/// Sums of squared z-scores and the worst one.
#[derive(Default)]
struct Summary {
    squares: f64,
    count: u32,
    worst: f64,
    worst_case: String,
}

impl Summary {
    fn add(&mut self, z: f64, case: &Case) {
        self.squares += z * z;
        self.count += 1;
        if z.abs() >= self.worst.abs() {
            self.worst = z;
            self.worst_case.clone_from(&case.id);
        }
    }

    fn line(&self, what: &str) -> String {
        let rms = (self.squares / f64::from(self.count.max(1))).sqrt();
        format!(
            "{what}: {} cases, rms z {rms:.3}, worst z {:+.2} ({})\n",
            self.count, self.worst, self.worst_case
        )
    }
}

/// Runs the command; prints a row a case and a summary.
pub fn run(args: &Args, cancel: &AtomicBool) -> Result<(), Failure> {
    let control = &Control::none().with_cancel(cancel);
    let cases = read_cases(&args.cases)?;
    let width = cases.iter().map(|c| c.id.len()).max().unwrap_or(4).max(4);
    let of_voxels = if args.no_voxels { "" } else { "   voxels  std err    error  error/se" };
    print(&format!(
        "{:width$}  {:>8} {:>8} {:>9} {:>6}{of_voxels}\n",
        "case", "value", "std err", "reference", "z"
    ))?;
    let (mut analytic, mut voxels) = (Summary::default(), Summary::default());
    let mut error_squares = 0.0;
    let mut cached: Option<(&Case, VoxelCase)> = None;
    for (i, case) in cases.iter().enumerate() {
        // Seeds of their own, or cases of equal optical thickness would share their noise.
        let seed = args.seed.wrapping_add((i as u64) << 32);
        let estimate = case.analytic(args.spp, seed, control)?;
        let z = case.z(&estimate);
        analytic.add(z, case);
        print(&format!(
            "{:width$}  {:8.5} {:8.5} {:9.5} {z:+6.2}",
            case.id, estimate.value, estimate.std_error, case.reference
        ))?;
        if args.no_voxels {
            print("\n")?;
            continue;
        }
        // Cases often share their object.
        if cached.as_ref().is_none_or(|(of, _)| !same_object(of, case)) {
            drop(cached.take());
            cached = Some((case, case.voxelise(Pitch::j750(), control)?));
        }
        let Some((_, object)) = &cached else { continue };
        let estimate = case.voxelised(object, args.spp, seed ^ 1, control)?;
        let (error, z) = (estimate.value - case.reference, case.z(&estimate));
        voxels.add(z, case);
        error_squares += error * error;
        print(&format!(" {:9.5} {:8.5} {error:+8.5} {z:+9.2}\n", estimate.value, estimate.std_error))?;
    }
    print(&analytic.line("analytic geometry"))?;
    if !args.no_voxels {
        print(&voxels.line("voxels of 600 x 300 x 940 DPI"))?;
        let rms = (error_squares / cases.len().max(1) as f64).sqrt();
        print(&format!(
            "voxel error: rms {rms:.5}; it holds what voxels change of the object, beside the noise\n"
        ))?;
    }
    Ok(())
}

/// Whether two cases have the same voxels: shape, filling and point; coefficients may differ.
fn same_object(a: &Case, b: &Case) -> bool {
    a.scene.shape() == b.scene.shape()
        && a.scene.medium() == b.scene.medium()
        && a.point_mm == b.point_mm
        && a.normal == b.normal
}
