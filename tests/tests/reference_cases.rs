//! The shipped reference cases over the public API: the tracer agrees with an independent renderer.

use pellucid::trace::cases::{Case, parse_cases};
use pellucid::voxel::{Control, Pitch};

const FILE: &str = include_str!("../../datasets/reference/radiance.json");
/// Paths an estimate: a standard error of 0.004 at most.
const PATHS: u32 = 1 << 14;
/// Standard errors that the worst of 14 estimates may be off: 1 in 1,000 sets of right ones exceeds it.
const WORST: f64 = 4.0;

fn cases() -> Vec<Case> {
    let cases = parse_cases(FILE).unwrap();
    assert_eq!(cases.len(), 14);
    cases
}

#[test]
fn analytic_geometry_agrees() {
    let mut squares = 0.0;
    for (i, case) in cases().iter().enumerate() {
        let estimate = case.analytic(Some(PATHS), (i as u64) << 32, &Control::none()).unwrap();
        let z = case.z(&estimate);
        assert!(estimate.std_error < 0.004, "{}: {}", case.id, estimate.std_error);
        assert!(z.abs() < WORST, "{}: {} for {}, z = {z:.2}", case.id, estimate.value, case.reference);
        squares += z * z;
    }
    // Of 14 right estimates the root mean square exceeds 1.6 once in 2,000 sets.
    assert!((squares / 14.0f64).sqrt() < 1.6);
}

#[test]
fn voxels_of_a_printer_agree() {
    // Two cubes, a thin slab, and a point beside an edge inside: half-spaces take 30 M voxels each.
    const VOXELISED: [&str; 4] = [
        "b_cube10_WB_centre_dielectric_n1.5",
        "b_cube10_CG_centre_matched",
        "c_slab1_WB_dielectric_n1.5",
        "e1_checker_G_x4.9_y4.5_matched",
    ];
    let all = cases();
    let chosen: Vec<&Case> = all.iter().filter(|case| VOXELISED.contains(&case.id.as_str())).collect();
    assert_eq!(chosen.len(), VOXELISED.len());
    for (i, case) in chosen.into_iter().enumerate() {
        let object = case.voxelise(Pitch::j750(), &Control::none()).unwrap();
        let estimate = case.voxelised(&object, Some(PATHS), (i as u64) << 32 | 1, &Control::none()).unwrap();
        // Voxels put the checkerboard's edges up to half a voxel elsewhere, and round a slab's thickness.
        let moved = if case.id.starts_with("e1") { 0.02 } else { 0.004 };
        let off = (estimate.value - case.reference).abs();
        let allowed = WORST * estimate.std_error.hypot(case.reference_error) + moved;
        assert!(off < allowed, "{}: {} for {}", case.id, estimate.value, case.reference);
    }
}

#[test]
fn a_wrong_medium_is_noticed() {
    let wrong = FILE.replace("\"albedo\": 0.98, \"sigma_t\"", "\"albedo\": 0.97, \"sigma_t\"");
    assert_ne!(wrong, FILE);
    let mut noticed = 0;
    for (right, wrong) in cases().iter().zip(parse_cases(&wrong).unwrap()) {
        if right.scene.optics() != wrong.scene.optics() {
            let estimate = wrong.analytic(Some(PATHS), 5, &Control::none()).unwrap();
            assert!(wrong.z(&estimate).abs() > WORST, "{}: {}", wrong.id, estimate.value);
            noticed += 1;
        }
    }
    assert_eq!(noticed, 2, "a half-space and a cube of magenta");
}
