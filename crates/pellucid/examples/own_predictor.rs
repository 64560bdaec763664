//! A predictor of a tool's own in place of the path tracer: here a fast and crude one, the mean albedo about a point. The
//! suite of `pellucid-predict` (`conformance`) tells whether such a predictor keeps what the interface promises.
//!
//! `cargo run --release -p pellucid --example own_predictor -- model.glb 8`

use std::path::Path;
use std::sync::Arc;

use pellucid::core::{Control, InstructionSet};
use pellucid::mesh::{ImportLimits, Scale, import_path};
use pellucid::predict::{
    BoundPredictor, Capabilities, Changed, Diagnostics, Draw, Identity, Object, PredictError, Predictor,
};
use pellucid::voxel::LabelGrid;
use pellucid::{Monitor, PrintJob, PrintSettings, StrategyKind, Workspace};

/// Shows the mean albedo of the solid voxels within so many voxels.
pub struct MeanAlbedo {
    /// Half the box's edge in voxels.
    pub reach: i64,
}

struct Bound {
    reach: i64,
    object: Arc<Object>,
    labels: Option<LabelGrid>,
}

impl Predictor for MeanAlbedo {
    fn identity(&self) -> Identity {
        Identity::new("mean albedo", InstructionSet::Portable, true).with("reach", self.reach)
    }

    fn supports(&self, _: &Object) -> Result<Capabilities, PredictError> {
        // No random error.
        Ok(Capabilities::new(false))
    }

    fn bind(&self, object: Arc<Object>) -> Result<Box<dyn BoundPredictor>, PredictError> {
        Ok(Box::new(Bound { reach: self.reach, object, labels: None }))
    }
}

impl BoundPredictor for Bound {
    fn update(&mut self, labels: &LabelGrid, _: Changed<'_>, _: &Control<'_>) -> Result<(), PredictError> {
        self.object.check_labels(labels)?;
        self.labels = Some(labels.clone());
        Ok(())
    }

    fn predict(
        &self,
        points: &[u32],
        _: Draw,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<Diagnostics, PredictError> {
        control.check()?;
        self.object.check_points(points, out.len())?;
        let labels =
            self.labels.as_ref().ok_or_else(|| PredictError::invalid("labels", "none were given"))?;
        let materials = self.object.materials();
        for (values, &point) in out.chunks_exact_mut(materials.channels()).zip(points) {
            let at = self.object.surface().voxels()[point as usize].map(i64::from);
            let about = |a: usize| at[a] - self.reach..=at[a] + self.reach;
            let (mut sums, mut count) = (vec![0.0; values.len()], 0.0);
            for z in about(2) {
                for y in about(1) {
                    for label in about(0).map(|x| labels.at([x, y, z])).filter(|label| *label != 0) {
                        sums.iter_mut().zip(0..).for_each(|(s, c)| *s += materials.albedo(label, c));
                        count += 1.0;
                    }
                }
            }
            values.iter_mut().zip(sums).for_each(|(value, sum)| *value = 0.8 * sum / count);
        }
        Ok(Diagnostics::default())
    }
}

/// Refines a model by it; mean differences of single voxels before and after, as paths judge them.
pub fn refine(
    model: &Path,
    height_mm: f64,
    settings: PrintSettings,
) -> Result<[f64; 2], Box<dyn std::error::Error>> {
    // Without derivatives there is the strategy that needs none.
    let job = PrintJob::new(PrintSettings {
        scale: Scale::HeightMm(height_mm),
        strategy: StrategyKind::SurfaceFirst,
        ..settings
    })?;
    let model = import_path(model, &ImportLimits::default())?;
    let predictor = MeanAlbedo { reach: 2 };
    let prepared = job.prepare_with(&predictor, &model, &Workspace::none(), &Monitor::silent())?;
    let evaluation = &prepared.judged.evaluation;
    Ok([&evaluation.unrefined, &evaluation.refined].map(|e| e.voxel.printable.mean))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [model, height_mm] = &arguments[..] else {
        return Err("own_predictor MODEL HEIGHT_MM".into());
    };
    let [before, after] = refine(model.as_ref(), height_mm.parse()?, PrintSettings::default())?;
    println!("mean dE2000, judged by paths: {before:.1} unrefined, {after:.1} refined");
    Ok(())
}
