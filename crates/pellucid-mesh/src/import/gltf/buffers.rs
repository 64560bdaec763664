//! The bytes of buffers and buffer views, loaded when first needed.

use std::borrow::Cow;
use std::cell::OnceCell;

use super::REEXPORT;
#[cfg(not(feature = "meshopt"))]
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
    /// Decompressed buffer views.
    #[cfg(feature = "meshopt")]
    decompressed: Vec<OnceCell<Vec<u8>>>,
}

impl<'a> Buffers<'a> {
    pub fn new(source: &'a Source<'a>, root: &'a Root, binary: Option<&'a [u8]>) -> Self {
        Self {
            source,
            root,
            binary,
            loaded: root.buffers.iter().map(|_| OnceCell::new()).collect(),
            #[cfg(feature = "meshopt")]
            decompressed: root.buffer_views.iter().map(|_| OnceCell::new()).collect(),
        }
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
        let object = format!("{object}, buffer view {index}");
        match view.extensions.meshopt() {
            None => Ok((view, self.range(&object, view.buffer, view.byte_offset, view.byte_length)?)),
            #[cfg(feature = "meshopt")]
            Some(compression) => {
                let cell = &self.decompressed[index];
                if let Some(bytes) = cell.get() {
                    return Ok((view, bytes));
                }
                let bytes = self.range(
                    &object,
                    compression.buffer,
                    compression.byte_offset,
                    compression.byte_length,
                )?;
                let bytes = super::meshopt::decode(self.source, &object, view, compression, bytes)?;
                Ok((view, cell.get_or_init(|| bytes)))
            }
            #[cfg(not(feature = "meshopt"))]
            Some(_) => Err(extensions::refuse_compressed_view(self.source, &object)),
        }
    }

    /// Some bytes of a buffer.
    fn range(&self, object: &str, buffer: usize, offset: usize, length: usize) -> Result<&[u8], MeshError> {
        let bytes = self.buffer(object, buffer)?;
        offset.checked_add(length).and_then(|end| bytes.get(offset..end)).ok_or_else(|| {
            let reason = format!(
                "bytes {offset} and {length} following are past the end of buffer {buffer}, which has {}",
                bytes.len()
            );
            self.source.invalid(object, reason, REEXPORT)
        })
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
