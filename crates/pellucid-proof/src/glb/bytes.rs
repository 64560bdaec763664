//! The binary part of a GLB, and the whole.

use serde_json::{Value, json};

/// A buffer of views, each at a multiple of four bytes.
#[derive(Default)]
pub(super) struct Bytes {
    data: Vec<u8>,
    views: Vec<Value>,
}

impl Bytes {
    /// Adds a view and gives its number.
    pub fn view(&mut self, bytes: impl Iterator<Item = u8>, target: Option<u32>) -> usize {
        let start = self.data.len();
        self.data.extend(bytes);
        let mut view = json!({ "buffer": 0, "byteOffset": start, "byteLength": self.data.len() - start });
        if let Some(target) = target {
            view["target"] = target.into();
        }
        self.views.push(view);
        pad(&mut self.data, 0);
        self.views.len() - 1
    }

    /// All views.
    pub fn views(&self) -> Value {
        self.views.clone().into()
    }

    /// Bytes of the buffer.
    pub fn len(&self) -> usize {
        self.data.len()
    }

    /// Header, JSON and buffer.
    pub fn into_glb(self, json: &str) -> Vec<u8> {
        let mut json = json.as_bytes().to_vec();
        pad(&mut json, b' ');
        let length = 12 + 8 + json.len() + 8 + self.data.len();
        let mut out = Vec::with_capacity(length);
        out.extend(b"glTF");
        out.extend(2u32.to_le_bytes());
        out.extend((length as u32).to_le_bytes());
        for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &self.data)] {
            out.extend((chunk.len() as u32).to_le_bytes());
            out.extend(kind);
            out.extend(chunk);
        }
        out
    }
}

fn pad(bytes: &mut Vec<u8>, with: u8) {
    bytes.resize(bytes.len().next_multiple_of(4), with);
}
