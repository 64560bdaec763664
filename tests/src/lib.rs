//! End-to-end tests of the workspace live in `tests/`; this library holds what they share.

use pellucid::mesh::{BaseColor, Model, Triangle, Vertex};

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
