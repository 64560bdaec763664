use super::*;
use crate::Vertex;
use crate::shapes::Shape;
use crate::voxelise::{VoxeliseOptions, voxelise};
use pellucid_voxel::SurfaceOptions;

const SIZE: [u32; 2] = [5, 4];

/// Seven bands of different patterns, the last first.
fn bands() -> Vec<(f64, Vec<f32>)> {
    let pattern = |k: u32| (0..20).map(|i| ((i * (k + 3) + k * k) % 17) as f32 / 16.0).collect();
    (0..7).rev().map(|k| (400.0 + 50.0 * f64::from(k), pattern(k))).collect()
}

/// A cube whose texture is `image`, seen from above on all sides.
fn textured(image: Arc<Image>) -> Model {
    let cube = Shape::cuboid([0.0; 3], [2.0; 3]).model();
    let uv = |p: [f64; 3]| [0.5 * p[0] + 0.1 * p[2], 0.5 * p[1]].map(|v| (1e3 * v) as f32);
    let vertices = cube.vertices().iter().map(|v| Vertex { uv: uv(v.position_m), ..*v }).collect();
    let material = BaseColor { texture: Some(0), ..cube.materials()[0].clone() };
    let texture = Texture::new(image, Sampler::default());
    Model::new("cube", vertices, cube.triangles().to_vec(), vec![material], vec![texture]).unwrap()
}

fn surface(model: &Model) -> (PlacedMesh<'_>, Surface) {
    let control = Control::none();
    let voxelised = voxelise(model, &VoxeliseOptions::default(), &control).unwrap();
    let surface = Surface::extract(&voxelised.grid, &SurfaceOptions::default(), &control).unwrap();
    (PlacedMesh::at(model, voxelised.placement), surface)
}

#[test]
fn every_band_is_sampled_as_a_texture_of_its_own() {
    let spectral = SpectralImage::new("bands", SIZE, bands()).unwrap();
    assert!(spectral.wavelengths_nm().is_sorted());
    let model = textured(spectral.bands(0..1).unwrap());
    let (mesh, surface) = surface(&model);
    let control = Control::none();
    let mut seen = Vec::new();
    mesh.surface_reflectances(&surface, &spectral, &control, |bands, values| {
        seen.push((bands, values.to_vec()));
    })
    .unwrap();
    assert_eq!(seen.iter().map(|(bands, _)| bands.clone()).collect::<Vec<_>>(), [0..3, 3..6, 6..7]);
    for (bands, values) in seen {
        let model = textured(spectral.bands(bands).unwrap());
        let expected = PlacedMesh::at(&model, *mesh.placement()).surface_colors(&surface, &control).unwrap();
        assert!(values == expected && values.iter().any(|v| v[0] > 0.1));
    }
}

#[test]
fn what_is_no_spectral_image_is_refused_by_name() {
    let refused = |size, bands: Vec<(f64, Vec<f32>)>| {
        SpectralImage::new("bad.exr", size, bands).unwrap_err().to_string()
    };
    let one = |nm| (nm, vec![0.5; 20]);
    assert!(refused(SIZE, vec![one(500.0)]).contains("bad.exr: bands: 1 of known wavelength"));
    assert!(refused(SIZE, vec![one(500.0), one(400.0), one(500.0)]).contains("500 nm: it is there twice"));
    assert!(refused(SIZE, vec![one(500.0), one(-400.0)]).contains("not above 0"));
    assert!(refused(SIZE, vec![one(500.0), one(f64::NAN)]).contains("not above 0"));
    assert!(refused([5, 5], vec![one(500.0), one(600.0)]).contains("20 values for 5 x 5"));
    assert!(refused([0, 5], vec![(1.0, vec![]), (2.0, vec![])]).contains("0 values"));
    let nan = vec![f32::NAN; 20];
    assert!(refused(SIZE, vec![one(500.0), (600.0, nan)]).contains("600 nm: a value is not finite"));

    let image = SpectralImage::new("bands", SIZE, bands()).unwrap();
    let plain = Shape::cuboid([0.0; 3], [2.0; 3]).model();
    let (mesh, surface) = surface(&plain);
    let error = mesh.surface_reflectances(&surface, &image, &Control::none(), |_, _| ()).unwrap_err();
    assert!(error.to_string().contains("no texture, whose place bands could take"), "{error}");
}

#[test]
fn digests_tell_images_apart() {
    let of = |bands| SpectralImage::new("bands", SIZE, bands).unwrap().digest().hex();
    let mut changed = bands();
    changed[3].1[7] += 0.1;
    let mut shifted = bands();
    shifted[0].0 += 1.0;
    let mut sorted = bands();
    sorted.reverse();
    assert!(of(bands()) == of(sorted) && of(bands()) != of(changed) && of(bands()) != of(shifted));
}

#[cfg(feature = "spectral")]
mod exr_files {
    use super::*;
    use crate::ImportLimits;
    use ::exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, WritableImage};

    /// An OpenEXR file of one layer.
    fn file(channels: Vec<(&str, Vec<f32>)>) -> Vec<u8> {
        let channel = |(name, values): (&str, Vec<f32>)| AnyChannel::new(name, FlatSamples::F32(values));
        let channels = AnyChannels::sort(channels.into_iter().map(channel).collect());
        let size = SIZE.map(|side| side as usize);
        let mut bytes = std::io::Cursor::new(Vec::new());
        Image::from_channels((size[0], size[1]), channels).write().to_buffered(&mut bytes).unwrap();
        bytes.into_inner()
    }

    fn read(bytes: &[u8]) -> Result<SpectralImage, MeshError> {
        SpectralImage::from_exr("image.exr", bytes, &ImportLimits::default())
    }

    #[test]
    fn channels_are_read_by_their_wavelengths() {
        let planes = bands();
        let names = ["T.700,000nm", "T.650nm", "600nm", "550", "T.500,0nm", "450.0nm", "T.4e2nm"];
        let mut channels: Vec<_> =
            names.iter().zip(&planes).map(|(name, (_, plane))| (*name, plane.clone())).collect();
        ["R", "G", "B", "T.S1"].iter().for_each(|&name| channels.push((name, vec![9.0; 20])));
        assert_eq!(read(&file(channels)).unwrap(), SpectralImage::new("image.exr", SIZE, planes).unwrap());
    }

    #[test]
    fn other_files_are_refused() {
        let says = |bytes: &[u8], text: &str| {
            let error = read(bytes).unwrap_err().to_string();
            assert!(error.starts_with("image.exr: ") && error.contains(text), "{error}");
        };
        let plane = || vec![0.5; 20];
        says(&file(vec![("R", plane()), ("G", plane())]), "0 of known wavelength");
        says(&file(vec![("S0.500,0nm", plane()), ("S0.600,0nm", plane())]), "sent out");
        says(b"no picture", "OpenEXR");
        let whole = file(vec![("T.500nm", plane()), ("T.600nm", plane())]);
        says(&whole[..whole.len() - 30], "OpenEXR");
        let limits = ImportLimits { texture_edge: 4, ..ImportLimits::default() };
        let error = SpectralImage::from_exr("image.exr", &whole, &limits).unwrap_err().to_string();
        assert!(error.contains("5 x 4 pixels"), "{error}");
        let limits = ImportLimits { texture_bytes: 100, ..ImportLimits::default() };
        let error = SpectralImage::from_exr("image.exr", &whole, &limits).unwrap_err().to_string();
        assert!(error.contains("2 channels of 5 x 4"), "{error}");
        let missing = SpectralImage::read_exr("no such file.exr", &ImportLimits::default()).unwrap_err();
        assert!(matches!(missing, MeshError::Io { .. }), "{missing}");
    }

    #[test]
    fn damage_is_an_error_or_another_image() {
        let whole = file(vec![("T.500nm", vec![0.5; 20]), ("T.600nm", vec![0.25; 20])]);
        for i in 0..whole.len() {
            for flip in [1u8, 0x80, 0xff] {
                let mut damaged = whole.clone();
                damaged[i] ^= flip;
                let _ = read(&damaged);
            }
            let _ = read(&whole[..i]);
        }
    }
}
