//! The tables and the plot of the tracer's study.

use std::fmt::Write as _;

use super::Row;

/// The time at which an estimator's curve passes `rmse`, interpolated in logarithms.
fn time_for(rows: &[Row], scene: &str, estimator: &str, rmse: f64) -> Option<f64> {
    let curve: Vec<&Row> = rows.iter().filter(|r| r.scene == scene && r.estimator == estimator).collect();
    if curve.first()?.rmse <= rmse {
        return Some(curve[0].microseconds);
    }
    curve.windows(2).find(|w| w[0].rmse > rmse && w[1].rmse <= rmse).map(|w| {
        let t = (w[0].rmse / rmse).ln() / (w[0].rmse / w[1].rmse).ln();
        (w[0].microseconds.ln() + t * (w[1].microseconds / w[0].microseconds).ln()).exp()
    })
}

/// The processor's name, where the system tells.
fn processor() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|l| l.starts_with("model name"))?;
    line.split(':').nth(1).map(|name| name.trim().to_owned())
}

/// The summary for readers.
pub(super) fn markdown(
    scenes: &[(&str, &str)],
    rows: &[Row],
    rates: &[(String, f64)],
    reference_spp: u32,
) -> String {
    let mut text = String::from("# Path tracer: error against run time\n\n");
    let _ = writeln!(
        text,
        "Written by `pellucid study tracer`. One thread, \
         times are processor time per point and channel. Boundary n = 1.5, default materials. RMSE over about \
         500 points and 3 channels against {reference_spp} paths, whose own variance is subtracted.\n"
    );
    if let Some(name) = processor() {
        let _ = writeln!(text, "Processor: {name}.\n");
    }
    let _ = writeln!(text, "| scene | what |\n| --- | --- |");
    for (name, what) in scenes {
        let _ = writeln!(text, "| {name} | {what} |");
    }
    let _ = writeln!(text, "\n## Microseconds a point and channel for an RMSE\n");
    let _ = writeln!(text, "| scene | estimator | 0.05 | 0.03 | 0.02 | 0.01 | gain at 0.03 | gain at 0.02 |");
    let _ = writeln!(text, "| --- | --- | --- | --- | --- | --- | --- | --- |");
    let show = |v: Option<f64>| v.map_or("-".to_owned(), |v| format!("{v:.1}"));
    for (scene, _) in scenes {
        for estimator in ["plain", "adaptive", "assisted"] {
            let t = |rmse| time_for(rows, scene, estimator, rmse);
            let gain = |rmse| time_for(rows, scene, "plain", rmse).zip(t(rmse)).map(|(p, e)| p / e);
            let _ = writeln!(
                text,
                "| {scene} | {estimator} | {} | {} | {} | {} | {} | {} |",
                show(t(0.05)),
                show(t(0.03)),
                show(t(0.02)),
                show(t(0.01)),
                show(gain(0.03)),
                show(gain(0.02))
            );
        }
    }
    let _ = writeln!(
        text,
        "\n`assisted` is biased: its mean error is in `tracer.csv`. A dash: not reached within 256 paths \
         (assisted) or 1024 (plain). `adaptive` spends paths to make the error even over points, which the RMSE \
         over all of them does not reward.\n"
    );
    let _ = writeln!(text, "## White cube of 10 mm, blue, index-matched, one thread\n");
    let _ = writeln!(text, "| tracer | paths/s | ns a scattering |\n| --- | --- | --- |");
    for (name, rate) in rates {
        let _ = writeln!(text, "| {name} | {rate:.0} | {:.2} |", 1e9 / rate / 331.0);
    }
    let find = |key: &str| rates.iter().find(|(n, _)| n.contains(key)).map(|(_, r)| *r);
    for backend in ["Avx512", "Avx2"] {
        if let (Some(ours), Some(default), Some(fast)) =
            (find(&format!("grid, {backend}")), find("grid, default"), find("grid, emitter sampling off"))
        {
            let _ = writeln!(
                text,
                "\n{backend}: {:.0} times Mitsuba's voxel grid with its default settings, {:.0} times with \
                 emitter sampling off.",
                ours / default,
                ours / fast
            );
        }
    }
    let _ = writeln!(text, "\n331 scatterings a path on average. Plain unbiased tracking.");
    text
}

/// One line a measurement.
pub(super) fn csv(rows: &[Row]) -> String {
    let mut text = String::from("scene,estimator,spp,microseconds_per_value,rmse,mean_error\n");
    for r in rows {
        let _ = writeln!(
            text,
            "{},{},{:.1},{:.3},{:.5},{:.5}",
            r.scene, r.estimator, r.spp, r.microseconds, r.rmse, r.bias
        );
    }
    text
}

/// Error against time, one panel a scene, both axes logarithmic.
pub(super) fn svg(scenes: &[(&str, &str)], rows: &[Row]) -> String {
    let (width, height, pad) = (300.0, 240.0, 42.0);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" font-family=\"sans-serif\" \
         font-size=\"10\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
        width * scenes.len() as f64,
        height + 24.0
    );
    let colours = [("plain", "#1f77b4"), ("adaptive", "#2ca02c"), ("assisted", "#d62728")];
    for (k, (scene, _)) in scenes.iter().enumerate() {
        let left = k as f64 * width + pad;
        // 0.1 to 10,000 microseconds across, RMSE 0.001 to 0.5 down.
        let x = |t: f64| left + (t / 0.1).log10() / 5.0 * (width - pad - 10.0);
        let y = |e: f64| {
            height - pad + 10.0
                - ((e.max(0.001) / 0.001).log10() / (0.5f64 / 0.001).log10()) * (height - pad - 15.0)
        };
        let _ = writeln!(out, "<text x=\"{}\" y=\"14\" font-size=\"12\">{scene}</text>", left + 90.0);
        for t in [0.1, 1.0, 10.0, 100.0, 1000.0, 10_000.0] {
            let _ = writeln!(
                out,
                "<line x1=\"{0:.1}\" y1=\"20\" x2=\"{0:.1}\" y2=\"{1:.1}\" stroke=\"#ddd\"/><text x=\"{0:.1}\" \
                 y=\"{2:.1}\" text-anchor=\"middle\">{t}</text>",
                x(t),
                y(0.001),
                y(0.001) + 14.0
            );
        }
        for e in [0.001, 0.003, 0.01, 0.03, 0.1, 0.3] {
            let _ = writeln!(
                out,
                "<line x1=\"{:.1}\" y1=\"{1:.1}\" x2=\"{2:.1}\" y2=\"{1:.1}\" stroke=\"#ddd\"/><text \
                 x=\"{3:.1}\" y=\"{4:.1}\" text-anchor=\"end\">{e}</text>",
                x(0.1),
                y(e),
                x(10_000.0),
                x(0.1) - 3.0,
                y(e) + 3.0
            );
        }
        for (name, colour) in colours {
            let points: Vec<String> = rows
                .iter()
                .filter(|r| r.scene == *scene && r.estimator == name)
                .map(|r| format!("{:.1},{:.1}", x(r.microseconds), y(r.rmse)))
                .collect();
            let _ = writeln!(
                out,
                "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.8\"/>",
                points.join(" ")
            );
        }
    }
    for (i, (name, colour)) in colours.iter().enumerate() {
        let _ = writeln!(
            out,
            "<text x=\"{}\" y=\"{}\" fill=\"{colour}\">{name}</text>",
            pad + 80.0 * i as f64,
            height + 14.0
        );
    }
    let _ = writeln!(
        out,
        "<text x=\"{}\" y=\"{}\">RMSE of linear radiance against microseconds a point and channel, one thread</text>\n</svg>",
        pad + 260.0,
        height + 14.0
    );
    out
}
