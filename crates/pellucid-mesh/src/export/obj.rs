//! The OBJ and MTL writers.

use std::fmt::Write as _;

use crate::bake::TexturedMesh;

/// Positions in millimetres with +Y up. Writing to a string cannot fail.
pub(super) fn to_obj(mesh: &TexturedMesh, stem: &str) -> String {
    let mut text = format!("# millimetres\nmtllib {stem}.mtl\nusemtl print\n");
    for [x, y, z] in &mesh.positions_mm {
        let _ = writeln!(text, "v {x:.6} {z:.6} {:.6}", -y);
    }
    for [u, v] in mesh.uv.iter().flatten() {
        // OBJ's v grows upwards.
        let _ = writeln!(text, "vt {u:.7} {:.7}", 1.0 - v);
    }
    for (i, triangle) in mesh.triangles.iter().enumerate() {
        let [a, b, c] = [0, 1, 2].map(|k| format!("{}/{}", triangle[k] + 1, 3 * i + k + 1));
        let _ = writeln!(text, "f {a} {b} {c}");
    }
    text
}

pub(super) fn to_mtl(stem: &str) -> String {
    format!("newmtl print\nKd 1 1 1\nmap_Kd -clamp on {stem}.png\n")
}
