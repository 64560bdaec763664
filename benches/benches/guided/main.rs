//! What guiding the walk towards where light leaves could gain (Herholz et al. 2019, which Rittig et al. 2021 weigh and
//! leave): a walk in double precision with and without directions drawn by a fitted exit field.
//!
//! `cargo bench -p pellucid-benches --bench guided`: in a minute; `-- --full` with more paths for `docs/results/guided`.

mod field;
mod scene;
mod walk;

use std::sync::Arc;

use clap::Parser;
use field::{ExitField, Fit};
use pellucid::core::random::{Domain, hash};
use pellucid::voxel::{Control, MaterialTable};
use pellucid_benches::appearance::Error;
use pellucid_benches::prints::unrefined;
use pellucid_benches::solids::{ball, sheet};
use pellucid_benches::study::stopwatch::{on_one_thread, seconds};
use pellucid_benches::study::{Axis, Panel, Plot, Record, Series, Study, StudySettings, Table};
use rand_pcg::Pcg64;
use scene::{Optics, Scene};
use walk::walk;

/// Surface voxels of a scene.
const POINTS: usize = 48;
/// Shares of the fitted slope that guide: less keeps weights closer together.
const STRENGTHS: [f64; 2] = [1.0, 0.5];
const PILOT: Domain = Domain::new("guided: pilot");
const PLAIN: Domain = Domain::new("guided: plain");
const GUIDED: Domain = Domain::new("guided: guided");

/// What guiding the walk could gain
#[derive(Parser)]
struct Args {
    #[command(flatten)]
    study: StudySettings,
}

/// Paths of one kind over some points.
#[derive(Default)]
struct Paths {
    /// Mean throughput and variance of one path, by point.
    points: Vec<[f64; 2]>,
    microseconds: f64,
    events: f64,
}

/// A channel of a scene, both ways.
struct Compared {
    scene: String,
    channel: String,
    /// Share of the fitted slope that guides.
    strength: f64,
    plain: Arc<Paths>,
    guided: Paths,
    paths: u32,
    field: ExitField,
}

fn main() -> Result<(), Error> {
    let args = Args::parse();
    on_one_thread(|| study(&args))
}

fn study(args: &Args) -> Result<(), Error> {
    let control = Control::none();
    let (pilot, paths) = if args.study.full { (1_000, 20_000) } else { (200, 1_000) };
    let mut record = Record::now("guided", 1);
    record.add(
        "paths",
        format!("{paths} of each of {POINTS} surface voxels and channel, {pilot} to fit the field"),
    );
    record.add("walk", "double precision, refractive index 1.5, faces of voxels reflect");
    let study = Study::new("guided", env!("CARGO_TARGET_TMPDIR"), &args.study, record)?;
    let table = MaterialTable::cmykw();
    let scenes = [
        Scene::new("sheet of 1 mm", &sheet(1.0, SKIN_MM), &control)?,
        Scene::new("ball of 8 mm", &ball(8.0, SKIN_MM), &control)?,
        Scene::new("white ball of 8 mm", &ball(8.0, 0.0), &control)?,
        Scene::new("jug of 8 mm, unrefined", &unrefined("vase-handle", Some(8.0), &control)?.1, &control)?,
    ];
    let mut found = Vec::new();
    for scene in &scenes {
        for (channel, name) in ["red", "green", "blue"].into_iter().enumerate() {
            let optics = Optics::of(&table, channel);
            let field = fit(scene, &optics, pilot);
            let plain = Arc::new(measure(scene, &optics, None, PLAIN, paths));
            for strength in STRENGTHS {
                let field = field.times(strength);
                let guided = measure(scene, &optics, Some(&field), GUIDED, paths);
                let (plain, channel) = (Arc::clone(&plain), name.to_owned());
                let compared =
                    Compared { scene: scene.name.clone(), channel, strength, plain, guided, paths, field };
                println!("{}", compared.cells().join(", "));
                found.push(compared);
            }
        }
    }
    study.write("Guiding the walk", &markdown(&found), &rows(&found), &plot(&found))?;
    Ok(())
}

/// Halftoned skins of solids.
const SKIN_MM: f64 = 0.5;

/// Random numbers of one path. All of the state is hashed, so that they are uniform from path to path.
fn random(domain: Domain, point: usize, path: u32) -> Pcg64 {
    let word = |k: u64| u128::from(hash(1, domain, point as u64, 2 * u64::from(path) + k));
    Pcg64::new(word(0) << 64 | word(1), 0)
}

fn fit(scene: &Scene, optics: &Optics, paths: u32) -> ExitField {
    let mut fit = Fit::new();
    let mut visits = Vec::new();
    for point in scene.some(POINTS) {
        for path in 0..paths {
            visits.clear();
            let end = walk(scene, optics, None, point, &mut random(PILOT, point, path), Some(&mut visits));
            fit.add(&visits, end.throughput);
        }
    }
    fit.field()
}

fn measure(scene: &Scene, optics: &Optics, field: Option<&ExitField>, domain: Domain, paths: u32) -> Paths {
    let start = seconds();
    let mut all = Paths::default();
    for point in scene.some(POINTS) {
        let (mut sum, mut squares) = (0.0, 0.0);
        for path in 0..paths {
            let end = walk(scene, optics, field, point, &mut random(domain, point, path), None);
            sum += end.throughput;
            squares += end.throughput * end.throughput;
            all.events += f64::from(end.events);
        }
        let n = f64::from(paths);
        let mean = sum / n;
        all.points.push([mean, (squares / n - mean * mean) * n / (n - 1.0)]);
    }
    let total = all.points.len() as f64 * f64::from(paths);
    all.microseconds = (seconds() - start) * 1e6 / total;
    all.events /= total;
    all
}

impl Paths {
    fn mean(&self, of: usize) -> f64 {
        self.points.iter().map(|p| p[of]).sum::<f64>() / self.points.len().max(1) as f64
    }
}

impl Compared {
    /// Root mean square of the points' differences in standard errors: about 1 where both are right.
    fn z(&self) -> f64 {
        let n = f64::from(self.paths);
        let pairs = self.plain.points.iter().zip(&self.guided.points);
        let squares = pairs.map(|(a, b)| (a[0] - b[0]).powi(2) * n / (a[1] + b[1]).max(1e-12));
        (squares.sum::<f64>() / self.plain.points.len().max(1) as f64).sqrt()
    }

    fn at_equal_samples(&self) -> f64 {
        self.plain.mean(1) / self.guided.mean(1)
    }

    fn at_equal_time(&self) -> f64 {
        self.at_equal_samples() * self.plain.microseconds / self.guided.microseconds
    }

    fn cells(&self) -> Vec<String> {
        vec![
            self.scene.clone(),
            self.channel.clone(),
            self.strength.to_string(),
            format!("{:.3}", self.plain.mean(0)),
            format!("{:.2}", self.z()),
            format!("{:.4}", self.plain.mean(1)),
            format!("{:.4}", self.guided.mean(1)),
            format!("{:.0}", self.plain.events),
            format!("{:.0}", self.guided.events),
            format!("{:.2}", self.at_equal_samples()),
            format!("{:.2}", self.at_equal_time()),
        ]
    }
}

fn rows(found: &[Compared]) -> Table {
    let mut table = Table::new(&[
        "scene",
        "channel",
        ">slope",
        ">radiance",
        ">difference, standard errors",
        ">variance of a path",
        ">guided",
        ">events of a path",
        ">guided",
        ">gain at equal samples",
        ">at equal time",
    ]);
    found.iter().for_each(|compared| table.row(compared.cells()));
    table
}

fn markdown(found: &[Compared]) -> String {
    format!(
        "Directions of scattering drawn by the product of the phase function and an exit field, linear in the cosine to the \
         outward normal, fitted by least squares for each depth below the surface (the plot has its slope) and channel of \
         a scene; against the phase function alone, by the same code. Slope is the share of the fitted one that guides. Gains are ratios of variance, then of variance \
         times processor time, the fit's own paths left out. The difference of both is the root mean square over points in \
         standard errors, 1 where both estimate the same.\n\n{}",
        rows(found).markdown()
    )
}

/// The fitted slopes by depth.
fn plot(found: &[Compared]) -> Plot {
    let mut panels: Vec<Panel> = Vec::new();
    for compared in found.iter().filter(|compared| compared.strength == 1.0) {
        if panels.last().is_none_or(|p| p.title != compared.scene) {
            panels.push(Panel { title: compared.scene.clone(), series: Vec::new() });
        }
        let points = (0..Scene::bins()).map(|bin| [Scene::depth_mm(bin), compared.field.slope(bin)]);
        let series = Series { name: compared.channel.clone(), points: points.collect() };
        panels.last_mut().expect("one was pushed").series.push(series);
    }
    Plot {
        x: Axis { title: "depth, mm".into(), range: [0.01, 3.0] },
        y: Axis { title: "slope of the exit field".into(), range: [0.01, 1.0] },
        panels,
    }
}
