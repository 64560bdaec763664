//! A slab, an ink model whose three channels differ, and small predictors.
#![allow(dead_code)] // Each test file uses its part.

use std::sync::Arc;
use std::sync::Mutex;

use pellucid_color::{MediaWhite, Viewing};
use pellucid_core::random::{Domain, uniform};
use pellucid_predict::{
    BoundPredictor, Changed, Diagnostics, Draw, Learned, MaterialGradient, Object, Pass, PredictError,
};
use pellucid_refine::{InkModel, Problem};
use pellucid_voxel::{
    Control, Frame, LabelGrid, Material, MaterialTable, NearestSurface, Pitch, Surface, SurfaceOptions, Tile,
};

pub const CYAN: u8 = 1;
pub const WHITE: u8 = 5;
pub const MEDIA_WHITE: [f64; 3] = [0.7, 0.8, 0.6];
/// What a voxel of pure cyan takes of R, of magenta of G, of yellow of B.
pub const TAKES: [f32; 3] = [0.9, 0.8, 0.7];

/// Cyan, magenta and yellow, each of which darkens one channel in proportion.
pub struct Inks;

impl InkModel for Inks {
    fn labels(&self) -> &[u8] {
        &[1, 2, 3, WHITE]
    }
    fn fractions(&self, rgb: [f32; 3], fractions: &mut [f32]) -> [f32; 3] {
        let wanted: [f32; 3] = std::array::from_fn(|c| ((1.0 - rgb[c]) / TAKES[c]).clamp(0.0, 1.0));
        let scale = wanted.iter().sum::<f32>().max(1.0);
        (0..3).for_each(|c| fractions[c] = wanted[c] / scale);
        fractions[3] = (1.0 - wanted.iter().sum::<f32>() / scale).max(0.0);
        self.color(fractions)
    }
    fn color(&self, fractions: &[f32]) -> [f32; 3] {
        std::array::from_fn(|c| 1.0 - TAKES[c] * fractions[c])
    }
}

/// A solid block with all that a problem needs.
pub struct Slab {
    pub solid: LabelGrid,
    pub nearest: NearestSurface,
    pub object: Arc<Object>,
    pub viewing: Viewing,
    pub target: Vec<[f32; 3]>,
    pub printable: Vec<[f32; 3]>,
}

pub fn table(channels: usize) -> MaterialTable {
    match channels {
        3 => MaterialTable::cmykw(),
        n => {
            let material = |name: &&str| Material {
                name: (*name).to_owned(),
                sigma_s: vec![5.0; n],
                sigma_a: vec![1.0; n],
                g: 0.4.into(),
            };
            let names = ["cyan", "magenta", "yellow", "black", "white"];
            let channels = (0..n).map(|k| format!("channel {k}")).collect();
            MaterialTable::new(channels, names.iter().map(material).collect()).unwrap()
        }
    }
}

/// Which of R, G, B a channel counts for.
pub fn band(channel: usize, channels: usize) -> usize {
    if channels == 1 { 1 } else { channel * 3 / channels }
}

pub fn viewing(channels: usize) -> Viewing {
    let white = MediaWhite::new(MEDIA_WHITE).unwrap();
    if channels == 3 {
        return Viewing::rgb(white);
    }
    let rows = std::array::from_fn(|c| {
        let own = |k: &usize| channels == 1 || band(*k, channels) == c;
        let count = (0..channels).filter(own).count() as f64;
        (0..channels).map(|k| if own(&k) { 1.0 / count } else { 0.0 }).collect()
    });
    Viewing::from_rows(rows, if channels == 1 { MediaWhite::new([0.8; 3]).unwrap() } else { white }).unwrap()
}

impl Slab {
    pub fn new(pitch: Pitch, size: [u32; 3], channels: usize, depth_mm: f64) -> Self {
        let frame = Frame::new([0.0; 3], pitch, size).unwrap();
        let solid = LabelGrid::from_tiles(frame, |_| Tile::Constant(WHITE));
        let control = Control::none();
        let surface = Surface::extract(&solid, &SurfaceOptions::default(), &control).unwrap();
        let nearest = NearestSurface::build(&solid, &surface, depth_mm, &control).unwrap();
        let object = Arc::new(Object::new(surface, table(channels), 1.5).unwrap());
        Self { solid, nearest, object, viewing: viewing(channels), target: vec![], printable: vec![] }
    }

    /// The slab that most tests use.
    pub fn small() -> Self {
        Self::new(Pitch::new([0.05, 0.05, 0.03]).unwrap(), [40, 20, 60], 3, 0.6)
    }

    /// Sets the target by voxel.
    pub fn towards(mut self, target: impl Fn([u32; 3]) -> [f32; 3]) -> Self {
        self.target = self.object.surface().voxels().iter().map(|&v| target(v)).collect();
        self.printable = self.target.iter().map(|&t| Inks.fractions(t, &mut [0.0; 4])).collect();
        self
    }

    pub fn problem(&self) -> Problem<'_> {
        Problem {
            object: &self.object,
            nearest: &self.nearest,
            ink: &Inks,
            viewing: &self.viewing,
            target: &self.target,
            printable_target: &self.printable,
            further: &[],
        }
    }

    pub fn blur(&self) -> Blur {
        Blur::new(self.object.clone())
    }
}

/// What a [`Blur`] was told of changes: whether anything might have, and otherwise which tiles.
#[derive(Clone, Debug, PartialEq)]
pub enum Told {
    Unknown,
    /// Tiles told of, and those that really differ.
    Tiles(Vec<u32>, Vec<u32>),
}

/// Looks straight down: what the inks leave, averaged over depth with weight falling off over `depth` voxels, and
/// sideways over `reach` voxels, as scattering does. With noise and with a memory on request.
pub struct Blur {
    pub object: Arc<Object>,
    pub labels: Option<LabelGrid>,
    pub depth: f64,
    pub reach: i64,
    /// Values are multiplied by 0 or 2, as few paths do.
    pub few_paths: bool,
    /// Standard deviation of what is added to values, over the square root of the effort.
    pub noise: f64,
    /// Adds what all passes absorbed so far learned.
    pub learns: bool,
    /// Fails in this iteration.
    pub fails_in: Option<u32>,
    pub told: Vec<Told>,
    pub memory: Learned,
    /// Iterations asked for.
    pub asked: Mutex<Vec<u32>>,
    /// With what effort.
    pub efforts: Mutex<Vec<u32>>,
}

impl Blur {
    pub fn new(object: Arc<Object>) -> Self {
        Self {
            object,
            labels: None,
            depth: 6.0,
            reach: 3,
            few_paths: false,
            noise: 0.0,
            learns: false,
            fails_in: None,
            told: Vec::new(),
            memory: Learned::default(),
            asked: Mutex::new(Vec::new()),
            efforts: Mutex::new(Vec::new()),
        }
    }

    /// What is seen of each channel, 0 to 1, and the sum of the weights behind it.
    fn values(&self, labels: &LabelGrid, voxel: [u32; 3]) -> ([f64; 3], f64) {
        let (mut sums, mut total) = ([0.0; 3], 0.0);
        self.each(labels, voxel, |_, label, weight| {
            sums.iter_mut().enumerate().for_each(|(c, sum)| *sum += weight * left(label, c));
            total += weight;
        });
        // Light meets ink several times on its way: mixtures look darker than their mean.
        (sums.map(|sum| (sum / total).powf(1.6)), total)
    }

    /// Visits the solid voxels about one: position, label, weight.
    fn each(&self, labels: &LabelGrid, voxel: [u32; 3], mut visit: impl FnMut([i64; 3], u8, f64)) {
        let [x, y, z] = voxel.map(i64::from);
        let up = if 2 * voxel[2] < labels.size()[2] { 1 } else { -1 };
        for dz in 0..24 {
            let share = (-(dz as f64) / self.depth).exp();
            for dx in -self.reach..=self.reach {
                let at = [x + dx, y, z + up * dz];
                let label = labels.at(at);
                if label != 0 {
                    visit(at, label, share / (1.0 + dx.abs() as f64));
                }
            }
        }
    }
}

/// What a voxel of a label leaves of a channel.
fn left(label: u8, c: usize) -> f64 {
    if usize::from(label) == c + 1 { 1.0 - f64::from(TAKES[c]) } else { 1.0 }
}

impl BoundPredictor for Blur {
    fn update(
        &mut self,
        labels: &LabelGrid,
        changed: Changed<'_>,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        control.check()?;
        self.told.push(match (changed, &self.labels) {
            (Changed::Tiles(tiles), Some(old)) => {
                let differs = |t: &u32| {
                    let (a, b) = (&old.tiles()[*t as usize], &labels.tiles()[*t as usize]);
                    (0..4096).any(|i| {
                        let at = |tile: &Tile| tile.label(i % 16, i / 16 % 16, i / 256);
                        at(a) != at(b)
                    })
                };
                let all = 0..labels.tiles().len() as u32;
                Told::Tiles(tiles.to_vec(), all.filter(differs).collect())
            }
            _ => Told::Unknown,
        });
        self.labels = Some(labels.clone());
        Ok(())
    }

    fn predict(
        &self,
        points: &[u32],
        draw: Draw,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<Diagnostics, PredictError> {
        self.object.check_points(points, out.len())?;
        let labels = self.labels.as_ref().ok_or_else(|| PredictError::invalid("labels", "none yet"))?;
        let iteration = match draw.pass {
            Pass::Loop(iteration) => {
                self.asked.lock().unwrap().push(iteration);
                self.efforts.lock().unwrap().push(draw.effort);
                iteration
            }
            Pass::Repeat(iteration) => iteration,
            _ => return Err(PredictError::invalid("pass", "is not of a loop")),
        };
        let channels = self.object.channels();
        let learned = 0.02 * self.memory.values.iter().sum::<f64>();
        for (i, (&p, out)) in points.iter().zip(out.chunks_exact_mut(channels)).enumerate() {
            if i % 256 == 0 {
                control.report(i as u64, points.len() as u64);
                control.check()?;
            }
            let voxel = self.object.surface().voxels()[p as usize];
            let (seen, _) = self.values(labels, voxel);
            let colors: [f64; 3] = std::array::from_fn(|c| MEDIA_WHITE[c] * seen[c]);
            for (k, out) in out.iter_mut().enumerate() {
                let mut value = colors[band(k, channels)];
                if self.few_paths {
                    let domain = Domain::new("few paths").pass(iteration);
                    value *= if uniform(draw.seed, domain, u64::from(p), k as u64) < 0.5 { 2.0 } else { 0.0 };
                }
                if self.noise > 0.0 {
                    let domain = Domain::new("noise").pass(draw.pass.number());
                    let u = uniform(draw.seed, domain, u64::from(p), k as u64) - 0.5;
                    value += self.noise * 12.0f64.sqrt() * u / f64::from(draw.effort).sqrt();
                }
                *out = (value + learned) as f32;
            }
        }
        if self.fails_in == Some(iteration) {
            return Err(PredictError::failed("blur", "planted"));
        }
        let mut diagnostics = Diagnostics::default();
        if self.learns {
            let mean = out.iter().map(|&v| f64::from(v)).sum::<f64>() / out.len() as f64;
            diagnostics.learned = Learned {
                predictor: "blur".into(),
                passes: vec![draw.pass.number()],
                values: vec![mean / 3.0],
                ..Learned::default()
            };
        }
        Ok(diagnostics)
    }

    fn pullback(
        &self,
        points: &[u32],
        _: Draw,
        d_radiance: &[f32],
        out: &mut dyn MaterialGradient,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        let labels = self.labels.as_ref().ok_or_else(|| PredictError::invalid("labels", "none yet"))?;
        let channels = self.object.channels();
        let (mut voxels, mut rows) = (Vec::new(), Vec::new());
        for (&p, d) in points.iter().zip(d_radiance.chunks_exact(channels)) {
            control.check()?;
            let voxel = self.object.surface().voxels()[p as usize];
            let (seen, total) = self.values(labels, voxel);
            let slopes: [f64; 3] = std::array::from_fn(|c| {
                let d: f64 = (0..channels).filter(|&k| band(k, channels) == c).map(|k| f64::from(d[k])).sum();
                d * MEDIA_WHITE[c] * 1.6 * seen[c].powf(0.6 / 1.6) / total
            });
            voxels.clear();
            rows.clear();
            self.each(labels, voxel, |at, _, weight| {
                voxels.push(at.map(|v| v as u32));
                rows.extend((1..=WHITE).map(|label| {
                    let by_channels = slopes.iter().enumerate().map(|(c, slope)| slope * left(label, c));
                    (weight * by_channels.sum::<f64>()) as f32
                }));
            });
            out.add_rows(&voxels, &rows);
        }
        Ok(())
    }

    fn absorb(&mut self, learned: &Learned) -> Result<(), PredictError> {
        for (pass, value) in learned.passes.iter().zip(&learned.values) {
            if !self.memory.passes.contains(pass) {
                self.memory.predictor = learned.predictor.clone();
                self.memory.passes.push(*pass);
                self.memory.values.push(*value);
            }
        }
        Ok(())
    }

    fn memory(&self) -> Learned {
        self.memory.clone()
    }
}
