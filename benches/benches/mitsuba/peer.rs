//! Mitsuba's paths, by the script under `benches/peers`.

use std::path::{Path, PathBuf};
use std::process::Command;

use pellucid::voxel::{AIR, LabelGrid, Material};
use pellucid_benches::appearance::Error;
use serde::Deserialize;

use super::Row;
use super::scene::{CHANNELS, Scene};

/// The variants that are compared with: the scalar one, and the one that is vectorised and compiled at run time.
const VARIANTS: [&str; 2] = ["scalar_rgb", "llvm_ad_mono"];
/// Its paths a point and channel.
pub const PATHS: u32 = 128;
/// A step in mm of the way from a voxel's centre out of the object: a fiftieth of the pitch's shortest edge.
const STEP_MM: f64 = 0.0005;

#[derive(Deserialize)]
struct Output {
    mitsuba: String,
    seconds: f64,
    radiance: Vec<f64>,
    std_error: Vec<f64>,
}

/// Whether Python is there and has Mitsuba.
pub fn is_there(python: &Path) -> bool {
    Command::new(python).args(["-c", "import mitsuba"]).output().is_ok_and(|out| out.status.success())
}

/// A row for each variant.
///
/// # Errors
/// What the script says when it fails.
pub fn measure(python: &Path, scene: &Scene) -> Result<Vec<Row>, Error> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("mitsuba-scene");
    std::fs::create_dir_all(&folder)?;
    write(&folder, scene)?;
    VARIANTS.into_iter().map(|variant| run(python, &folder, scene, variant)).collect()
}

fn run(python: &Path, folder: &Path, scene: &Scene, variant: &str) -> Result<Row, Error> {
    let script = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("peers/mitsuba_prints.py");
    let out = Command::new(python)
        .arg(script)
        .arg(folder)
        .args(["--variant", variant, "--paths", &PATHS.to_string()])
        .output()?;
    if !out.status.success() {
        return Err(String::from_utf8_lossy(&out.stderr).into_owned().into());
    }
    let found: Output = serde_json::from_slice(&out.stdout)?;
    let square = found.std_error.iter().map(|e| e * e).sum::<f64>() / CHANNELS as f64;
    Ok(Row {
        object: scene.name.clone(),
        points: scene.object.surface().len(),
        tracer: format!("Mitsuba {}, {variant}", found.mitsuba),
        seconds: found.seconds,
        radiance: [found.radiance.iter().sum::<f64>() / CHANNELS as f64, (square / CHANNELS as f64).sqrt()],
        deviation: (square * scene.chosen.len() as f64 * f64::from(PATHS)).sqrt(),
    })
}

/// Writes what the script reads.
fn write(folder: &Path, scene: &Scene) -> Result<(), Error> {
    let grid = &scene.labels;
    let size = grid.size();
    let mut labels = Vec::with_capacity(size.iter().map(|&n| n as usize).product());
    for z in 0..size[2] {
        for y in 0..size[1] {
            labels.extend((0..size[0]).map(|x| grid.get([x, y, z])));
        }
    }
    std::fs::write(folder.join("labels.u8"), &labels)?;
    let materials = scene.object.materials().materials();
    // By channel and label, air first.
    let table = |of: &dyn Fn(&Material, usize) -> f64| -> Vec<Vec<f64>> {
        let row = |c| std::iter::once(0.0).chain(materials.iter().map(|m| of(m, c))).collect();
        (0..CHANNELS).map(row).collect()
    };
    let extinction = |m: &Material, c: usize| f64::from(m.sigma_s[c]) + f64::from(m.sigma_a[c]);
    let surface = scene.object.surface();
    let points = scene.chosen.iter().map(|&p| {
        let (voxel, normal) = (surface.voxels()[p as usize], surface.normals()[p as usize].map(f64::from));
        serde_json::json!({
            "position_mm": outside(grid, voxel, normal),
            "direction": normal.map(|n| -n),
        })
    });
    let given = serde_json::json!({
        "size": size,
        "pitch_mm": grid.frame().pitch().mm(),
        "g": materials[0].g,
        "sigma_t": table(&extinction),
        "albedo": table(&|m, c| f64::from(m.sigma_s[c]) / extinction(m, c).max(1e-30)),
        "points": points.collect::<Vec<_>>(),
    });
    std::fs::write(folder.join("scene.json"), serde_json::to_vec(&given)?)?;
    Ok(())
}

/// Where the ray from a voxel's centre along a normal is in air, in mm from the grid's corner.
fn outside(grid: &LabelGrid, voxel: [u32; 3], normal: [f64; 3]) -> [f64; 3] {
    let (pitch, size) = (grid.frame().pitch().mm(), grid.size());
    let mut at: [f64; 3] = std::array::from_fn(|a| (f64::from(voxel[a]) + 0.5) * pitch[a]);
    loop {
        let v: [f64; 3] = std::array::from_fn(|a| (at[a] / pitch[a]).floor());
        let inside = (0..3).all(|a| v[a] >= 0.0 && v[a] < f64::from(size[a]));
        if !inside || grid.get(v.map(|c| c as u32)) == AIR {
            // Within the box that holds the medium.
            return std::array::from_fn(|a| at[a].clamp(1e-6, f64::from(size[a]) * pitch[a] - 1e-6));
        }
        (0..3).for_each(|a| at[a] += STEP_MM * normal[a]);
    }
}
