//! Derivatives collected, and their functionals with standard errors.

use std::collections::BTreeMap;

use pellucid_core::Team;
use pellucid_trace::{AdjointOptions, Derivatives, TraceOptions, Tracer, Volume};
use pellucid_voxel::{Control, Material, MaterialTable};

use crate::common::Object;

/// All that was added.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sums {
    pub values: BTreeMap<([u32; 3], u8), f64>,
    /// Every call, as bits.
    pub calls: Vec<([u32; 3], u8, u32)>,
    pub region: Option<[[u32; 3]; 2]>,
}

impl Derivatives for Sums {
    fn add(&mut self, voxel: [u32; 3], label: u8, derivative: f32) {
        *self.values.entry((voxel, label)).or_default() += f64::from(derivative);
        self.calls.push((voxel, label, derivative.to_bits()));
    }

    fn region(&self) -> Option<[[u32; 3]; 2]> {
        self.region
    }
}

impl Sums {
    pub fn at(&self, voxel: [u32; 3], label: u8) -> f64 {
        self.values.get(&(voxel, label)).copied().unwrap_or(0.0)
    }

    /// Sum over voxels of the derivative by a label that may depend on the voxel.
    pub fn total(&self, label: impl Fn([u32; 3]) -> Option<u8>) -> f64 {
        self.values.iter().filter(|((v, l), _)| label(*v) == Some(*l)).map(|(_, d)| d).sum()
    }
}

/// What is differentiated.
#[derive(Clone, Copy)]
pub struct Scene<'a> {
    pub volume: &'a Volume,
    pub table: &'a MaterialTable,
    pub options: TraceOptions,
    pub points: &'a [u32],
    pub d_radiance: &'a [f32],
}

impl<'a> Scene<'a> {
    pub fn new(
        object: &'a Object,
        table: &'a MaterialTable,
        options: TraceOptions,
        points: &'a [u32],
        d_radiance: &'a [f32],
    ) -> Self {
        Self { volume: &object.volume, table, options, points, d_radiance }
    }

    pub fn pullback(&self, iteration: u32, paths: f32) -> Sums {
        let mut sums = Sums::default();
        self.pullback_to(iteration, paths, &mut sums);
        sums
    }

    pub fn pullback_to(&self, iteration: u32, paths: f32, sums: &mut Sums) {
        self.pullback_by(iteration, &AdjointOptions { paths, ..AdjointOptions::default() }, sums);
    }

    pub fn pullback_in(&self, team: &dyn Team, iteration: u32, paths: f32) -> Sums {
        let tracer = Tracer::new(self.volume, self.table, self.options).unwrap();
        let options = AdjointOptions { paths, ..AdjointOptions::default() };
        let (points, d_radiance, none) = (self.points, self.d_radiance, Control::none());
        let mut sums = Sums::default();
        tracer.pullback_in(team, points, iteration, d_radiance, &options, &mut sums, &none).unwrap();
        sums
    }

    pub fn pullback_by(&self, iteration: u32, options: &AdjointOptions, sums: &mut Sums) {
        let tracer = Tracer::new(self.volume, self.table, self.options).unwrap();
        tracer.pullback(self.points, iteration, self.d_radiance, options, sums, &Control::none()).unwrap();
    }

    /// The weighted sum of radiances, channel by channel.
    pub fn weighted(&self, iteration: u32, table: &MaterialTable) -> [f64; 3] {
        let tracer = Tracer::new(self.volume, table, self.options).unwrap();
        let mut l = vec![0.0; self.d_radiance.len()];
        tracer.radiance(self.points, iteration, &mut l, &Control::none()).unwrap();
        let mut sums = [0.0; 3];
        for (i, (&l, &r)) in l.iter().zip(self.d_radiance).enumerate() {
            sums[i % 3] += f64::from(l) * f64::from(r);
        }
        sums
    }

    /// Means and standard errors of functionals of the derivative over `runs` passes.
    pub fn functionals(&self, runs: u32, paths: f32, of: impl Fn(&Sums) -> Vec<f64>) -> Vec<Measured> {
        measured((0..runs).map(|i| of(&self.pullback(i, paths))).collect())
    }
}

/// A mean and its standard error.
#[derive(Clone, Copy, Debug)]
pub struct Measured {
    pub mean: f64,
    pub error: f64,
}

impl Measured {
    /// Asserts agreement within 3.5 standard errors, which are at most `most`.
    #[track_caller]
    pub fn agrees(self, other: Measured, most: f64, what: &str) {
        let error = self.error.hypot(other.error);
        let z = (self.mean - other.mean) / error;
        let text = format!("{what}: {self:?} for {other:?}, z = {z:.2}");
        println!("{text}");
        assert!(z.abs() < 3.5, "{text}");
        assert!(error <= most, "too noisy to tell: {text}");
    }
}

/// Of rows, one a run.
pub fn measured(rows: Vec<Vec<f64>>) -> Vec<Measured> {
    let n = rows.len() as f64;
    (0..rows[0].len())
        .map(|i| {
            let mean = rows.iter().map(|r| r[i]).sum::<f64>() / n;
            let variance = rows.iter().map(|r| (r[i] - mean).powi(2)).sum::<f64>() / (n - 1.0);
            Measured { mean, error: (variance / n).sqrt() }
        })
        .collect()
}

/// A table of three channels: rows of (sigma_s, sigma_a) a channel, and g.
pub fn rgb(rows: &[([(f32, f32); 3], f32)]) -> MaterialTable {
    let materials = rows
        .iter()
        .enumerate()
        .map(|(i, (channels, g))| Material {
            name: format!("m{i}"),
            sigma_s: channels.map(|c| c.0).to_vec(),
            sigma_a: channels.map(|c| c.1).to_vec(),
            g: (*g).into(),
        })
        .collect();
    MaterialTable::new(["r", "g", "b"].map(str::to_string).to_vec(), materials).unwrap()
}
