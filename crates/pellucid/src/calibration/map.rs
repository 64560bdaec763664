//! The chart's map: which patch is where, as a drawing.

use std::fmt::Write as _;

use pellucid_slice::PrintTarget;

use super::{Chart, ChartPatch};

/// Pixels a millimetre when the drawing is opened at its own size.
const SCALE: f64 = 12.0;

/// An SVG drawing of the chart from above, patches with their names in the palette's colours of what lies on top.
pub(super) fn svg(chart: &Chart, printer: &PrintTarget) -> String {
    let layout = chart.layout();
    let [width, depth] = layout.size_mm();
    let color = |parts: &[(String, f64)]| {
        let mut rgb = [0.0; 3];
        for (name, share) in parts {
            let rgba = printer.color_of(name).unwrap_or([128; 4]);
            (0..3).for_each(|c| rgb[c] += share * f64::from(rgba[c]));
        }
        rgb.map(|v| v.round() as u8)
    };
    let hex = |[r, g, b]: [u8; 3]| format!("#{r:02x}{g:02x}{b:02x}");
    let pure = |name: &str| hex(color(&[(name.to_owned(), 1.0)]));
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" viewBox=\"-1 -1 {} {}\" \
         font-family=\"sans-serif\" text-anchor=\"middle\">\n",
        SCALE * (width + 2.0),
        SCALE * (depth + 5.0),
        width + 2.0,
        depth + 5.0
    );
    let outline: Vec<String> = layout.outline().iter().map(|[x, y]| format!("{x},{y}")).collect();
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "<polygon points=\"{}\" fill=\"{}\"/>",
        outline.join(" "),
        pure(&chart.settings().black)
    );
    let mut rectangle = |low: [f64; 2], high: [f64; 2], fill: &str| {
        let _ = writeln!(
            text,
            "<rect x=\"{:.3}\" y=\"{:.3}\" width=\"{:.3}\" height=\"{:.3}\" fill=\"{fill}\" \
             stroke=\"#999\" stroke-width=\"0.05\"/>",
            low[0],
            low[1],
            high[0] - low[0],
            high[1] - low[1]
        );
    };
    let white = pure(&chart.settings().white);
    rectangle(layout.bed().low_mm, layout.bed().high_mm, &white);
    for patch in chart.patches() {
        rectangle(patch.area.low_mm, patch.area.high_mm, &hex(color(top_of(patch))));
    }
    for patch in chart.patches() {
        let ink = if is_light(color(top_of(patch))) { "#000" } else { "#fff" };
        text.push_str(&label(patch, patch.area == layout.deep(), ink));
    }
    let lines = [
        "Seen from above, the corner that is cut off most far left. Read each patch in its middle,",
        "W1 to W9 all in the one deep white field. Numbers are the top layer's thickness in mm.",
    ];
    for (line, y) in lines.iter().zip([1.8, 3.4]) {
        let (x, y) = (0.5 * width, depth + y);
        let _ = writeln!(text, "<text x=\"{x:.2}\" y=\"{y:.2}\" font-size=\"1.15\">{line}</text>");
    }
    text.push_str("</svg>\n");
    text
}

/// A patch's name, and, but for readings of one large field, the thickness of its top layer and what lies below.
fn label(patch: &ChartPatch, is_reading: bool, ink: &str) -> String {
    let ([x, y], id) = (patch.center_mm, &patch.patch.id);
    if is_reading {
        return format!("<text x=\"{x:.2}\" y=\"{y:.2}\" font-size=\"0.8\" fill=\"{ink}\">{id}</text>\n");
    }
    let layers = patch.patch.stack.layers();
    let mm = match layers.first().map(|layer| layer.thickness_mm()) {
        Some(mm) if mm.is_finite() => format!("{mm:.3}"),
        _ => "thick".to_owned(),
    };
    let below = layers.get(1).map_or(String::new(), |layer| format!("on {}", escaped(&layer.parts()[0].0)));
    format!(
        "<text x=\"{x:.2}\" y=\"{:.2}\" font-size=\"1.8\" fill=\"{ink}\">{id}<tspan x=\"{x:.2}\" dy=\"1.4\" \
         font-size=\"1.1\">{mm}</tspan><tspan x=\"{x:.2}\" dy=\"1.2\" font-size=\"0.9\">{below}</tspan></text>\n",
        y - 0.4
    )
}

/// What is on top of a patch.
fn top_of(patch: &ChartPatch) -> &[(String, f64)] {
    patch.patch.stack.layers().first().map_or(&[], |layer| layer.parts())
}

fn is_light([r, g, b]: [u8; 3]) -> bool {
    0.3 * f64::from(r) + 0.6 * f64::from(g) + 0.1 * f64::from(b) > 120.0
}

/// A name within XML.
fn escaped(name: &str) -> String {
    name.replace('&', "&amp;").replace('<', "&lt;")
}
