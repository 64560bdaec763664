//! The surface and its fields as bytes.

use pellucid_color::space::srgb_encode_u8;
use pellucid_core::{Control, FileError};
use serde::Serialize;

use super::pack::{byte_plane, deflate, planes};
use crate::{ProofError, SurfaceMesh};

/// Bytes that differences of 16-bit numbers take.
const POSITION_BYTES: usize = 3;
/// Bytes that differences of vertices' numbers take.
const INDEX_BYTES: usize = 4;

/// Something that every surface voxel has, to be seen on the page.
#[derive(Clone, Copy, Debug)]
pub struct PageField<'a> {
    /// Its name for the program: `refined`, `error` and so on.
    pub key: &'a str,
    /// Its name for people.
    pub label: &'a str,
    /// The light that it is seen under, where the page lets one choose; the first light's fields, and what no light
    /// changes, have none.
    pub under: Option<&'a str>,
    /// The values.
    pub values: FieldValues<'a>,
}

/// Values of a field, one a surface voxel.
#[derive(Clone, Copy, Debug)]
pub enum FieldValues<'a> {
    /// Linear RGB, shown as it is.
    Colors(&'a [[f32; 3]]),
    /// A quantity, shown in false colours.
    Quantity {
        /// From 0 on.
        values: &'a [f32],
        /// Upper end of what is kept; what is more counts as that. It is kept in 255 steps.
        most: f32,
        /// Upper end of the colours.
        shown: f32,
        /// Unit, such as `mm`.
        unit: &'a str,
    },
}

/// What the program must know to unpack.
#[derive(Clone, Debug, Serialize)]
pub(super) struct SurfaceIndex {
    vertices: usize,
    quads: usize,
    /// Positions are `low + step * n` in mm.
    low: [f64; 3],
    step: [f64; 3],
    cell_mm: [f64; 3],
    fields: Vec<FieldIndex>,
}

#[derive(Clone, Debug, Serialize)]
struct FieldIndex {
    key: String,
    label: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    under: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    quantity: Option<QuantityIndex>,
}

#[derive(Clone, Debug, Serialize)]
struct QuantityIndex {
    most: f32,
    shown: f32,
    unit: String,
}

/// A surface as bytes: positions by axis, quads by corner, fields by channel.
pub(super) struct PackedSurface {
    pub index: SurfaceIndex,
    pub bytes: Vec<u8>,
}

impl PackedSurface {
    pub fn pack(
        mesh: &SurfaceMesh,
        fields: &[PageField<'_>],
        control: &Control<'_>,
    ) -> Result<Self, ProofError> {
        let positions = mesh.positions_mm();
        let extreme = |axis: usize, from: f32, choose: fn(f32, f32) -> f32| {
            f64::from(positions.iter().map(|p| p[axis]).fold(from, choose))
        };
        let low = [0, 1, 2].map(|a| extreme(a, f32::INFINITY, f32::min));
        let high = [0, 1, 2].map(|a| extreme(a, f32::NEG_INFINITY, f32::max));
        let step: [f64; 3] = std::array::from_fn(|a| ((high[a] - low[a]) / 65_535.0).max(1e-9));
        let mut bytes = Vec::new();
        for axis in 0..3 {
            let number = |p: &[f32; 3]| ((f64::from(p[axis]) - low[axis]) / step[axis]).round() as u32;
            planes(positions.iter().map(number), POSITION_BYTES, &mut bytes);
        }
        for corner in 0..4 {
            planes(mesh.quads().iter().map(|quad| quad[corner]), INDEX_BYTES, &mut bytes);
        }
        let mut index = Vec::with_capacity(fields.len());
        for field in fields {
            control.check()?;
            index.push(field.pack(mesh, &mut bytes)?);
        }
        let index = SurfaceIndex {
            vertices: positions.len(),
            quads: mesh.quads().len(),
            low,
            step,
            cell_mm: mesh.cell_mm(),
            fields: index,
        };
        let bytes = deflate(&bytes).map_err(FileError::at("pack", "surface"))?;
        control.check()?;
        Ok(Self { index, bytes })
    }
}

impl PageField<'_> {
    fn pack(&self, mesh: &SurfaceMesh, bytes: &mut Vec<u8>) -> Result<FieldIndex, ProofError> {
        let quantity = match self.values {
            FieldValues::Colors(colors) => {
                let means = mesh.means(colors)?;
                for channel in 0..3 {
                    byte_plane(means.iter().map(|rgb| srgb_encode_u8(f64::from(rgb[channel]))), bytes);
                }
                None
            }
            FieldValues::Quantity { values, most, shown, unit } => {
                let values: Vec<[f32; 1]> = values.iter().map(|&v| [v]).collect();
                let step = |[v]: [f32; 1]| (255.0 * (v / most).clamp(0.0, 1.0)).round() as u8;
                byte_plane(mesh.means(&values)?.into_iter().map(step), bytes);
                Some(QuantityIndex { most, shown, unit: unit.into() })
            }
        };
        Ok(FieldIndex {
            key: self.key.into(),
            label: self.label.into(),
            under: self.under.map(Into::into),
            quantity,
        })
    }
}
