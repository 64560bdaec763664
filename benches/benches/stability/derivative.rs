//! The derivative by path replay: summed over all voxels it is that by the scale of all coefficients.

use pellucid::trace::{AdjointOptions, Boundary, Derivatives, Tracer};
use pellucid::voxel::Control;

use super::Error;
use super::case::Case;
use super::scene::{Filling, Row, Solid, index};
use super::tracer::WHITE;

pub const PART: &str = "derivative";

/// Independent estimates, whose spread gives the standard error.
const BATCHES: u32 = 10;
/// Change of scale that a difference is taken over.
const STEP: f64 = 0.05;
/// Standard errors, which ten batches know to a quarter.
const Z: f64 = 5.0;

/// Sums derivatives by each voxel's own material.
struct Own<'a> {
    label: &'a dyn Fn([u32; 3]) -> u8,
    sum: f64,
    finite: bool,
}

impl Derivatives for Own<'_> {
    fn add(&mut self, voxel: [u32; 3], label: u8, derivative: f32) {
        self.finite &= derivative.is_finite();
        if (self.label)(voxel) == label {
            self.sum += f64::from(derivative);
        }
    }
}

/// Mean and standard error.
fn mean(values: &[f64]) -> [f64; 2] {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let square = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    [mean, (square / n).sqrt()]
}

/// Differences from difference quotients in double precision, over their standard errors.
pub fn cases(paths: u32, control: &Control<'_>) -> Result<Vec<Case>, Error> {
    let glass = index(1.5)?;
    let cube = |row: Row, boundary| Solid::of([1.0; 3], row, boundary);
    let checks = |rows: Vec<Row>| Solid { rows, filling: Filling::Checkerboard, ..cube(WHITE, glass) };
    let solids = [
        ("white", cube(WHITE, glass)),
        ("albedo exactly 1", cube((9.0, 0.0, 0.4), glass)),
        (
            "albedo exactly 0, sheet of 0.1 mm, index-matched",
            Solid::of([3.0, 3.0, 0.1], (0.0, 5.0, 0.0), Boundary::Matched),
        ),
        ("black", cube((2.0, 40.0, 0.4), glass)),
        ("extinction 1e3 per mm", cube((990.0, 10.0, 0.4), glass)),
        ("extinction 1e5 per mm", cube((9.9e4, 1e3, 0.4), glass)),
        ("g = 0.99", cube((9.0, 0.5, 0.99), glass)),
        ("g = -0.99", cube((9.0, 0.5, -0.99), glass)),
        ("refractive index 2", cube((5.0, 0.5, 0.4), index(2.0)?)),
        ("sheet of 0.1 mm", Solid::of([3.0, 3.0, 0.1], (9.0, 0.5, 0.4), glass)),
        ("checkerboard of voxels, extinctions 1e6 : 1", checks(vec![(9.0, 0.5, 0.4), (9e-6, 5e-7, 0.4)])),
    ];
    solids.iter().map(|(name, solid)| case(name, solid, paths, control)).collect()
}

fn case(name: &str, solid: &Solid, paths: u32, control: &Control<'_>) -> Result<Case, Error> {
    let (volume, top) = solid.traced(control)?;
    let materials = solid.materials()?;
    let grid = solid.grid()?;
    let label = |voxel: [u32; 3]| grid.get(voxel);
    let batch = paths / BATCHES;
    let tracer = Tracer::new(&volume, &materials, solid.options(batch, 1))?;
    let options = AdjointOptions { paths: batch as f32, ..AdjointOptions::default() };
    let (mut replayed, mut quotients) = (Vec::new(), Vec::new());
    for i in 0..BATCHES {
        let mut own = Own { label: &label, sum: 0.0, finite: true };
        tracer.pullback(&[top], i, &[1.0], &options, &mut own, control)?;
        replayed.push(if own.finite { own.sum } else { f64::NAN });
        // The same seed on either side: paths differ only where a flight ends elsewhere.
        let [low, high] =
            [1.0 - STEP, 1.0 + STEP].map(|s| solid.exact(s, batch, 100 + u64::from(i), control));
        quotients.push((high?.value - low?.value) / (2.0 * STEP));
    }
    let ([a, e], [b, f]) = (mean(&replayed), mean(&quotients));
    let z = match e.hypot(f) {
        // Both are exact.
        0.0 if a == b => 0.0,
        std_error => (a - b).abs() / std_error,
    };
    let bound = Some(Z);
    Ok(Case { part: PART, name: name.to_owned(), measured: "z to a difference quotient", found: z, bound })
}
