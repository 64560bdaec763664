//! A model, a folder and the program.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The program, waiting for arguments.
pub fn pellucid() -> Command {
    Command::new(env!("CARGO_BIN_EXE_pellucid"))
}

/// Runs to the end.
pub fn run(arguments: &[&str]) -> Output {
    pellucid().args(arguments).output().expect("the program starts")
}

/// A path as an argument.
pub fn text(path: &Path) -> &str {
    path.to_str().expect("temporary folders have plain names")
}

/// Standard error as text.
pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Standard output as text.
pub fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// A cube of 2 mm, each corner of another colour, as a GLB file in `folder`.
pub fn cube(folder: &Path) -> PathBuf {
    let mut bin = Vec::new();
    for i in 0..8u32 {
        (0..3).for_each(|a| bin.extend((0.002 * (i >> a & 1) as f32).to_le_bytes()));
    }
    for i in 0..8u32 {
        (0..3).for_each(|a| bin.extend((0.15 + 0.7 * (i >> a & 1) as f32).to_le_bytes()));
    }
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    for [a, b, c, d] in quads {
        [a, b, c, a, c, d].iter().for_each(|i: &u16| bin.extend(i.to_le_bytes()));
    }
    let mut json = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0,"COLOR_0":1},"indices":2}]}],
"buffers":[{"byteLength":264}],
"bufferViews":[{"buffer":0,"byteLength":96},{"buffer":0,"byteOffset":96,"byteLength":96},
{"buffer":0,"byteOffset":192,"byteLength":72}],
"accessors":[{"bufferView":0,"componentType":5126,"count":8,"type":"VEC3","min":[0,0,0],"max":[0.002,0.002,0.002]},
{"bufferView":1,"componentType":5126,"count":8,"type":"VEC3"},
{"bufferView":2,"componentType":5123,"count":36,"type":"SCALAR"}]}"#
        .to_owned();
    while !json.len().is_multiple_of(4) {
        json.push(' ');
    }
    let mut glb = b"glTF\x02\0\0\0".to_vec();
    glb.extend(((28 + json.len() + bin.len()) as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", json.as_bytes()), (b"BIN\0", &bin[..])] {
        glb.extend((chunk.len() as u32).to_le_bytes());
        glb.extend(kind);
        glb.extend(chunk);
    }
    let path = folder.join("cube.glb");
    std::fs::write(&path, glb).expect("the folder can be written");
    path
}

/// Arguments of a job that takes about a second.
pub fn quick<'a>(model: &'a str, out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let mut arguments = vec!["prepare", model, "--out", out, "--spp", "2", "--iterations", "2"];
    arguments.extend(more);
    arguments
}

/// Every file of a folder's `slices` with its bytes, by name.
pub fn slices(out: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = std::fs::read_dir(out.join("slices"))
        .expect("there are slices")
        .map(|f| f.expect("readable"))
        .map(|f| (f.file_name().to_string_lossy().into_owned(), std::fs::read(f.path()).expect("readable")))
        .collect();
    files.sort();
    files
}
