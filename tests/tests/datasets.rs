//! The files under `datasets/` are those that the crates carry.

use std::path::Path;

use pellucid::slice::PrintTarget;

#[test]
fn printers_are_the_built_in_profiles() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut names = Vec::new();
    for entry in std::fs::read_dir(root.join("datasets/printers")).unwrap() {
        let entry = entry.unwrap();
        let target = PrintTarget::load(entry.path()).unwrap();
        assert_eq!(PrintTarget::by_name(target.name()).unwrap(), target);
        let carried = root.join("crates/pellucid-slice/printers").join(entry.file_name());
        assert_eq!(std::fs::read(entry.path()).unwrap(), std::fs::read(carried).unwrap());
        names.push(target.name().to_owned());
    }
    names.sort();
    assert_eq!(names, PrintTarget::NAMES);
}
