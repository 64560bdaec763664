//! The committed files are what the generator makes, and every model is a closed solid.

use std::path::Path;

use pellucid_models::{glb, models};

#[test]
fn models_are_closed_outward_and_of_the_stated_size() {
    // Longest edge of the bounding box in millimetres, and volume relative to that box.
    let sizes = [
        ("wedge", 60.0),
        ("showcase", 30.0),
        ("octostar", 30.0),
        ("bone", 40.0),
        ("vase-handle", 40.0),
        ("vase-hollow", 50.0),
        ("tubes", 60.0),
        ("plane", 30.0),
    ];
    let models = models::all();
    assert_eq!(models.len(), sizes.len());
    for (model, (name, edge)) in models.iter().zip(sizes) {
        assert_eq!(model.name, name);
        assert_eq!(model.part.defect(), None, "{name}");
        let (lo, hi) = model.part.bounds();
        let longest = (0..3).map(|a| hi[a] - lo[a]).fold(0.0, f64::max);
        assert!((longest / edge - 1.0).abs() < 0.02, "{name} is {longest} mm");
        assert!(lo[2] == 0.0 && (lo[0] + hi[0]).abs() < 1e-9, "{name} does not stand on the origin");
    }
}

#[test]
fn committed_files_are_what_the_generator_makes() {
    for model in models::all() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../{}.glb", model.name));
        let made = glb::to_glb(&model).unwrap();
        assert!(made.len() < 300_000, "{} has {} bytes", model.name, made.len());
        let committed = std::fs::read(&path).unwrap();
        assert!(
            committed == made,
            "{} differs; run `cargo run --release -p pellucid-models`",
            path.display()
        );
    }
}
