//! End-to-end tests of the workspace live in `tests/`; this library holds what they share.

pub mod readers;

use pellucid::PrintSettings;
use pellucid::color::spectrum::Illuminant;
use pellucid::mesh::{BaseColor, Model, Scale, Triangle, Vertex};
use pellucid::refine::Effort;
use pellucid::voxel::{Channels, LabelGrid, Material, MaterialTable};

/// A ball of 6 mm with patches of two vertex colours, about 32 x 16 faces: closed and oriented.
pub fn patched_ball() -> Model {
    const AROUND: u32 = 32;
    const DOWN: u32 = 16;
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    let at = |i: u32, j: u32| {
        let (a, b) = (
            std::f64::consts::TAU * f64::from(i % AROUND) / f64::from(AROUND),
            std::f64::consts::PI * f64::from(j) / f64::from(DOWN),
        );
        [a.cos() * b.sin(), a.sin() * b.sin(), b.cos()].map(|v| 0.003 * v)
    };
    for j in 0..DOWN {
        for i in 0..AROUND {
            // Each face has vertices of its own, so that colours change at its edge.
            let dark = (i / 4 + j / 2) % 2 == 0;
            let color = if dark { [0.25, 0.05, 0.04, 1.0] } else { [0.85, 0.8, 0.7, 1.0] };
            let quad = [at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)];
            let first = vertices.len() as u32;
            vertices.extend(quad.map(|position_m| Vertex { position_m, uv: [0.0; 2], color }));
            let corners: &[[u32; 3]] = match j {
                0 => &[[0, 1, 2]],
                _ if j == DOWN - 1 => &[[0, 1, 3]],
                _ => &[[0, 1, 2], [0, 2, 3]],
            };
            triangles
                .extend(corners.iter().map(|c| Triangle { vertices: c.map(|v| first + v), material: 0 }));
        }
    }
    let plain = BaseColor { name: "patches".into(), factor: [1.0; 4], texture: None, double_sided: false };
    Model::new("patched ball", vertices, triangles, vec![plain], vec![]).expect("the ball is valid")
}

/// FNV-1a, 64 bits, over the labels of a grid in `[z][y][x]` order.
pub fn label_digest(grid: &LabelGrid) -> u64 {
    let [nx, ny, nz] = grid.size();
    let mut digest = 0xcbf2_9ce4_8422_2325_u64;
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                let label = u64::from(grid.get([x, y, z]));
                digest = (digest ^ label).wrapping_mul(0x0100_0000_01b3);
            }
        }
    }
    digest
}

/// Cyan, magenta, yellow, black and white over 31 bands: the default table's coefficients, joined smoothly from its
/// blue at 450 nm over its green at 550 nm to its red at 610 nm. A test's table, not a measured one.
pub fn spectral_cmykw() -> MaterialTable {
    let anchors = [(450.0, 2), (550.0, 1), (610.0, 0)];
    let between = |values: &[f32], nm: f32| {
        let [(low, b), (middle, g), (high, r)] = anchors;
        let mix =
            |from: usize, to: usize, t: f32| values[from] + (values[to] - values[from]) * t.clamp(0.0, 1.0);
        if nm < middle {
            mix(b, g, (nm - low) / (middle - low))
        } else {
            mix(g, r, (nm - middle) / (high - middle))
        }
    };
    let bands = |values: &[f32]| (0..31).map(|i| between(values, 400.0 + 10.0 * i as f32)).collect();
    let materials = MaterialTable::cmykw()
        .materials()
        .iter()
        .map(|m| Material { sigma_s: bands(&m.sigma_s), sigma_a: bands(&m.sigma_a), ..m.clone() })
        .collect();
    let channels = Channels::Bands { start_nm: 400.0, step_nm: 10.0, count: 31 };
    MaterialTable::over(channels, materials).expect("the table is valid")
}

/// As few paths, points and iterations as a print under several lights can do with.
pub fn lit_settings(height_mm: f64, materials: MaterialTable, also_under: &[Illuminant]) -> PrintSettings {
    let mut settings = PrintSettings {
        scale: Scale::HeightMm(height_mm),
        materials,
        also_under: also_under.to_vec(),
        spp: Some(2),
        judge: Effort { points: 20, point_passes: 2, surface_passes: 2 },
        judge_spp: 2,
        judge_point_spp: 8,
        proof_edge: 16,
        ..PrintSettings::default()
    };
    settings.refine.iterations = Some(1);
    settings.descent.opening_steps = 1;
    settings
}

/// The Rust of the guide, compiled and run by the tests.
#[cfg(doctest)]
#[doc = include_str!("../../docs/GUIDE.md")]
struct Guide;
