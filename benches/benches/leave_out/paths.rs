//! Null collisions, weights of zero, voxels that no derivative is wanted for.

use pellucid::trace::{
    AdjointOptions, Boundary, Derivatives, ErrorTarget, TraceOptions, Tracer, Tracking, Volume,
};
use pellucid::voxel::{Control, MaterialTable};
use pellucid_benches::appearance::Error;
use pellucid_benches::study::stopwatch::time;

use super::Saving;
use super::scene::Scene;

/// Points that paths start from, neighbours of one another.
const POINTS: usize = 6000;
const SPP: u32 = 16;
/// Depth in mm within which materials are arranged.
const COLORED_MM: f64 = 0.5;

pub fn savings(scene: &Scene, control: &Control<'_>) -> Result<Vec<Saving>, Error> {
    let volume = Volume::new(&scene.labels, scene.object.surface(), control)?;
    let points = &scene.near[..scene.near.len().min(POINTS)];
    let traced = Traced { scene, volume: &volume, points, materials: MaterialTable::cmykw() };
    Ok(vec![
        traced.tracking(control)?,
        traced.adaptive(control)?,
        traced.zero_weights(control)?,
        traced.unwanted_voxels(control)?,
    ])
}

struct Traced<'a> {
    scene: &'a Scene,
    volume: &'a Volume,
    points: &'a [u32],
    materials: MaterialTable,
}

/// The sum of squares of derivatives by voxels within a depth below the surface of the scene's ball.
struct Near<'a> {
    scene: &'a Scene,
    /// All where `None`.
    depth_mm: Option<f64>,
    squares: f64,
}

impl Derivatives for Near<'_> {
    fn add(&mut self, voxel: [u32; 3], _: u8, derivative: f32) {
        if self.depth(voxel.map(i64::from)) <= COLORED_MM {
            self.squares += f64::from(derivative).powi(2);
        }
    }

    fn wants(&self, first: [u32; 3], _: [u32; 3]) -> bool {
        // The middle of a box of four voxels, whose half diagonal is 0.2 mm.
        self.depth_mm.is_none_or(|mm| self.depth(first.map(|c| i64::from(c) + 2)) <= mm + 0.2)
    }
}

impl Near<'_> {
    fn depth(&self, voxel: [i64; 3]) -> f64 {
        let at = self.scene.labels.frame().centre_mm(voxel);
        self.scene.mm / 2.0 - at.iter().map(|c| c * c).sum::<f64>().sqrt()
    }
}

impl Traced<'_> {
    fn tracer(&self, spp: u32, tracking: Tracking) -> Result<Tracer<'_>, Error> {
        let options = TraceOptions {
            spp,
            tracking,
            boundary: Boundary::with_index(self.scene.object.refractive_index())?,
            ..TraceOptions::default()
        };
        Ok(Tracer::new(self.volume, &self.materials, options)?)
    }

    /// Delta tracking leaves out the faces between voxels; it is chosen where contrast is low.
    fn tracking(&self, control: &Control<'_>) -> Result<Saving, Error> {
        let mut out = vec![0.0; self.points.len() * 3];
        let mut mean = |tracking| -> Result<(f64, f64), Error> {
            let tracer = self.tracer(SPP, tracking)?;
            let (_, spent) = time(|| tracer.radiance(self.points, 1, &mut out, control))?;
            Ok((spent, out.iter().map(|&l| f64::from(l)).sum::<f64>() / out.len() as f64))
        };
        let (without, by_voxels) = mean(Tracking::Regular)?;
        let (with, by_majorant) = mean(Tracking::Auto)?;
        Ok(Saving {
            what: "faces between voxels that a path crosses (delta tracking)".into(),
            object: self.scene.name(),
            unit: "us a path".into(),
            without: self.each(without),
            with: self.each(with),
            changes: format!("nothing but noise (mean radiance by {:+.1e})", by_majorant - by_voxels),
        })
    }

    /// Paths of points that are known well already.
    fn adaptive(&self, control: &Control<'_>) -> Result<Saving, Error> {
        let some = &self.points[..self.points.len() / 10];
        let tracer = self.tracer(1, Tracking::Auto)?;
        let target = ErrorTarget { std_error: 0.01, max_spp: 1 << 16 };
        let (mut out, mut errors) = (vec![0.0; some.len() * 3], vec![0.0; some.len() * 3]);
        let (paths, spent) = time(|| tracer.radiance_to(some, 1, target, &mut out, &mut errors, control))?;
        let mean_square = errors.iter().map(|e| f64::from(*e).powi(2)).sum::<f64>() / errors.len() as f64;
        // As many for each as the mean square error asks for: the mean variance of a path over it.
        let spp = 64;
        let flat = self.tracer(spp, Tracking::Auto)?;
        let (_, flat_spent) = time(|| flat.radiance_with_error(some, 1, &mut out, &mut errors, control))?;
        let flat_square = errors.iter().map(|e| f64::from(*e).powi(2)).sum::<f64>() / errors.len() as f64;
        Ok(Saving {
            what: "paths of points whose radiance is known well enough".into(),
            object: self.scene.name(),
            unit: "ms to a root mean square error of 0.01".into(),
            without: 1e3 * flat_spent * flat_square / 0.01f64.powi(2),
            with: 1e3 * spent * mean_square / 0.01f64.powi(2),
            changes: format!("nothing but noise; {:.0} paths a value", paths as f64 / out.len() as f64),
        })
    }

    /// Half of the points count for nothing.
    fn zero_weights(&self, control: &Control<'_>) -> Result<Saving, Error> {
        let mut weights = vec![1.0; self.points.len() * 3];
        weights.iter_mut().skip(self.points.len() / 2 * 3).for_each(|w| *w = 0.0);
        let few: Vec<f32> = weights.iter().copied().filter(|w| *w != 0.0).collect();
        let half = self.points.len() / 2;
        let (_, all) = self.pullback(self.points, &vec![1.0; weights.len()], None, 4.0, control)?;
        // The mean is over all values of the call: twice the paths for half of them.
        let (with_zeros, spent) = self.pullback(self.points, &weights, None, 2.0, control)?;
        let (alone, _) = self.pullback(&self.points[..half], &few, None, 4.0, control)?;
        Ok(Saving {
            what: "paths of points whose derivative has no weight".into(),
            object: self.scene.name(),
            unit: "us a point and channel of all, half of them without weight".into(),
            without: 1e6 * all / (self.points.len() * 3) as f64,
            with: 1e6 * spent / (self.points.len() * 3) as f64,
            changes: match with_zeros == alone {
                true => "nothing".into(),
                false => format!("the derivative's norm by {:+.1e}", (with_zeros / alone).sqrt() - 1.0),
            },
        })
    }

    /// Derivatives by voxels that are not arranged.
    fn unwanted_voxels(&self, control: &Control<'_>) -> Result<Saving, Error> {
        let weights = vec![1.0; self.points.len() * 3];
        let (all, without) = self.pullback(self.points, &weights, None, 4.0, control)?;
        let (near, with) = self.pullback(self.points, &weights, Some(COLORED_MM), 4.0, control)?;
        Ok(Saving {
            what: "voxels deeper than materials are arranged".into(),
            object: self.scene.name(),
            unit: "us a point and channel, derivative".into(),
            without: 1e6 * without / weights.len() as f64,
            with: 1e6 * with / weights.len() as f64,
            changes: match all == near {
                true => "nothing".into(),
                false => format!("the others' norm by {:+.1e}", (near / all).sqrt() - 1.0),
            },
        })
    }

    /// The sum of squares of the wanted derivatives, and the time of a run.
    fn pullback(
        &self,
        points: &[u32],
        weights: &[f32],
        depth_mm: Option<f64>,
        paths: f32,
        control: &Control<'_>,
    ) -> Result<(f64, f64), Error> {
        let tracer = self.tracer(1, Tracking::Auto)?;
        let options = AdjointOptions { paths, ..AdjointOptions::default() };
        time(|| {
            let mut near = Near { scene: self.scene, depth_mm, squares: 0.0 };
            tracer.pullback(points, 1, weights, &options, &mut near, control)?;
            Ok(near.squares)
        })
    }

    fn each(&self, seconds: f64) -> f64 {
        1e6 * seconds / (self.points.len() * 3) as f64 / f64::from(SPP)
    }
}
