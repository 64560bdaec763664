use super::moments::Moments;
use super::*;
use crate::{Changed, Diagnostics, Draw, InstructionSet, Learned, ObjectId, Pass, predict_all};
use pellucid_core::{Control, Domain, random};
use pellucid_voxel::{Frame, LabelGrid, MaterialTable, Pitch, Surface, SurfaceOptions, Tile};

/// Radiance that a formula gives: of the position in mm, the channel, and a random number of mean 0.
#[derive(Clone)]
struct Formula<G>(G);

struct BoundFormula<G>(G, Arc<Object>);

impl<G: Fn([f64; 3], usize, f64) -> f64 + Clone + Send + Sync + 'static> Predictor for Formula<G> {
    fn identity(&self) -> Identity {
        Identity::new("formula", InstructionSet::Portable, true)
    }

    fn supports(&self, _: &Object) -> Result<Capabilities, PredictError> {
        Ok(Capabilities::new(true))
    }

    fn bind(&self, object: Arc<Object>) -> Result<Box<dyn BoundPredictor>, PredictError> {
        Ok(Box::new(BoundFormula(self.0.clone(), object)))
    }
}

impl<G: Fn([f64; 3], usize, f64) -> f64 + Send> BoundPredictor for BoundFormula<G> {
    fn update(&mut self, _: &LabelGrid, _: Changed<'_>, _: &Control<'_>) -> Result<(), PredictError> {
        Ok(())
    }

    fn predict(
        &self,
        points: &[u32],
        draw: Draw,
        out: &mut [f32],
        _: &Control<'_>,
    ) -> Result<Diagnostics, PredictError> {
        let domain = Domain::new("formula").pass(draw.pass.number());
        for (values, &p) in out.chunks_exact_mut(3).zip(points) {
            for (c, value) in values.iter_mut().enumerate() {
                let noise = random::uniform(draw.seed, domain, u64::from(p), c as u64) - 0.5;
                *value = (self.0)(position(&self.1, p), c, noise) as f32;
            }
        }
        let outside_training = points.iter().filter(|p| **p % 7 == 0).count() as u64;
        Ok(Diagnostics { outside_training, ..Diagnostics::default() })
    }
}

fn position(object: &Object, p: u32) -> [f64; 3] {
    let (voxel, pitch) = (object.surface().voxels()[p as usize], object.frame().pitch().mm());
    std::array::from_fn(|a| f64::from(voxel[a]) * pitch[a])
}

fn block(size: [u32; 3]) -> (LabelGrid, Arc<Object>) {
    let frame = Frame::new([0.0; 3], Pitch::j750(), size).unwrap();
    let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(5));
    let surface = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()).unwrap();
    (grid, Arc::new(Object::new(surface, MaterialTable::cmykw(), 1.5).unwrap()))
}

/// Stripes finer than any smoothing, of three brightnesses.
fn truth(at: [f64; 3], c: usize) -> f64 {
    0.2 + 0.2 * c as f64 + 0.1 * (at[2] * 40.0).sin().signum()
}

/// Root mean square error in the third of three passes of a fast predictor off by `bias(at, channel, truth)`.
fn error<B>(bias: B, noise: f64, settings: Correction) -> f64
where
    B: Fn([f64; 3], usize, f64) -> f64 + Clone + Send + Sync + 'static,
{
    let (grid, object) = block([120, 70, 150]);
    let none = Control::none();
    let fast = Formula(move |at, c, _| truth(at, c) + bias(at, c, truth(at, c)));
    let unbiased = Formula(move |at, c, random| truth(at, c) + noise * random);
    let mut bound = Corrected::new(fast, unbiased, settings).unwrap().bind(Arc::clone(&object)).unwrap();
    bound.update(&grid, Changed::Unknown, &none).unwrap();
    let mut out = Vec::new();
    for pass in 0..3 {
        let draw = Draw::new(7, Pass::Loop(pass));
        let (values, seen) = predict_all(&*bound, &object, draw, &none).unwrap();
        bound.absorb(&seen.learned).unwrap();
        assert_eq!(seen.outside_training, object.surface().len().div_ceil(7) as u64);
        out = values;
    }
    let exact = |i: usize| truth(position(&object, i as u32 / 3), i % 3);
    let squares: f64 = out.iter().enumerate().map(|(i, v)| (f64::from(*v) - exact(i)).powi(2)).sum();
    (squares / out.len() as f64).sqrt()
}

#[test]
fn errors_smooth_in_brightness_and_space_are_taken_out() {
    let default = Correction::default();
    // Too bright in the dark, too dark in the light: 0.06 rms. What stays is the measurement's noise, 0.087 over the
    // root of some 200.
    let tone = |_: [f64; 3], _: usize, v: f64| 0.12 - 0.3 * v + 0.05 * v * v;
    assert!(error(tone, 0.3, default) < 0.01, "{}", error(tone, 0.3, default));
    // Waves of 4 mm over the surface: 0.035 rms. Smoothing and the prior leave a few per cent of them beside the noise,
    // and more at edges, where it reaches round the corner.
    let wave = |at: [f64; 3], c: usize, _: f64| 0.05 * ((at[0] + at[2]) * 1.57 + c as f64).sin();
    let waves = error(wave, 0.3, default);
    assert!(waves < 0.015, "{waves}");
    // What changes from voxel to voxel cannot be found, but is not made worse than the noise does: 0.03 stays.
    let fine = |at: [f64; 3], _: usize, _: f64| {
        0.03 * ((at[0] * 75.0).sin() * (at[1] * 37.0).sin() * (at[2] * 116.0).sin()).signum()
    };
    let kept = error(fine, 0.3, default);
    assert!((0.028..0.033).contains(&kept), "{kept}");
}

#[test]
fn noise_of_the_measurement_hardly_passes() {
    let rms = |settings| error(|_, _, _| 0.0, 0.3, settings);
    // A uniform deviate of width 0.3 deviates by 0.087; some 200 are averaged.
    let default = rms(Correction::default());
    assert!(default > 1e-4 && default < 0.087 / 10.0, "{default}");
    // Without memory about three times as much variance.
    let forgetful = rms(Correction { memory: 0.0, ..Correction::default() });
    assert!(forgetful > 1.3 * default && forgetful < 2.5 * default, "{forgetful} {default}");
}

/// One pass's anchors: where, the fast value and the error, by channel.
type Measured = Vec<([f64; 3], [f32; 3], [f64; 3])>;

/// The correction by its definition: weighted least squares over all passes, and a mean over all anchors about each
/// corner of a point's cell.
fn naive(passes: &[Measured], settings: Correction, at: [f64; 3], value: f32, c: usize) -> f64 {
    let common = |upto: usize, v: f32| {
        let (mut a, mut b) = ([[0.0; 3]; 3], [0.0; 3]);
        for (age, pass) in passes[..=upto].iter().rev().enumerate() {
            let weight = settings.memory.powi(age as i32);
            for (_, fast, error) in pass {
                let powers = [1.0, f64::from(fast[c]), f64::from(fast[c]).powi(2)];
                for i in 0..3 {
                    (0..3).for_each(|j| a[i][j] += weight * powers[i] * powers[j]);
                    b[i] += weight * powers[i] * error[c];
                }
            }
        }
        let pull = 1e-3 * a[0][0];
        (0..3).for_each(|i| a[i][i] += pull);
        let det = |m: [[f64; 3]; 3]| {
            (0..3)
                .map(|i| {
                    m[0][i] * (m[1][(i + 1) % 3] * m[2][(i + 2) % 3] - m[1][(i + 2) % 3] * m[2][(i + 1) % 3])
                })
                .sum::<f64>()
        };
        (0..3).fold(0.0, |sum, k| {
            let mut with = a;
            (0..3).for_each(|i| with[i][k] = b[i]);
            sum + det(with) / det(a) * f64::from(v).powi(k as i32)
        })
    };
    let cell = |at: [f64; 3]| at.map(|v| (v / settings.radius_mm).floor());
    let place = at.map(|v| v / settings.radius_mm - 0.5);
    let mut local = 0.0;
    for corner in 0..8 {
        let own: [f64; 3] = std::array::from_fn(|a| place[a].floor() + f64::from(corner >> a & 1));
        let share: f64 = (0..3).map(|a| 1.0 - (place[a] - own[a]).abs()).product();
        let (mut total, mut sum, mut near) = (4.0, 0.0, false);
        for (upto, pass) in passes.iter().enumerate() {
            let memory = settings.memory.powi((passes.len() - 1 - upto) as i32);
            for (there, fast, error) in pass {
                let there = cell(*there);
                let steps: [f64; 3] = std::array::from_fn(|a| there[a] - own[a]);
                near |= steps.iter().all(|d| d.abs() <= 1.0);
                if steps.iter().all(|d| d.abs() <= 3.0) {
                    let weight = memory * (-0.5 * steps.iter().map(|d| d * d).sum::<f64>()).exp();
                    total += weight;
                    sum += weight * (error[c] - common(upto, fast[c]));
                }
            }
        }
        local += if near { share * sum / total } else { 0.0 };
    }
    common(passes.len() - 1, value) + local
}

#[test]
fn the_correction_is_what_its_definition_says() {
    let (grid, object) = block([20, 9, 30]);
    let none = Control::none();
    let settings = Correction { one_in: 9, ..Correction::default() };
    let fast = Formula(|at: [f64; 3], c, _| truth(at, c) + 0.1 * at[0] - 0.05 * c as f64);
    let unbiased = Formula(|at, c, random| truth(at, c) + 0.2 * random);
    let corrected = Corrected::new(fast.clone(), unbiased.clone(), settings).unwrap();
    let alone = |predictor: &dyn Predictor, draw| {
        let mut bound = predictor.bind(Arc::clone(&object)).unwrap();
        bound.update(&grid, Changed::Unknown, &none).unwrap();
        predict_all(&*bound, &object, draw, &none).unwrap().0
    };
    let mut bound = corrected.bind(Arc::clone(&object)).unwrap();
    bound.update(&grid, Changed::Unknown, &none).unwrap();
    let mut passes: Vec<Measured> = Vec::new();
    for pass in 0..2 {
        let draw = Draw::new(11, Pass::Loop(pass));
        let (plain, exact) = (alone(&fast, draw), alone(&unbiased, draw));
        let domain = Domain::new("anchor").pass(pass);
        let anchors =
            object.points().into_iter().filter(|&p| random::uniform(11, domain, u64::from(p), 0) < 1.0 / 9.0);
        passes.push(
            anchors
                .map(|p| {
                    let at = |c: usize| 3 * p as usize + c;
                    let errors = std::array::from_fn(|c| f64::from(exact[at(c)] - plain[at(c)]));
                    (position(&object, p), std::array::from_fn(|c| plain[at(c)]), errors)
                })
                .collect(),
        );
        let share = passes[pass as usize].len() as f64 / object.surface().len() as f64;
        assert!(
            (share - 1.0 / 9.0).abs() < 4.0 * (8.0 / 81.0 / object.surface().len() as f64).sqrt(),
            "{share}"
        );
        let (values, seen) = predict_all(&*bound, &object, draw, &none).unwrap();
        for p in object.points().into_iter().step_by(17) {
            for c in 0..3 {
                let at = 3 * p as usize + c;
                let expected =
                    f64::from(plain[at]) + naive(&passes, settings, position(&object, p), plain[at], c);
                assert!(
                    (f64::from(values[at]) - expected.max(0.0)).abs() < 1e-6,
                    "{} {expected}",
                    values[at]
                );
            }
        }
        bound.absorb(&seen.learned).unwrap();
    }
}

#[test]
fn every_point_is_an_anchor_where_one_in_one_is() {
    let (grid, object) = block([20, 9, 30]);
    let zero = Formula(|_, _, _| 0.0);
    let half = Formula(|_, _, _| 0.5);
    let settings = Correction { one_in: 1, memory: 0.0, ..Correction::default() };
    let mut bound = Corrected::new(zero, half, settings).unwrap().bind(Arc::clone(&object)).unwrap();
    bound.update(&grid, Changed::Unknown, &Control::none()).unwrap();
    let draw = Draw::new(0, Pass::Loop(0));
    let (values, seen) = predict_all(&*bound, &object, draw, &Control::none()).unwrap();
    assert_eq!(seen.learned.values[4], object.surface().len() as f64);
    assert!(values.iter().all(|v| (v - 0.5).abs() < 0.01));
}

#[test]
fn what_was_learned_of_something_else_is_refused() {
    let (grid, object) = block([20, 9, 30]);
    let corrected = |radius_mm| {
        let settings = Correction { radius_mm, ..Correction::default() };
        Corrected::new(Formula(|_, _, _| 0.3), Formula(|_, _, r| 0.5 + r), settings).unwrap()
    };
    let bind = |radius| {
        let mut bound = corrected(radius).bind(Arc::clone(&object)).unwrap();
        bound.update(&grid, Changed::Unknown, &Control::none()).unwrap();
        bound
    };
    let mut bound = bind(0.2);
    let draw = Draw::new(0, Pass::Loop(1));
    let learned = predict_all(&*bound, &object, draw, &Control::none()).unwrap().1.learned;
    assert_eq!(learned.predictor, corrected(0.2).identity().name);
    let spoiled = |spoil: &dyn Fn(&mut Learned)| {
        let mut other = learned.clone();
        spoil(&mut other);
        other
    };
    let cell = 4 + 3 * super::quadratic::SUMS;
    for other in [
        spoiled(&|l| l.predictor.push('x')),
        spoiled(&|l| l.passes.clear()),
        spoiled(&|l| l.passes = vec![2, 1]),
        spoiled(&|l| l.values[0] += 1.0),
        spoiled(&|l| l.values[3] = 0.3),
        spoiled(&|l| l.values.clear()),
        spoiled(&|l| l.values.truncate(6)),
        spoiled(&|l| l.values.truncate(l.values.len() - 1)),
        spoiled(&|l| l.values[5] = f64::NAN),
        spoiled(&|l| l.values[cell] = 0.5),
        spoiled(&|l| l.values[cell] = 1e300),
        spoiled(&|l| l.values[cell + 3] = -1.0),
    ] {
        assert!(bound.absorb(&other).is_err(), "{:?} {:?}", other.predictor, other.passes);
        assert!(bound.memory().is_empty());
    }
    assert!(bind(0.3).absorb(&learned).is_err());
    bound.absorb(&learned).unwrap();
    assert_eq!(bound.memory(), learned);
    let overlap = spoiled(&|l| l.passes = vec![1, 2]);
    assert!(bound.absorb(&overlap).unwrap_err().to_string().contains("already"));
    assert_eq!(bound.memory(), learned);
}

#[test]
fn moments_survive_being_written_down() {
    let owner = super::moments::Owner {
        predictor: "a+b".into(),
        object: ObjectId(0xfedc_ba98_7654_3210),
        channels: 2,
        radius_mm: 0.2,
    };
    let mut moments = Moments::new(2);
    moments.quadratics[1].add(0.3, -0.1);
    moments.field.add([0.1, 0.5, 123.0], 0.2, [1.5, -0.25].into_iter());
    moments.field.add([0.0, 0.0, 0.0], 0.2, [1e-30, 0.1].into_iter());
    let learned = owner.write(vec![1, 5], &moments);
    assert_eq!(owner.read(&learned).unwrap(), moments);
}

#[test]
fn refuses_settings_out_of_range() {
    let fine = Correction::default();
    for bad in [
        Correction { one_in: 0, ..fine },
        Correction { radius_mm: 0.0, ..fine },
        Correction { radius_mm: f64::NAN, ..fine },
        Correction { memory: 1.0, ..fine },
    ] {
        let make = || Formula(|_: [f64; 3], _: usize, _: f64| 0.0);
        assert!(Corrected::new(make(), make(), bad).is_err(), "{bad:?}");
    }
}

#[test]
fn the_identity_has_both() {
    struct Named(&'static str, bool);
    impl Predictor for Named {
        fn identity(&self) -> Identity {
            let set = if self.1 { InstructionSet::Avx512 } else { InstructionSet::Avx2 };
            Identity::new(self.0, set, self.1).with("spp", 4)
        }
        fn supports(&self, _: &Object) -> Result<Capabilities, PredictError> {
            Err(PredictError::unsupported("object", format!("{} takes none", self.0)))
        }
        fn bind(&self, object: Arc<Object>) -> Result<Box<dyn BoundPredictor>, PredictError> {
            Err(self.supports(&object).unwrap_err())
        }
    }
    let corrected = Corrected::new(Named("a", false), Named("b", true), Correction::default()).unwrap();
    let identity = corrected.identity();
    assert_eq!((identity.name.as_str(), identity.exact), ("a+b", false));
    assert_eq!(identity.instruction_set, InstructionSet::Avx2);
    let settings: Vec<&str> = identity.settings.keys().map(String::as_str).collect();
    assert_eq!(settings, ["a.spp", "b.spp", "memory", "one_in", "radius_mm"]);
    let (_, object) = block([8, 8, 8]);
    assert!(corrected.supports(&object).unwrap_err().to_string().contains("a takes none"));
    assert_eq!(corrected.fast().identity().name, "a");
}
