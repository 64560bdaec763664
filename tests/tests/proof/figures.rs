//! Every figure of the page's text is one of report and manifest.

use crate::{PRINT, plain, shown};

/// Cuts all parts between `start` and `end` out of a text, and returns them.
fn cut(text: &mut String, start: &str, end: &str) -> Vec<String> {
    let mut parts = Vec::new();
    while let Some(from) = text.find(start) {
        let to = text[from..].find(end).map_or(text.len(), |to| from + to + end.len());
        parts.push(text[from..to].to_owned());
        text.replace_range(from..to, " ");
    }
    parts
}

fn attribute<'a>(element: &'a str, name: &str) -> Option<&'a str> {
    element.split_once(&format!(" {name}=\""))?.1.split('"').next()
}

/// Cuts programs, styles and figures out of a page, and holds each figure to what `value` has in its place; how many there
/// were.
pub fn check_figures(html: &mut String, value: impl Fn(&str) -> f64) -> usize {
    for [start, end] in [["<script", "</script>"], ["<style", "</style>"]] {
        assert!(!cut(html, start, end).is_empty());
    }
    let figures = cut(html, "<data ", "</data>");
    for element in &figures {
        let from = attribute(element, "data-from").unwrap();
        let digits = attribute(element, "data-digits").unwrap().parse().unwrap();
        let scale: f64 = attribute(element, "data-scale").map_or(1.0, |s| s.parse().unwrap());
        let text = element.split_once('>').unwrap().1.trim_end_matches("</data>");
        assert_eq!(plain(text), shown(value(from) * scale, digits), "{from}");
    }
    figures.len()
}

#[test]
fn every_figure_is_the_reports_or_the_manifests() {
    let mut html = PRINT.text("proof.html");
    let figures = check_figures(&mut html, |from| PRINT.figure(from));
    assert!(figures > 60, "{figures}");
    // What is left are words, and numbers that explain them.
    let report = PRINT.json("report.json");
    let manifest = PRINT.json("manifest.json");
    let record = &report["record"];
    let mut text: String = {
        cut(&mut html, "<", ">");
        html.replace("&nbsp;", " ").replace("&#x2f;", "/")
    };
    for words in [
        &record["model"]["digest"],
        &record["model"]["name"],
        &manifest["target"],
        &manifest["orientation"],
        &manifest["files"],
        &manifest["generator"],
    ] {
        text = text.replace(words.as_str().unwrap(), "");
    }
    let explaining =
        ["dE2000", "0.045 mm", "0.1 mm", "0.2 mm", "300 mm", "1 mm", "2 mm", "95 %", "first is 0", "y = 0"];
    for words in explaining.iter().chain(&["2 ×", "4 ×", "8 ×", "press Enter for the middle; 0 brings"]) {
        text = text.replace(words, "");
    }
    let left: Vec<&str> = text.lines().filter(|line| line.bytes().any(|b| b.is_ascii_digit())).collect();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn report_and_manifest_in_the_page_are_the_files() {
    let mut html = PRINT.text("proof.html");
    let scripts = cut(&mut html, "<script type=\"application/json\"", "</script>");
    for name in ["report", "manifest"] {
        let script = scripts.iter().find(|s| attribute(s, "id") == Some(name)).unwrap();
        let text = script.split_once('>').unwrap().1.trim_end_matches("</script>");
        let value: serde_json::Value = serde_json::from_str(text).unwrap();
        assert_eq!(value, PRINT.json(&format!("{name}.json")), "{name}");
    }
}

#[test]
fn resins_add_up_and_shares_sum_to_one() {
    let report = PRINT.json("report.json");
    let manifest = PRINT.json("manifest.json");
    let resins = &report["resins"];
    let materials = resins["materials"].as_array().unwrap();
    let pitch: f64 = manifest["pitch_mm"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).product();
    for (resin, material) in materials.iter().zip(manifest["materials"].as_array().unwrap()) {
        assert_eq!((&resin["label"], &resin["name"]), (&material["label"], &material["name"]));
        let wanted = material["voxels"].as_f64().unwrap() * pitch / 1000.0;
        assert!((resin["volume_cm3"].as_f64().unwrap() / wanted - 1.0).abs() < 1e-9);
    }
    let grams: f64 = materials.iter().map(|m| m["grams"].as_f64().unwrap()).sum();
    assert!((grams / resins["grams"].as_f64().unwrap() - 1.0).abs() < 1e-9 && grams > 0.0);
    for state in ["unrefined", "refined"] {
        let shares = report["error_histogram"][state].as_array().unwrap();
        let sum: f64 = shares.iter().map(|v| v.as_f64().unwrap()).sum();
        assert!((sum - 1.0).abs() < 1e-6, "{state}: {sum}");
    }
}
