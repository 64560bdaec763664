//! The judge on planted errors.

mod common;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use common::{MEDIA_WHITE, viewing};
use pellucid_color::space::lab_of_linear_rgb;
use pellucid_color::{Lab, Viewing, delta_e_2000};
use pellucid_core::random::{Domain, uniform};
use pellucid_predict::{
    BoundPredictor, Capabilities, Changed, Diagnostics, Draw, Object, Pass, PredictError,
};
use pellucid_refine::{
    ColorClass, Effort, ErrorShares, Errors, Evaluation, Judge, JudgeInput, Judged, MeanColor, RefineError,
};
use pellucid_voxel::{Control, Frame, LabelGrid, Pitch, Surface, SurfaceOptions, Tile, near_order};

/// Shows planted colours, with white noise of a given size: uniform, of this standard deviation in each channel.
struct Planted {
    object: Arc<Object>,
    shown: Vec<[f32; 3]>,
    noise: f64,
    updated: bool,
}

impl BoundPredictor for Planted {
    fn update(&mut self, _: &LabelGrid, _: Changed<'_>, _: &Control<'_>) -> Result<(), PredictError> {
        self.updated = true;
        Ok(())
    }
    fn predict(
        &self,
        points: &[u32],
        draw: Draw,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<Diagnostics, PredictError> {
        assert!(self.updated && matches!(draw.pass, Pass::Judge(_)));
        self.object.check_points(points, out.len())?;
        let domain = Domain::new("planted").pass(draw.pass.number());
        let channels = self.object.channels();
        for (i, (&p, out)) in points.iter().zip(out.chunks_exact_mut(channels)).enumerate() {
            if i % 1024 == 0 {
                control.check()?;
                control.report(i as u64, points.len() as u64);
            }
            for (k, out) in out.iter_mut().enumerate() {
                let c = common::band(k, channels);
                let deviation = self.noise / f64::from(draw.effort).sqrt();
                let error =
                    (uniform(draw.seed, domain, u64::from(p), k as u64) - 0.5) * 12f64.sqrt() * deviation;
                *out = ((f64::from(self.shown[p as usize][c]) + error) * MEDIA_WHITE[c]) as f32;
            }
        }
        let mut diagnostics = Diagnostics::default();
        diagnostics.paths = points.len() as u64;
        Ok(diagnostics)
    }
}

struct Block {
    solid: LabelGrid,
    object: Arc<Object>,
}

/// 4.2 x 0.3 x 4 mm at the J750's pitch: two great faces that show x and z.
fn block(channels: usize) -> Block {
    let frame = Frame::new([0.0; 3], Pitch::j750(), [100, 4, 150]).unwrap();
    let solid = LabelGrid::from_tiles(frame, |_| Tile::Constant(5));
    let surface = Surface::extract(&solid, &SurfaceOptions::default(), &Control::none()).unwrap();
    Block { solid, object: Arc::new(Object::new(surface, common::table(channels), 1.5).unwrap()) }
}

impl Block {
    fn field(&self, color: impl Fn([u32; 3]) -> [f32; 3]) -> Vec<[f32; 3]> {
        self.object.surface().voxels().iter().map(|&v| color(v)).collect()
    }

    fn judge(
        &self,
        printable: &[[f32; 3]],
        target: &[[f32; 3]],
        shown: Vec<[f32; 3]>,
        noise: f64,
        effort: Effort,
    ) -> Judged {
        let viewing = viewing(self.object.channels());
        let input =
            JudgeInput { object: &self.object, viewing: &viewing, target, printable_target: printable };
        self.judge_by(&Judge::new(input, effort, 3, &Control::none()).unwrap(), shown, noise)
    }

    /// A target that can be printed as it is.
    fn aimed_at<'a>(&'a self, target: &'a [[f32; 3]], viewing: &'a Viewing) -> JudgeInput<'a> {
        JudgeInput { object: &self.object, viewing, target, printable_target: target }
    }

    fn judge_by(&self, judge: &Judge<'_>, shown: Vec<[f32; 3]>, noise: f64) -> Judged {
        let mut bound = Planted { object: self.object.clone(), shown, noise, updated: false };
        judge.judge(&self.solid, &mut bound, Capabilities::new(noise > 0.0), &Control::none()).unwrap()
    }
}

fn effort() -> Effort {
    Effort { points: 2000, point_passes: 4, surface_passes: 4 }
}

fn lab(rgb: [f32; 3]) -> Lab {
    Lab::from_linear_rgb(rgb.map(f64::from))
}

fn difference(a: [f32; 3], b: [f32; 3]) -> f64 {
    delta_e_2000(lab(a), lab(b))
}

const RED: [f32; 3] = [0.5, 0.1, 0.1];
const BLUE: [f32; 3] = [0.1, 0.15, 0.5];
const VIOLET: [f32; 3] = [0.2, 0.15, 0.5];

#[test]
fn a_hue_shift_of_one_class_shows_in_that_class_alone() {
    let block = block(3);
    let half = |left, right| move |v: [u32; 3]| if v[0] < 40 { left } else { right };
    let target = block.field(half(RED, BLUE));
    let judged = block.judge(&target, &target, block.field(half(RED, VIOLET)), 0.0, effort());
    let classes = &judged.errors.color_classes;
    assert_eq!(classes.iter().map(|c| c.class).collect::<Vec<_>>(), [ColorClass::Red, ColorClass::Blue]);
    let planted = difference(BLUE, VIOLET);
    assert!(planted > 5.0);
    let [red, blue] = [classes[0], classes[1]];
    // Smoothing by 0.1 mm carries some of it over the border, 0.04 mm wide on average of 1.7 and 2.5 mm.
    assert!(red.mean < 0.06 * planted && (blue.mean - planted).abs() < 0.06 * planted, "{red:?} {blue:?}");
    let reds = target.iter().filter(|t| **t == RED).count() as f64 / target.len() as f64;
    assert!((red.share - reds).abs() < 1e-9 && (red.share + blue.share - 1.0).abs() < 1e-9);
    // Of single voxels the reds have none of it.
    let voxel = judged.errors.voxel;
    assert!((voxel.printable.mean - (1.0 - reds) * planted).abs() < 0.04 * planted, "{voxel:?}");
    assert!((voxel.printable.max - planted).abs() < 1e-3);
    assert_eq!((voxel.noise, judged.errors.point_passes, judged.errors.surface_passes), (0.0, 1, 1));
}

#[test]
fn errors_to_the_target_as_given_are_kept_apart() {
    let block = block(3);
    let printable = block.field(|_| RED);
    let target = block.field(|_| [0.9, 0.05, 0.05]);
    let judged = block.judge(&printable, &target, printable.clone(), 0.0, effort());
    for errors in [judged.errors.voxel, judged.errors.at_0_045_mm, judged.errors.at_0_2_mm] {
        assert!(errors.printable.max < 0.01, "{errors:?}");
        assert!((errors.raw.mean - difference(RED, [0.9, 0.05, 0.05])).abs() < 0.01, "{errors:?}");
    }
    assert_eq!(judged.errors.sharpness.slope, None, "no edges");
}

#[test]
fn a_blur_lowers_the_slope_by_the_gaussians_factor() {
    let block = block(3);
    let wave = |amplitude: f64| {
        move |v: [u32; 3]| {
            let x = f64::from(v[0]) * 25.4 / 600.0;
            [(0.4 + 0.12 * amplitude * (std::f64::consts::TAU * x / 0.8).sin()) as f32; 3]
        }
    };
    let target = block.field(wave(1.0));
    let sharp = block.judge(&target, &target, target.clone(), 0.0, effort()).errors;
    assert!((sharp.sharpness.slope.unwrap() - 1.0).abs() < 1e-6 && sharp.sharpness.edges > 0.3);
    for sigma in [0.05, 0.1, 0.15] {
        let factor = (-0.5 * (std::f64::consts::TAU * sigma / 0.8f64).powi(2)).exp();
        let errors = block.judge(&target, &target, block.field(wave(factor)), 0.0, effort()).errors;
        let slope = errors.sharpness.slope.unwrap();
        // Lightness is not linear in light: a tenth of the amplitude's curvature.
        assert!((slope - factor).abs() < 0.03 * factor, "{sigma} mm: {slope}, closed form {factor}");
        // What a blur takes is fine detail, and smoothing both alike hides it the more the wider.
        let [voxel, fine, viewed, wide] =
            [errors.voxel, errors.at_0_045_mm, errors.at_0_1_mm, errors.at_0_2_mm].map(|e| e.printable.mean);
        assert!(voxel > fine && fine > viewed && viewed > 2.0 * wide, "{voxel} {fine} {viewed} {wide}");
    }
}

#[test]
fn white_noise_is_stated_and_taken_out_of_smoothed_errors() {
    let block = block(3);
    let target = block.field(|_| RED);
    let shown = block.field(|_| [0.55, 0.11, 0.09]);
    let clean = block.judge(&target, &target, shown.clone(), 0.0, effort()).errors;
    let noise = 0.03;
    let judged = block.judge(&target, &target, shown.clone(), noise, effort());
    let noisy = judged.errors.clone();
    // The noise of the mean of four passes, by itself: measured on noise of its own.
    let n = 40_000;
    let expected: Vec<f64> = (0..n)
        .map(|i| {
            let error = |c: u64| {
                let sum: f64 = (0..4).map(|k| uniform(9, Domain::new("own"), i, 4 * c + k) - 0.5).sum();
                (sum / 4.0 * 12f64.sqrt() * noise) as f32
            };
            difference([0.55 + error(0), 0.11 + error(1), 0.09 + error(2)], [0.55, 0.11, 0.09])
        })
        .collect();
    let mean = expected.iter().sum::<f64>() / n as f64;
    let variance = expected.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / n as f64;
    // Four standard errors of 2,000 voxels, and 4 % for what halves' differences, twice the size, meet of curvature.
    let tolerance = 4.0 * (variance / 2000.0).sqrt() + 0.04 * mean;
    assert!((noisy.voxel.noise - mean).abs() < tolerance, "{} {mean} {tolerance}", noisy.voxel.noise);
    assert!(noisy.voxel.printable.mean > 1.05 * clean.voxel.printable.mean, "voxels show it");
    let radii = |e: &pellucid_refine::StateErrors| [e.at_0_045_mm, e.at_0_1_mm, e.at_0_2_mm];
    let mut last = noisy.voxel.noise;
    for (noisy, clean) in radii(&noisy).iter().zip(radii(&clean)) {
        assert!(noisy.noise < 0.7 * last && noisy.noise > 0.0, "{noisy:?}");
        last = noisy.noise;
        let (noisy, clean) = (noisy.printable.mean, clean.printable.mean);
        assert!((noisy - clean).abs() < 0.04 * clean, "{noisy} {clean}");
    }
    assert_eq!(noisy.paths, 4 * (2000 + target.len() as u64));
    // The appearance is the mean of the passes over all.
    let mean = judged.appearance().iter().map(|a| f64::from(a[0])).sum::<f64>() / target.len() as f64;
    assert!((mean - 0.55).abs() < 4.0 * noise / 2.0 / (target.len() as f64).sqrt(), "{mean}");
    // A network that is off by 0.02 is found to be, though each value of the judge is off by more.
    let off: Vec<f32> = judged
        .points
        .iter()
        .flat_map(|&p| (0..3).map(move |c| (p, c)))
        .map(|(p, c)| ((shown[p as usize][c] + 0.02) as f64 * MEDIA_WHITE[c]) as f32)
        .collect();
    let score = judged.prediction_error(&off).unwrap();
    let expected = 0.02 * (MEDIA_WHITE.iter().map(|w| w * w).sum::<f64>() / 3.0).sqrt();
    assert!((score.rmse() - expected).abs() < 0.1 * expected, "{} {expected}", score.rmse());
    assert!((score.bias() - 0.014).abs() < 0.0015, "{}", score.bias());
    assert!(judged.prediction_error(&off[1..]).is_err());
}

/// Lightness, chroma and hue in degrees.
fn polar(rgb: [f32; 3]) -> [f64; 3] {
    let lab = lab(rgb);
    [lab.l, lab.a.hypot(lab.b), lab.b.atan2(lab.a).to_degrees().rem_euclid(360.0)]
}

fn near(mean: MeanColor, [l, c, h]: [f64; 3], tolerance: f64) -> bool {
    let turn = (mean.hue_deg - h + 180.0).rem_euclid(360.0) - 180.0;
    (mean.lightness - l).abs() < tolerance
        && (mean.chroma - c).abs() < tolerance
        && turn.to_radians().abs() * c < tolerance
}

#[test]
fn classes_state_the_mean_colours_of_target_printable_and_shown() {
    let block = block(3);
    let half = |left, right| move |v: [u32; 3]| if v[0] < 50 { left } else { right };
    const YELLOW: [f32; 3] = [0.7, 0.5, 0.1];
    let [target, printable, shown] = [
        half(YELLOW, BLUE),
        half([0.6, 0.45, 0.15], [0.12, 0.15, 0.4]),
        half([0.5, 0.48, 0.2], [0.2, 0.16, 0.35]),
    ];
    let fields = [&target, &printable, &shown].map(|f| block.field(f));
    let judged = block.judge(&fields[1], &fields[0], fields[2].clone(), 0.0, effort());
    let classes = &judged.errors.color_classes;
    assert_eq!(classes.iter().map(|c| c.class).collect::<Vec<_>>(), [ColorClass::Yellow, ColorClass::Blue]);
    for (class, at) in classes.iter().zip([[0; 3], [99, 0, 0]]) {
        // Naive: each voxel's colour by the Gaussian's share on either side of the border, on the great faces.
        let wanted = |colors: &dyn Fn([u32; 3]) -> [f32; 3]| {
            let ([own, other], sigma) = ([colors(at), colors([99 - at[0], 0, 0])], 0.2);
            let (mut means, mut chroma) = ([0.0; 3], 0.0);
            for i in 0..50 {
                let weight = |x: f64| {
                    let x = (x - (f64::from(i) + 0.5)) * 25.4 / 600.0 / sigma;
                    (-0.5 * x * x).exp()
                };
                let sum = |from: i32, to: i32| (from..to).map(|x| weight(f64::from(x) + 0.5)).sum::<f64>();
                // Own from the outer end, 0, to the border at 50.
                let (own_weight, other_weight) = (sum(0, 50), sum(50, 100));
                let rgb = std::array::from_fn(|c| {
                    let sum = f64::from(own[c]) * own_weight + f64::from(other[c]) * other_weight;
                    (sum / (own_weight + other_weight)) as f32
                });
                let lab = lab(rgb);
                [lab.l, lab.a, lab.b].iter().enumerate().for_each(|(c, v)| means[c] += v / 50.0);
                chroma += lab.a.hypot(lab.b) / 50.0;
            }
            [means[0], chroma, means[2].atan2(means[1]).to_degrees().rem_euclid(360.0)]
        };
        // Pooling and the ends' own faces leave half a unit.
        assert!(near(class.target, wanted(&target), 0.5), "{class:?} {:?}", wanted(&target));
        assert!(near(class.printable, wanted(&printable), 0.5), "{class:?} {:?}", wanted(&printable));
        assert!(near(class.shown, wanted(&shown), 0.5), "{class:?} {:?}", wanted(&shown));
        let far = polar(shown(at));
        assert!(near(class.shown, far, 6.0) && !near(class.shown, polar(target(at)), 6.0), "{class:?}");
    }
}

#[test]
fn detail_finer_than_0_2_mm_is_averaged_before_chroma_is_taken() {
    let block = block(3);
    let target = block.field(|_| RED);
    // Stripes of three voxels, 0.13 mm, whose mean is grey.
    let [cyan, pink] = [[0.1, 0.4, 0.4], [0.7, 0.4, 0.4]];
    let shown = block.field(|v| if v[0] / 3 % 2 == 0 { cyan } else { pink });
    let class = block.judge(&target, &target, shown, 0.0, effort()).errors.color_classes[0];
    assert!(polar(cyan)[1] > 15.0 && polar(pink)[1] > 15.0);
    assert!(
        class.shown.chroma < 1.0 && (class.shown.lightness - polar([0.4; 3])[0]).abs() < 0.5,
        "{class:?}"
    );
    assert!(near(class.target, polar(RED), 1e-2) && near(class.printable, polar(RED), 1e-2), "{class:?}");
}

#[test]
fn noise_does_not_pass_for_chroma() {
    let block = block(3);
    let target = block.field(|_| [0.3; 3]);
    let class = |shown: [f32; 3], noise: f64| {
        let effort = Effort { points: 1, point_passes: 2, surface_passes: 2 };
        block.judge(&target, &target, block.field(|_| shown), noise, effort).errors.color_classes[0].shown
    };
    // The mean of two passes with this noise, over the 0.2 mm Gaussian's voxels: its chroma by itself.
    let noise = 0.4;
    let [x, z] = [25.4 / 600.0, 0.027];
    let voxels = 4.0 * std::f64::consts::PI * 0.2f64.powi(2) / (x * z);
    let error = |c: u64, i: u64| {
        let sum = uniform(5, Domain::new("own"), i, c) + uniform(6, Domain::new("own"), i, c) - 1.0;
        (0.5 * sum * 12f64.sqrt() * noise / voxels.sqrt()) as f32
    };
    let alone = |rgb: [f32; 3]| {
        let chroma = |i| polar(std::array::from_fn(|c| rgb[c] + error(c as u64, i)))[1];
        (0..4000).map(chroma).sum::<f64>() / 4000.0
    };
    let grey = class([0.3; 3], noise);
    assert!(alone([0.3; 3]) > 1.0 && grey.chroma < 0.8 * alone([0.3; 3]), "{grey:?}");
    let pale = [0.33, 0.29, 0.28];
    let (found, bare, wanted) = (class(pale, noise).chroma, alone(pale), polar(pale)[1]);
    let left = (found - wanted).abs() / (bare - wanted);
    assert!(bare - wanted > 0.5 && left < 0.25, "{found}, with noise {bare}, without {wanted}");
    // What has chroma keeps it.
    let (clean, noisy) = (class(RED, 0.0), class(RED, 0.25 * noise));
    assert!(near(clean, polar(RED), 1e-2), "{clean:?}");
    assert!(near(noisy, polar(RED), 0.5), "{noisy:?} {:?}", polar(RED));
}

#[test]
fn the_error_is_shared_by_what_takes_it() {
    let block = block(3);
    let colors = [[0.9, 0.05, 0.04], [0.7, 0.12, 0.1], [0.65, 0.2, 0.15], [0.5, 0.25, 0.2]];
    let [target, gamut, printable, shown] = colors.map(|c| block.field(|_| c));
    let viewing = viewing(3);
    let input = JudgeInput {
        object: &block.object,
        viewing: &viewing,
        target: &target,
        printable_target: &printable,
    };
    let new = || Judge::new(input, effort(), 3, &Control::none()).unwrap();
    let steps: Vec<f64> = colors.windows(2).map(|pair| difference(pair[0], pair[1])).collect();
    let way: f64 = steps.iter().sum();
    let close = |shares: ErrorShares, wanted: [f64; 3]| {
        let found = [shares.out_of_gamut, shares.too_thin, shares.cross_talk];
        (found.iter().sum::<f64>() - 1.0).abs() < 1e-12
            && found.iter().zip(wanted).all(|(f, w)| (f - w).abs() < 1e-3)
    };
    let told = new().with_gamut_target(&gamut, &Control::none()).unwrap();
    let judged = block.judge_by(&told, shown.clone(), 0.0);
    let shares = judged.errors.shares;
    assert!(close(shares, [0, 1, 2].map(|i| steps[i] / way)), "{shares:?} {steps:?}");
    let parts = told.error_parts(&judged.appearance(), &Control::none()).unwrap();
    for part in &parts {
        let sum: f64 = part.iter().map(|&v| f64::from(v)).sum();
        assert!((sum - difference(colors[0], colors[3])).abs() < 0.01, "{part:?}");
    }
    let mean = parts.iter().flatten().map(|&v| f64::from(v)).sum::<f64>() / target.len() as f64;
    assert!((mean - judged.errors.at_0_1_mm.raw.mean).abs() < 1e-4);
    // Not told what a thick print shows, the gamut takes all up to the printable target.
    let shares = block.judge_by(&new(), shown.clone(), 0.0).errors.shares;
    let to_printable = difference(colors[0], colors[2]);
    let way = to_printable + steps[2];
    assert!(close(shares, [to_printable / way, 0.0, steps[2] / way]), "{shares:?}");
    // Nothing is left to refinement, or nothing at all.
    let perfect = block.judge_by(&told, printable.clone(), 0.0).errors.shares;
    assert!(close(perfect, [steps[0] / (steps[0] + steps[1]), steps[1] / (steps[0] + steps[1]), 0.0]));
    let short = told.error_parts(&shown[1..], &Control::none()).unwrap_err();
    assert!(short.to_string().contains("appearance"), "{short}");
    let short = new().with_gamut_target(&gamut[1..], &Control::none()).err().unwrap();
    assert!(short.to_string().contains("gamut target"), "{short}");
}

#[test]
fn parts_lie_where_the_error_does() {
    let block = block(3);
    // From left to right: out of gamut, too thin, cross-talk, and no error.
    let quarter = |colors: [[f32; 3]; 4]| move |v: [u32; 3]| colors[(v[0] / 25) as usize];
    let target = block.field(|_| RED);
    let gamut = block.field(quarter([BLUE, RED, RED, RED]));
    let printable = block.field(quarter([BLUE, BLUE, RED, RED]));
    let shown = block.field(quarter([BLUE, BLUE, BLUE, RED]));
    let viewing = viewing(3);
    let input = JudgeInput {
        object: &block.object,
        viewing: &viewing,
        target: &target,
        printable_target: &printable,
    };
    let judge = Judge::new(input, effort(), 3, &Control::none()).unwrap();
    let judge = judge.with_gamut_target(&gamut, &Control::none()).unwrap();
    let judged = block.judge_by(&judge, shown.clone(), 0.02);
    let error = difference(RED, BLUE) as f32;
    let parts = judge.error_parts(&shown, &Control::none()).unwrap();
    for (voxel, part) in block.object.surface().voxels().iter().zip(&parts) {
        // More than 0.3 mm from the borders.
        let (quarter, within) = (voxel[0] / 25, voxel[0] % 25);
        if !(8..17).contains(&within) {
            continue;
        }
        let wanted: [f32; 3] = std::array::from_fn(|i| if i == quarter as usize { error } else { 0.0 });
        let off = part.iter().zip(wanted).map(|(p, w): (&f32, f32)| (p - w).abs()).fold(0.0, f32::max);
        assert!(off < 0.08 * error, "{voxel:?} {part:?}, wanted {wanted:?}");
    }
    let ErrorShares { out_of_gamut, too_thin, cross_talk, .. } = judged.errors.shares;
    for share in [out_of_gamut, too_thin, cross_talk] {
        assert!((share - 1.0 / 3.0).abs() < 0.04, "{:?}", judged.errors.shares);
    }
}

#[test]
fn points_are_distinct_addressed_and_spread() {
    let block = block(3);
    let target = block.field(|_| RED);
    let viewing = viewing(3);
    let input = block.aimed_at(&target, &viewing);
    let points = |points: u32, seed: u64| {
        let effort = Effort { points, ..effort() };
        Judge::new(input, effort, seed, &Control::none()).unwrap().points().to_vec()
    };
    let few = points(500, 1);
    assert_eq!(few.len(), 500);
    assert!(few.windows(2).all(|w| w[0] < w[1]));
    assert_ne!(few, points(500, 2));
    // One of each of 500 equal stretches along the surface's order.
    let order = near_order(block.object.surface().voxels());
    let mut stretches: Vec<u64> = order
        .iter()
        .enumerate()
        .filter(|(_, p)| few.binary_search(p).is_ok())
        .map(|(at, _)| (at as u64 * 500 + 499) / order.len() as u64)
        .collect();
    stretches.dedup();
    assert_eq!(stretches.len(), 500);
    let lower = few.iter().filter(|&&p| (p as usize) < target.len() / 2).count() as f64;
    assert!((lower - 250.0).abs() < 4.0 * 125f64.sqrt(), "{lower}");
    assert_eq!(points(1 << 30, 1).len(), target.len());
    assert_eq!(points(1, 1).len(), 1);
}

#[test]
fn efforts_are_those_of_the_passes() {
    let block = block(3);
    let target = block.field(|_| VIOLET);
    let viewing = viewing(3);
    let input = block.aimed_at(&target, &viewing);
    let judge = Judge::new(input, effort(), 3, &Control::none()).unwrap();
    let noise = |efforts: [u32; 2]| {
        let (object, shown) = (Arc::clone(&block.object), target.clone());
        let mut bound = Planted { object, shown, noise: 0.02, updated: false };
        let capabilities = Capabilities::new(true);
        let judged = judge.judge_with(&block.solid, &mut bound, efforts, capabilities, &Control::none());
        let errors = judged.unwrap().errors;
        [errors.at_0_1_mm.noise, errors.voxel.noise]
    };
    let [surface, points] = noise([1, 1]);
    for (efforts, factors) in [([4, 1], [0.5, 1.0]), ([1, 16], [1.0, 0.25])] {
        let [own_surface, own_points] = noise(efforts);
        assert!(
            (own_surface / surface / factors[0] - 1.0).abs() < 0.05,
            "{efforts:?}: {own_surface} {surface}"
        );
        assert!((own_points / points / factors[1] - 1.0).abs() < 0.05, "{efforts:?}: {own_points} {points}");
    }
}

#[test]
fn many_channels_are_judged_as_the_colour_they_make() {
    let (three, many) = (block(3), block(31));
    let half = |left, right| move |v: [u32; 3]| if v[0] < 40 { left } else { right };
    let [target, shown] = [half(RED, BLUE), half(RED, VIOLET)].map(|f| three.field(f));
    let a = three.judge(&target, &target, shown.clone(), 0.0, effort());
    let b = many.judge(&target, &target, shown, 0.0, effort());
    assert_eq!(b.halves[0].len(), 31 * b.points.len());
    for (a, b) in [(a.errors.voxel, b.errors.voxel), (a.errors.at_0_1_mm, b.errors.at_0_1_mm)] {
        assert!((a.printable.mean - b.printable.mean).abs() < 1e-3, "{a:?} {b:?}");
    }
}

#[test]
fn cancelling_and_bad_input_are_told() {
    let block = block(3);
    let target = block.field(|_| RED);
    let viewing = viewing(3);
    let input = block.aimed_at(&target, &viewing);
    let new = |input, effort| Judge::new(input, effort, 0, &Control::none());
    let odd = Effort { point_passes: 3, ..effort() };
    assert!(new(input, odd).err().unwrap().to_string().contains("point_passes"));
    let short = JudgeInput { target: &target[1..], ..input };
    assert!(new(short, effort()).err().unwrap().to_string().contains("target"));
    let judge = new(input, effort()).unwrap();
    let bound = |noise: f64, shown: Vec<[f32; 3]>| Planted {
        object: block.object.clone(),
        shown,
        noise,
        updated: false,
    };
    let stop = AtomicBool::new(false);
    let progress = |done: u64, total: u64| stop.store(2 * done > total, Ordering::Relaxed);
    let control = Control::none().with_progress(&progress).with_cancel(&stop);
    let result =
        judge.judge(&block.solid, &mut bound(0.1, target.clone()), Capabilities::new(true), &control);
    assert!(matches!(result, Err(RefineError::Cancelled)));
    let mut broken = target.clone();
    broken[7][2] = f32::NAN;
    let result =
        judge.judge(&block.solid, &mut bound(0.0, broken), Capabilities::new(false), &Control::none());
    assert!(result.unwrap_err().to_string().contains("not finite"));
}

#[test]
fn the_report_reads_as_documented() {
    let block = block(3);
    let target = block.field(|v| if v[0] < 40 { RED } else { [0.6, 0.7, 0.9] });
    let judged = block.judge(&target, &target, block.field(|_| VIOLET), 0.02, effort());
    let evaluation = Evaluation { unrefined: judged.errors.clone(), refined: judged.errors };
    let json = serde_json::to_value(&evaluation).unwrap();
    let state = &json["refined"];
    for field in ["voxel", "at_0_045_mm", "at_0_1_mm", "at_0_2_mm"] {
        for number in ["mean", "median", "p95", "max", "noise"] {
            assert!(state[field][number].is_f64(), "{field} {number}");
        }
        assert!(state[field]["raw"]["p95"].is_f64());
    }
    assert!(state["sharpness"]["slope"].is_f64());
    let class = &state["colour_classes"][0];
    assert_eq!(class["class"], "red");
    for (color, number) in ["target", "printable", "shown"]
        .iter()
        .flat_map(|c| ["lightness", "chroma", "hue_deg"].map(|n| (c, n)))
    {
        assert!(class[color][number].is_f64(), "{color} {number}");
    }
    for share in ["out_of_gamut", "too_thin", "cross_talk"] {
        assert!(state["shares"][share].is_f64(), "{share}");
    }
    assert_eq!(state["points"], 2000);
    let back: Evaluation = serde_json::from_value(json).unwrap();
    assert_eq!(back, evaluation);
    assert_eq!(evaluation.reduction(), 0.0);
    let better = Evaluation {
        refined: {
            let mut state = evaluation.refined.clone();
            state.voxel.printable.mean *= 0.25;
            state
        },
        ..evaluation
    };
    assert!((better.reduction() - 0.75).abs() < 1e-12);
    let _: Errors = better.refined.voxel;
    let mut rgb = [[0.0; 3]];
    lab_of_linear_rgb(&[VIOLET], &mut rgb);
    assert_eq!(ColorClass::of(rgb[0]), ColorClass::Blue);
}
