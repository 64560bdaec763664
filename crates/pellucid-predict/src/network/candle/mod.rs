//! The appearance network in candle as a predictor.

mod engine;
mod pipeline;

use std::sync::Arc;

use candle_core::{DType, Device};
use candle_nn::VarBuilder;
use pellucid_core::InstructionSet;
use pellucid_rpnn::candle::{InputLayer, Rpnn, tensors};
use pellucid_rpnn::{Precision, TrainedNetwork};

use super::bound::BoundNetwork;
use super::trained_range::TrainedRange;
use super::{Network, described, identity, supports};
use crate::{
    BoundPredictor, Capabilities, Identity, NetworkDevice, Object, PredictError, Predictor, Sharing,
};

/// Samples of a batch on the processor: about 50 ms, after which a prediction can be stopped.
const ON_CPU: usize = 128;
/// On other devices, which need many to be busy: 40 MB of stencils.
const ON_DEVICE: usize = 4096;

/// Predicts by the network in candle, on any of its devices. Stencils are extracted on the processor, batch by batch,
/// while the device computes; where the device is the processor itself they take turns, and [`Network`] is several times
/// as fast.
///
/// A network with an exact first flight is run for points [`Sharing::spacing_mm`] apart, as in [`Network`]; all levels
/// are read for each of them.
///
/// The same labels give the same values for any number of threads and whatever else is predicted with them. Values
/// differ from those of [`Network`], and between devices, by rounding.
#[derive(Clone, Debug)]
pub struct CandleNetwork {
    trained: Arc<TrainedNetwork>,
    digest: String,
    rpnn: Rpnn,
    inputs: InputLayer,
    device: Device,
    precision: Precision,
    sharing: Option<Sharing>,
    batch: usize,
}

impl CandleNetwork {
    /// Copies weights to a device; [`NetworkDevice::open`] opens one. On the processor candle is slow in bf16.
    ///
    /// # Errors
    /// [`PredictError::Failed`] when the device fails.
    pub fn new(
        trained: impl Into<Arc<TrainedNetwork>>,
        device: Device,
        precision: Precision,
    ) -> Result<Self, PredictError> {
        let trained = trained.into();
        let weights = &trained.weights;
        let build = || {
            let vb = VarBuilder::from_tensors(tensors(weights, &device)?, dtype(precision), &device);
            let rpnn = Rpnn::new(weights.variant(), weights.head(), vb)?;
            // Coefficients span five decades: bf16 comes after their logarithm.
            Ok((rpnn, InputLayer::new(trained.provenance.form, DType::F32, &device)?))
        };
        let (rpnn, inputs) =
            build().map_err(|error: candle_core::Error| PredictError::failed("rpnn", error))?;
        Ok(Self {
            digest: weights.digest(),
            rpnn,
            inputs,
            precision,
            sharing: Some(whole(Sharing::default())),
            batch: if device.is_cpu() { ON_CPU } else { ON_DEVICE },
            device,
            trained,
        })
    }

    /// The weights that this library carries, in f32.
    ///
    /// # Errors
    /// [`PredictError::Failed`] when they are damaged or the device fails.
    #[cfg(feature = "weights")]
    pub fn shipped(device: Device) -> Result<Self, PredictError> {
        Self::new(pellucid_rpnn::shipped()?, device, Precision::F32)
    }

    /// The same with other spacing between the points that it is run for; [`Sharing::fine_levels`] does not matter.
    ///
    /// # Errors
    /// [`PredictError::Invalid`] as [`Sharing::check`] says.
    pub fn with_sharing(mut self, sharing: Option<Sharing>) -> Result<Self, PredictError> {
        sharing.map_or(Ok(()), Sharing::check)?;
        self.sharing = sharing.map(whole);
        Ok(self)
    }

    /// The same with batches of other size. Values may change by rounding.
    ///
    /// # Errors
    /// [`PredictError::Invalid`] when `samples` is not 1 to 65536.
    pub fn with_batch(mut self, samples: usize) -> Result<Self, PredictError> {
        if !(1..=1 << 16).contains(&samples) {
            return Err(PredictError::invalid(
                "batch",
                format!("{samples} samples; 1 to 65536 are possible"),
            ));
        }
        self.batch = samples;
        Ok(self)
    }

    /// The weights and what they were trained for.
    pub fn trained(&self) -> &Arc<TrainedNetwork> {
        &self.trained
    }

    /// The device.
    pub fn device(&self) -> &Device {
        &self.device
    }

    fn engine(&self, object: &Object) -> Result<engine::Engine, PredictError> {
        let coefficients = Network::coefficients(object)?;
        Ok(engine::Engine {
            inputs: self.inputs.clone(),
            rpnn: self.rpnn.clone(),
            device: self.device.clone(),
            dtype: dtype(self.precision),
            voxels: (self.batch / coefficients.channels()).max(1),
            coefficients,
            trained: TrainedRange::new(&self.trained.provenance),
            instruction_set: InstructionSet::chosen(),
            beside: !self.device.is_cpu(),
        })
    }
}

/// All levels are read for every point.
fn whole(sharing: Sharing) -> Sharing {
    Sharing { fine_levels: 9, ..sharing }
}

fn dtype(precision: Precision) -> DType {
    match precision {
        Precision::F32 => DType::F32,
        Precision::Bf16 => DType::BF16,
    }
}

fn device_name(device: &Device) -> &'static str {
    match device {
        Device::Cpu => NetworkDevice::Cpu,
        Device::Cuda(_) => NetworkDevice::Cuda,
        Device::Metal(_) => NetworkDevice::Metal,
    }
    .name()
}

impl Predictor for CandleNetwork {
    fn identity(&self) -> Identity {
        let described = described(self.sharing, self.rpnn.head());
        identity(&self.trained, &self.digest, self.precision, described, InstructionSet::chosen())
            .with("engine", "candle")
            .with("device", device_name(&self.device))
            .with("batch", self.batch)
    }

    fn supports(&self, object: &Object) -> Result<Capabilities, PredictError> {
        supports(&self.trained, object)
    }

    fn bind(&self, object: Arc<Object>) -> Result<Box<dyn BoundPredictor>, PredictError> {
        self.supports(&object)?;
        let engine = Box::new(self.engine(&object)?);
        Ok(Box::new(BoundNetwork::new(engine, self.sharing, object)?))
    }
}

#[cfg(test)]
mod tests {
    use pellucid_core::Control;
    use pellucid_rpnn::transform::{FeatureTransform, InputForm, LevelOrder};
    use pellucid_rpnn::variant::Head;
    use pellucid_rpnn::{Provenance, Variant, Weights};
    use pellucid_voxel::{CountSat, Frame, LabelGrid, MaterialTable, Pitch, Surface, SurfaceOptions};

    use super::*;
    use crate::network::evaluate::{Contents, Evaluator};

    fn block() -> (LabelGrid, Object) {
        let mut labels = LabelGrid::new(Frame::new([0.0; 3], Pitch::j750(), [20, 18, 24]).unwrap());
        for (x, y, z) in (4..16).flat_map(|x| (4..14).flat_map(move |y| (4..20).map(move |z| (x, y, z)))) {
            labels.set([x, y, z], 1 + ((x * 7 + y * 5 + z * 3) % 11 % 5) as u8);
        }
        let surface = Surface::extract(&labels, &SurfaceOptions::default(), &Control::none()).unwrap();
        (labels, Object::new(surface, MaterialTable::cmykw(), 1.5).unwrap())
    }

    /// The pipeline of GPUs, on the processor: batches beside the extraction give the bits of batches in turn.
    #[test]
    fn beside_and_in_turn_agree_bit_for_bit() {
        let (labels, object) = block();
        let table = CountSat::build(&labels, 5, &Control::none()).unwrap();
        let provenance = Provenance {
            form: InputForm { transform: FeatureTransform::Log, order: LevelOrder::CoarseToFine },
            pitch_mm: Pitch::j750().mm(),
            refractive_index: 1.5,
            sigma_s_range: [0.3, 24.0],
            sigma_a_range: [0.0027, 16.2],
            history: "drawn at random".into(),
        };
        let weights = Weights::initial(Variant::SharedLevels, Head::FirstFlight, 2, 8.0);
        let network =
            CandleNetwork::new(TrainedNetwork { weights, provenance }, Device::Cpu, Precision::F32).unwrap();
        let voxels = &object.surface().voxels()[..150];
        let of = Contents { labels: &labels, table: &table };
        let outputs = |beside: bool| {
            let engine = engine::Engine { beside, ..network.engine(&object).unwrap() };
            engine.outputs(of, voxels, &Control::none()).unwrap().values
        };
        let in_turn = outputs(false);
        assert_eq!(in_turn.len(), 150 * 3 * 4);
        assert!(in_turn.iter().any(|v| v.abs() > 0.1));
        assert_eq!(in_turn, outputs(true));
    }
}
