//! The whole state of a run as one file.

use std::collections::HashMap;
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors, TensorView, serialize};

use super::trainer::State;
use super::{Curve, TrainSettings, Trainer};
use crate::adamw::AdamW;
use crate::file::{read_bounded, write_whole};
use crate::{RpnnError, Weights};

const FORMAT: &str = "pellucid-rpnn-run-1";
/// Four vectors of the largest variant take 60 MB, a curve of a million rows 200 MB.
const MAX_BYTES: u64 = 512 << 20;
const TENSORS: [&str; 4] = ["weights", "average", "first", "second"];

#[derive(serde::Serialize, serde::Deserialize)]
struct Header {
    format: String,
    settings: TrainSettings,
    step: u64,
    pending: (f64, u64),
    seconds: f64,
    curve: Curve,
}

impl Trainer {
    /// Writes the state, by way of a temporary file beside `path`.
    ///
    /// # Errors
    /// [`RpnnError::Io`] when the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), RpnnError> {
        let io = |reason: String| RpnnError::Io { path: path.to_owned(), reason };
        let header = Header {
            format: FORMAT.to_owned(),
            settings: self.settings().clone(),
            step: self.steps_done(),
            pending: self.pending(),
            seconds: self.seconds(),
            curve: self.curve().clone(),
        };
        // One entry: a map's order would change the bytes from run to run.
        let header = serde_json::to_string(&header).map_err(|e| io(e.to_string()))?;
        let header = HashMap::from([("run".to_owned(), header)]);
        let optimiser = self.optimiser();
        let values = [self.weights().values(), &optimiser.average, &optimiser.first, &optimiser.second];
        let bytes = values.map(|v| v.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>());
        let views = TENSORS
            .iter()
            .zip(&bytes)
            .map(|(name, bytes)| Ok((name, TensorView::new(Dtype::F32, vec![bytes.len() / 4], bytes)?)))
            .collect::<Result<Vec<_>, safetensors::SafeTensorError>>()
            .map_err(|e| io(e.to_string()))?;
        write_whole(path, &serialize(views, Some(header)).map_err(|e| io(e.to_string()))?)
    }

    /// Reads a state and goes on from it.
    ///
    /// # Errors
    /// [`RpnnError::Io`] when the file cannot be read or is damaged, [`RpnnError::Unsupported`] when it is
    /// another format's.
    pub fn resume(path: &Path) -> Result<Self, RpnnError> {
        let io = |reason: String| RpnnError::Io { path: path.to_owned(), reason };
        let bytes = read_bounded(path, MAX_BYTES)?;
        let (_, metadata) = SafeTensors::read_metadata(&bytes).map_err(|e| io(e.to_string()))?;
        let fields = metadata.metadata().clone().unwrap_or_default();
        let header = fields.get("run").ok_or_else(|| io("the field \"run\" is missing".into()))?;
        let header: Header = serde_json::from_str(header).map_err(|e| io(format!("field \"run\": {e}")))?;
        if header.format != FORMAT {
            return Err(RpnnError::Unsupported {
                path: path.to_owned(),
                field: "format".into(),
                reason: format!("{:?}; this version reads {FORMAT}", header.format),
            });
        }
        header.settings.check()?;
        let tensors = SafeTensors::deserialize(&bytes).map_err(|e| io(e.to_string()))?;
        let parameters = header.settings.variant.parameters();
        let read = |name: &str| -> Result<Vec<f32>, RpnnError> {
            let tensor = tensors.tensor(name).map_err(|e| io(format!("{name}: {e}")))?;
            if tensor.dtype() != Dtype::F32 || tensor.shape() != [parameters] {
                return Err(io(format!("{name} is {:?} {:?}", tensor.dtype(), tensor.shape())));
            }
            let chunks = tensor.data().as_chunks::<4>().0;
            let values: Vec<f32> = chunks.iter().map(|b| f32::from_le_bytes(*b)).collect();
            if values.iter().any(|v| !v.is_finite()) {
                return Err(io(format!("{name} holds values that are not finite")));
            }
            Ok(values)
        };
        let [weights, average, first, second] = TENSORS;
        let mut optimiser = AdamW::new(header.settings.optimiser, &read(average)?);
        optimiser.step = header.step;
        optimiser.first = read(first)?;
        optimiser.second = read(second)?;
        let state = State {
            weights: Weights::new(header.settings.variant, read(weights)?)?,
            optimiser,
            curve: header.curve,
            pending: header.pending,
            seconds: header.seconds,
        };
        Self::from_state(header.settings, state)
    }
}
