//! The README's command, as far as it goes without its model.

use crate::common::{pellucid, stderr};

#[test]
fn the_readmes_command_lacks_nothing_but_the_model() {
    let readme = include_str!("../../README.md");
    let line =
        readme.lines().find_map(|line| line.strip_prefix("pellucid ")).expect("the README has a command");
    let folder = tempfile::tempdir().unwrap();
    let output = pellucid().args(line.split_whitespace()).current_dir(&folder).output().unwrap();
    let told = stderr(&output);
    // Arguments that make no sense would end with status 2.
    assert!(output.status.code() == Some(1) && told.contains("model.glb"), "{told}");
}
