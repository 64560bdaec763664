//! The proof as one page: a file that any browser opens from the disk, without a request.

mod figures;
mod pack;
mod slices;
mod surface;

use std::path::Path;

use pellucid_core::{Control, files};
use pellucid_voxel::{LabelGrid, Surface};
use serde::Serialize;
use serde_json::Value;

use crate::{ProofError, SurfaceMesh, false_color};
use figures::Facts;
use pack::base64;
use slices::PackedSlices;
use surface::PackedSurface;

pub use surface::{FieldValues, PageField};

/// Colours of the scale that quantities are shown in.
const SCALE_STEPS: usize = 33;

const TEMPLATE: &str = include_str!("assets/page.html.jinja");
const STYLE: &str = include_str!("assets/style.css");
/// One program, in the order in which its parts need each other.
const SCRIPT: [&str; 7] = [
    include_str!("assets/data.js"),
    include_str!("assets/color.js"),
    include_str!("assets/shaders.js"),
    include_str!("assets/viewer.js"),
    include_str!("assets/layers.js"),
    include_str!("assets/charts.js"),
    include_str!("assets/page.js"),
];

/// How much a page may hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PageSize {
    /// Vertices of the surface; with the nine fields of a prepared print each takes about 20 bytes of the page. Of larger
    /// objects the mesh is coarser.
    pub most_vertices: usize,
    /// Bytes of the slices before they are written as text, which takes a third more. Where all of them need more, the
    /// page holds every second, third and so on.
    pub most_slice_bytes: u64,
}

impl Default for PageSize {
    fn default() -> Self {
        Self { most_vertices: 250_000, most_slice_bytes: 4 << 20 }
    }
}

/// A proof page: surface and slices packed, and ready for the figures of a report.
///
/// ```
/// use pellucid_proof::page::{FieldValues, PageField, PageSize, ProofPage};
/// use pellucid_voxel::{Control, Frame, LabelGrid, Pitch, Surface, SurfaceOptions};
/// let frame = Frame::new([0.0; 3], Pitch::j750(), [24, 12, 36])?;
/// let grid = LabelGrid::from_fn(frame, |_| 5);
/// let none = Control::none();
/// let surface = Surface::extract(&grid, &SurfaceOptions::default(), &none)?;
/// let colors = vec![[0.8, 0.4, 0.1]; surface.len()];
/// let fields = [PageField { key: "refined", label: "Refined", under: None, values: FieldValues::Colors(&colors) }];
/// let page = ProofPage::new(&grid, &surface, &fields, true, PageSize::default(), &none)?;
/// let manifest = serde_json::json!({
///     "generator": "doc", "target": "j750", "pitch_mm": [0.0423, 0.0847, 0.027], "dpi": [600, 300, 940.7],
///     "size": [24, 12, 36], "layers": 36, "padding_layers": 0, "files": "slices/slice_%05d.png",
///     "orientation": "Layer 0 is the bottom.", "row_order": "highest_y_first", "background": [0, 0, 0, 0],
///     "materials": [{ "label": 5, "name": "white", "rgba": [255, 255, 255, 255], "voxels": 10368 }],
/// });
/// let html = page.render("block", &serde_json::Value::Null, &manifest)?;
/// assert!(html.starts_with("<!doctype html>") && html.contains("block"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct ProofPage {
    surface: PackedSurface,
    slices: Option<PackedSlices>,
}

/// What the page's program is told of its data.
#[derive(Serialize)]
struct Contents<'a> {
    surface: &'a surface::SurfaceIndex,
    slices: Option<&'a slices::SlicesIndex>,
    /// sRGB, 0 to 255, from the lower end to the upper.
    scale: Vec<[u8; 3]>,
}

impl ProofPage {
    /// Packs what is to be seen: `fields` of every surface voxel, and the slices of `labels`, whose images have the
    /// highest y in their top row where `highest_y_first`.
    ///
    /// # Errors
    /// [`ProofError::Invalid`] when a field has not one value a surface voxel, or as [`SurfaceMesh::build`];
    /// [`ProofError::Cancelled`].
    pub fn new(
        labels: &LabelGrid,
        surface: &Surface,
        fields: &[PageField<'_>],
        highest_y_first: bool,
        size: PageSize,
        control: &Control<'_>,
    ) -> Result<Self, ProofError> {
        let page = Self::of_surface(labels, surface, fields, size, control)?;
        page.with_slices(labels, highest_y_first, size, &control.silent())
    }

    /// The same with the slices of labels in the surface's frame: those that it was made of, or those with the clear resin
    /// around it.
    ///
    /// # Errors
    /// [`ProofError::Cancelled`].
    pub fn with_slices(
        self,
        labels: &LabelGrid,
        highest_y_first: bool,
        size: PageSize,
        control: &Control<'_>,
    ) -> Result<Self, ProofError> {
        let slices = PackedSlices::pack(labels, highest_y_first, size.most_slice_bytes, control)?;
        Ok(Self { slices: Some(slices), ..self })
    }

    /// [`ProofPage::new`] without slices: of what is not yet to be printed.
    ///
    /// # Errors
    /// As there.
    pub fn of_surface(
        labels: &LabelGrid,
        surface: &Surface,
        fields: &[PageField<'_>],
        size: PageSize,
        control: &Control<'_>,
    ) -> Result<Self, ProofError> {
        let silent = control.silent();
        control.report(0, 2);
        let mesh = SurfaceMesh::build(labels, surface, size.most_vertices, &silent)?;
        control.report(1, 2);
        let surface = PackedSurface::pack(&mesh, fields, &silent)?;
        control.report(2, 2);
        Ok(Self { surface, slices: None })
    }

    /// The page, named `title`, with the figures of a print's `report.json` and `manifest.json`, null where there is none.
    /// Every figure on it is one of theirs. A page with slices needs the manifest.
    ///
    /// # Errors
    /// [`ProofError::Invalid`] when report or manifest lack a figure that the page needs.
    pub fn render(&self, title: &str, report: &Value, manifest: &Value) -> Result<String, ProofError> {
        let scale = (0..SCALE_STEPS).map(|i| {
            let color = false_color(i as f32 / (SCALE_STEPS - 1) as f32);
            color.map(|v| pellucid_color::space::srgb_encode_u8(f64::from(v)))
        });
        let slices = self.slices.as_ref();
        let contents = Contents {
            surface: &self.surface.index,
            slices: slices.map(|s| &s.index),
            scale: scale.collect(),
        };
        let data = [
            ("contents", in_script(&serde_json::to_value(&contents).unwrap_or_default())),
            ("report", in_script(report)),
            ("manifest", in_script(manifest)),
            ("surface", base64(&self.surface.bytes)),
            ("slices", base64(slices.map_or(&[], |s| &s.bytes[..]))),
        ];
        Facts::new(report, manifest).render(TEMPLATE, title, STYLE, &SCRIPT.concat(), &data)
    }

    /// Writes [`ProofPage::render`] as a file, whole or not at all.
    ///
    /// # Errors
    /// As there; [`ProofError::Io`].
    pub fn write(
        &self,
        path: impl AsRef<Path>,
        title: &str,
        report: &Value,
        manifest: &Value,
    ) -> Result<(), ProofError> {
        Ok(files::write_whole_bytes(path, self.render(title, report, manifest)?.as_bytes())?)
    }
}

/// JSON that cannot end the script element around it.
fn in_script(value: &Value) -> String {
    value.to_string().replace('<', "\\u003c")
}

#[cfg(test)]
mod tests;
