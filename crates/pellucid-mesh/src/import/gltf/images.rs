//! The bytes of images, in files, data URIs and buffer views.

use super::REEXPORT;
use super::buffers::Buffers;
use crate::MeshError;
use crate::import::picture::{self, Decoded, Profiles};
use crate::import::source::label;

/// Decodes image `index`, charging its size to `budget` (bytes left for all textures).
pub(super) fn decode(buffers: &Buffers, index: usize, budget: &mut u64) -> Result<Decoded, MeshError> {
    let (source, root) = (buffers.source(), buffers.root());
    let Some(image) = root.images.get(index) else {
        return Err(source.invalid(
            label("image", index, None),
            format!("it does not exist, there are {}", root.images.len()),
            REEXPORT,
        ));
    };
    let object = label("image", index, image.name.as_deref());
    let loaded;
    let bytes = match (&image.uri, image.buffer_view) {
        (Some(uri), _) => {
            loaded = buffers.load_uri(&object, uri)?;
            &loaded[..]
        }
        (None, Some(view)) => buffers.view(&object, view)?.1,
        (None, None) => {
            return Err(source.invalid(object, "it has neither a URI nor a buffer view", picture::PLAIN));
        }
    };
    picture::decode(source, &object, bytes, Profiles::Ignored, budget)
}
