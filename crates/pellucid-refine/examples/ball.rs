//! Refines a textured ball with the path tracer and prints the errors of every iteration.
//!
//! ```text
//! cargo run --release -p pellucid-refine --example ball -- --diameter 8 --spp 32 [--texture cow]
//! ```
//! Every setting of the refinement is an option (`--gain 1`, `--compression 4`, ...). Errors are
//! judged at 2,000 random surface voxels with `--judge-spp` paths (default 512), of which a part
//! is Monte Carlo noise: the last line gives the mean error of one judgement against another.

use pellucid_color::{Gamut, MatchOptions, MixtureModel, mixture::table::DEFAULT_NODES};
use pellucid_refine::{
    AppearancePredictor, InkModel, Judge, PredictError, PrintInk, RefineInput, RefineSettings, Scene, refine,
};
use pellucid_trace::{AssistOptions, TraceOptions, Tracer, Volume};
use pellucid_voxel::{
    Control, Frame, LabelGrid, MaterialTable, NearestSurface, Pitch, Surface, SurfaceOptions, TILE,
    TILE_VOXELS, Tile,
};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

struct MonteCarlo {
    options: TraceOptions,
    assisted: bool,
}

impl AppearancePredictor for MonteCarlo {
    fn name(&self) -> &str {
        "mc"
    }

    fn predict(
        &mut self,
        scene: &Scene<'_>,
        points: &[u32],
        iteration: u32,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        let failed = |e| PredictError::failed("mc", e);
        let volume = Volume::new(scene.grid, scene.surface, control).map_err(failed)?;
        let tracer = Tracer::new(&volume, scene.materials, self.options.clone()).map_err(failed)?;
        if self.assisted {
            tracer.radiance_assisted(points, iteration, &AssistOptions::default(), out, control)
        } else {
            tracer.radiance(points, iteration, out, control)
        }
        .map_err(failed)
    }
}

struct Arguments(Vec<String>);

impl Arguments {
    fn text(&self, name: &str) -> Option<&str> {
        let at = self.0.iter().position(|a| a.strip_prefix("--") == Some(name))?;
        self.0.get(at + 1).map(String::as_str)
    }

    fn number<T: std::str::FromStr>(&self, name: &str, default: T) -> Result<T, String> {
        self.text(name)
            .map_or(Ok(default), |t| t.parse().map_err(|_| format!("--{name} {t} is not a number")))
    }
}

/// A ball with a bumpy surface, of one label.
fn ball(diameter: f64, label: u8) -> Result<LabelGrid, Box<dyn std::error::Error>> {
    let pitch = Pitch::j750();
    let size = pitch.mm().map(|p| (1.2 * diameter / p).ceil() as u32);
    let frame = Frame::new(pitch.mm().map(|_| -0.6 * diameter), pitch, size)?;
    Ok(LabelGrid::from_tiles(frame, |t| {
        let mut labels = Box::new([0; TILE_VOXELS]);
        for (i, l) in labels.iter_mut().enumerate() {
            let local = [i % TILE, i / TILE % TILE, i / TILE / TILE];
            let p = frame.centre_mm(std::array::from_fn(|a| i64::from(t[a]) * TILE as i64 + local[a] as i64));
            let r = p.iter().map(|v| v * v).sum::<f64>().sqrt().max(1e-9);
            let bump: f64 = p.iter().map(|v| (5.0 * v / r).sin()).product();
            if r < 0.5 * diameter * (1.0 + 0.08 * bump) {
                *l = label;
            }
        }
        Tile::Dense(labels)
    }))
}

/// A sharp texture over space; `p` in units of the radius.
fn texture(name: &str, p: [f64; 3]) -> [f32; 3] {
    let wave = |k: f64, s: f64| (k * p[0] + s).sin() + (k * p[1] + 2.0 * s).sin() + (k * p[2] - s).sin();
    match name {
        "cow" if wave(4.0, 0.3) + 0.5 * wave(9.0, 1.0) > 1.1 => [0.05, 0.05, 0.05],
        "cow" if p[1] < -0.75 => [1.0, 0.57, 0.4],
        "cow" => [1.0, 0.86, 0.79],
        "grey" => [0.5; 3],
        "stripes" => {
            let bands = [[0.05f32, 0.05, 0.06], [0.85, 0.8, 0.75], [0.6, 0.08, 0.06], [0.9, 0.8, 0.1]];
            bands[((p[2] + 2.0) * (8.0 + 4.0 * p[0])) as usize % 4]
        }
        _ => {
            let cell = |v: f64| ((v + 2.0) * 4.0) as usize;
            let k = (cell(p[0]) + 3 * cell(p[1]) + 5 * cell(p[2])) % 7;
            let palette = [
                [0.6f32, 0.05, 0.05],
                [0.9, 0.8, 0.1],
                [0.05, 0.2, 0.5],
                [0.95, 0.95, 0.95],
                [0.1, 0.4, 0.1],
                [0.03, 0.03, 0.03],
                [0.5, 0.3, 0.2],
            ];
            palette[k]
        }
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments = Arguments(std::env::args().skip(1).collect());
    let diameter: f64 = arguments.number("diameter", 8.0)?;
    let base = RefineSettings::default();
    let settings = RefineSettings {
        iterations: arguments.number("iterations", base.iterations)?,
        coloured_depth_mm: arguments.number("depth", base.coloured_depth_mm)?,
        layers: arguments.number("layers", base.layers)?,
        compression: arguments.number("compression", base.compression)?,
        reach: arguments.number("reach", base.reach)?,
        gain: arguments.number("gain", base.gain)?,
        gain_decay: arguments.number("decay", base.gain_decay)?,
        residual_blur_mm: arguments.number("blur", base.residual_blur_mm)?,
        seed: arguments.number("seed", base.seed)?,
    };
    let control = Control::none();
    let materials = MaterialTable::cmykw();
    let mut grid = ball(diameter, 5)?;
    let surface = Surface::extract(&grid, &SurfaceOptions::default(), &control)?;
    let nearest = NearestSurface::build(&grid, &surface, settings.coloured_depth_mm, &control)?;
    let model = MixtureModel::new(&materials, "white", 1.5)?;
    let gamut = Gamut::build(model, MatchOptions::default(), DEFAULT_NODES, &control)?;
    let ink = PrintInk::new(&gamut)?;
    let name = arguments.text("texture").unwrap_or("cow");
    let target: Vec<[f32; 3]> = (0..surface.len() as u32)
        .map(|i| texture(name, surface.position_mm(i).map(|v| 2.0 * v / diameter)))
        .collect();
    let input = RefineInput {
        surface: &surface,
        nearest: &nearest,
        materials: &materials,
        ink: &ink,
        target: &target,
        aim: None,
    };
    let options = |spp, seed| TraceOptions { spp, seed, ..TraceOptions::default() };
    let assisted = arguments.number("assisted", 0u8)? > 0;
    let mut tracer = MonteCarlo { options: options(arguments.number("spp", 32)?, 1), assisted };
    let judge_spp = arguments.number("judge-spp", 512)?;
    let mut judge = MonteCarlo { options: options(judge_spp, 2), assisted: false };
    let mut random = Pcg64Mcg::seed_from_u64(3);
    let points: Vec<u32> = (0..arguments.number("judge-points", 2000)?)
        .map(|_| (random.next_u64() % surface.len() as u64) as u32)
        .collect();
    println!("{name}: {} surface voxels; {settings:?}", surface.len());
    let report = refine(
        &mut grid,
        &input,
        &mut tracer,
        Some(Judge { predictor: &mut judge, points: &points }),
        &settings,
        &mut |state| {
            let r = state.report;
            println!(
                "{:2}{} mean {:.2} median {:.2} p95 {:.2} max {:.1}; {} flips, {:.2} s halftone, {:.1} s predict",
                r.iteration,
                if state.best { "*" } else { " " },
                r.mapped.mean,
                r.mapped.median,
                r.mapped.p95,
                r.mapped.max,
                r.label_flips,
                r.halftone_seconds,
                r.predict_seconds
            );
        },
        &control,
    )?;
    let first = report.iterations[0].mapped.mean;
    let best = report.best_iteration().ok_or("no iteration")?.mapped.mean;
    println!("{first:.2} -> {best:.2}: {:.1} % less", 100.0 * (1.0 - best / first));
    let scene = Scene { grid: &grid, surface: &surface, materials: &materials };
    let mut two = [vec![0.0; 3 * points.len()], vec![0.0; 3 * points.len()]];
    judge.predict(&scene, &points, 0, &mut two[0], &control)?;
    judge.predict(&scene, &points, 1, &mut two[1], &control)?;
    let noise: f64 = two[0]
        .chunks_exact(3)
        .zip(two[1].chunks_exact(3))
        .map(|(a, b)| f64::from(ink.delta_e(ink.relative_rgb(a), ink.relative_rgb(b))))
        .sum();
    println!("two judgements differ by {:.2} on average", noise / points.len() as f64);
    Ok(())
}
