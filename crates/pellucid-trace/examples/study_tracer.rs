//! Error against run time of every estimator of the path tracer, and its paths a second beside
//! Mitsuba's: writes tracer.csv, tracer.md and tracer.svg.
//!
//! `cargo run --release -p pellucid-trace --example study_tracer -- docs/results [reference spp]`

use std::error::Error;
use std::fmt::Write as _;
use std::path::Path;
use std::time::Instant;

use pellucid_trace::{
    AnalyticScene, AssistOptions, Backend, Boundary, ErrorTarget, Medium, Optics, Shape, TraceOptions,
    Tracer, Volume,
};
use pellucid_voxel::{
    Control, Frame, LabelGrid, Material, MaterialTable, Pitch, Surface, SurfaceOptions, TILE, TILE_VOXELS,
    Tile,
};

const WHITE: u8 = 5;

/// An object and the points at which it is judged.
struct Scene {
    name: &'static str,
    what: &'static str,
    volume: Volume,
    /// A connected part of the surface, for estimators that share between points.
    patch: Vec<u32>,
    /// Every so manieth point of the patch, at which errors are taken.
    judged: Vec<usize>,
}

/// One measurement.
struct Row {
    scene: &'static str,
    estimator: &'static str,
    spp: f64,
    microseconds: f64,
    rmse: f64,
    bias: f64,
}

fn hash(v: [i64; 3]) -> u64 {
    v.iter().fold(0x9E37_79B9_7F4A_7C15, |h: u64, &c| {
        let h = (h ^ c as u64).wrapping_mul(0xFF51_AFD7_ED55_8CCD);
        h ^ (h >> 32)
    })
}

/// A halftoned material: white mixed with a second ink, pale, mid and dark by turns.
fn halftone(p: [f64; 3], v: [i64; 3]) -> u8 {
    let wave =
        |k: f64| 0.5 * ((k * p[0]).sin() * (1.1 * k * p[1] + 1.0).sin() + (0.9 * k * p[2] + 2.0).sin());
    let white = 0.55 + 0.45 * wave(2.1) + 0.2 * wave(9.8);
    let h = hash(v);
    if (h % 1000) as f64 <= 1000.0 * white {
        WHITE
    } else {
        1 + ((h / 1024 + u64::from(wave(1.3) > 0.0) + 2 * u64::from(wave(0.9) > 0.2)) % 4) as u8
    }
}

/// Labels from a depth below the surface (negative outside), 1-Lipschitz, and a skin.
fn solid(half: [f64; 3], skin: f64, depth: impl Fn([f64; 3]) -> f64 + Sync) -> LabelGrid {
    let pitch = Pitch::j750();
    let mm = pitch.mm();
    let size = std::array::from_fn(|a| (2.0 * half[a] / mm[a]).ceil() as u32);
    let frame = Frame::new(half.map(|h| -h), pitch, size).expect("a valid frame");
    let reach = 8.1 * mm.iter().map(|m| m * m).sum::<f64>().sqrt();
    LabelGrid::from_tiles(frame, |t| {
        let at = t.map(|c| i64::from(c) * TILE as i64);
        let middle = frame.centre_mm(at.map(|c| c + 8));
        if depth(middle) > skin + reach {
            return Tile::Constant(WHITE);
        }
        if depth(middle) < -reach {
            return Tile::Constant(0);
        }
        let mut labels = Box::new([0; TILE_VOXELS]);
        for (i, label) in labels.iter_mut().enumerate() {
            let v = [
                at[0] + (i % TILE) as i64,
                at[1] + (i / TILE % TILE) as i64,
                at[2] + (i / TILE / TILE) as i64,
            ];
            let p = frame.centre_mm(v);
            let d = depth(p);
            *label = if d < 0.0 {
                0
            } else if d > skin {
                WHITE
            } else {
                halftone(p, v)
            };
        }
        Tile::Dense(labels)
    })
}

fn ball(diameter: f64, skin: f64) -> LabelGrid {
    let r = diameter / 2.0;
    solid([r; 3], skin, |p| r - p.iter().map(|c| c * c).sum::<f64>().sqrt())
}

fn scene(name: &'static str, what: &'static str, grid: &LabelGrid) -> Result<Scene, Box<dyn Error>> {
    let control = Control::none();
    let surface = Surface::extract(grid, &SurfaceOptions::default(), &control)?;
    let volume = Volume::new(grid, &surface, &control)?;
    // A cap of 2 mm radius about the point farthest along (1, 0.5, 2).
    let frame = grid.frame();
    let position = |i: usize| frame.centre_mm(surface.voxels()[i].map(i64::from));
    let along = |i: usize| {
        let p = position(i);
        let n = surface.normals()[i];
        p[2] * 2.0 + p[0] + 0.5 * p[1] + f64::from(n[2])
    };
    let flat = frame.size()[2] < 100;
    let top = if flat {
        let s = frame.size();
        let top = (0..s[2]).rev().find_map(|z| surface.index_of([s[0] / 2, s[1] / 2, z]));
        top.ok_or("no surface in the middle")? as usize
    } else {
        (0..surface.len()).max_by(|&a, &b| along(a).total_cmp(&along(b))).ok_or("no surface")?
    };
    let centre = position(top);
    let patch: Vec<u32> = (0..surface.len())
        .filter(|&i| {
            let p = position(i);
            (0..3).map(|a| (p[a] - centre[a]).powi(2)).sum::<f64>() < 4.0
        })
        .map(|i| i as u32)
        .collect();
    let stride = (patch.len() / 500).max(1);
    let judged = (0..patch.len()).step_by(stride).collect();
    Ok(Scene { name, what, volume, patch, judged })
}

/// Processor seconds of this process where the system tells, else seconds on the clock: other
/// work on the machine lengthens only the latter.
fn seconds() -> f64 {
    thread_local!(static START: Instant = Instant::now());
    let mut total = 0u64;
    if let Ok(tasks) = std::fs::read_dir("/proc/self/task") {
        for task in tasks.flatten() {
            let text = std::fs::read_to_string(task.path().join("schedstat")).unwrap_or_default();
            total += text.split(' ').next().and_then(|n| n.parse::<u64>().ok()).unwrap_or(0);
        }
    }
    if total > 0 { total as f64 * 1e-9 } else { START.with(|s| s.elapsed().as_secs_f64()) }
}

fn measure(scene: &Scene, reference_spp: u32, rows: &mut Vec<Row>) -> Result<(), Box<dyn Error>> {
    let control = Control::none();
    let materials = MaterialTable::cmykw();
    let n = materials.channels();
    let tracer =
        |spp| Tracer::new(&scene.volume, &materials, TraceOptions { spp, ..TraceOptions::default() });
    let judged: Vec<u32> = scene.judged.iter().map(|&i| scene.patch[i]).collect();
    let count = judged.len() * n;
    let mut reference = vec![0.0; count];
    let mut reference_error = vec![0.0; count];
    tracer(reference_spp)?.radiance_with_error(
        &judged,
        1000,
        &mut reference,
        &mut reference_error,
        &control,
    )?;
    let noise = reference_error.iter().map(|&e| f64::from(e).powi(2)).sum::<f64>() / count as f64;
    let errors = |l: &[f32]| {
        let d: Vec<f64> = l.iter().zip(&reference).map(|(a, b)| f64::from(a - b)).collect();
        let square = d.iter().map(|d| d * d).sum::<f64>() / count as f64;
        // The reference's own variance is known and does not belong to the estimator.
        ((square - noise).max(0.0).sqrt(), d.iter().sum::<f64>() / count as f64)
    };
    for exponent in 0..=10 {
        let spp = 1 << exponent;
        let tracer = tracer(spp)?;
        let mut l = vec![0.0; count];
        let start = seconds();
        tracer.radiance(&judged, 0, &mut l, &control)?;
        let microseconds = (seconds() - start) * 1e6 / count as f64;
        let (rmse, bias) = errors(&l);
        rows.push(Row {
            scene: scene.name,
            estimator: "plain",
            spp: f64::from(spp),
            microseconds,
            rmse,
            bias,
        });
        if exponent <= 8 {
            let mut all = vec![0.0; scene.patch.len() * n];
            let start = seconds();
            tracer.radiance_assisted(&scene.patch, 0, &AssistOptions::default(), &mut all, &control)?;
            let microseconds = (seconds() - start) * 1e6 / all.len() as f64;
            let some: Vec<f32> =
                scene.judged.iter().flat_map(|&i| all[i * n..(i + 1) * n].iter().copied()).collect();
            let (rmse, bias) = errors(&some);
            rows.push(Row {
                scene: scene.name,
                estimator: "assisted",
                spp: f64::from(spp),
                microseconds,
                rmse,
                bias,
            });
        }
    }
    for std_error in [0.08f32, 0.04, 0.02, 0.01] {
        let (mut l, mut e) = (vec![0.0; count], vec![0.0; count]);
        let start = seconds();
        let target = ErrorTarget { std_error, max_spp: 1 << 16 };
        let paths = tracer(1)?.radiance_to(&judged, 0, target, &mut l, &mut e, &control)?;
        let microseconds = (seconds() - start) * 1e6 / count as f64;
        let (rmse, bias) = errors(&l);
        let spp = paths as f64 / count as f64;
        rows.push(Row { scene: scene.name, estimator: "adaptive", spp, microseconds, rmse, bias });
    }
    Ok(())
}

/// The time at which an estimator's curve passes `rmse`, interpolated in logarithms.
fn time_for(rows: &[Row], scene: &str, estimator: &str, rmse: f64) -> Option<f64> {
    let curve: Vec<&Row> = rows.iter().filter(|r| r.scene == scene && r.estimator == estimator).collect();
    if curve.first()?.rmse <= rmse {
        return Some(curve[0].microseconds);
    }
    curve.windows(2).find(|w| w[0].rmse > rmse && w[1].rmse <= rmse).map(|w| {
        let t = (w[0].rmse / rmse).ln() / (w[0].rmse / w[1].rmse).ln();
        (w[0].microseconds.ln() + t * (w[1].microseconds / w[0].microseconds).ln()).exp()
    })
}

/// Best paths a second of several runs of the white cube, blue, index-matched, on this thread.
fn cube_rates() -> Result<Vec<(String, f64)>, Box<dyn Error>> {
    let control = Control::none();
    let pitch = Pitch::j750();
    let frame = Frame::new([0.0; 3], pitch, pitch.mm().map(|m| (10.0 / m).round() as u32))?;
    let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(1));
    let s = frame.size();
    let surface = Surface::extract(&grid, &SurfaceOptions::default(), &control)?;
    let top = surface.index_of([s[0] / 2, s[1] / 2, s[2] - 1]).ok_or("no top")?;
    let volume = Volume::new(&grid, &surface, &control)?;
    let white = Material::from_albedo("white", &[0.999], &[24.0], 0.4);
    let optics =
        Optics { sigma_s: f64::from(white.sigma_s[0]), sigma_a: f64::from(white.sigma_a[0]), g: 0.4 };
    let table = MaterialTable::new(vec!["B".into()], vec![white])?;
    let mut out = Vec::new();
    let base = TraceOptions { boundary: Boundary::Matched, ..TraceOptions::default() };
    for backend in Backend::available() {
        let spp = if backend == Backend::Portable { 4096 } else { 65_536 };
        let tracer = Tracer::new(&volume, &table, TraceOptions { spp, backend: Some(backend), ..base })?;
        let mut best = 0.0f64;
        for _ in 0..7 {
            let start = seconds();
            tracer.radiance(&[top], 0, &mut [0.0], &control)?;
            best = best.max(f64::from(spp) / (seconds() - start));
        }
        out.push((format!("voxel grid, {backend:?}"), best));
    }
    let shape = Shape::Box { min_mm: [0.0; 3], max_mm: [10.0; 3] };
    let scene = AnalyticScene::new(shape, Medium::Homogeneous(0), vec![optics])?;
    let start = seconds();
    scene.radiance([5.0, 5.0, 10.0], [0.0, 0.0, 1.0], &TraceOptions { spp: 8192, ..base }, &control)?;
    out.push(("homogeneous box, double precision".into(), 8192.0 / (seconds() - start)));
    Ok(out)
}

/// Mitsuba's rates, when Python has it.
fn mitsuba_rates() -> Option<Vec<(String, f64)>> {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../benches/peers/mitsuba_cube.py");
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

fn markdown(scenes: &[(&str, &str)], rows: &[Row], rates: &[(String, f64)], reference_spp: u32) -> String {
    let mut text = String::from("# Path tracer: error against run time\n\n");
    let _ = writeln!(
        text,
        "Written by `cargo run --release -p pellucid-trace --example study_tracer -- docs/results`. One thread, \
         times are processor time per point and channel. Boundary n = 1.5, default materials. RMSE over about \
         500 points and 3 channels against {reference_spp} paths, whose own variance is subtracted.\n"
    );
    let _ = writeln!(text, "| scene | what |\n| --- | --- |");
    for (name, what) in scenes {
        let _ = writeln!(text, "| {name} | {what} |");
    }
    let _ = writeln!(text, "\n## Microseconds a point and channel for an RMSE\n");
    let _ = writeln!(text, "| scene | estimator | 0.05 | 0.03 | 0.02 | 0.01 | gain at 0.03 | gain at 0.02 |");
    let _ = writeln!(text, "| --- | --- | --- | --- | --- | --- | --- | --- |");
    let show = |v: Option<f64>| v.map_or("-".to_owned(), |v| format!("{v:.1}"));
    for (scene, _) in scenes {
        for estimator in ["plain", "adaptive", "assisted"] {
            let t = |rmse| time_for(rows, scene, estimator, rmse);
            let gain = |rmse| time_for(rows, scene, "plain", rmse).zip(t(rmse)).map(|(p, e)| p / e);
            let _ = writeln!(
                text,
                "| {scene} | {estimator} | {} | {} | {} | {} | {} | {} |",
                show(t(0.05)),
                show(t(0.03)),
                show(t(0.02)),
                show(t(0.01)),
                show(gain(0.03)),
                show(gain(0.02))
            );
        }
    }
    let _ = writeln!(
        text,
        "\n`assisted` is biased: its mean error is in `tracer.csv`. A dash: not reached within 256 paths \
         (assisted) or 1024 (plain). `adaptive` spends paths to make the error even over points, which the RMSE \
         over all of them does not reward.\n"
    );
    let _ = writeln!(text, "## White cube of 10 mm, blue, index-matched, one thread\n");
    let _ = writeln!(text, "| tracer | paths/s | ns a scattering |\n| --- | --- | --- |");
    for (name, rate) in rates {
        let _ = writeln!(text, "| {name} | {rate:.0} | {:.2} |", 1e9 / rate / 331.0);
    }
    let find = |key: &str| rates.iter().find(|(n, _)| n.contains(key)).map(|(_, r)| *r);
    for backend in ["Avx512", "Avx2"] {
        if let (Some(ours), Some(default), Some(fast)) =
            (find(&format!("grid, {backend}")), find("grid, default"), find("grid, emitter sampling off"))
        {
            let _ = writeln!(
                text,
                "\n{backend}: {:.0} times Mitsuba's voxel grid with its default settings, {:.0} times with \
                 emitter sampling off.",
                ours / default,
                ours / fast
            );
        }
    }
    let _ = writeln!(text, "\n331 scatterings a path on average. Plain unbiased tracking.");
    text
}

fn svg(scenes: &[(&str, &str)], rows: &[Row]) -> String {
    let (width, height, pad) = (300.0, 240.0, 42.0);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" font-family=\"sans-serif\" \
         font-size=\"10\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
        width * scenes.len() as f64,
        height + 24.0
    );
    let colours = [("plain", "#1f77b4"), ("adaptive", "#2ca02c"), ("assisted", "#d62728")];
    for (k, (scene, _)) in scenes.iter().enumerate() {
        let left = k as f64 * width + pad;
        // 0.1 to 1000 microseconds across, RMSE 0.003 to 0.5 down.
        let x = |t: f64| left + (t / 0.1).log10() / 4.0 * (width - pad - 10.0);
        let y = |e: f64| {
            height - pad + 10.0
                - ((e.max(0.003) / 0.003).log10() / (0.5f64 / 0.003).log10()) * (height - pad - 15.0)
        };
        let _ = writeln!(out, "<text x=\"{}\" y=\"14\" font-size=\"12\">{scene}</text>", left + 90.0);
        for t in [0.1, 1.0, 10.0, 100.0, 1000.0] {
            let _ = writeln!(
                out,
                "<line x1=\"{0:.1}\" y1=\"20\" x2=\"{0:.1}\" y2=\"{1:.1}\" stroke=\"#ddd\"/><text x=\"{0:.1}\" \
                 y=\"{2:.1}\" text-anchor=\"middle\">{t}</text>",
                x(t),
                y(0.003),
                y(0.003) + 14.0
            );
        }
        for e in [0.003, 0.01, 0.03, 0.1, 0.3] {
            let _ = writeln!(
                out,
                "<line x1=\"{:.1}\" y1=\"{1:.1}\" x2=\"{2:.1}\" y2=\"{1:.1}\" stroke=\"#ddd\"/><text \
                 x=\"{3:.1}\" y=\"{4:.1}\" text-anchor=\"end\">{e}</text>",
                x(0.1),
                y(e),
                x(1000.0),
                x(0.1) - 3.0,
                y(e) + 3.0
            );
        }
        for (name, colour) in colours {
            let points: Vec<String> = rows
                .iter()
                .filter(|r| r.scene == *scene && r.estimator == name)
                .map(|r| format!("{:.1},{:.1}", x(r.microseconds), y(r.rmse)))
                .collect();
            let _ = writeln!(
                out,
                "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.8\"/>",
                points.join(" ")
            );
        }
    }
    for (i, (name, colour)) in colours.iter().enumerate() {
        let _ = writeln!(
            out,
            "<text x=\"{}\" y=\"{}\" fill=\"{colour}\">{name}</text>",
            pad + 80.0 * i as f64,
            height + 14.0
        );
    }
    let _ = writeln!(
        out,
        "<text x=\"{}\" y=\"{}\">RMSE of linear radiance against microseconds a point and channel, one thread</text>\n</svg>",
        pad + 260.0,
        height + 14.0
    );
    out
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let folder = args.next().unwrap_or_else(|| "docs/results".into());
    let reference_spp = args.next().map_or(Ok(16_384), |s| s.parse())?;
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global()?;
    let mut rates = cube_rates()?;
    rates.extend(mitsuba_rates().unwrap_or_default());
    for (name, rate) in &rates {
        eprintln!("{name}: {rate:.0} paths/s");
    }
    let mut rows = Vec::new();
    let mut names = Vec::new();
    type Maker = fn() -> LabelGrid;
    let makers: [(&str, &str, Maker); 5] = [
        ("p10", "slab 1 mm thick, 12 x 12 mm, halftone throughout", || {
            solid([6.0, 6.0, 0.5], 1.0, |p| (6.0 - p[0].abs()).min(6.0 - p[1].abs()).min(0.5 - p[2].abs()))
        }),
        ("s10", "ball of 10 mm, 1 mm halftone skin over white", || ball(10.0, 1.0)),
        ("s20", "ball of 20 mm, 1 mm halftone skin over white", || ball(20.0, 1.0)),
        ("s40", "ball of 40 mm, 1 mm halftone skin over white", || ball(40.0, 1.0)),
        ("w20", "ball of 20 mm, all white", || ball(20.0, 0.0)),
    ];
    for (name, what, make) in makers {
        let grid = make();
        let scene = scene(name, what, &grid)?;
        drop(grid);
        eprintln!("{name}: {} points in the patch, {} judged", scene.patch.len(), scene.judged.len());
        measure(&scene, reference_spp, &mut rows)?;
        names.push((scene.name, scene.what));
    }
    let mut csv = String::from("scene,estimator,spp,microseconds_per_value,rmse,mean_error\n");
    for r in &rows {
        let _ = writeln!(
            csv,
            "{},{},{:.1},{:.3},{:.5},{:.5}",
            r.scene, r.estimator, r.spp, r.microseconds, r.rmse, r.bias
        );
    }
    let folder = Path::new(&folder);
    std::fs::create_dir_all(folder)?;
    std::fs::write(folder.join("tracer.csv"), csv)?;
    std::fs::write(folder.join("tracer.md"), markdown(&names, &rows, &rates, reference_spp))?;
    std::fs::write(folder.join("tracer.svg"), svg(&names, &rows))?;
    Ok(())
}
