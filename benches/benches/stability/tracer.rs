//! The tracer's kernel, in single precision and through voxels, beside double precision without voxels.

use pellucid::trace::Boundary;
use pellucid::voxel::Control;

use super::Error;
use super::case::Case;
use super::scene::{Filling, Row, Solid, index};

pub const PART: &str = "tracer";

/// About the printer's white in red light.
pub const WHITE: Row = (9.0, 0.005, 0.4);
/// Standard errors that one of some thirty differences passes once in 500 studies.
const Z: f64 = 4.0;

/// How far radiances of voxels and of smooth solids may lie apart: at edges the voxels' normals are rounded off.
const VOXELS: f64 = 0.005;

/// A difference at one length of paths.
pub struct Drift {
    pub scatterings: f64,
    pub difference: f64,
    pub std_error: f64,
}

fn case(name: impl Into<String>, measured: &'static str, found: f64, bound: f64) -> Case {
    Case { part: PART, name: name.into(), measured, found, bound: Some(bound) }
}

/// Differences over their standard errors, and closed forms.
pub fn cases(paths: u32, control: &Control<'_>) -> Result<Vec<Case>, Error> {
    let glass = index(1.5)?;
    let cube = |row: Row, boundary| Solid::of([2.0; 3], row, boundary);
    let mut found = Vec::new();
    for (name, solid, wanted) in [
        ("albedo exactly 1", cube((9.0, 0.0, 0.4), glass), 1.0),
        ("albedo exactly 0, index-matched", cube((0.0, 50.0, 0.0), Boundary::Matched), 0.0),
        ("clear", cube((0.0, 0.0, 0.0), glass), 1.0),
    ] {
        let [l, _] = solid.radiance(paths, 1, control)?;
        found.push(case(name, "difference from the closed form", (l - wanted).abs(), 0.0));
    }
    // Chandrasekhar's half-space of albedo 0.98; thousands of mean free paths a voxel.
    for sigma_t in [1e3, 1e4, 1e5] {
        let solid = cube((0.98 * sigma_t, 0.02 * sigma_t, 0.0), Boundary::Matched);
        let [l, e] = solid.radiance(paths, 1, control)?;
        let name = format!("extinction {sigma_t:.0e} per mm, half-space of albedo 0.98");
        found.push(case(name, "z to the closed form", (l - 0.671_083_743).abs() / e, Z));
    }
    for (name, solid) in solids(glass)? {
        let [l, e] = solid.radiance(paths, 1, control)?;
        let exact = solid.exact(1.0, paths, 2, control)?;
        let beyond = (l - exact.value).abs() - Z * e.hypot(exact.std_error);
        found.push(case(
            name,
            "difference from double precision beyond 4 standard errors",
            beyond.max(0.0),
            VOXELS,
        ));
    }
    for (name, row) in [("white", WHITE), ("grey", (5.0, 0.5, 0.4)), ("black", (2.0, 40.0, 0.4))] {
        found.push(conditioned(name, &cube(row, glass), paths, control)?);
    }
    Ok(found)
}

/// What double precision is compared on.
fn solids(glass: Boundary) -> Result<Vec<(String, Solid)>, Error> {
    let cube = |row: Row, boundary| Solid::of([2.0; 3], row, boundary);
    let mut solids = vec![
        ("sheet of 0.1 mm".to_owned(), Solid::of([3.0, 3.0, 0.1], WHITE, glass)),
        ("one voxel".to_owned(), Solid::of([0.05; 3], (5.0, 5.0, 0.4), Boundary::Matched)),
        ("black".to_owned(), cube((2.0, 40.0, 0.4), glass)),
        (
            "100 mm of white".to_owned(),
            Solid { pitch_mm: [0.25; 3], voxels: [400; 3], ..Solid::of([1.0; 3], WHITE, glass) },
        ),
        (
            "pitch 1 : 100".to_owned(),
            Solid {
                pitch_mm: [1.0, 1.0, 0.01],
                voxels: [41, 41, 300],
                ..Solid::of([1.0; 3], (2.0, 0.05, 0.4), glass)
            },
        ),
    ];
    for g in [0.99, -0.99] {
        solids.push((format!("g = {g}"), cube((9.0, 0.05, g), glass)));
    }
    for n in [1.0, 1.33, 2.0] {
        solids.push((format!("refractive index {n}"), cube(WHITE, index(n)?)));
    }
    for (ratio, other) in [("1e4", (9e-4, 5e-7, 0.4)), ("1e6", (9e-6, 5e-9, 0.4))] {
        let name = format!("checkerboard of voxels, extinctions {ratio} : 1");
        let rows = vec![WHITE, other];
        solids.push((name, Solid { rows, filling: Filling::Checkerboard, ..cube(WHITE, glass) }));
    }
    let opposed = vec![(1e3, 1.0, 0.4), (0.1, 1e3, -0.9)];
    solids.push((
        "checkerboard of voxels, dense scatterer and dense absorber".to_owned(),
        Solid { rows: opposed, filling: Filling::Checkerboard, ..cube(WHITE, glass) },
    ));
    Ok(solids)
}

/// How far a change of all absorption by a thousandth moves the radiance, as a multiple of it.
fn conditioned(name: &str, solid: &Solid, paths: u32, control: &Control<'_>) -> Result<Case, Error> {
    let changed = |part: f64| {
        let rows = solid.rows.iter().map(|&(s, a, g)| (s, a * (1.0 + part), g)).collect();
        Solid { rows, ..*solid }
    };
    // The same seed: paths differ only where a flight ends elsewhere.
    let [low, high] = [-0.05, 0.05].map(|part| changed(part).exact(1.0, 4 * paths, 3, control));
    let [low, high] = [low?.value, high?.value];
    let number = ((high - low) / 0.1 / (0.5 * (high + low))).abs();
    Ok(case(
        format!("{name}, absorption a thousandth off"),
        "relative change of radiance, in thousandths",
        number,
        1.0,
    ))
}

/// Differences from double precision where paths become long.
pub fn drift(paths: u32, control: &Control<'_>) -> Result<(Vec<Case>, Vec<Drift>), Error> {
    let (mut found, mut points) = (Vec::new(), Vec::new());
    for power in 1..=6 {
        let absorbed = 10f64.powi(-power);
        let solid = Solid::of([10.0; 3], (20.0 * (1.0 - absorbed), 20.0 * absorbed, 0.4), index(1.5)?);
        let [l, e] = solid.radiance(paths, 1, control)?;
        let exact = solid.exact(1.0, paths, 2, control)?;
        let (difference, std_error) = (l - exact.value, e.hypot(exact.std_error));
        let name = format!("10 mm of albedo 1 - 1e-{power}");
        found.push(case(name, "z to double precision", difference.abs() / std_error, Z));
        points.push(Drift { scatterings: 1.0 / absorbed, difference, std_error });
    }
    Ok((found, points))
}
