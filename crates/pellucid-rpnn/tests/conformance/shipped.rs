//! Candle from the file that the library carries, unchanged.

use candle_core::{DType, Device, Tensor};
use candle_nn::{Module, VarBuilder, VarMap};
use pellucid_rpnn::candle::{InputLayer, Rpnn};
use pellucid_rpnn::variant::INPUTS;
use pellucid_rpnn::{Inference, Precision, SHIPPED, shipped};

use super::cases::{self, half_space};

#[test]
fn candle_from_the_shipped_file_equals_own_f32() {
    let network = shipped().unwrap();
    let (weights, form) = (&network.weights, network.provenance.form);
    let build = |vb| Rpnn::new(weights.variant(), weights.head(), vb).unwrap();
    let from_bytes = build(VarBuilder::from_slice_safetensors(SHIPPED, DType::F32, &Device::Cpu).unwrap());
    // The same through variables and a file on disk.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("weights.safetensors");
    std::fs::write(&path, SHIPPED).unwrap();
    let mut map = VarMap::new();
    let from_file = build(VarBuilder::from_varmap(&map, DType::F32, &Device::Cpu));
    map.load(&path).unwrap();
    assert_eq!(from_bytes.weights().unwrap(), *weights);
    assert_eq!(from_file.weights().unwrap(), *weights);

    let mut stencils = cases::all().into_iter().find(|c| c.name == "mixtures").unwrap().stencils;
    for sigma_a in [0.002, 0.005, 0.02, 0.1, 0.5, 4.0] {
        stencils.extend(half_space(6.0 - sigma_a, sigma_a));
    }
    let n = stencils.len() / INPUTS;
    let mut own = vec![0.0; n * weights.head().outputs()];
    Inference::new(weights, form, Precision::F32).unwrap().outputs(&stencils, &mut own).unwrap();
    assert!(own.iter().any(|v| *v > 0.5), "{own:?}");
    let inputs = InputLayer::new(form, DType::F32, &Device::Cpu).unwrap();
    let inputs = inputs.forward(&Tensor::from_vec(stencils, (n, 9, 270), &Device::Cpu).unwrap()).unwrap();
    for rpnn in [from_bytes, from_file] {
        let candle = rpnn.forward(&inputs).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();
        let worst = candle.iter().zip(&own).fold(0.0f32, |w, (a, b)| w.max((a - b).abs()));
        assert!(worst <= 1e-5, "{worst:e}");
    }
}
