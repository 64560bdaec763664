//! First flights against a naive integration in fine steps, closed forms and symmetries.

use pellucid_stencil::{FLIGHT_BINS, FLIGHT_DEPTHS_MM, FirstFlight, FirstFlights};
use pellucid_voxel::{
    Control, Frame, LabelGrid, Material, MaterialTable, Pitch, Surface, SurfaceOptions, internal_reflectance,
};
use proptest::prelude::*;

/// Three materials, three different channels.
fn materials() -> MaterialTable {
    let material = |name: &str, sigma_s: [f32; 3], sigma_a: [f32; 3]| Material {
        name: name.into(),
        sigma_s: sigma_s.to_vec(),
        sigma_a: sigma_a.to_vec(),
        g: 0.4.into(),
    };
    let names = ["r", "g", "b"].map(String::from).to_vec();
    let table = vec![
        material("clear", [0.01, 0.2, 0.0], [0.0, 0.1, 0.02]),
        material("ink", [2.0, 0.5, 9.0], [0.1, 7.0, 3.0]),
        material("white", [6.0, 9.0, 24.0], [0.005, 0.003, 0.02]),
    ];
    MaterialTable::new(names, table).unwrap()
}

fn surface(grid: &LabelGrid) -> Surface {
    Surface::extract(grid, &SurfaceOptions::default(), &Control::none()).unwrap()
}

fn flights(grid: &LabelGrid, surface: &Surface, point: u32, index: f64) -> [FirstFlight; 3] {
    let mut out = [FirstFlight::default(); 3];
    let table = materials();
    let flights = FirstFlights::new(&table, grid, surface, index).unwrap();
    flights.extract(&[point], &mut out, &Control::none()).unwrap();
    out
}

/// Integrates in steps of 20 nm, voxel by voxel as positions say. Only for rays that pass no notch.
fn naive(grid: &LabelGrid, surface: &Surface, point: u32, index: f64) -> Option<[FirstFlight; 3]> {
    const STEP: f64 = 2e-5;
    let table = materials();
    let mm = grid.frame().pitch().mm();
    let voxel = surface.voxels()[point as usize];
    let normal = surface.normals()[point as usize].map(f64::from);
    let at = |t: f64| -> [i64; 3] {
        std::array::from_fn(|a| (f64::from(voxel[a]) + 0.5 + t * normal[a] / mm[a]).floor() as i64)
    };
    let mut top = 0.0;
    while grid.at(at(top)) != 0 {
        top += STEP;
    }
    // The last place inside.
    top -= STEP;
    let mut transmittance = [1.0f64; 3];
    let mut masses = [[0.0f64; FLIGHT_BINS]; 3];
    let mut depth = 0.0;
    let mut last = [0; 3];
    loop {
        let voxel = at(top - depth - 0.5 * STEP);
        let label = grid.at(voxel);
        if label == 0 {
            break;
        }
        last = voxel;
        let bin = FLIGHT_DEPTHS_MM.iter().filter(|&&edge| depth + 0.5 * STEP >= edge).count();
        for c in 0..3 {
            let kept = transmittance[c] * (-f64::from(table.sigma_t(label, c)) * STEP).exp();
            masses[c][bin] += (transmittance[c] - kept) * f64::from(table.albedo(label, c));
            transmittance[c] = kept;
        }
        depth += STEP;
        if transmittance.iter().all(|&t| t < 1e-9) {
            break;
        }
    }
    let far = surface.index_of(last.map(|v| v as u32));
    let far_normal = far.map(|p| surface.normals()[p as usize].map(f64::from));
    let cosine = -(0..3).map(|a| normal[a] * far_normal.map_or(0.0, |n| n[a])).sum::<f64>();
    if transmittance.iter().any(|&t| t >= 1e-9) && cosine <= 0.05 {
        return None;
    }
    let r = internal_reflectance(cosine, index);
    Some(std::array::from_fn(|c| FirstFlight {
        masses: masses[c].map(|m| m as f32),
        escaped: (transmittance[c] * (1.0 - r)) as f32,
        returned: (transmittance[c] * r) as f32,
    }))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn agrees_with_a_naive_integration(
        seed in 0u64..1_000_000,
        size in [8u32..30, 4u32..16, 10u32..60],
        tilt in -0.6f64..0.6,
        pick in 0usize..1000,
        index in 1.0f64..2.0,
    ) {
        // A slanted block of layers and specks; air above the slant.
        let frame = Frame::new([0.0; 3], Pitch::j750(), size).unwrap();
        let grid = LabelGrid::from_fn(frame, |[x, y, z]| {
            let top = f64::from(size[2]) * 0.8 + tilt * f64::from(x);
            if f64::from(z) > top { return 0; }
            let mixed = (seed ^ (u64::from(x) * 7919) ^ (u64::from(y) * 104_729) ^ (u64::from(z) * 1_299_709))
                .wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 61;
            if z % 5 == 0 { 1 } else { 1 + (mixed % 3) as u8 }
        });
        let surface = surface(&grid);
        let point = (pick % surface.len()) as u32;
        let got = flights(&grid, &surface, point, index);
        let Some(expected) = naive(&grid, &surface, point, index) else { return Ok(()) };
        for (got, expected) in got.iter().zip(expected) {
            for (a, b) in got.to_array().into_iter().zip(expected.to_array()) {
                // A step of 20 nm at 25/mm, at each of some tens of faces.
                prop_assert!((a - b).abs() < 2e-3, "{got:?} {expected:?}");
            }
        }
    }

    #[test]
    fn nothing_is_lost_and_nothing_gained(
        labels in prop::collection::vec(0u8..4, 12 * 8 * 14),
        index in 1.0f64..4.0,
    ) {
        let frame = Frame::new([0.0; 3], Pitch::j750(), [12, 8, 14]).unwrap();
        let grid = LabelGrid::from_dense(frame, &labels).unwrap();
        let surface = surface(&grid);
        for point in 0..surface.len() as u32 {
            for flight in flights(&grid, &surface, point, index) {
                let values = flight.to_array();
                prop_assert!(values.iter().all(|v| (0.0..=1.0 + 1e-6).contains(v)), "{values:?}");
                prop_assert!(values.iter().sum::<f32>() <= 1.0 + 1e-5);
                prop_assert_eq!(FirstFlight::from_array(values), flight);
                // All that scatters, leaves or returns gives back all of it.
                let all = flight.radiance(&[1.0; FLIGHT_BINS + 1]);
                prop_assert!((all - values.iter().sum::<f32>()).abs() < 1e-6);
            }
        }
    }
}

#[test]
fn a_level_layer_follows_beer_and_lambert() {
    let frame = Frame::new([0.0; 3], Pitch::j750(), [60, 30, 40]).unwrap();
    for label in 1..=3u8 {
        let grid = LabelGrid::from_fn(frame, |[_, _, z]| if z < 20 { label } else { 0 });
        let surface = surface(&grid);
        let point = surface.index_of([30, 15, 19]).unwrap();
        let table = materials();
        let thickness = 20.0 * Pitch::j750().mm()[2];
        for (c, flight) in flights(&grid, &surface, point, 1.5).into_iter().enumerate() {
            let sigma = f64::from(table.sigma_t(label, c));
            let albedo = f64::from(table.albedo(label, c));
            let edges = [0.0, FLIGHT_DEPTHS_MM[0], FLIGHT_DEPTHS_MM[1], thickness];
            for bin in 0..FLIGHT_BINS {
                let expected = albedo * ((-sigma * edges[bin]).exp() - (-sigma * edges[bin + 1]).exp());
                assert!((f64::from(flight.masses[bin]) - expected).abs() < 2e-6, "{label} {c} {bin}");
            }
            let through = (-sigma * thickness).exp();
            assert!((f64::from(flight.escaped) - 0.96 * through).abs() < 2e-6, "{flight:?}");
            assert!((f64::from(flight.returned) - 0.04 * through).abs() < 2e-6);
        }
    }
}

#[test]
fn a_staircase_is_crossed_and_a_gap_is_not() {
    // A slab tilted about y, of a material that hardly absorbs: rays along its normal pass the steps of its faces.
    let frame = Frame::new([0.0; 3], Pitch::j750(), [120, 20, 160]).unwrap();
    let pitch = Pitch::j750().mm();
    let slope = 0.35f64;
    let slab = |gap: bool| {
        LabelGrid::from_fn(frame, |[x, _, z]| {
            let height = (f64::from(z) + 0.5) * pitch[2] - slope * (f64::from(x) + 0.5) * pitch[0] - 1.0;
            let inside = height > 0.0 && height < 0.8 && !(gap && height > 0.25 && height < 0.6);
            u8::from(inside)
        })
    };
    let normal_length = (1.0 + slope * slope).sqrt();
    for gap in [false, true] {
        let grid = slab(gap);
        let surface = surface(&grid);
        let thickness = (if gap { 0.2 } else { 0.8 }) / normal_length;
        let mut checked = 0;
        for point in 0..surface.len() as u32 {
            let (v, n) = (surface.voxels()[point as usize], surface.normals()[point as usize]);
            let height =
                (f64::from(v[2]) + 0.5) * pitch[2] - slope * (f64::from(v[0]) + 0.5) * pitch[0] - 1.0;
            if n[2] < 0.9 || height < 0.6 || !(40..80).contains(&v[0]) || !(6..14).contains(&v[1]) {
                continue;
            }
            checked += 1;
            let green = flights(&grid, &surface, point, 1.0)[1];
            let expected = (-0.3 * thickness).exp();
            // Half a voxel on either side: 0.04 mm of 0.3/mm.
            assert!((f64::from(green.escaped) - expected).abs() < 0.015, "{gap} {green:?} {expected}");
        }
        assert!(checked > 100, "{checked}");
    }
}

#[test]
fn progress_counts_points() {
    let frame = Frame::new([0.0; 3], Pitch::j750(), [30, 30, 30]).unwrap();
    let grid = LabelGrid::from_fn(frame, |_| 3);
    let (surface, table) = (surface(&grid), materials());
    let points: Vec<u32> = (0..surface.len() as u32).collect();
    let mut out = vec![FirstFlight::default(); 3 * points.len()];
    let told = std::sync::Mutex::new(Vec::new());
    let note = |done: u64, total: u64| told.lock().unwrap().push((done, total));
    let control = Control::none().with_progress(&note);
    FirstFlights::new(&table, &grid, &surface, 1.5).unwrap().extract(&points, &mut out, &control).unwrap();
    let told = told.into_inner().unwrap();
    let all = points.len() as u64;
    assert!(told.iter().all(|(done, total)| *total == all && *done <= all), "{told:?}");
    assert!(told.iter().any(|(done, _)| *done == all));
}

#[test]
fn refuses_what_does_not_fit() {
    let frame = Frame::new([0.0; 3], Pitch::j750(), [4, 4, 4]).unwrap();
    let grid = LabelGrid::from_fn(frame, |_| 4);
    let surface = surface(&grid);
    let table = materials();
    assert!(FirstFlights::new(&table, &grid, &surface, 1.5).unwrap_err().to_string().contains("label 4"));
    let grid = LabelGrid::from_fn(frame, |_| 3);
    assert!(FirstFlights::new(&table, &grid, &surface, f64::NAN).is_err());
    let flights = FirstFlights::new(&table, &grid, &surface, 1.5).unwrap();
    let mut out = [FirstFlight::default(); 3];
    assert!(flights.extract(&[999], &mut out, &Control::none()).is_err());
    assert!(flights.extract(&[0, 1], &mut out, &Control::none()).is_err());
}
