//! Stencils of a halftoned ball and what the network makes of them, for `benches/peers/rpnn_torch.py` to agree
//! with.
//!
//! `cargo run --release -p pellucid-rpnn --features weights --example peer_samples -- FOLDER [WEIGHTS]`
//!
//! Writes `FOLDER/weights.safetensors`, a copy of WEIGHTS or of the shipped file, and `FOLDER/samples.safetensors`: `stencils`
//! `[samples][9][270]` in 1/mm, `flights` `[samples][5]` (masses of three bins, escaped, returned), `outputs`
//! `[samples][outputs]` and `radiance` `[samples]`, all f32.

use std::path::PathBuf;

use pellucid_rpnn::file::parse;
use pellucid_rpnn::variant::{FirstFlight, INPUTS, LEVEL_INPUTS, LEVELS};
use pellucid_rpnn::{Inference, Precision, SHIPPED};
use pellucid_stencil::{Coefficients, Features, FirstFlights, StencilSpec, Stencils};
use pellucid_voxel::{Control, CountSat, Frame, LabelGrid, MaterialTable, Pitch, Surface, SurfaceOptions};
use safetensors::tensor::{Dtype, TensorView, serialize};

const RADIUS_MM: f64 = 2.0;
/// About so many surface points.
const POINTS: usize = 256;
const WHITE: u8 = 5;

/// A ball of white under a skin of 0.6 mm in which stripes of each ink mix with it.
fn ball() -> Result<LabelGrid, pellucid_voxel::VoxelError> {
    let mm = Pitch::j750().mm();
    let size = mm.map(|mm| (2.0 * (RADIUS_MM + 0.2) / mm).ceil() as u32);
    let frame = Frame::new([-RADIUS_MM - 0.2; 3], Pitch::j750(), size)?;
    let mut labels = LabelGrid::new(frame);
    for (x, y, z) in
        (0..size[0]).flat_map(|x| (0..size[1]).flat_map(move |y| (0..size[2]).map(move |z| (x, y, z))))
    {
        let p = frame.centre_mm([x, y, z].map(i64::from));
        let depth = RADIUS_MM - p.iter().map(|c| c * c).sum::<f64>().sqrt();
        if depth < 0.0 {
            continue;
        }
        let inked = depth < 0.6 && (x * 7 + y * 5 + z * 3) % 11 < 4 + (z / 16) % 5;
        let ink = 1 + ((p[2] + RADIUS_MM) * 2.0) as u8 % 4;
        labels.set([x, y, z], if inked { ink } else { WHITE });
    }
    Ok(labels)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1).map(PathBuf::from);
    let folder = arguments.next().ok_or("name a folder")?;
    let file = match arguments.next() {
        Some(path) => std::fs::read(path)?,
        None => SHIPPED.to_vec(),
    };
    std::fs::create_dir_all(&folder)?;
    let none = Control::none();
    let (labels, materials) = (ball()?, MaterialTable::cmykw());
    let surface = Surface::extract(&labels, &SurfaceOptions::default(), &none)?;
    let step = surface.len() / POINTS;
    let points: Vec<u32> = (0..surface.len() as u32).step_by(step).collect();
    let voxels: Vec<[u32; 3]> = points.iter().map(|&p| surface.voxels()[p as usize]).collect();

    let coefficients = Coefficients::all(&materials, Features::ScatterAbsorb)?;
    let table = CountSat::build(&labels, materials.len(), &none)?;
    let samples = points.len() * coefficients.channels();
    let mut stencils = vec![0.0; samples * INPUTS];
    Stencils::new(StencilSpec::paper(), &labels, &table)?.extract(
        &coefficients,
        &voxels,
        &mut stencils,
        &none,
    )?;
    let mut flights = vec![FirstFlight::default(); samples];
    FirstFlights::new(&materials, &labels, &surface, 1.5)?.extract(&points, &mut flights, &none)?;

    let network = parse("the weights".as_ref(), &file)?;
    let mut inference = Inference::new(&network.weights, network.provenance.form, Precision::F32)?;
    let outputs_each = inference.head().outputs();
    let mut outputs = vec![0.0; samples * outputs_each];
    inference.outputs(&stencils, &mut outputs)?;
    let mut radiance = vec![0.0; samples];
    inference.head().radiance(&outputs, &flights, &mut radiance);

    let flights: Vec<f32> = flights.iter().flat_map(|f| f.to_array()).collect();
    let bytes = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let tensors = [
        ("stencils", vec![samples, LEVELS, LEVEL_INPUTS], bytes(&stencils)),
        ("flights", vec![samples, FirstFlight::VALUES], bytes(&flights)),
        ("outputs", vec![samples, outputs_each], bytes(&outputs)),
        ("radiance", vec![samples], bytes(&radiance)),
    ];
    let views = tensors
        .iter()
        .map(|(name, shape, data)| Ok((*name, TensorView::new(Dtype::F32, shape.clone(), data)?)))
        .collect::<Result<Vec<_>, safetensors::SafeTensorError>>()?;
    std::fs::write(folder.join("samples.safetensors"), serialize(views, None)?)?;
    std::fs::write(folder.join("weights.safetensors"), &file)?;
    println!("{samples} samples, {} on {}", network.weights.variant().name(), inference.instruction_set());
    Ok(())
}
