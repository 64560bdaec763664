//! Thousands of damaged files of each format: none may panic or take memory out of proportion.

use std::fs;
use std::path::Path;

use crate::common::Random;
use pellucid_mesh::{ImportLimits, ImportOptions, Model};
use rand_pcg::Pcg64Mcg;

use crate::scene::*;

const MUTANTS: u32 = 10_000;

const LIMITS: ImportLimits = ImportLimits {
    file_bytes: 1 << 20,
    items: 1 << 10,
    json_values: 1 << 20,
    nesting: 64,
    vertices: 100_000,
    triangles: 100_000,
    deformations: 1_000_000,
    texture_edge: 4096,
    texture_pixels: 1 << 20,
    texture_bytes: 16 << 20,
};

/// Words that number readers stumble over.
const WORDS: [&str; 24] = [
    "0",
    "-1",
    "1",
    "nan",
    "inf",
    "-inf",
    "1e308",
    "1e39",
    "-0",
    "255",
    "256",
    "65536",
    "4294967295",
    "4294967296",
    "18446744073709551615",
    "-9223372036854775808",
    "1e-320",
    "0x1",
    "1/2/3",
    "a",
    "\"",
    "#",
    "../x",
    "\u{e9}",
];

fn is_word(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || matches!(byte, b'.' | b'-' | b'+' | b'_' | b'/')
}

/// One change of text: of a word, a line, or a byte.
fn mutate_text(text: &mut Vec<u8>, random: &mut Random) {
    if text.is_empty() {
        return;
    }
    let at = random.below(text.len());
    let word = {
        let start = (0..=at).rev().find(|&i| !is_word(text[i])).map_or(0, |i| i + 1);
        let end = (at..text.len()).find(|&i| !is_word(text[i])).unwrap_or(text.len());
        start..end.max(start)
    };
    let line = {
        let start = (0..at).rev().find(|&i| text[i] == b'\n').map_or(0, |i| i + 1);
        start..(at..text.len()).find(|&i| text[i] == b'\n').map_or(text.len(), |i| i + 1)
    };
    match random.below(8) {
        0..=2 => drop(text.splice(word, random.pick(&WORDS).bytes())),
        3 => drop(text.drain(word)),
        4 => drop(text.drain(line)),
        5 => {
            let copy = text[line.clone()].repeat(1 + random.below(4));
            drop(text.splice(line.end..line.end, copy));
        }
        6 => text[at] ^= 1 << random.below(8),
        _ => {
            let other = random.below(text.len());
            text.swap(at, other);
        }
    }
}

/// One change of bytes: of a word of four, of one bit, or of the length.
fn mutate_bytes(bytes: &mut Vec<u8>, random: &mut Random) {
    if bytes.is_empty() {
        return;
    }
    let at = random.below(bytes.len());
    match random.below(6) {
        0..=2 => {
            let words =
                [[0xFF; 4], [0, 0, 0x80, 0x7F], [0x7F, 0x80, 0, 0], [0; 4], [1, 0, 0, 0], [0, 0, 0, 0x80]];
            let word = random.pick(&words);
            bytes.iter_mut().skip(at).zip(word).for_each(|(b, w)| *b = *w);
        }
        3 => bytes[at] ^= 1 << random.below(8),
        4 if random.below(4) == 0 => bytes.truncate(at),
        4 => drop(bytes.drain(at..(at + 1 + random.below(60)).min(bytes.len()))),
        _ => {
            let copy = bytes[at..(at + 1 + random.below(60)).min(bytes.len())].to_vec();
            drop(bytes.splice(at..at, copy));
        }
    }
}

/// Whatever gets through must be a model that downstream code can trust.
fn check(model: &Model) {
    assert!(!model.triangles().is_empty() && model.triangles().len() as u64 <= LIMITS.triangles);
    assert!(model.vertices().len() as u64 <= LIMITS.vertices);
    assert!(model.bounds_m().as_flattened().iter().all(|c| c.is_finite()));
    for (i, triangle) in model.triangles().iter().enumerate() {
        assert!(triangle.vertices.iter().all(|&v| (v as usize) < model.vertices().len()));
        let color = model.color_at(i as u32, [0.25, 0.25, 0.5], 0.1);
        assert!(color.iter().all(|c| (0.0..=1.0).contains(c)), "{color:?}");
        model.is_clear_at(i as u32, [0.25, 0.25, 0.5], 0.1);
    }
    assert_eq!(model.clear_bodies().len(), model.triangles().len());
}

/// The most address space this process ever held, in bytes; reserved but untouched memory counts.
fn peak_address_space() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmPeak:"))?;
    Some(line.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok()? * 1024)
}

/// Imports damaged copies of the seeds; `mutate` makes one.
fn torture(
    name: &str,
    folder: Option<&Path>,
    seeds: &[Vec<u8>],
    mut mutate: impl FnMut(&[u8], &mut Random) -> Vec<u8>,
) {
    let options = |opacity| ImportOptions { opacity, ..ImportOptions::from(LIMITS) };
    for seed in seeds {
        let model = options(true).import_slice(name, seed, folder);
        check(&model.unwrap_or_else(|e| panic!("the seed is sound: {e}")));
    }
    let before = peak_address_space();
    let (mut imported, mut refused) = (0, 0);
    for number in 0..MUTANTS {
        let mut random = Random(Pcg64Mcg::new(0x0570_1e55 + u128::from(number)));
        let seed = &seeds[random.below(seeds.len())];
        let mutant = mutate(seed, &mut random);
        match options(number % 2 == 0).import_slice(name, &mutant, folder) {
            Ok(model) => {
                check(&model);
                imported += 1;
            }
            Err(error) => {
                assert!(error.to_string().starts_with(name), "{error}");
                refused += 1;
            }
        }
    }
    // Both must be common, or the damage is too light or too heavy to test anything.
    assert!(imported > MUTANTS / 20 && refused > MUTANTS / 20, "{imported} imported, {refused} refused");
    if let (Some(before), Some(after)) = (before, peak_address_space()) {
        assert!(after - before < 512 << 20, "took {} MiB", (after - before) >> 20);
    }
}

/// A tetrahedron, so that much of a file is not geometry.
fn small(textured: bool) -> Scene {
    let faces = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
    Scene {
        positions: vec![[0.0; 3], [7.0, 0.0, 0.0], [0.0, 7.5, 0.0], [0.0, 0.0, 8.0]],
        coords: vec![[0.0, 0.0], [1.0, 0.0], [0.5, 1.0], [0.25, 0.75]],
        colors: if textured { vec![[255; 3]; 4] } else { SIDES[..4].to_vec() },
        faces,
    }
}

fn folder(mtl: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.mtl"), mtl).unwrap();
    fs::write(folder.path().join("skin.png"), picture()).unwrap();
    folder
}

fn few(random: &mut Random, mut mutate: impl FnMut(&mut Random)) {
    (0..=random.below(4)).for_each(|_| mutate(random));
}

#[test]
fn damaged_obj_files_neither_panic_nor_swell() {
    let (textured, mtl) = obj(&small(true), true);
    let polygon = "v 0 0 0\nv 3 0 0 1\nv 3 1 0 0.5 0.5 1\nv 1 1 0 0 0 1 1\nv 1 2 0\nv 0 2 9\nvt 0 1\n\
        g a\nf 1 2 \\\n3 4 5 6\nf -1/1 -2/1 -3/-1\nl 1 2\n";
    let seeds = [textured.into_bytes(), obj_vertex_colors(&small(false)).into_bytes(), polygon.into()];
    let folder = folder(&mtl);
    torture("mutant.obj", Some(folder.path()), &seeds, |seed, random| {
        let mut text = seed.to_vec();
        few(random, |random| mutate_text(&mut text, random));
        text
    });
}

#[test]
fn damaged_material_libraries_neither_panic_nor_swell() {
    let (text, mtl) = obj(&small(true), true);
    let other = "newmtl other\nKd spectral x\nKd 0.5\nmap_Kd -clamp on -o 1 2 -mm 0 1 -s 1 1 1 \"skin.png\"\nTr 0.5\nKe 1\n";
    let see_through = mtl.replacen("map_Kd", "d 0.4\nTr 0.2\nmap_d -o 1 0 skin.png\nmap_Kd", 1);
    let mtl = (see_through + &mtl + other).into_bytes();
    let folder = folder("");
    let library = folder.path().join("scene.mtl");
    fs::write(&library, &mtl).unwrap();
    torture("mutant.obj", Some(folder.path()), &[text.clone().into_bytes()], |seed, random| {
        let mut changed = mtl.clone();
        few(random, |random| mutate_text(&mut changed, random));
        // Some file systems flush a file that is cut to nothing and written again; a new one they do not.
        fs::remove_file(&library).unwrap();
        fs::write(&library, changed).unwrap();
        seed.to_vec()
    });
}

#[test]
fn damaged_ply_files_neither_panic_nor_swell() {
    let folder = folder("");
    let mut seeds = Vec::new();
    for encoding in [Encoding::Ascii, Encoding::Little, Encoding::Big] {
        seeds.push(ply(&small(false), encoding, PlyColors::Faces));
        seeds.push(ply(&small(true), encoding, PlyColors::Texture));
        seeds.push(ply(&small(true), encoding, PlyColors::Wedges));
    }
    seeds.push(
        b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
        property uchar r\nproperty uchar g\nproperty uchar b\nproperty float a\nelement face 2\n\
        property list uchar int vertex_index\nend_header\n0 0 0 9 9 9 .2\n5 0 0 9 9 9 1\n5 5 0 9 9 9 .1\n\
        0 5 1 9 9 9 0\n3 0 1 2\n3 0 2 3\n"
            .to_vec(),
    );
    torture("mutant.ply", Some(folder.path()), &seeds, |seed, random| {
        let mut bytes = seed.to_vec();
        let body = bytes.windows(11).position(|w| w == b"end_header\n").map_or(0, |at| at + 11);
        let mut rest = bytes.split_off(body);
        let text = seed.starts_with(b"ply\nformat ascii");
        few(random, |random| match random.below(3) {
            0 => mutate_text(&mut bytes, random),
            _ if text => mutate_text(&mut rest, random),
            _ => mutate_bytes(&mut rest, random),
        });
        bytes.extend(rest);
        bytes
    });
}

#[test]
fn damaged_stl_files_neither_panic_nor_swell() {
    let seeds = [stl_ascii(&small(false)), stl_binary(&small(false))];
    torture("mutant.stl", None, &seeds, |seed, random| {
        let mut bytes = seed.to_vec();
        let binary = seed.contains(&0);
        few(random, |random| match binary {
            true => mutate_bytes(&mut bytes, random),
            false => mutate_text(&mut bytes, random),
        });
        bytes
    });
}

#[test]
fn damaged_3mf_packages_neither_panic_nor_swell() {
    let layers = "<basematerials id=\"21\"><base name=\"a\" displaycolor=\"#12345640\"/></basematerials>\
        <m:compositematerials id=\"22\" matid=\"21\" matindices=\"0\"><m:composite values=\"1\"/></m:compositematerials>\
        <m:multiproperties id=\"23\" pids=\"22 1\" blendmethods=\"multiply\"><m:multi pindices=\"0 0\"/></m:multiproperties>\
        <object id=\"24\" pid=\"23\" pindex=\"0\"><components><component objectid=\"2\" \
        transform=\"1 0 0 0 1 0 0 0 1 5 5 5\"/></components></object>\n";
    let models = [ThreeMfColors::Base, ThreeMfColors::Group, ThreeMfColors::Texture]
        .map(|colors| threemf_xml(&small(colors == ThreeMfColors::Texture), colors))
        .map(|xml| {
            let xml = xml.replace("</resources>", &format!("{layers}</resources>"));
            xml.replace("<build>", "<build><item objectid=\"24\" transform=\"0 1 0 1 0 0 0 0 1 0 0 0\"/>")
        });
    let skin = picture();
    let pack = |xml: &str| package(xml, &[("3D/Texture/skin.png", skin.as_slice())]);
    let seeds: Vec<Vec<u8>> = models.iter().map(|xml| pack(xml)).collect();
    torture("mutant.3mf", None, &seeds, |seed, random| {
        if random.below(3) == 0 {
            let mut bytes = seed.to_vec();
            mutate_bytes(&mut bytes, random);
            return bytes;
        }
        let mut text = random.pick(&models).clone().into_bytes();
        few(random, |random| mutate_text(&mut text, random));
        let mut bytes = zip_of(&text, &skin);
        if random.below(8) == 0 {
            mutate_bytes(&mut bytes, random);
        }
        bytes
    });
}

/// A package whose model need not be text.
fn zip_of(model: &[u8], skin: &[u8]) -> Vec<u8> {
    zipped(&[("3D/3dmodel.model", model), ("3D/Texture/skin.png", skin)])
}
