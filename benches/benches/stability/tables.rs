//! Summed-area tables and stencils: whole numbers stay whole, and what is read from them finite.

use pellucid::stencil::{Coefficients, Features, StencilSpec, Stencils};
use pellucid::voxel::{Control, CountSat, Frame, LabelGrid, Pitch, Tile};

use super::Error;
use super::case::Case;
use super::scene::{Filling, Solid, index};

pub const PART: &str = "tables";

fn case(name: &str, measured: &'static str, found: f64, bound: Option<f64>) -> Case {
    Case { part: PART, name: name.to_owned(), measured, found, bound }
}

/// Counts against products and naive sums, features against the coefficients that they average.
pub fn cases(control: &Control<'_>) -> Result<Vec<Case>, Error> {
    let mut found = large(control)?;
    let frame = Frame::new([0.0; 3], Pitch::new([0.01, 1.0, 0.03])?, [37, 41, 45])?;
    let noise = LabelGrid::from_fn(frame, |[x, y, z]| ((7 * x + 13 * y + 29 * z + x * y * z) % 16) as u8);
    let sat = CountSat::build(&noise, 15, control)?;
    let mut worst = 0u64;
    for (low, high) in
        [([0; 3], [37, 41, 45]), ([-5, 3, 17], [20, 60, 18]), ([1, 1, 1], [2, 2, 2]), ([36, 40, 44], [99; 3])]
    {
        let mut counts = vec![0; 15];
        sat.counts(low, high, &mut counts);
        let mut naive = [0u64; 16];
        for z in low[2]..high[2] {
            for y in low[1]..high[1] {
                (low[0]..high[0]).for_each(|x| naive[usize::from(noise.at([x, y, z]))] += 1);
            }
        }
        worst = counts.iter().zip(&naive[1..]).map(|(a, b)| a.abs_diff(*b)).fold(worst, u64::max);
    }
    found.push(case(
        "15 materials as noise, pitch 1 : 100, boxes past the grid",
        "most wrong count",
        worst as f64,
        Some(0.0),
    ));
    for (name, rows) in [
        ("extinctions 1e6 : 1 in a checkerboard", vec![(1e5, 0.0, 0.4), (0.0, 0.1, 0.4)]),
        ("clear beside 1e5 per mm", vec![(0.0, 0.0, 0.0), (9e4, 1e4, 0.99)]),
    ] {
        let solid = Solid {
            rows,
            filling: Filling::Checkerboard,
            ..Solid::of([1.0; 3], (1.0, 1.0, 0.0), index(1.5)?)
        };
        found.push(features(name, &solid, control)?);
    }
    Ok(found)
}

/// 100 mm at the printer's pitch: more voxels than 32 bits count.
fn large(control: &Control<'_>) -> Result<Vec<Case>, Error> {
    let pitch = Pitch::j750();
    let size = pitch.mm().map(|mm| (100.0 / mm).round() as u32);
    let grid = LabelGrid::from_tiles(Frame::new([0.0; 3], pitch, size)?, |_| Tile::Constant(5));
    let sat = CountSat::build(&grid, 5, control)?;
    let mut counts = [0; 5];
    sat.counts([-10; 3], size.map(|s| i64::from(s) + 10), &mut counts);
    let voxels: u64 = size.iter().map(|&s| u64::from(s)).product();
    let memory = sat.memory().total() as f64 / voxels as f64;
    Ok(vec![
        case("solid of 100 mm", "voxels counted wrongly", counts[4].abs_diff(voxels) as f64, Some(0.0)),
        case("solid of 100 mm", "bytes a voxel", memory, Some(1.0)),
    ])
}

/// By how much features leave the range of what they average.
fn features(name: &str, solid: &Solid, control: &Control<'_>) -> Result<Case, Error> {
    let (grid, materials) = (solid.grid()?, solid.materials()?);
    let sat = CountSat::build(&grid, materials.len(), control)?;
    let stencils = Stencils::new(StencilSpec::paper(), &grid, &sat)?;
    let coefficients = Coefficients::all(&materials, Features::ScatterAbsorb)?;
    let size = grid.size();
    let points = [[size[0] / 2, size[1] / 2, size[2] - 1], [0; 3], [0, size[1] / 2, size[2] / 2]];
    let mut out = vec![0.0; points.len() * coefficients.values_per_point(stencils.spec())];
    stencils.extract(&coefficients, &points, &mut out, control)?;
    let most = solid.rows.iter().map(|r| r.0.max(r.1)).fold(0.0, f64::max);
    let beyond = |v: &f32| {
        if v.is_finite() { (f64::from(*v) - most).max(-f64::from(*v)).max(0.0) / most } else { f64::NAN }
    };
    // A NaN must not be passed over by max.
    let worst =
        out.iter().map(beyond).fold(0.0, |worst: f64, b| if b.is_nan() || b > worst { b } else { worst });
    Ok(case(name, "features beyond the range, relative", worst, Some(1e-6)))
}
