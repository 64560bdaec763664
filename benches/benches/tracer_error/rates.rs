//! Paths a second in the white cube, beside Mitsuba's.

use std::error::Error;
use std::path::Path;

use pellucid::trace::{
    AnalyticScene, Boundary, InstructionSet, Medium, Optics, Shape, TraceOptions, Tracer, Volume,
};
use pellucid::voxel::{
    Control, Frame, LabelGrid, Material, MaterialTable, Pitch, Surface, SurfaceOptions, Tile,
};

use pellucid_benches::study::stopwatch::time;

/// Best paths a second of several runs of the white cube, blue, index-matched, on one thread.
pub(super) fn cube(control: &Control<'_>) -> Result<Vec<(String, f64)>, Box<dyn Error>> {
    let pitch = Pitch::j750();
    let frame = Frame::new([0.0; 3], pitch, pitch.mm().map(|m| (10.0 / m).round() as u32))?;
    let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(1));
    let s = frame.size();
    let surface = Surface::extract(&grid, &SurfaceOptions::default(), control)?;
    let top = surface.index_of([s[0] / 2, s[1] / 2, s[2] - 1]).ok_or("no top")?;
    let volume = Volume::new(&grid, &surface, control)?;
    let white = Material::from_albedo("white", &[0.999], &[24.0], 0.4);
    let optics =
        Optics { sigma_s: f64::from(white.sigma_s[0]), sigma_a: f64::from(white.sigma_a[0]), g: 0.4 };
    let table = MaterialTable::new(vec!["B".into()], vec![white])?;
    let mut out = Vec::new();
    let base = TraceOptions { boundary: Boundary::Matched, ..TraceOptions::default() };
    for set in InstructionSet::available() {
        let spp = if set == InstructionSet::Portable { 4096 } else { 65_536 };
        let tracer = Tracer::new(&volume, &table, TraceOptions { spp, instruction_set: Some(set), ..base })?;
        if tracer.instruction_set() != set {
            continue;
        }
        let mut best = 0.0f64;
        for _ in 0..3 {
            let (_, spent) = time(|| tracer.radiance(&[top], 0, &mut [0.0], control))?;
            best = best.max(f64::from(spp) / spent);
        }
        out.push((format!("voxel grid, {set}"), best));
    }
    let shape = Shape::Box { min_mm: [0.0; 3], max_mm: [10.0; 3] };
    let scene = AnalyticScene::new(shape, Medium::Homogeneous(0), vec![optics])?;
    let options = TraceOptions { spp: 8192, ..base };
    let (_, spent) = time(|| scene.radiance([5.0, 5.0, 10.0], [0.0, 0.0, 1.0], &options, control))?;
    out.push(("homogeneous box, double precision".into(), 8192.0 / spent));
    Ok(out)
}

/// Mitsuba's rates by the peer script, when Python has Mitsuba.
pub(super) fn mitsuba(script: &Path) -> Option<Vec<(String, f64)>> {
    let out = std::process::Command::new("python3").arg(script).output().ok()?;
    let value: serde_json::Value = serde_json::from_slice(&out.stdout).ok()?;
    let version = value["mitsuba"].as_str()?;
    Some(
        [
            ("grid_emitter_sampling", "voxel grid, default settings"),
            ("grid", "voxel grid, emitter sampling off"),
            ("homogeneous_emitter_sampling", "homogeneous, default settings"),
            ("homogeneous", "homogeneous, emitter sampling off"),
        ]
        .into_iter()
        .filter_map(|(key, what)| {
            Some((format!("Mitsuba {version} scalar, {what}"), value[key]["paths_per_cpu_second"].as_f64()?))
        })
        .collect(),
    )
}
