//! Textures with ICC profiles: known codes become known colours, and damaged profiles are refused.

use std::path::Path;

use moxcms::ColorProfile;
use pellucid_mesh::import::IccProfile;
use pellucid_mesh::{ImportOptions, MeshError, Model};
use proptest::prelude::*;

/// Linear Display P3 to linear Rec.709, both with D65.
const REC709_OF_P3: [[f64; 3]; 3] = [
    [1.224_940_2, -0.224_940_2, 0.0],
    [-0.042_056_95, 1.042_056_95, 0.0],
    [-0.019_637_55, -0.078_636_05, 1.098_273_6],
];
/// Linear Adobe RGB (1998) to linear Rec.709, both with D65.
const REC709_OF_ADOBE: [[f64; 3]; 3] =
    [[1.398_283_2, -0.398_283_2, 0.0], [0.0, 1.0, 0.0], [0.0, -0.042_938_3, 1.042_938_3]];

fn srgb(v: f64) -> f64 {
    if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

fn adobe(v: f64) -> f64 {
    v.powf(563.0 / 256.0)
}

fn wanted(matrix: &[[f64; 3]; 3], curve: fn(f64) -> f64, code: [u8; 3]) -> [f64; 3] {
    let linear = code.map(|v| curve(f64::from(v) / 255.0));
    matrix.map(|row| row.iter().zip(linear).map(|(a, b)| a * b).sum::<f64>().clamp(0.0, 1.0))
}

fn profile(name: &str, profile: &ColorProfile) -> IccProfile {
    IccProfile::from_bytes(name, &profile.encode().unwrap()).unwrap()
}

/// A PNG of one pixel, with a profile or none.
fn png(code: [u8; 3], profile: Option<&ColorProfile>) -> Vec<u8> {
    let mut info = png::Info::with_size(1, 1);
    info.color_type = png::ColorType::Rgb;
    info.bit_depth = png::BitDepth::Eight;
    info.icc_profile = profile.map(|p| p.encode().unwrap().into());
    let mut out = Vec::new();
    let mut writer = png::Encoder::with_info(&mut out, info).unwrap().write_header().unwrap();
    writer.write_image_data(&code).unwrap();
    writer.finish().unwrap();
    out
}

/// A triangle of OBJ with a texture.
fn imported(texture: &[u8], options: &ImportOptions) -> Model {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    write("a.mtl", b"newmtl a\nmap_Kd a.png\n");
    write("a.png", texture);
    let obj = b"mtllib a.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n";
    options.import_slice("a.obj", obj, Some(Path::new(folder.path()))).unwrap()
}

fn color(model: &Model) -> [f64; 3] {
    model.color_at(0, [0.3, 0.3, 0.4], 0.0).map(f64::from)
}

fn near(found: [f64; 3], wanted: [f64; 3]) {
    assert!((0..3).all(|c| (found[c] - wanted[c]).abs() < 6e-4), "{found:?} is not {wanted:?}");
}

const CODES: [[u8; 3]; 6] = [[255; 3], [0; 3], [180, 150, 120], [64, 120, 110], [12, 20, 30], [255, 40, 30]];

#[test]
fn textures_are_read_by_the_given_profile() {
    for code in CODES {
        let by = |given: ColorProfile| {
            let icc = Some(profile("given", &given));
            imported(&png(code, None), &ImportOptions { icc, ..ImportOptions::default() })
        };
        near(color(&by(ColorProfile::new_display_p3())), wanted(&REC709_OF_P3, srgb, code));
        let model = by(ColorProfile::new_adobe_rgb());
        near(color(&model), wanted(&REC709_OF_ADOBE, adobe, code));
        assert!(model.notes()[0].text.contains("\"given\""), "{:?}", model.notes());
    }
}

#[test]
fn an_embedded_profile_goes_before_the_given_one() {
    let p3 = profile("given", &ColorProfile::new_display_p3());
    let given = ImportOptions { icc: Some(p3), ..ImportOptions::default() };
    for code in CODES {
        let adobe_rgb = imported(&png(code, Some(&ColorProfile::new_adobe_rgb())), &given);
        near(color(&adobe_rgb), wanted(&REC709_OF_ADOBE, adobe, code));
        assert!(adobe_rgb.notes()[0].text.contains("embeds"), "{:?}", adobe_rgb.notes());
        // What most files embed changes nothing, to the last bit.
        let plain = imported(&png(code, None), &ImportOptions::default());
        let tagged = imported(&png(code, Some(&ColorProfile::new_srgb())), &given);
        assert_eq!((tagged.digest(), tagged.notes().len()), (plain.digest(), 0));
    }
}

#[test]
fn a_useless_embedded_profile_is_left_out_and_noted() {
    let grey = ColorProfile::new_gray_with_gamma(2.2);
    let model = imported(&png([90; 3], Some(&grey)), &ImportOptions::default());
    assert!(model.notes()[0].text.contains("left out"), "{:?}", model.notes());
    assert_eq!(model.digest(), imported(&png([90; 3], None), &ImportOptions::default()).digest());
}

#[test]
fn gltf_takes_no_profile() {
    let icc = Some(profile("given", &ColorProfile::new_display_p3()));
    let options = ImportOptions { icc, ..ImportOptions::default() };
    let gltf = br#"{ "asset": {"version": "2.0"} }"#;
    let error = options.import_slice("a.gltf", gltf, None).unwrap_err();
    assert!(
        matches!(&error, MeshError::Unsupported { object, .. } if object == "ImportOptions::icc"),
        "{error}"
    );
}

#[test]
fn profiles_of_another_kind_are_refused() {
    let refused = |bytes: &[u8]| IccProfile::from_bytes("a.icc", bytes).unwrap_err();
    let grey = refused(&ColorProfile::new_gray_with_gamma(2.2).encode().unwrap());
    assert!(matches!(grey, MeshError::Unsupported { .. }), "{grey}");
    assert!(matches!(refused(&vec![0; 5 << 20]), MeshError::Unsupported { .. }));
    for bytes in [&b""[..], b"not a profile", &[0; 200]] {
        assert!(matches!(refused(bytes), MeshError::Invalid { .. }));
    }
    let missing = IccProfile::load("none.icc").unwrap_err();
    assert!(matches!(missing, MeshError::Io { .. }), "{missing}");
    // As many tags as can be said, and a tag as long.
    let mut bytes = ColorProfile::new_display_p3().encode().unwrap();
    for at in [128, 136, 140] {
        let mut hostile = bytes.clone();
        hostile[at..at + 4].fill(0xff);
        let _ = IccProfile::from_bytes("a.icc", &hostile);
    }
    bytes.truncate(300);
    assert!(matches!(refused(&bytes), MeshError::Invalid { .. }));
}

proptest! {
    /// Neither a panic nor colours out of range, whatever a profile says.
    #[test]
    fn damaged_profiles_do_no_harm(
        damage in prop::collection::vec((0usize..4_000, any::<u8>()), 1..12),
        length in 0usize..4_000,
        which in 0usize..3,
    ) {
        let whole = [ColorProfile::new_display_p3(), ColorProfile::new_adobe_rgb(), ColorProfile::new_pro_photo_rgb()];
        let mut bytes = whole[which].encode().unwrap();
        for (at, value) in damage {
            let at = at % bytes.len();
            bytes[at] = value;
        }
        if length < 1_000 {
            bytes.truncate(length);
        }
        if let Ok(profile) = IccProfile::from_bytes("damaged", &bytes) {
            prop_assert_eq!(profile.linear(&[[0; 3], [1_000, 30_000, 65_535], [65_535; 3]]).len(), 3);
        }
    }
}
