//! A predictor and an ink model of a tool's own, and a foreign tool's slices.

use std::path::Path;
use std::sync::Arc;

use pellucid::core::{Control, InstructionSet};
use pellucid::predict::{
    BoundPredictor, Capabilities, Changed, Diagnostics, Draw, Identity, Object, PredictError, Predictor,
};
use pellucid::refine::InkModel;
use pellucid::voxel::LabelGrid;

/// Sees the albedo of a voxel, and of the next one along x by a share.
pub struct Bleed {
    share: f32,
}

impl Bleed {
    pub fn new(share: f32) -> Self {
        Self { share }
    }
}

impl Predictor for Bleed {
    fn identity(&self) -> Identity {
        Identity::new("bleed", InstructionSet::Portable, true).with("share", self.share)
    }

    fn supports(&self, _: &Object) -> Result<Capabilities, PredictError> {
        Ok(Capabilities::new(false))
    }

    fn bind(&self, object: Arc<Object>) -> Result<Box<dyn BoundPredictor>, PredictError> {
        Ok(Box::new(BoundBleed { share: self.share, object, labels: None }))
    }
}

struct BoundBleed {
    share: f32,
    object: Arc<Object>,
    labels: Option<LabelGrid>,
}

impl BoundPredictor for BoundBleed {
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
            let [x, y, z] = self.object.surface().voxels()[point as usize];
            let own = labels.get([x, y, z]);
            let next = match labels.get([x.saturating_sub(1), y, z]) {
                0 => own,
                label => label,
            };
            for (channel, value) in values.iter_mut().enumerate() {
                let albedo = |label| 0.8 * materials.albedo(label, channel);
                *value = (1.0 - self.share) * albedo(own) + self.share * albedo(next);
            }
        }
        Ok(Diagnostics::default())
    }
}

/// Greys only.
pub struct BlackAndWhite {
    pub black: u8,
    pub white: u8,
}

impl InkModel for BlackAndWhite {
    fn labels(&self) -> &[u8] {
        // Most absorbing first, white last.
        if self.black == 4 && self.white == 5 { &[4, 5] } else { &[1, 2] }
    }

    fn fractions(&self, rgb: [f32; 3], fractions: &mut [f32]) -> [f32; 3] {
        let light = (rgb.iter().sum::<f32>() / 3.0).clamp(0.05, 1.0);
        fractions.copy_from_slice(&[1.0 - light, light]);
        self.color(fractions)
    }

    fn color(&self, fractions: &[f32]) -> [f32; 3] {
        [0.05 + 0.95 * fractions[1]; 3]
    }
}

/// A stack of plain RGB pictures as another tool writes them: a cyan block with a magenta face, in white.
pub fn foreign_stack(prefix: &Path) -> std::io::Result<tempfile::TempDir> {
    let folder = tempfile::tempdir()?;
    let (width, height) = (24u32, 12u32);
    for z in 0..30 {
        let file = folder.path().join(format!("{}{z}.png", prefix.display()));
        let mut encoder = png::Encoder::new(std::fs::File::create(file)?, width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let pixel = |x: u32, y: u32| match (x, y) {
            (2..=21, 2) => [236, 0, 140],
            (2..=4, 3..=9) => [0, 174, 239],
            (5..=21, 3..=9) => [255, 255, 255],
            _ => [0, 0, 0],
        };
        let data: Vec<u8> = (0..width * height).flat_map(|i| pixel(i % width, i / width)).collect();
        encoder.write_header()?.write_image_data(&data)?;
    }
    Ok(folder)
}
