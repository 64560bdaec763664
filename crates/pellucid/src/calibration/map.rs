//! The chart's map: which patch is where, as a drawing.

use std::fmt::Write as _;

use pellucid_slice::PrintTarget;

use super::Chart;

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
            "<rect x=\"{:.3}\" y=\"{:.3}\" width=\"{:.3}\" height=\"{:.3}\" fill=\"{fill}\"/>",
            low[0],
            low[1],
            high[0] - low[0],
            high[1] - low[1]
        );
    };
    let white = pure(&chart.settings().white);
    rectangle(layout.bed().low_mm, layout.bed().high_mm, &white);
    for patch in chart.patches() {
        let top = patch.patch.stack.layers().first().map_or(&[][..], |layer| layer.parts());
        rectangle(patch.area.low_mm, patch.area.high_mm, &hex(color(top)));
    }
    for patch in chart.patches() {
        let ([x, y], id) = (patch.center_mm, &patch.patch.id);
        let top = patch.patch.stack.layers().first().map_or(&[][..], |layer| layer.parts());
        let [r, g, b] = color(top).map(f64::from);
        let ink = if 0.3 * r + 0.6 * g + 0.1 * b > 120.0 { "#000" } else { "#fff" };
        let thickness = patch.patch.stack.layers().first().map_or(f64::INFINITY, |l| l.thickness_mm());
        let below = if thickness.is_finite() { format!("{thickness:.3}") } else { "thick".to_owned() };
        let _ = writeln!(
            text,
            "<text x=\"{x:.2}\" y=\"{y:.2}\" font-size=\"1.8\" fill=\"{ink}\">{id}<tspan x=\"{x:.2}\" dy=\"1.5\" \
             font-size=\"1.1\">{below}</tspan></text>"
        );
    }
    let _ = writeln!(
        text,
        "<text x=\"{:.2}\" y=\"{:.2}\" font-size=\"1.6\">seen from above; thickness of the top layer in mm; the far left \
         corner is cut off most</text>\n</svg>",
        0.5 * width,
        depth + 2.4
    );
    text
}
