//! Thousands of damaged models: none may panic or take memory out of proportion.

#[allow(dead_code, reason = "the writer is shared with the other import tests")]
#[path = "import/glb.rs"]
mod glb;

mod common;

use common::Random;
use glb::*;
use pellucid_mesh::{ImportLimits, ImportOptions, Model, import_slice};
use rand_core::Rng;
use rand_pcg::Pcg64Mcg;
use serde_json::{Value, json};

const MUTANTS: u32 = 24_000;

/// A valid model to damage.
struct Seed {
    json: Value,
    bin: Vec<u8>,
}

fn textured() -> Glb {
    let texels: Vec<[u8; 3]> = (0..64u8).map(|i| [i * 4, 255 - i, i]).collect();
    let mut glb = textured_square(&png(8, 8, &texels));
    glb.push("samplers", json!({"wrapS": 33648, "wrapT": 33071, "minFilter": 9985}));
    glb.at("/textures/0")["sampler"] = json!(0);
    let colors = glb.accessor(&[200; 16], U8, "VEC4", 4);
    glb.at("/accessors")[colors]["normalized"] = json!(true);
    glb.at("/meshes/0/primitives/0/attributes")["COLOR_0"] = colors.into();
    glb.at("/materials/0/pbrMetallicRoughness/baseColorTexture")["extensions"] =
        json!({"KHR_texture_transform": {"offset": [0.5, 0], "rotation": 1, "scale": [2, 2], "texCoord": 0}});
    glb.push("extensionsUsed", "KHR_texture_transform".into());
    glb.at("/materials/0")["alphaMode"] = "MASK".into();
    glb.at("/materials/0")["alphaCutoff"] = 0.4.into();
    glb
}

fn jpeg() -> Glb {
    let texels: Vec<[u8; 3]> = (0..256).map(|i| [i as u8, (i / 3) as u8, 90]).collect();
    let mut glb = textured_square(&encode(16, 16, &texels, image::ImageFormat::Jpeg));
    glb.at("/meshes/0/primitives/0")["mode"] = json!(5);
    glb
}

fn sparse() -> Glb {
    let mut glb = square();
    let (indices, values) = (glb.view(&[1, 0, 3, 0]), glb.view(&[0; 24]));
    glb.at("/accessors/0")["sparse"] = json!({
        "count": 2,
        "indices": {"bufferView": indices, "componentType": U16},
        "values": {"bufferView": values},
    });
    glb.push("nodes", json!({"children": [0], "rotation": [0, 0, 0, 1], "scale": [1, -2, 1]}));
    glb.at("/scenes/0")["nodes"] = json!([1]);
    glb
}

fn skin_and_morph() -> Glb {
    let mut glb = square();
    let target = glb.floats(&[[0.0, 0.5, 0.25]; 4]);
    let joints = glb.accessor(&[0, 1, 0, 0].repeat(4), U8, "VEC4", 4);
    let weights = glb.floats(&[[0.25, 0.75, 0.0, 0.0]; 4]);
    let mut identity = [0.0; 16];
    (0..4).for_each(|i| identity[5 * i] = 1.0);
    let bind = glb.floats(&[identity; 2]);
    let root = glb.push("nodes", json!({"children": [2], "translation": [0, 0, 3]}));
    let matrix = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 4, 0, 0, 1];
    let tip = glb.push("nodes", json!({"matrix": matrix}));
    glb.push("skins", json!({"joints": [root, tip], "inverseBindMatrices": bind}));
    glb.at("/nodes/0")["skin"] = json!(0);
    glb.at("/meshes/0/primitives/0")["targets"] = json!([{"POSITION": target}]);
    glb.at("/meshes/0")["weights"] = json!([0.5]);
    let attributes = &mut glb.at("/meshes/0/primitives/0")["attributes"];
    attributes["JOINTS_0"] = joints.into();
    attributes["WEIGHTS_0"] = weights.into();
    glb
}

/// The seeds as GLB, and one with its buffer and image in data URIs.
fn seeds() -> Vec<Seed> {
    let seed = |mut glb: Glb| {
        glb.json["buffers"] = json!([{"byteLength": glb.bin.len()}]);
        Seed { json: glb.json, bin: glb.bin }
    };
    let mut seeds: Vec<_> = [textured(), jpeg(), sparse(), skin_and_morph()].into_iter().map(seed).collect();
    let text = textured().gltf();
    seeds.push(Seed { json: serde_json::from_slice(&text).unwrap(), bin: Vec::new() });
    seeds
}

/// JSON pointers of every value below `value`.
fn pointers(value: &Value, at: String, out: &mut Vec<String>) {
    match value {
        Value::Object(map) => map.iter().for_each(|(k, v)| pointers(v, format!("{at}/{k}"), out)),
        Value::Array(items) => {
            items.iter().enumerate().for_each(|(k, v)| pointers(v, format!("{at}/{k}"), out))
        }
        _ => {}
    }
    if !at.is_empty() {
        out.push(at);
    }
}

fn number(random: &mut Random) -> Value {
    match random.below(14) {
        0 => json!(-1),
        1 => json!(0),
        2 => json!(1u64 << 31),
        3 => json!(u32::MAX),
        4 => json!((1u64 << 32) + 1),
        5 => json!(u64::MAX),
        6 => json!(i64::MIN),
        7 => json!(1e308),
        8 => json!(-1e-300),
        9 => json!(0.5),
        10 => json!(*random.pick(&[5120, 5121, 5122, 5123, 5125, 5126])),
        _ => json!(random.below(9)),
    }
}

fn text(random: &mut Random) -> Value {
    const WORDS: [&str; 14] = [
        "SCALAR",
        "VEC2",
        "VEC3",
        "VEC4",
        "MAT4",
        "",
        "3.0",
        "MASK",
        "../x.bin",
        "data:,%00",
        "data:;base64,AAAA",
        "KHR_draco_mesh_compression",
        "\u{0}\u{7f}é",
        "file:///etc/passwd",
    ];
    json!(random.pick(&WORDS))
}

/// One change somewhere in the JSON.
fn mutate_json(json: &mut Value, random: &mut Random) {
    let mut all = Vec::new();
    pointers(json, String::new(), &mut all);
    let donor = json.pointer(random.pick(&all).as_str()).cloned().unwrap_or_default();
    let pointer = random.pick(&all).clone();
    let Some(target) = json.pointer_mut(&pointer) else { return };
    let choice = random.below(8);
    match target {
        Value::Number(_) if choice < 6 => *target = number(random),
        Value::String(_) if choice < 4 => *target = text(random),
        Value::Array(items) if choice < 2 && !items.is_empty() => {
            let (a, b) = (random.below(items.len()), random.below(items.len()));
            items.swap(a, b);
        }
        Value::Array(items) if choice < 4 => {
            let extra = if choice == 2 { number(random) } else { donor };
            items.extend(vec![extra; 1 + random.below(20)]);
        }
        Value::Array(items) if choice < 6 => items.truncate(items.len() / 2),
        Value::Object(map) if choice < 4 && !map.is_empty() => {
            let key = map.keys().nth(random.below(map.len())).cloned().unwrap_or_default();
            map.remove(&key);
        }
        Value::Object(map) if choice < 5 => {
            let names = [
                "bufferView",
                "sparse",
                "byteStride",
                "skin",
                "matrix",
                "children",
                "mode",
                "uri",
                "weights",
            ];
            map.insert((*random.pick(&names)).into(), donor);
        }
        _ => *target = donor,
    }
}

/// A damaged copy of a seed.
fn mutant(seeds: &[Seed], random: &mut Random) -> Vec<u8> {
    let seed = random.pick(seeds);
    let kind = random.below(10);
    let (mut json, mut bin) = (seed.json.clone(), seed.bin.clone());
    if kind < 5 {
        for _ in 0..=random.below(3) {
            mutate_json(&mut json, random);
        }
    }
    if (4..7).contains(&kind) && !bin.is_empty() {
        for _ in 0..=random.below(6) {
            let at = random.below(bin.len()) & !3;
            let words = [[0xFF; 4], [0, 0, 0x80, 0x7F], [0; 4], (random.0.next_u32() >> 8).to_le_bytes()];
            let word = random.pick(&words);
            bin.iter_mut().skip(at).zip(word).for_each(|(b, w)| *b = *w);
        }
    }
    let text = json.to_string();
    let mut bytes = if bin.is_empty() && random.below(2) == 0 {
        text.into_bytes()
    } else {
        pack(text.as_bytes(), Some(&bin))
    };
    match kind {
        7 => {
            for _ in 0..=random.below(12) {
                let at = random.below(bytes.len());
                bytes[at] ^= 1 << random.below(8);
            }
        }
        8 => bytes.truncate(random.below(bytes.len())),
        9 => {
            // Header and chunk lengths.
            let chunk = 20 + u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
            let at = *random.pick(&[4, 8, 12, 16, chunk, chunk.saturating_add(4)]);
            let lengths = [0, 1, 3, u32::MAX, bytes.len() as u32, random.below(2000) as u32];
            let value = random.pick(&lengths).to_le_bytes();
            bytes.iter_mut().skip(at).zip(value).for_each(|(b, v)| *b = v);
        }
        _ => {}
    }
    bytes
}

/// Whatever gets through must be a model that downstream code can trust.
fn check(model: &Model, limits: &ImportLimits) {
    assert!(!model.triangles().is_empty() && model.triangles().len() as u64 <= limits.triangles);
    assert!(model.vertices().len() as u64 <= limits.vertices);
    assert!(model.bounds_m().as_flattened().iter().all(|c| c.is_finite()));
    for (i, triangle) in model.triangles().iter().enumerate() {
        assert!(triangle.vertices.iter().all(|&v| (v as usize) < model.vertices().len()));
        for footprint in [0.0, 0.1] {
            let color = model.color_at(i as u32, [0.25, 0.25, 0.5], footprint);
            assert!(color.iter().all(|c| (0.0..=1.0).contains(c)), "{color:?}");
            model.is_clear_at(i as u32, [0.25, 0.25, 0.5], footprint);
        }
    }
    assert_eq!(model.clear_bodies().len(), model.triangles().len());
}

/// The most address space this process ever held, in bytes; reserved but untouched memory counts.
fn peak_address_space() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmPeak:"))?;
    Some(line.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok()? * 1024)
}

#[test]
fn damaged_models_neither_panic_nor_swell() {
    let limits = ImportLimits {
        file_bytes: 1 << 20,
        vertices: 100_000,
        triangles: 100_000,
        deformations: 1_000_000,
        texture_edge: 4096,
        texture_pixels: 1 << 20,
        texture_bytes: 16 << 20,
        ..ImportLimits::default()
    };
    let seeds = seeds();
    for seed in &seeds {
        let bytes = pack(seed.json.to_string().as_bytes(), Some(&seed.bin));
        check(&import_slice("seed", &bytes, None, &limits).unwrap(), &limits);
    }
    let options = |opacity| ImportOptions { opacity, ..ImportOptions::from(limits) };
    let before = peak_address_space();
    let (mut imported, mut refused) = (0, 0);
    for number in 0..MUTANTS {
        let mut random = Random(Pcg64Mcg::new(0x0570_1e55 + u128::from(number)));
        let mutant = mutant(&seeds, &mut random);
        match options(number % 2 == 0).import_slice("mutant", &mutant, None) {
            Ok(model) => {
                check(&model, &limits);
                imported += 1;
            }
            Err(error) => {
                assert!(error.to_string().starts_with("mutant: "), "{error}");
                refused += 1;
            }
        }
    }
    // Both must be common, or the damage is too light or too heavy to test anything.
    assert!(imported > MUTANTS / 10 && refused > MUTANTS / 4, "{imported} imported, {refused} refused");
    if let (Some(before), Some(after)) = (before, peak_address_space()) {
        assert!(after - before < 256 << 20, "took {} MiB", (after - before) >> 20);
    }
}
