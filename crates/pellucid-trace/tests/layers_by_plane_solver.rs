//! The plane-parallel solution against the path tracer: thin layers over thick white and thick black.

use pellucid_color::plane_parallel::{Layer, Solver};
use pellucid_trace::{AnalyticScene, Boundary, Medium, Optics, Shape, TraceOptions};
use pellucid_voxel::{Control, MaterialTable};

/// Sideways and down to where no path comes.
const FAR_MM: f64 = 1000.0;

#[test]
fn layers_over_thick_white_and_black_agree_with_paths() {
    let table = MaterialTable::cmykw();
    let solver = Solver::new(1.5).unwrap();
    let (mut squares, mut count) = (0.0, 0.0);
    for (ink, below, mm) in [
        ("cyan", "white", 0.108),
        ("cyan", "black", 0.27),
        ("magenta", "white", 0.27),
        ("yellow", "black", 0.54),
        ("white", "black", 0.5),
        ("black", "white", 0.054),
    ] {
        let [ink, below] = [ink, below].map(|name| table.get(table.label_of(name).unwrap()).unwrap());
        for channel in 0..3 {
            let optics = [below, ink].map(|m| Optics {
                sigma_s: m.sigma_s[channel].into(),
                sigma_a: m.sigma_a[channel].into(),
                g: m.g.at(channel).into(),
            });
            let layers = [mm, f64::INFINITY];
            let layers: Vec<Layer> = [optics[1], optics[0]]
                .iter()
                .zip(layers)
                .map(|(o, thickness_mm)| Layer {
                    sigma_s: o.sigma_s,
                    sigma_a: o.sigma_a,
                    g: o.g,
                    thickness_mm,
                })
                .collect();
            let exact = solver.radiance_normal(&layers).unwrap();
            let shape = Shape::Box { min_mm: [-FAR_MM; 3], max_mm: [FAR_MM, FAR_MM, 0.0] };
            let boxes = vec![(1, [-FAR_MM, -FAR_MM, -mm], [FAR_MM, FAR_MM, 0.0])];
            let scene =
                AnalyticScene::new(shape, Medium::Layers { base: 0, boxes }, optics.to_vec()).unwrap();
            let options = TraceOptions {
                spp: 40_000,
                seed: 7,
                boundary: Boundary::with_index(1.5).unwrap(),
                ..TraceOptions::default()
            };
            let paths = scene.radiance([0.0; 3], [0.0, 0.0, 1.0], &options, &Control::none()).unwrap();
            let z = (paths.value - exact) / paths.std_error;
            let label = format!("{} over {}, channel {channel}", ink.name, below.name);
            assert!(paths.std_error < 0.003, "{label}: {}", paths.std_error);
            assert!(z.abs() < 3.6, "{label}: {exact} and by paths {} ± {}", paths.value, paths.std_error);
            squares += z * z;
            count += 1.0;
        }
    }
    // z² has the mean 1 and, over 18 values, a scatter of 1/3.
    let mean: f64 = squares / count;
    assert!(mean < 2.0, "{mean}");
}
