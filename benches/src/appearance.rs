//! What studies of predictors share: colour differences, times of stencils, false colours.

use pellucid::color::delta_e::delta_e_2000_of_linear_rgb;
use pellucid::color::{ErrorStats, Viewing};
use pellucid::dataset::Sampler;
use pellucid::stencil::{Coefficients, Features, StencilSpec, Stencils, near_order};
use pellucid::voxel::{Control, CountSat, Surface, SurfaceOptions};

use crate::study::stopwatch::time;

/// Why a measurement ended.
pub type Error = Box<dyn std::error::Error + Send + Sync>;

/// Surface points on which a predictor is timed.
pub const TIMED_POINTS: usize = 4096;

/// Mean CIEDE2000 between radiances of whole points, both `[point][channel]`, relative to the print's white.
pub fn mean_delta_e(a: &[f32], b: &[f32], viewing: &Viewing) -> f64 {
    let rgb = |values: &[f32]| -> Vec<[f32; 3]> {
        values.chunks_exact(viewing.channels()).map(|point| viewing.relative_rgb(point)).collect()
    };
    let mut differences = vec![0.0; a.len() / viewing.channels()];
    delta_e_2000_of_linear_rgb(&rgb(a), &rgb(b), &mut differences);
    ErrorStats::of(differences).mean
}

/// Processor seconds that the stencil of one sample takes, of neighbouring surface points of a volume.
///
/// # Errors
/// When the volume cannot be built, or the control asks to stop.
pub fn stencil_seconds(sampler: &Sampler, volume: u32, control: &Control<'_>) -> Result<f64, Error> {
    let grid = sampler.grid(volume)?;
    let surface = Surface::extract(&grid, &SurfaceOptions::default(), control)?;
    let sat = CountSat::build(&grid, sampler.materials().len(), control)?;
    let stencils = Stencils::new(StencilSpec::paper(), &grid, &sat)?;
    let coefficients = Coefficients::all(sampler.materials(), Features::ScatterAbsorb)?;
    let order = near_order(surface.voxels());
    let points: Vec<[u32; 3]> =
        order.iter().take(TIMED_POINTS).map(|&i| surface.voxels()[i as usize]).collect();
    let mut out = vec![0.0; points.len() * coefficients.values_per_point(stencils.spec())];
    let (_, spent) = time(|| stencils.extract(&coefficients, &points, &mut out, control))?;
    Ok(spent / (points.len() * sampler.channels()).max(1) as f64)
}

/// Linear RGB of a signed error: white at none, red for too much, blue for too little, full colour at `full`.
pub fn signed_color(error: f32, full: f32) -> [f32; 3] {
    let part = (error / full).clamp(-1.0, 1.0);
    // The stronger the error, the less of the other two colours.
    if part > 0.0 { [1.0, 1.0 - part, 1.0 - part] } else { [1.0 + part, 1.0 + part, 1.0] }
}

/// Colours from black by violet, red and yellow to white, whose lightness rises evenly; linear RGB.
const HEAT: [[f32; 3]; 6] = [
    [0.0, 0.0, 0.0],
    [0.07, 0.01, 0.15],
    [0.34, 0.02, 0.16],
    [0.83, 0.13, 0.03],
    [0.95, 0.52, 0.05],
    [1.0, 1.0, 0.75],
];

/// Linear RGB of an error without sign: black at none, nearly white at `full` and above.
pub fn heat_color(error: f32, full: f32) -> [f32; 3] {
    let at = (error / full).clamp(0.0, 1.0) * (HEAT.len() - 1) as f32;
    let i = (at as usize).min(HEAT.len() - 2);
    let part = at - i as f32;
    std::array::from_fn(|c| HEAT[i][c] + part * (HEAT[i + 1][c] - HEAT[i][c]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn false_colours_tell_sign_and_size() {
        assert_eq!(signed_color(0.0, 0.1), [1.0; 3]);
        assert_eq!(signed_color(0.05, 0.1), [1.0, 0.5, 0.5]);
        assert_eq!(signed_color(-1.0, 0.1), [0.0, 0.0, 1.0]);
        let luminance = |[r, g, b]: [f32; 3]| 0.2126 * r + 0.7152 * g + 0.0722 * b;
        let steps: Vec<f32> = (0..=40).map(|i| luminance(heat_color(0.25 * i as f32, 10.0))).collect();
        assert!(steps.windows(2).all(|w| w[0] < w[1]), "{steps:?}");
        assert_eq!(heat_color(99.0, 10.0), heat_color(10.0, 10.0));
    }
}
