//! Weights as safetensors files whose header says what they were trained for.

use std::path::Path;

use pellucid_core::Fault;
use pellucid_core::files::{read_bounded, write_whole_bytes};
use safetensors::tensor::{Dtype, SafeTensors, TensorView, serialize};

use crate::transform::InputForm;
use crate::variant::{CELLS_XYZ, Head, LEVELS};
use crate::{RpnnError, Variant, Weights};

/// What a weights file was trained for.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Provenance {
    /// The form of its inputs.
    #[serde(flatten)]
    pub form: InputForm,
    /// Voxel edges `[x, y, z]` of the training volumes in mm.
    pub pitch_mm: [f64; 3],
    /// Refractive index of the boundary; 1 is matched.
    pub refractive_index: f64,
    /// Smallest and largest scattering coefficient of the training materials, 1/mm.
    pub sigma_s_range: [f64; 2],
    /// Smallest and largest absorption coefficient of the training materials, 1/mm.
    pub sigma_a_range: [f64; 2],
    /// Commands, data and times that made the weights.
    pub history: String,
}

impl Provenance {
    /// Tells whether weights fit voxels of `pitch_mm` `[x, y, z]`, within one per cent, and a boundary's refractive
    /// index, within 0.001.
    ///
    /// # Errors
    /// [`RpnnError::Unsupported`] naming what differs.
    pub fn check(&self, pitch_mm: [f64; 3], refractive_index: f64) -> Result<(), RpnnError> {
        let differs = |field: &str, reason: String| Err(RpnnError::Unsupported(Fault::new(field, reason)));
        let trained = self.refractive_index;
        if !(trained - 1e-3..=trained + 1e-3).contains(&refractive_index) {
            return differs(
                "refractive index",
                format!("{refractive_index}; the network was trained for {trained}"),
            );
        }
        if !pitch_mm.iter().zip(self.pitch_mm).all(|(a, b)| (a / b - 1.0).abs() <= 0.01) {
            return differs(
                "pitch",
                format!("{pitch_mm:?} mm; the network was trained for {:?} mm", self.pitch_mm),
            );
        }
        Ok(())
    }
}

/// Weights and what they were trained for.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainedNetwork {
    /// The parameters.
    pub weights: Weights,
    /// What they were trained for.
    pub provenance: Provenance,
}

/// Longest file that is read: the largest variant takes 15 MB.
const MAX_BYTES: u64 = 64 << 20;
const FORMAT: &str = "pellucid-rpnn-1";
/// The entry of the file's metadata that holds the header, a JSON object.
const ENTRY: &str = "pellucid";
/// The entry that checkpoints have instead.
pub(crate) const RUN: &str = "run";

fn stencil() -> String {
    let [x, y, z] = CELLS_XYZ;
    format!("{LEVELS} levels of {x} x {y} x {z}")
}

/// Writes weights, by way of a temporary file beside `path`.
///
/// # Errors
/// [`RpnnError::Io`] when the file cannot be written.
pub fn save(path: &Path, weights: &Weights, provenance: &Provenance) -> Result<(), RpnnError> {
    let bytes = to_bytes(weights, provenance)
        .map_err(|reason| RpnnError::in_file(path, format!("cannot be made: {reason}"), ""))?;
    Ok(write_whole_bytes(path, &bytes)?)
}

fn to_bytes(weights: &Weights, provenance: &Provenance) -> Result<Vec<u8>, String> {
    let raw = |range: std::ops::Range<usize>| -> Vec<u8> {
        weights.values()[range].iter().flat_map(|v| v.to_le_bytes()).collect()
    };
    let mut tensors: Vec<(String, Vec<usize>, Vec<u8>)> = Vec::new();
    for layer in &weights.layout().layers {
        tensors.push((
            format!("{}.weight", layer.name),
            vec![layer.outputs, layer.inputs],
            raw(layer.weight.clone()),
        ));
        if !layer.bias.is_empty() {
            tensors.push((format!("{}.bias", layer.name), vec![layer.outputs], raw(layer.bias.clone())));
        }
    }
    let views = tensors
        .iter()
        .map(|(name, shape, bytes)| Ok((name, TensorView::new(Dtype::F32, shape.clone(), bytes)?)))
        .collect::<Result<Vec<_>, safetensors::SafeTensorError>>()
        .map_err(|e| e.to_string())?;
    let header = serde_json::json!({
        "format": FORMAT,
        "variant": weights.variant().name(),
        "head": weights.head().name(),
        "stencil": stencil(),
        "provenance": provenance,
    });
    // One entry: a map's order would change the bytes from run to run.
    let header = [(ENTRY.to_owned(), header.to_string())].into_iter().collect();
    serialize(views, Some(header)).map_err(|e| e.to_string())
}

/// Reads weights.
///
/// # Errors
/// [`RpnnError::Io`] when the file cannot be read or is longer than any such file,
/// [`RpnnError::Invalid`] when it holds no network or a damaged one, [`RpnnError::Unsupported`] naming the header
/// field that does not fit this crate's network.
pub fn load(path: &Path) -> Result<TrainedNetwork, RpnnError> {
    parse(path, &read_bounded(path, MAX_BYTES)?)
}

/// Reads weights from memory; `name` stands in for the path in errors.
///
/// # Errors
/// As [`load`].
pub fn parse(name: &Path, bytes: &[u8]) -> Result<TrainedNetwork, RpnnError> {
    let damaged = |reason: String| RpnnError::in_file(name, reason, "give another copy of the file");
    let (_, header) = SafeTensors::read_metadata(bytes)
        .map_err(|e| not_a_network(name, &format!("it is no safetensors file ({e})")))?;
    let metadata = header.metadata().as_ref();
    let entry = metadata.and_then(|m| m.get(ENTRY)).ok_or_else(|| match metadata {
        Some(m) if m.contains_key(RUN) => not_a_network(name, "it is the checkpoint of a run"),
        _ => not_a_network(name, &format!("its metadata has no entry {ENTRY:?}")),
    })?;
    let fields: serde_json::Value =
        serde_json::from_str(entry).map_err(|e| damaged(format!("metadata {ENTRY:?}: {e}")))?;
    let field = |key: &str| fields[key].as_str().unwrap_or_default().to_owned();
    let unsupported = |key: &str, needed: &str| {
        let fault = Fault::new(format!("{}, {key}", name.display()), format!("{:?}", field(key)));
        RpnnError::Unsupported(fault.remedy(format!("this version reads {needed}")))
    };
    if field("format") != FORMAT {
        return Err(unsupported("format", FORMAT));
    }
    if field("stencil") != stencil() {
        return Err(unsupported("stencil", &stencil()));
    }
    let variant = Variant::from_name(&field("variant"))
        .ok_or_else(|| unsupported("variant", "baseline, L, O and L+O"))?;
    // Files of before there was a choice have no such field.
    let head = match &fields["head"] {
        serde_json::Value::Null => Head::Radiance,
        _ => {
            Head::from_name(&field("head")).ok_or_else(|| unsupported("head", "radiance and first-flight"))?
        }
    };
    let provenance: Provenance = serde_json::from_value(fields["provenance"].clone())
        .map_err(|_| unsupported("provenance", "a complete record"))?;
    let tensors = SafeTensors::deserialize(bytes).map_err(|e| damaged(e.to_string()))?;
    let mut weights = Weights::zeros(variant, head);
    let layout = weights.layout().clone();
    for layer in &layout.layers {
        let mut read = |suffix: &str, shape: &[usize], range: std::ops::Range<usize>| {
            let tensor_name = format!("{}.{suffix}", layer.name);
            let tensor = tensors.tensor(&tensor_name).map_err(|e| damaged(format!("{tensor_name}: {e}")))?;
            if tensor.dtype() != Dtype::F32 || tensor.shape() != shape {
                return Err(damaged(format!(
                    "{tensor_name} is {:?} {:?}, not f32 {shape:?}",
                    tensor.dtype(),
                    tensor.shape()
                )));
            }
            for (v, b) in weights.values_mut()[range].iter_mut().zip(tensor.data().chunks_exact(4)) {
                *v = f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
            }
            Ok(())
        };
        read("weight", &[layer.outputs, layer.inputs], layer.weight.clone())?;
        if !layer.bias.is_empty() {
            read("bias", &[layer.outputs], layer.bias.clone())?;
        }
    }
    let weights =
        Weights::new(variant, head, weights.values().to_vec()).map_err(|e| damaged(e.to_string()))?;
    Ok(TrainedNetwork { weights, provenance })
}

fn not_a_network(name: &Path, reason: &str) -> RpnnError {
    RpnnError::in_file(
        name,
        format!("is no network of `pellucid train`: {reason}"),
        "give the weights.safetensors of a training run",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::train::{TrainSettings, Trainer};
    use crate::transform::{FeatureTransform, LevelOrder};

    fn provenance() -> Provenance {
        Provenance {
            form: InputForm { transform: FeatureTransform::Log, order: LevelOrder::CoarseToFine },
            pitch_mm: [0.04, 0.08, 0.03],
            refractive_index: 1.5,
            sigma_s_range: [0.1, 24.0],
            sigma_a_range: [0.001, 16.0],
            history: "made by a test".into(),
        }
    }

    #[test]
    fn round_trip_is_exact() {
        let folder = tempfile::tempdir().unwrap();
        for (variant, head) in Variant::ALL.into_iter().flat_map(|v| Head::ALL.map(|h| (v, h))) {
            let path = folder.path().join("w.safetensors");
            let weights = Weights::initial(variant, head, 9, 0.3);
            save(&path, &weights, &provenance()).unwrap();
            let network = TrainedNetwork { weights: weights.clone(), provenance: provenance() };
            assert_eq!(load(&path).unwrap(), network);
            let bytes = std::fs::read(&path).unwrap();
            save(&path, &weights, &provenance()).unwrap();
            assert_eq!(bytes, std::fs::read(&path).unwrap(), "the same bytes");
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file stays");
    }

    #[test]
    fn tells_what_weights_were_trained_for() {
        let p = provenance();
        assert!(p.check([0.04, 0.0807, 0.0298], 1.5005).is_ok());
        for (pitch, index, field) in [
            ([0.04, 0.08, 0.0304], 1.5, "pitch"),
            ([0.04, f64::NAN, 0.03], 1.5, "pitch"),
            ([0.04, 0.08, 0.03], 1.0, "refractive index"),
            ([0.04, 0.08, 0.03], f64::NAN, "refractive index"),
        ] {
            let error = p.check(pitch, index).unwrap_err();
            assert!(matches!(&error, RpnnError::Unsupported(fault) if fault.subject == field), "{error}");
            assert!(error.to_string().contains("trained for"), "{error}");
        }
    }

    #[test]
    fn refuses_what_does_not_fit() {
        let weights = Weights::initial(Variant::SharedLevels, Head::Radiance, 9, 0.3);
        let bytes = to_bytes(&weights, &provenance()).unwrap();
        let name = Path::new("w.safetensors");
        let replaced = |from: &str, to: &str| {
            assert_eq!(from.len(), to.len());
            let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
            let mut changed = bytes.clone();
            changed[at..at + to.len()].copy_from_slice(to.as_bytes());
            parse(name, &changed).unwrap_err()
        };
        assert!(
            matches!(replaced("9 levels", "8 levels"), RpnnError::Unsupported(fault) if fault.subject.ends_with("stencil"))
        );
        assert!(
            matches!(replaced("rpnn-1", "rpnn-2"), RpnnError::Unsupported(fault) if fault.subject.ends_with("format"))
        );
        assert!(matches!(replaced("refractive", "reflective"), RpnnError::Unsupported(_)));
        assert!(matches!(replaced("end3.bias", "end9.bias"), RpnnError::Invalid(_)));
        assert!(parse(name, &bytes[..bytes.len() / 2]).is_err());
        assert!(parse(name, &[]).is_err());
    }

    #[test]
    fn a_file_of_something_else_is_named_with_what_to_give() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("photo.jpg");
        let text = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            let error = load(&path).unwrap_err();
            assert!(matches!(error, RpnnError::Invalid(_)), "{error:?}");
            pellucid_core::chain(&error)
        };
        let foreign =
            serialize([("w", TensorView::new(Dtype::F32, vec![1], &[0; 4]).unwrap())], None).unwrap();
        for bytes in [&b"\xff\xd8\xff\xe0 this is a photo and no network"[..], b"", &foreign] {
            let text = text(bytes);
            for part in ["photo.jpg", "no network of `pellucid train`", "safetensors", "give the weights"] {
                assert!(text.contains(part), "{text}");
            }
        }
        let run =
            Trainer::new(TrainSettings { variant: Variant::SharedLevels, ..Default::default() }).unwrap();
        run.save(&path).unwrap();
        assert!(text(&std::fs::read(&path).unwrap()).contains("checkpoint of a run"));
        let missing = load(&folder.path().join("none.safetensors")).unwrap_err();
        let text = pellucid_core::chain(&missing);
        assert!(
            matches!(missing, RpnnError::Io(_)) && text.matches("none.safetensors").count() == 1,
            "{text}"
        );
    }
}
