//! The print as a textured model, for printers that mix inks by themselves.

use std::path::Path;

use pellucid_core::staging::{OwnFiles, StagedDir};
use pellucid_mesh::bake::{BakeOptions, SurfacePoint, TexturedMesh};
use pellucid_mesh::export::{self, MeshFormat};
use pellucid_mesh::{Model, PlacedMesh};
use pellucid_voxel::Surface;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::job::prepared::{REPORT_FILE, write_report};
use crate::stage::Stage;
use crate::{ModelRecord, Monitor, Prepared, PrintError, PrintJob, Report};

/// Name of the model's files, without their ends.
const STEM: &str = "textured";
/// How far around a texel surface voxels give it colour, in voxels.
const REACH: f64 = 1.75;
/// Cosine between a voxel's and the mesh's normal from which both are of one side.
const SAME_SIDE: f64 = 0.1;

/// A compensated texture, in a report.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct TextureReport {
    /// The model's files.
    pub files: Vec<String>,
    /// Width and height of the texture.
    pub size: [u32; 2],
    /// Whether the model's own UV map was kept; otherwise it has a new one.
    pub own_uv_map: bool,
    /// By how much of itself the mean CIEDE2000 to the printable target over 0.1 mm is predicted to fall, beside the
    /// texture printed as it was.
    pub gain: f64,
}

/// What a folder of a compensated texture consists of; only such a folder is ever replaced.
pub fn own_texture_files() -> OwnFiles {
    let pattern = format!("{STEM}.*");
    OwnFiles::new([REPORT_FILE, "proof.png", "proof.exr", "error.png", &pattern])
        .marked_by(REPORT_FILE, is_texture_report)
}

fn is_texture_report(bytes: &[u8]) -> bool {
    serde_json::from_slice::<Value>(bytes)
        .is_ok_and(|v| v.get("record").is_some() && v.get("texture").is_some_and(Value::is_object))
}

impl PrintJob {
    /// Tells before any work whether [`Prepared::write_texture`] would refuse folder, format or strategy. Changes
    /// nothing.
    ///
    /// # Errors
    /// [`PrintError::Staging`] when the folder exists and may not be replaced, [`PrintError::Invalid`] for another
    /// strategy, [`PrintError::Unsupported`] for a format that this build cannot write.
    pub fn check_texture_output(
        &self,
        dir: &Path,
        format: MeshFormat,
        force: bool,
    ) -> Result<(), PrintError> {
        if self.settings().strategy != crate::StrategyKind::SurfaceColor {
            let reason = format!("{:?} changes more than surface colours", self.settings().strategy.name());
            return Err(PrintError::invalid(
                "strategy",
                format!("{reason}; a texture needs \"surface-color\""),
            ));
        }
        if !format.is_available() {
            let fault = pellucid_core::Fault::new("texture format", "this build cannot write 3MF");
            return Err(PrintError::Unsupported(
                fault.remedy("build with the cargo feature 3mf, or take another"),
            ));
        }
        Ok(pellucid_core::staging::check(dir, force, &own_texture_files())?)
    }
}

impl Prepared {
    /// Bakes the compensated colours into a texture of the model that was prepared with
    /// [`StrategyKind::SurfaceColor`](crate::StrategyKind::SurfaceColor).
    ///
    /// # Errors
    /// [`PrintError::Invalid`] for another model or strategy, [`PrintError::Mesh`], [`PrintError::Cancelled`].
    pub fn bake(&self, model: &Model, monitor: &Monitor<'_>) -> Result<TexturedMesh, PrintError> {
        if ModelRecord::of(model).digest != self.record.model.digest {
            return Err(PrintError::invalid("model", "it is not the one that was prepared"));
        }
        let Some(colors) = &self.refined.colors else {
            return Err(PrintError::invalid(
                "strategy",
                "it moved more than surface colours; prepare with \"surface-color\"",
            ));
        };
        let settings = &self.record.settings;
        let mesh = PlacedMesh::new(model, settings.scale)?;
        let surface = self.aimed.object.surface();
        let white = if settings.absolute { self.aimed.viewing.media_white() } else { [1.0; 3] };
        let [x, y, _] = surface.frame().pitch().mm();
        let options = BakeOptions { texel_mm: (x * y).sqrt(), ..BakeOptions::default() };
        monitor.run(Stage::Texture, |control| {
            let color = |at: &SurfacePoint| match around(surface, colors, at) {
                Some(rgb) => std::array::from_fn(|c| rgb[c] * white[c]),
                None => model.color_at(at.triangle, at.barycentric, at.footprint_m),
            };
            Ok(mesh.bake(&options, color, control)?)
        })
    }

    /// Writes the model with its compensated texture (`textured.glb`, or as [`MeshFormat::files`]), `report.json`,
    /// `proof.png`, `proof.exr` and `error.png` into the folder `dir`, which appears complete or not at all, and returns
    /// the report. The model has the print's size.
    ///
    /// # Errors
    /// As [`Prepared::bake`] and [`Prepared::write`].
    pub fn write_texture(
        &self,
        dir: &Path,
        model: &Model,
        format: MeshFormat,
        force: bool,
        monitor: &Monitor<'_>,
    ) -> Result<Report, PrintError> {
        let staged = StagedDir::begin(dir, force, &own_texture_files())?;
        let baked = self.bake(model, monitor)?;
        export::write(&baked, format, staged.path(), STEM)?;
        monitor.run(Stage::Proof, |c| self.write_pictures(staged.path(), c))?;
        let mean = |errors: &pellucid_refine::StateErrors| errors.at_0_1_mm.printable.mean;
        let (before, after) =
            (mean(&self.judged.evaluation.unrefined), mean(&self.judged.evaluation.refined));
        let report = Report {
            texture: Some(TextureReport {
                files: format.files(STEM),
                size: baked.size,
                own_uv_map: baked.own_uv_map,
                gain: if before > 0.0 { 1.0 - after / before } else { 0.0 },
            }),
            ..self.report(monitor)
        };
        write_report(&report, staged.path())?;
        staged.commit()?;
        Ok(report)
    }
}

/// Mean colour of the surface voxels around a place on the mesh, the near ones counting most; `None` where there are
/// none.
fn around(surface: &Surface, colors: &[[f32; 3]], at: &SurfacePoint) -> Option<[f32; 3]> {
    let frame = surface.frame();
    let (pitch, centre) = (frame.pitch().mm(), frame.voxel_at(at.position_mm));
    let reach = REACH.ceil() as i64;
    // First those of the same side, then, where normals tell nothing, any.
    for same_side in [true, false] {
        let (mut sum, mut total) = ([0.0f64; 3], 0.0);
        for dz in -reach..=reach {
            for dy in -reach..=reach {
                for dx in -reach..=reach {
                    let voxel = [centre[0] + dx, centre[1] + dy, centre[2] + dz];
                    let Some(inside) = within(voxel, frame.size()) else { continue };
                    let Some(point) = surface.index_of(inside) else { continue };
                    let off = frame.centre_mm(voxel);
                    let squared: f64 =
                        (0..3).map(|a| ((off[a] - at.position_mm[a]) / pitch[a]).powi(2)).sum();
                    let normal = surface.normals()[point as usize];
                    let facing: f64 = (0..3).map(|a| f64::from(normal[a]) * at.normal[a]).sum();
                    let near = 1.0 - squared / (REACH * REACH);
                    if near > 0.0 && (!same_side || facing > SAME_SIDE) {
                        let weight = near * near;
                        (0..3).for_each(|c| sum[c] += weight * f64::from(colors[point as usize][c]));
                        total += weight;
                    }
                }
            }
        }
        if total > 0.0 {
            return Some(sum.map(|v| (v / total) as f32));
        }
    }
    None
}

fn within(voxel: [i64; 3], size: [u32; 3]) -> Option<[u32; 3]> {
    let inside = (0..3).all(|a| (0..i64::from(size[a])).contains(&voxel[a]));
    inside.then(|| voxel.map(|v| v as u32))
}
