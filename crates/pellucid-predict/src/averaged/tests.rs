use super::*;
use crate::{Changed, Diagnostics, Draw, InstructionSet, Learned, Pass, predict_all};
use pellucid_core::{Control, Domain, random};
use pellucid_voxel::{Frame, LabelGrid, MaterialTable, Pitch, Surface, SurfaceOptions, Tile};

/// Half the width of the noise of a pass; its standard deviation is less by the root of 3.
const NOISE: f64 = 0.3;

/// Radiance by the label at the point, off by what differs from voxel to voxel, with noise.
#[derive(Clone, Copy)]
struct ByLabel {
    /// How far it is off.
    wrong: f64,
    noise: f64,
}

struct BoundByLabel(ByLabel, Arc<Object>, Vec<u8>);

impl Predictor for ByLabel {
    fn identity(&self) -> Identity {
        Identity::new("by-label", InstructionSet::Portable, true)
    }

    fn supports(&self, _: &Object) -> Result<Capabilities, PredictError> {
        Ok(Capabilities::new(self.noise > 0.0))
    }

    fn bind(&self, object: Arc<Object>) -> Result<Box<dyn BoundPredictor>, PredictError> {
        Ok(Box::new(BoundByLabel(*self, object, Vec::new())))
    }
}

impl BoundPredictor for BoundByLabel {
    fn update(
        &mut self,
        labels: &LabelGrid,
        _: Changed<'_>,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        control.check()?;
        self.2 = self.1.surface().voxels().iter().map(|voxel| labels.get(*voxel)).collect();
        Ok(())
    }

    fn predict(
        &self,
        points: &[u32],
        draw: Draw,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<Diagnostics, PredictError> {
        control.check()?;
        let Self(ByLabel { wrong, noise }, object, labels) = self;
        let channels = object.channels();
        for (values, &p) in out.chunks_exact_mut(channels).zip(points) {
            for (c, value) in values.iter_mut().enumerate() {
                let drawn = |domain| random::uniform(draw.seed, domain, u64::from(p), c as u64) - 0.5;
                let own = wrong * drawn(Domain::new("own error"));
                let noise = noise * 2.0 * drawn(Domain::new("noise").pass(draw.pass.number()));
                *value = (truth(labels[p as usize], c) + own + noise) as f32;
            }
        }
        Ok(Diagnostics { paths: points.len() as u64, ..Diagnostics::default() })
    }
}

fn truth(label: u8, c: usize) -> f64 {
    0.5 + 0.06 * f64::from(label) * (c as f64 - 0.7)
}

fn block() -> (LabelGrid, Arc<Object>) {
    let frame = Frame::new([0.0; 3], Pitch::j750(), [40, 32, 48]).unwrap();
    let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(5));
    let surface = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()).unwrap();
    (grid, Arc::new(Object::new(surface, MaterialTable::cmykw(), 1.5).unwrap()))
}

fn averaged(newest: f64) -> Averaged<ByLabel, ByLabel> {
    let fast = ByLabel { wrong: 0.2, noise: 0.0 };
    Averaged::new(fast, ByLabel { wrong: 0.0, noise: NOISE }, newest).unwrap()
}

/// A pass of what is bound, taken in.
fn pass(bound: &mut dyn BoundPredictor, object: &Object, number: u32) -> Vec<f32> {
    let draw = Draw::new(3, Pass::Loop(number));
    let (values, seen) = predict_all(&*bound, object, draw, &Control::none()).unwrap();
    bound.absorb(&seen.learned).unwrap();
    values
}

/// Root mean square error where all points have a label.
fn error(values: &[f32], label: u8) -> f64 {
    let off = |(i, v): (usize, &f32)| f64::from(*v) - truth(label, i % 3);
    (values.iter().enumerate().map(|v| off(v).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
}

#[test]
fn an_error_that_differs_from_voxel_to_voxel_goes_and_noise_averages() {
    let (grid, object) = block();
    let mut bound = averaged(0.2).bind(Arc::clone(&object)).unwrap();
    bound.update(&grid, Changed::Unknown, &Control::none()).unwrap();
    let deviation = NOISE / 3f64.sqrt();
    let mut squares = 0.0;
    for number in 0..30 {
        let error = error(&pass(&mut *bound, &object, number), 5);
        squares = squares * (1.0 - share(number, 0.2)).powi(2) + share(number, 0.2).powi(2);
        // Of 10,000 values and more: its standard error is below 1 %.
        let wanted = deviation * squares.sqrt();
        assert!((error / wanted - 1.0).abs() < 0.03, "{number}: {error} instead of {wanted}");
    }
    assert!(squares < 1.05 * 0.2 / 1.8, "of a fading mean");
}

/// The share of a pass in the mean, by its number.
fn share(number: u32, newest: f64) -> f64 {
    (2.0 / (f64::from(number) + 2.0)).max(newest)
}

#[test]
fn what_changes_is_followed_at_once() {
    let (white, object) = block();
    let black = LabelGrid::from_tiles(*white.frame(), |_| Tile::Constant(4));
    let mut bound = averaged(0.1).bind(Arc::clone(&object)).unwrap();
    bound.update(&white, Changed::Unknown, &Control::none()).unwrap();
    let before = (0..20).map(|number| error(&pass(&mut *bound, &object, number), 5)).last().unwrap();
    bound.update(&black, Changed::Unknown, &Control::none()).unwrap();
    let after = error(&pass(&mut *bound, &object, 20), 4);
    // White and black differ by 0.05, root mean square: not followed, that would make the error half as large again.
    assert!(after < 1.05 * before, "{before} {after}");
}

#[test]
fn one_pass_is_the_unbiased_predictor_alone() {
    let (grid, object) = block();
    let values = |predictor: &dyn Predictor| {
        let mut bound = predictor.bind(Arc::clone(&object)).unwrap();
        bound.update(&grid, Changed::Unknown, &Control::none()).unwrap();
        pass(&mut *bound, &object, 0)
    };
    let alone = values(&ByLabel { wrong: 0.0, noise: NOISE });
    let both = values(&averaged(0.2));
    assert!(alone.iter().any(|&v| v < 0.0), "dark points, with noise");
    assert!(alone.iter().zip(&both).all(|(a, b)| (a - b).abs() < 1e-6));
}

#[test]
fn passes_count_by_age_and_errors_of_others_are_refused() {
    let (grid, object) = block();
    let mut bound = averaged(0.3).bind(Arc::clone(&object)).unwrap();
    bound.update(&grid, Changed::Unknown, &Control::none()).unwrap();
    let measured: Vec<Learned> = (0..6)
        .map(|number| {
            let draw = Draw::new(3, Pass::Loop(number));
            let (_, seen) = predict_all(&*bound, &object, draw, &Control::none()).unwrap();
            bound.absorb(&seen.learned).unwrap();
            seen.learned
        })
        .collect();
    let memory = bound.memory();
    assert_eq!((&memory.passes[..], memory.values.len()), (&[0, 1, 2, 3, 4, 5][..], 2));
    for i in [0, 1, 77] {
        let mean = measured.iter().enumerate().fold(0.0, |mean, (number, pass)| {
            mean + share(number as u32, 0.3) * (f64::from(pass.singles[i]) - mean)
        });
        assert!((f64::from(memory.singles[i]) - mean).abs() < 1e-6);
    }

    let refused = |change: &dyn Fn(&mut Learned)| {
        let mut damaged = measured[0].clone();
        damaged.passes = vec![9];
        change(&mut damaged);
        averaged(0.3).bind(Arc::clone(&object)).unwrap().absorb(&damaged).unwrap_err().to_string()
    };
    assert!(refused(&|l| l.singles.truncate(7)).contains("7 in number"));
    assert!(refused(&|l| l.singles[5] = f32::NAN).contains("finite"));
    assert!(refused(&|l| l.values[0] += 1.0).contains("another object"));
    assert!(refused(&|l| l.passes.clear()).contains("passes"));
    assert!(refused(&|l| l.predictor.push('x')).contains("by-label~by-labelx"));
    let both = Learned { passes: vec![5, 6], ..memory };
    assert!(bound.absorb(&both).unwrap_err().to_string().contains("already"));
    assert!([0.0, -1.0, 1.1, f64::NAN].iter().all(|&newest| {
        let fast = ByLabel { wrong: 0.0, noise: 0.0 };
        Averaged::new(fast, fast, newest).is_err()
    }));
}
