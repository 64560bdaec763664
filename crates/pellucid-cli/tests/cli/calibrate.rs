//! `pellucid calibrate` as a user meets it.

use std::fs;
use std::path::Path;

use pellucid::color::calibration::{Patch, Stack};
use pellucid::color::plane_parallel::{Layer, Solver};
use pellucid::color::{Lab, Xyz};
use pellucid::voxel::MaterialTable;

use crate::common::{run, stderr, stdout, text};

/// A coarse printer, so that a chart takes a moment.
fn printer(folder: &Path) -> String {
    let path = folder.join("coarse.json");
    let profile = r#"{"name": "coarse", "pitch_mm": [0.3, 0.3, 0.027], "build_space_mm": [400, 400, 200],
        "max_materials": 3, "min_layers": 1, "row_order": "highest_y_first", "background": [0, 0, 0, 0],
        "palette": {"cyan": [0, 90, 158, 255], "black": [26, 26, 29, 255], "white": [240, 240, 240, 255]}}"#;
    fs::write(&path, profile).unwrap();
    text(&path).to_owned()
}

/// L*a*b* under D50 of what the built-in materials show.
fn color(stack: &Stack) -> Lab {
    let (table, solver) = (MaterialTable::cmykw(), Solver::with_directions(1.5, 16).unwrap());
    let rgb = [0, 1, 2].map(|c| {
        let layers: Vec<Layer> = stack
            .layers()
            .iter()
            .map(|layer| {
                let mut mixed =
                    Layer { sigma_s: 0.0, sigma_a: 0.0, g: 0.4, thickness_mm: layer.thickness_mm() };
                for (name, share) in layer.parts() {
                    let material = table.get(table.label_of(name).unwrap()).unwrap();
                    mixed.sigma_s += share * f64::from(material.sigma_s[c]);
                    mixed.sigma_a += share * f64::from(material.sigma_a[c]);
                }
                mixed
            })
            .collect();
        solver.radiance_normal(&layers).unwrap()
    });
    Xyz::from_linear_rgb(rgb).adapt(Xyz::D65, Xyz::D50).to_lab(Xyz::D50)
}

/// The chart's table with colours, as `edit` leaves them.
fn fill(table: &str, edit: impl Fn(&str, &mut Lab)) -> String {
    let colors: Vec<String> = Patch::parse_chart(table)
        .unwrap()
        .iter()
        .map(|patch| {
            let mut lab = color(&patch.stack);
            edit(&patch.id, &mut lab);
            format!(",{:.3},{:.3},{:.3}", lab.l, lab.a, lab.b)
        })
        .collect();
    let mut lines = table.lines();
    let mut filled = format!("{}\n", lines.next().unwrap());
    for (line, color) in lines.zip(colors) {
        filled += &format!("{}{color}\n", line.trim_end_matches(','));
    }
    filled
}

#[test]
fn a_filled_chart_becomes_materials_that_prepare_takes() {
    let folder = tempfile::tempdir().unwrap();
    let (chart, out) = (folder.path().join("chart"), folder.path().join("resins"));
    let printer = printer(folder.path());
    let made = run(&["calibrate", "chart", "--out", text(&chart), "--printer", &printer, "--inks", "cyan"]);
    assert!(made.status.success(), "{}", stderr(&made));
    for file in ["slices/slice_00000.png", "manifest.json", "chart.csv", "chart.svg"] {
        assert!(chart.join(file).metadata().unwrap().len() > 0, "{file}");
    }
    let svg = fs::read_to_string(chart.join("chart.svg")).unwrap();
    let table = fs::read_to_string(chart.join("chart.csv")).unwrap();
    for patch in Patch::parse_chart(&table).unwrap() {
        assert!(svg.contains(&format!(">{}<", patch.id)), "{}", patch.id);
    }
    let measured = folder.path().join("measured.csv");
    let fit = |more: &[&str]| {
        let mut arguments =
            vec!["calibrate", "fit", text(&measured), "--out", text(&out), "--geometry", "radiance"];
        arguments.extend(more);
        run(&arguments)
    };

    // An empty table, and one of which two patches were swapped, make nothing.
    fs::write(&measured, &table).unwrap();
    let empty = fit(&[]);
    assert!(!empty.status.success() && stderr(&empty).contains("no colours"), "{}", stderr(&empty));
    let dark = fill(&table, |id, lab| {
        if id == "W5" {
            lab.l -= 40.0
        }
    });
    fs::write(&measured, dark).unwrap();
    let contradictory = fit(&[]);
    let message = stderr(&contradictory);
    assert!(!contradictory.status.success() && message.contains("contradict"), "{message}");
    assert!(message.contains("W5") && message.contains("measured.csv"), "{message}");
    assert!(!out.exists());

    fs::write(&measured, fill(&table, |_, _| ())).unwrap();
    let fitted = fit(&[]);
    assert!(fitted.status.success(), "{}", stderr(&fitted));
    assert!(stdout(&fitted).contains("cyan scattering"), "{}", stdout(&fitted));
    assert!(stdout(&fitted).contains("patches checking"), "{}", stdout(&fitted));
    let found = MaterialTable::load(out.join("materials.json")).unwrap();
    let (truth, white) = (MaterialTable::cmykw(), found.label_of("white").unwrap());
    for channel in 0..3 {
        let ratio = found.get(white).unwrap().sigma_s[channel] / truth.get(5).unwrap().sigma_s[channel];
        assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
    }
    let report: serde_json::Value =
        serde_json::from_slice(&fs::read(out.join("calibration.json")).unwrap()).unwrap();
    assert_eq!(report["quantity"], "lab");
    assert!(report["delta_e"]["checked"]["max"].as_f64().unwrap() < 0.2, "{}", report["delta_e"]);

    let again = fit(&[]);
    assert!(!again.status.success() && stderr(&again).contains("--force"), "{}", stderr(&again));
    assert!(fit(&["--force"]).status.success());
}

#[test]
fn arguments_that_cannot_be_are_told() {
    for (arguments, part) in [
        (&["calibrate", "fit", "none.csv", "--out", "x", "--geometry", "45/45"][..], "d/8-excluded"),
        (&["calibrate", "fit", "none.csv", "--out", "x", "--illuminant", "sun"], "D65, D50, E, A"),
        (&["calibrate", "fit", "none.csv", "--out", "x", "--g", "clear=2"], "-0.99 to 0.99"),
        (&["calibrate", "fit", "none.csv", "--out", "x"], "none.csv"),
        (&["calibrate", "chart", "--out", "x", "--inks", "gold"], "gold"),
        (&["calibrate", "chart", "--out", "x", "--printer", "j750-high-speed-vivid"], "5 are needed"),
    ] {
        let output = run(arguments);
        assert!(!output.status.success() && stderr(&output).contains(part), "{}", stderr(&output));
    }
}
