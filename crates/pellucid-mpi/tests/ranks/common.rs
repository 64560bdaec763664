//! Processes of the program, and what they left.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Settings of a job that takes little time.
const QUICK: &str = r#"{"spp": 2, "judge_spp": 2, "judge_point_spp": 8, "proof_edge": 32,
    "judge": {"points": 50, "point_passes": 2, "surface_passes": 2}}"#;

/// The program as so many processes of one thread each, in `folder`.
pub fn mpirun(ranks: usize, folder: &Path) -> Command {
    let mut command = Command::new("mpirun");
    command.args(["--oversubscribe", "--bind-to", "none", "-n", &ranks.to_string()]);
    command.arg(env!("CARGO_BIN_EXE_pellucid-mpi")).current_dir(folder);
    // Containers run as root, and let no process read another one's memory.
    command.env("OMPI_ALLOW_RUN_AS_ROOT", "1").env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1");
    command.env("OMPI_MCA_btl_vader_single_copy_mechanism", "none").env("RAYON_NUM_THREADS", "1");
    command
}

/// Runs a command line to its successful end.
pub fn run(ranks: usize, folder: &Path, line: &str) -> Output {
    let output = mpirun(ranks, folder).args(line.split_whitespace()).output().expect("mpirun starts");
    assert!(output.status.success(), "{ranks} ranks, {line}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

/// A folder with `quick.json`, a wedge under two names and a recipe.
pub fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../datasets");
    fs::write(folder.path().join("quick.json"), QUICK).expect("it can be written");
    for (from, to) in
        [("models/wedge.glb", "a.glb"), ("models/wedge.glb", "b.glb"), ("recipes/toy.json", "toy.json")]
    {
        fs::copy(root.join(from), folder.path().join(to)).expect("the repository has it");
    }
    folder
}

/// What a print consists of: slices and manifest, byte for byte.
pub fn print(out: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let slices = fs::read_dir(out.join("slices")).expect("there are slices");
    let files = slices.map(|entry| entry.expect("an entry").path()).chain([out.join("manifest.json")]);
    files
        .map(|file| (file.strip_prefix(out).expect("below").to_owned(), fs::read(&file).expect("a file")))
        .collect()
}
