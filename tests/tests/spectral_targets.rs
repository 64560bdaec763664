//! Targets from a spectral image in place of a texture.

use std::sync::Arc;

use pellucid::color::plane_parallel::Solver;
use pellucid::color::spectrum::Illuminant;
use pellucid::color::upsampling::Upsampling;
use pellucid::job::Aimed;
use pellucid::mesh::{BaseColor, Image, Model, Sampler, SpectralImage, Texture, Vertex};
use pellucid::voxel::MaterialTable;
use pellucid::{Monitor, PrintError, PrintJob, PrintSettings, Workspace};
use pellucid_tests::{lit_settings, patched_ball, spectral_cmykw};

/// Red light comes back from one half, as a sharp filter's; the other is grey.
fn sharp(nm: f64) -> f32 {
    if nm < 595.0 { 0.12 } else { 0.55 }
}
const GREY: f32 = 0.4;

/// Every 5 nm, beyond the materials' bands on both sides.
fn image() -> SpectralImage {
    let bands = (78..=142).map(|k| 5.0 * f64::from(k)).map(|nm| (nm, vec![sharp(nm), GREY]));
    SpectralImage::new("halves", [2, 1], bands.collect()).unwrap()
}

/// A ball that shows one half of a texture on each side.
fn ball() -> Model {
    let plain = patched_ball();
    let triangles = plain.triangles().to_vec();
    let mut vertices = plain.vertices().to_vec();
    for triangle in &triangles {
        let x: f64 = triangle.vertices.iter().map(|&v| vertices[v as usize].position_m[0]).sum();
        for v in triangle.vertices {
            let uv = [if x < 0.0 { 0.25 } else { 0.75 }, 0.5];
            vertices[v as usize] = Vertex { uv, ..vertices[v as usize] };
        }
    }
    let texels = Image::from_srgb8(2, 1, vec![[10, 200, 30], [90, 90, 200]]).unwrap();
    let material = BaseColor { texture: Some(0), ..plain.materials()[0].clone() };
    let texture = Texture::new(Arc::new(texels), Sampler::default());
    Model::new("ball", vertices, triangles, vec![material], vec![texture]).unwrap()
}

fn settings() -> PrintSettings {
    lit_settings(1.2, spectral_cmykw(), &[Illuminant::A])
}

fn aimed(settings: PrintSettings) -> Aimed {
    let (job, monitor) = (PrintJob::new(settings).unwrap(), Monitor::silent());
    job.aim(job.place_spectral(&ball(), &image(), &monitor).unwrap(), &monitor).unwrap()
}

fn white(table: &MaterialTable) -> Vec<f64> {
    let white = table.get(table.label_of("white").unwrap()).unwrap();
    Solver::new(1.5).unwrap().thick_block(white).unwrap()
}

/// Within what 16 bits a reflectance and the solver's own rounding make of a colour, many times over.
fn near(a: [f32; 3], b: [f32; 3]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-3)
}

/// The reflectances of both halves in the materials' bands.
fn reflectances(table: &MaterialTable) -> [Vec<f32>; 2] {
    let sharp = table.spectrum().wavelengths_nm().map(sharp).collect();
    [sharp, vec![GREY; 31]]
}

#[test]
fn what_a_light_shows_follows_from_the_reflectances() {
    for absolute in [false, true] {
        let aimed = aimed(PrintSettings { absolute, ..settings() });
        let table = aimed.object.materials();
        let white = white(table);
        let expected = |viewing: &pellucid::color::Viewing| {
            reflectances(table).map(|reflectance| {
                let of = |(r, w): (&f32, &f64)| if absolute { *r } else { r * *w as f32 };
                viewing.relative_rgb(&reflectance.iter().zip(&white).map(of).collect::<Vec<f32>>())
            })
        };
        let lit = &aimed.further[0];
        let [main, under] = [expected(&aimed.viewing), expected(&lit.viewing)];
        let mut seen = [0, 0];
        for (a, b) in aimed.target.iter().zip(&lit.target) {
            let half = (0..2).find(|&h| near(*a, main[h]) && near(*b, under[h]));
            seen[half.unwrap_or_else(|| panic!("{a:?} {b:?}, of {main:?} {under:?}"))] += 1;
        }
        assert!(seen.iter().all(|&n| n > 500), "{seen:?}");
        if !absolute {
            assert!(near(main[1], [GREY; 3]) && near(under[1], [GREY; 3]), "{main:?} {under:?}");
        }
        // A smooth reflectance of the same colour looks otherwise under the other light.
        let upsampling = Upsampling::new(table.spectrum(), &aimed.viewing, &white).unwrap();
        let smooth = lit.viewing.relative_rgb(&upsampling.radiance(main[0]));
        assert!(!near(smooth, under[0]), "{smooth:?} {:?}", under[0]);
    }
}

#[test]
fn what_can_be_printed_under_one_light_stays_as_given_under_the_others() {
    let aimed = aimed(settings());
    let lit = &aimed.further[0];
    let mut unchanged = 0;
    for i in (0..aimed.target.len()).filter(|&i| near(aimed.target[i], aimed.printable_target[i])) {
        assert!(near(lit.target[i], lit.printable_target[i]));
        unchanged += 1;
    }
    assert!(unchanged > 100, "{unchanged}");
}

#[test]
fn a_print_of_it_says_so() {
    let (job, monitor) = (PrintJob::new(settings()).unwrap(), Monitor::silent());
    let prepared = job.prepare_spectral(&ball(), &image(), &Workspace::none(), &monitor).unwrap();
    assert_eq!(prepared.record.model.spectral_image, Some(image().digest().hex()));
    assert_eq!(prepared.report(&monitor).lights.len(), 2);
}

#[test]
fn what_does_not_fit_is_refused() {
    let refused = |settings: PrintSettings, model: &Model, image: &SpectralImage| {
        let job = PrintJob::new(settings).unwrap();
        job.place_spectral(model, image, &Monitor::silent()).unwrap_err()
    };
    let error = refused(PrintSettings::default(), &ball(), &image());
    assert!(matches!(error, PrintError::Unsupported(_)) && error.to_string().contains("bands"), "{error}");
    let few = |from: u32, step: u32| {
        let bands = (from..=720).step_by(step as usize).map(|nm| (f64::from(nm), vec![0.5, 0.5]));
        SpectralImage::new("few", [2, 1], bands.collect()).unwrap()
    };
    let error = refused(settings(), &ball(), &few(420, 10)).to_string();
    assert!(error.contains("spectral image") && error.contains("do not reach 400 nm"), "{error}");
    let error = refused(settings(), &ball(), &few(380, 40)).to_string();
    assert!(error.contains("a gap from 380 to 420"), "{error}");
    let error = refused(settings(), &patched_ball(), &image());
    assert!(matches!(error, PrintError::Mesh(_)) && error.to_string().contains("no texture"), "{error}");
    let clear = PrintSettings { clear_from_alpha: true, ..PrintSettings::default() };
    let error = refused(clear, &ball(), &image()).to_string();
    assert!(error.contains("clear_from_alpha"), "{error}");
}
