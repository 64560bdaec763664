//! The whole state of a run as one file.

use std::path::Path;

use pellucid_core::Fault;
use pellucid_core::files::{read_bounded, write_whole_bytes};
use safetensors::tensor::{Dtype, SafeTensors, TensorView, serialize};

use super::trainer::State;
use super::{Curve, TrainSettings, Trainer};
use crate::adamw::AdamW;
use crate::file::RUN;
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
        let unmade = |reason: String| RpnnError::in_file(path, format!("cannot be made: {reason}"), "");
        let header = Header {
            format: FORMAT.to_owned(),
            settings: self.settings().clone(),
            step: self.steps_done(),
            pending: self.pending(),
            seconds: self.seconds(),
            curve: self.curve().clone(),
        };
        // One entry: a map's order would change the bytes from run to run.
        let header = serde_json::to_string(&header).map_err(|e| unmade(e.to_string()))?;
        let header = [(RUN.to_owned(), header)].into_iter().collect();
        let optimiser = self.optimiser();
        let values = [self.weights().values(), &optimiser.average, &optimiser.first, &optimiser.second];
        let bytes = values.map(|v| v.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>());
        let views = TENSORS
            .iter()
            .zip(&bytes)
            .map(|(name, bytes)| Ok((name, TensorView::new(Dtype::F32, vec![bytes.len() / 4], bytes)?)))
            .collect::<Result<Vec<_>, safetensors::SafeTensorError>>()
            .map_err(|e| unmade(e.to_string()))?;
        Ok(write_whole_bytes(path, &serialize(views, Some(header)).map_err(|e| unmade(e.to_string()))?)?)
    }

    /// Reads a state and goes on from it.
    ///
    /// # Errors
    /// [`RpnnError::Io`] when the file cannot be read, [`RpnnError::Invalid`] when it is no checkpoint or a damaged
    /// one, [`RpnnError::Unsupported`] when it is another format's or asks for instructions that this processor
    /// lacks.
    pub fn resume(path: &Path) -> Result<Self, RpnnError> {
        let damaged = |reason: String| {
            let remedy = "give the run.safetensors of a training run, or start another run";
            RpnnError::in_file(path, reason, remedy)
        };
        let bytes = read_bounded(path, MAX_BYTES)?;
        let (_, metadata) = SafeTensors::read_metadata(&bytes).map_err(|e| damaged(e.to_string()))?;
        let fields = metadata.metadata().clone().unwrap_or_default();
        let header = fields.get(RUN).ok_or_else(|| damaged("is no checkpoint of a training run".into()))?;
        let header: Header =
            serde_json::from_str(header).map_err(|e| damaged(format!("field \"run\": {e}")))?;
        if header.format != FORMAT {
            let fault = Fault::new(format!("{}, format", path.display()), format!("{:?}", header.format));
            return Err(RpnnError::Unsupported(fault.remedy(format!("this version reads {FORMAT}"))));
        }
        header.settings.check()?;
        let tensors = SafeTensors::deserialize(&bytes).map_err(|e| damaged(e.to_string()))?;
        let parameters = header.settings.variant.layout(header.settings.head).parameters;
        let read = |name: &str| -> Result<Vec<f32>, RpnnError> {
            let tensor = tensors.tensor(name).map_err(|e| damaged(format!("{name}: {e}")))?;
            if tensor.dtype() != Dtype::F32 || tensor.shape() != [parameters] {
                return Err(damaged(format!("{name} is {:?} {:?}", tensor.dtype(), tensor.shape())));
            }
            let chunks = tensor.data().as_chunks::<4>().0;
            let values: Vec<f32> = chunks.iter().map(|b| f32::from_le_bytes(*b)).collect();
            if values.iter().any(|v| !v.is_finite()) {
                return Err(damaged(format!("{name} holds values that are not finite")));
            }
            Ok(values)
        };
        let [weights, average, first, second] = TENSORS;
        let mut optimiser = AdamW::new(header.settings.optimiser, &read(average)?);
        optimiser.step = header.step;
        optimiser.first = read(first)?;
        optimiser.second = read(second)?;
        let state = State {
            weights: Weights::new(header.settings.variant, header.settings.head, read(weights)?)?,
            optimiser,
            curve: header.curve,
            pending: header.pending,
            seconds: header.seconds,
        };
        Self::from_state(header.settings, state)
    }
}
