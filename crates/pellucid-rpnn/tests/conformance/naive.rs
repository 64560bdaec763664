//! The network one sample at a time in f64.

use pellucid_rpnn::transform::{FeatureTransform, InputForm, LevelOrder};
use pellucid_rpnn::variant::octant_gather;
use pellucid_rpnn::{Variant, Weights};

/// The network's input of a raw stencil.
fn inputs(form: InputForm, stencil: &[f32]) -> Vec<f64> {
    let mut levels: Vec<Vec<f64>> = stencil
        .chunks(270)
        .enumerate()
        .map(|(k, level)| {
            let scaled = level.iter().map(|&v| f64::from(v) * f64::powi(2.0, k as i32));
            match form.transform {
                FeatureTransform::Scaled => scaled.map(|v| v / 64.0).collect(),
                FeatureTransform::Log => {
                    let logarithm = |i: usize, v: f64| match i % 2 {
                        0 => (0.2 * v).ln_1p() / 3.0,
                        _ => (30.0 * v).ln_1p() / 4.0,
                    };
                    scaled.enumerate().map(|(i, v)| logarithm(i, v)).collect()
                }
            }
        })
        .collect();
    if form.order == LevelOrder::CoarseToFine {
        levels.reverse();
    }
    levels.concat()
}

/// The plain outputs of one raw stencil: the design's table written out directly. What a radiance is before its ReLU.
pub fn outputs(weights: &Weights, form: InputForm, stencil: &[f32]) -> Vec<f64> {
    let sample = inputs(form, stencil);
    let variant = weights.variant();
    let layer = |name: &str, x: &[f64]| -> Vec<f64> {
        let l = weights.layout().layers.iter().find(|l| l.name == name).unwrap();
        let (w, b) = (&weights.values()[l.weight.clone()], &weights.values()[l.bias.clone()]);
        assert_eq!(x.len(), l.inputs);
        (0..l.outputs)
            .map(|o| {
                let dot: f64 = (0..l.inputs).map(|i| f64::from(w[o * l.inputs + i]) * x[i]).sum();
                dot + b.get(o).map_or(0.0, |&b| f64::from(b))
            })
            .collect()
    };
    let relu = |x: Vec<f64>| -> Vec<f64> { x.into_iter().map(|v| v.max(0.0)).collect() };
    let add = |a: Vec<f64>, b: &[f64]| -> Vec<f64> { a.into_iter().zip(b).map(|(a, b)| a + b).collect() };
    let octant_layers = matches!(variant, Variant::SharedOctants | Variant::SharedLevelsAndOctants);
    let one_block = matches!(variant, Variant::SharedLevels | Variant::SharedLevelsAndOctants);
    let mut state = vec![0.0; if octant_layers { 480 } else { 270 }];
    for k in 0..9 {
        let p = if one_block { "level".to_owned() } else { format!("level{}", k + 1) };
        let x = sample[k * 270..(k + 1) * 270].to_vec();
        let through = |x: &[f64], names: [&str; 2]| {
            let h = relu(layer(&format!("{p}.{}", names[0]), x));
            relu(layer(&format!("{p}.{}", names[1]), &h))
        };
        let value: Vec<f64> = if octant_layers {
            (0..8)
                .flat_map(|o| {
                    let part: Vec<f64> = octant_gather(o).iter().map(|&i| x[usize::from(i)]).collect();
                    through(&part, ["octant1", "octant2"])
                })
                .collect()
        } else if k == 0 && !one_block {
            through(&x, ["dense1", "dense2"])
        } else {
            x
        };
        if k == 0 && !one_block {
            state = value;
            continue;
        }
        let new = if variant == Variant::SharedOctants { value } else { layer(&format!("{p}.a"), &value) };
        let mixed = relu(add(new, &layer(&format!("{p}.b"), &state)));
        state = relu(add(layer(&format!("{p}.c"), &mixed), &state));
    }
    let mut outputs = vec![0.0; weights.head().outputs()];
    for row in state.chunks(if octant_layers { 60 } else { 270 }) {
        let of_row = layer("end3", &relu(layer("end2", &relu(layer("end1", row)))));
        outputs.iter_mut().zip(of_row).for_each(|(sum, v)| *sum += v);
    }
    outputs
}
