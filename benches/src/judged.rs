//! Objects with reference radiances at some points.

use std::sync::Arc;

use pellucid::core::NoisyScore;
use pellucid::predict::Object;
use pellucid::trace::{Boundary, ErrorTarget, TraceOptions, Tracer, Volume};
use pellucid::voxel::{Control, LabelGrid, MaterialTable, Surface, near_order};

use crate::appearance::Error;

const INDEX: f64 = 1.5;
/// Standard error of a traced reference.
const STD_ERROR: f32 = 0.003;
const MOST_PATHS: u32 = 65_536;

/// An object with reference radiances at some points.
pub struct Judged {
    /// What it is called in tables.
    pub name: String,
    /// Surface and materials.
    pub object: Arc<Object>,
    /// Materials by voxel.
    pub labels: LabelGrid,
    /// The judged points: positions in the surface.
    pub points: Vec<u32>,
    /// Radiance there, `[point][channel]`.
    pub radiance: Vec<f32>,
    /// Its standard error, `[point][channel]`.
    pub std_error: Vec<f32>,
}

impl Judged {
    /// Adds the errors of radiances at the judged points.
    pub fn compare(&self, predicted: &[f32], score: &mut NoisyScore) {
        for ((p, r), e) in predicted.iter().zip(&self.radiance).zip(&self.std_error) {
            score.add_difference(f64::from(p - r), f64::from(*e).powi(2));
        }
    }

    /// Adds the errors of the judged points among `points`, whose radiance is `predicted`.
    pub fn compare_within(&self, points: &[u32], predicted: &[f32], score: &mut NoisyScore) {
        let (at, predicted) = self.within(points, predicted);
        for (p, i) in predicted.iter().zip(at) {
            let variance = f64::from(self.std_error[i]).powi(2);
            score.add_difference(f64::from(p - self.radiance[i]), variance);
        }
    }

    /// Of the values `[point][channel]` of some points those of judged points, and where the reference has each.
    pub fn within(&self, points: &[u32], values: &[f32]) -> (Vec<usize>, Vec<f32>) {
        let channels = self.object.channels();
        let mut place = vec![u32::MAX; self.object.surface().len()];
        (0..).zip(points).for_each(|(i, &p)| place[p as usize] = i);
        let known = self.points.iter().enumerate().filter(|(_, p)| place[**p as usize] != u32::MAX);
        let pairs = known.flat_map(|(i, &p)| {
            let at = place[p as usize] as usize;
            (0..channels).map(move |c| (i * channels + c, values[at * channels + c]))
        });
        pairs.unzip()
    }

    /// So many neighbouring points at most, the judged ones among them if the reference was traced for as many.
    pub fn near(&self, most: usize) -> Vec<u32> {
        let order = near_order(self.object.surface().voxels());
        order[..order.len().min(most)].to_vec()
    }

    /// Traces the reference of so many points (the second number), spread over so many neighbouring ones (the first).
    ///
    /// # Errors
    /// When the object cannot be traced, or `control` asks to stop.
    pub fn traced(
        name: &str,
        labels: LabelGrid,
        surface: Surface,
        [near, points]: [usize; 2],
        control: &Control<'_>,
    ) -> Result<Self, Error> {
        println!("tracing {name}: {} surface voxels", surface.len());
        let volume = Volume::new(&labels, &surface, control)?;
        let materials = MaterialTable::cmykw();
        let options = TraceOptions { boundary: Boundary::with_index(INDEX)?, ..TraceOptions::default() };
        let order = near_order(surface.voxels());
        let near = &order[..order.len().min(near)];
        let points: Vec<u32> = near.iter().copied().step_by((near.len() / points).max(1)).collect();
        let mut radiance = vec![0.0; points.len() * 3];
        let mut std_error = radiance.clone();
        let target = ErrorTarget { std_error: STD_ERROR, max_spp: MOST_PATHS };
        let tracer = Tracer::new(&volume, &materials, options)?;
        tracer.radiance_to(&points, 1, target, &mut radiance, &mut std_error, control)?;
        let object = Arc::new(Object::new(surface, materials, INDEX)?);
        Ok(Self { name: name.into(), object, labels, points, radiance, std_error })
    }
}
