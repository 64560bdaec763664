//! The bytes of buffers and buffer views, loaded when first needed.

use std::borrow::Cow;
use std::cell::OnceCell;

use super::REEXPORT;
use super::extensions;
use super::schema::{BufferView, Root};
use crate::MeshError;
use crate::import::source::{Source, label};
use crate::import::uri;

/// All buffers of a model.
pub(super) struct Buffers<'a> {
    source: &'a Source<'a>,
    root: &'a Root,
    binary: Option<&'a [u8]>,
    loaded: Vec<OnceCell<Cow<'a, [u8]>>>,
}

impl<'a> Buffers<'a> {
    pub fn new(source: &'a Source<'a>, root: &'a Root, binary: Option<&'a [u8]>) -> Self {
        Self { source, root, binary, loaded: root.buffers.iter().map(|_| OnceCell::new()).collect() }
    }

    pub fn source(&self) -> &'a Source<'a> {
        self.source
    }

    pub fn root(&self) -> &'a Root {
        self.root
    }

    /// The bytes of a URI, counted against the limit on all of them.
    pub fn load_uri(&self, object: &str, uri: &str) -> Result<Vec<u8>, MeshError> {
        uri::load(self.source, object, uri)
    }

    /// A buffer view and its bytes; `object` is what refers to it.
    pub fn view(&self, object: &str, index: usize) -> Result<(&'a BufferView, &[u8]), MeshError> {
        let Some(view) = self.root.buffer_views.get(index) else {
            return Err(self.source.invalid(
                object,
                format!("buffer view {index} does not exist, there are {}", self.root.buffer_views.len()),
                REEXPORT,
            ));
        };
        extensions::refuse_compressed_view(self.source, object, view)?;
        let object = || format!("{object}, buffer view {index}");
        let buffer = self.buffer(&object(), view.buffer)?;
        let end = view.byte_offset.checked_add(view.byte_length);
        let Some(bytes) = end.and_then(|end| buffer.get(view.byte_offset..end)) else {
            return Err(self.source.invalid(
                object(),
                format!(
                    "bytes {} and {} following are past the end of buffer {}, which has {}",
                    view.byte_offset,
                    view.byte_length,
                    view.buffer,
                    buffer.len()
                ),
                REEXPORT,
            ));
        };
        Ok((view, bytes))
    }

    fn buffer(&self, object: &str, index: usize) -> Result<&[u8], MeshError> {
        let (Some(buffer), Some(cell)) = (self.root.buffers.get(index), self.loaded.get(index)) else {
            return Err(self.source.invalid(
                object,
                format!("buffer {index} does not exist, there are {}", self.loaded.len()),
                REEXPORT,
            ));
        };
        if let Some(bytes) = cell.get() {
            return Ok(bytes);
        }
        let object = label("buffer", index, None);
        let bytes: Cow<'a, [u8]> = match (&buffer.uri, self.binary) {
            (Some(uri), _) => self.load_uri(&object, uri)?.into(),
            (None, Some(binary)) if index == 0 => binary.into(),
            (None, _) => {
                return Err(self.source.invalid(
                    object,
                    "it has neither a URI nor the GLB's binary chunk",
                    "the file is damaged or its data is compressed; export it again as .glb without compression",
                ));
            }
        };
        if bytes.len() < buffer.byte_length {
            return Err(self.source.invalid(
                object,
                format!("it claims {} bytes, {} are there", buffer.byte_length, bytes.len()),
                "the file is damaged or cut short; export or download it again",
            ));
        }
        let bytes = match bytes {
            Cow::Borrowed(b) => Cow::Borrowed(&b[..buffer.byte_length]),
            Cow::Owned(mut b) => {
                b.truncate(buffer.byte_length);
                Cow::Owned(b)
            }
        };
        Ok(cell.get_or_init(|| bytes))
    }
}
