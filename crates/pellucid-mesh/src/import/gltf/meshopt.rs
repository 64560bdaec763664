//! Buffer views that meshopt compressed (`EXT_meshopt_compression`, `KHR_meshopt_compression`).

use meshoptimizer_rs::codec::{self, BufferView as Layout, Filter, Mode};
use meshoptimizer_rs::{Error, Limits, Workspace};

use super::REEXPORT;
use super::extensions::UNCOMPRESSED;
use super::schema::{BufferView, Meshopt};
use crate::MeshError;
use crate::import::source::{Source, quoted};

/// The bytes of a compressed view, charged to the limit on all files before they are allocated.
pub(super) fn decode(
    source: &Source,
    object: &str,
    view: &BufferView,
    compression: &Meshopt,
    bytes: &[u8],
) -> Result<Vec<u8>, MeshError> {
    let unknown = |what: &str, name: &str| {
        source.unsupported(
            object,
            format!("meshopt compression of the {what} {}", quoted(name)),
            UNCOMPRESSED,
        )
    };
    let mode = Mode::parse(&compression.mode).map_err(|_| unknown("mode", &compression.mode))?;
    let name = compression.filter.as_deref().unwrap_or("NONE");
    // Of the KHR extension alone, as the second version of the vertex codec is.
    let is_color = name == "COLOR" && mode == Mode::Attributes;
    let filter = match is_color {
        true => Filter::None,
        false => Filter::parse(name).map_err(|_| unknown("filter", name))?,
    };
    let invalid = |error: Error| {
        source.invalid(object, format!("its meshopt compression is damaged: {error}"), REEXPORT)
    };
    let layout = Layout::new(mode, filter, compression.count, compression.byte_stride).map_err(invalid)?;
    layout.validate_parent(view.byte_length, view.byte_stride).map_err(invalid)?;
    let budget = source.budget.get();
    let Some(left) = budget.checked_sub(layout.byte_length() as u64) else {
        let reason = format!("it takes {} bytes decompressed; {budget} are left", layout.byte_length());
        return Err(source.unsupported(
            object,
            reason,
            "simplify the model or raise ImportLimits::file_bytes",
        ));
    };
    let limits = Limits { max_bytes: layout.byte_length().saturating_add(SCRATCH), ..Limits::default() };
    let mut workspace = Workspace::new(limits);
    let (count, stride) = (compression.count, compression.byte_stride);
    let decoded = match mode {
        Mode::Attributes => codec::decode_vertex_buffer(count, stride, bytes, &mut workspace),
        Mode::Triangles => codec::decode_index_buffer(count, stride, bytes, &mut workspace),
        Mode::Indices => codec::decode_index_sequence(count, stride, bytes, &mut workspace),
    };
    let mut decoded = decoded.map_err(invalid)?;
    let filtered = match filter {
        Filter::None if is_color => codec::decode_filter_color(&mut decoded, count, stride, &mut workspace),
        Filter::None => Ok(()),
        Filter::Octahedral => codec::decode_filter_oct(&mut decoded, count, stride, &mut workspace),
        Filter::Quaternion => codec::decode_filter_quat(&mut decoded, count, stride, &mut workspace),
        Filter::Exponential => codec::decode_filter_exp(&mut decoded, count, stride, &mut workspace),
    };
    filtered.map_err(invalid)?;
    source.budget.set(left);
    Ok(decoded)
}

/// What the decoder may take beside its output.
const SCRATCH: usize = 1 << 20;
