//! Line plots as SVG, both axes logarithmic.

use std::fmt::Write as _;

const SIZE: [f64; 2] = [720.0, 440.0];
const MARGIN: [f64; 2] = [70.0, 50.0];

/// One line of a plot.
#[derive(Clone, Debug, PartialEq)]
pub struct Series<'a> {
    /// Text in the legend.
    pub name: &'a str,
    /// A colour as SVG writes it, such as `#06c`.
    pub color: &'a str,
    /// Points (x, y). Those that are not positive and finite are left out.
    pub points: Vec<(f64, f64)>,
}

/// A plot of some lines, with titles of its axes.
pub fn log_log(x_title: &str, y_title: &str, series: &[Series<'_>]) -> String {
    let lines: Vec<Vec<(f64, f64)>> = series.iter().map(|s| logarithms(&s.points)).collect();
    let area = Area::around(lines.iter().flatten().copied());
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" font-family=\"sans-serif\" \
         font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
        SIZE[0], SIZE[1]
    );
    // Writing to a string cannot fail, here and below.
    for v in ticks(area.x) {
        let [px, _] = area.place((v, area.y.0));
        let [top, bottom] = [MARGIN[1], SIZE[1] - MARGIN[1]];
        let _ = writeln!(
            out,
            "<path d=\"M{px:.1} {top:.1}V{bottom:.1}\" stroke=\"#ddd\"/>\
             <text x=\"{px:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            SIZE[1] - 32.0,
            label(v)
        );
    }
    for v in ticks(area.y) {
        let [_, py] = area.place((area.x.0, v));
        let [left, right] = [MARGIN[0], SIZE[0] - MARGIN[0]];
        let _ = writeln!(
            out,
            "<path d=\"M{left:.1} {py:.1}H{right:.1}\" stroke=\"#ddd\"/>\
             <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            left - 6.0,
            py + 4.0,
            label(v)
        );
    }
    for (i, (series, line)) in series.iter().zip(&lines).enumerate() {
        let points: Vec<String> =
            line.iter().map(|&p| area.place(p)).map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        let _ = writeln!(
            out,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.5\"/>\
             <text x=\"{}\" y=\"24\" fill=\"{color}\">{}</text>",
            points.join(" "),
            MARGIN[0] + 40.0 + 220.0 * i as f64,
            escaped(series.name),
            color = series.color,
        );
    }
    let _ = writeln!(
        out,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>\n<text x=\"8\" y=\"24\">{}</text>\n</svg>",
        SIZE[0] / 2.0,
        SIZE[1] - 12.0,
        escaped(x_title),
        escaped(y_title)
    );
    out
}

/// The part of the logarithmic plane that is drawn.
struct Area {
    x: (f64, f64),
    y: (f64, f64),
}

impl Area {
    fn around(points: impl Iterator<Item = (f64, f64)> + Clone) -> Self {
        let span = |values: &mut dyn Iterator<Item = f64>| {
            let (low, high) =
                values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
            if low.is_finite() { (low - 0.05, high + 0.05) } else { (0.0, 1.0) }
        };
        Self { x: span(&mut points.clone().map(|p| p.0)), y: span(&mut points.map(|p| p.1)) }
    }

    fn place(&self, (x, y): (f64, f64)) -> [f64; 2] {
        let inner = [SIZE[0] - 2.0 * MARGIN[0], SIZE[1] - 2.0 * MARGIN[1]];
        let part = |v: f64, (low, high): (f64, f64)| (v - low) / (high - low);
        [MARGIN[0] + part(x, self.x) * inner[0], SIZE[1] - MARGIN[1] - part(y, self.y) * inner[1]]
    }
}

fn logarithms(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let drawn = |v: f64| v > 0.0 && v.is_finite();
    points.iter().filter(|(x, y)| drawn(*x) && drawn(*y)).map(|(x, y)| (x.log10(), y.log10())).collect()
}

/// Logarithms of 1, 2 and 5 times the powers of ten in a range.
fn ticks((low, high): (f64, f64)) -> impl Iterator<Item = f64> {
    (low.floor() as i32..=high.ceil() as i32)
        .flat_map(|decade| [1.0f64, 2.0, 5.0].map(|digit| f64::from(decade) + digit.log10()))
        .filter(move |v| (low..=high).contains(v))
}

fn label(logarithm: f64) -> String {
    // As many decimals as the first digit needs.
    let decimals = (-logarithm - 1e-9).ceil().max(0.0) as usize;
    format!("{:.decimals$}", 10f64.powf(logarithm))
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_lie_where_their_points_are() {
        let line = |points: &[(f64, f64)]| Series { name: "a < b", color: "#06c", points: points.to_vec() };
        let svg =
            log_log("samples", "RMSE", &[line(&[(1.0, 1.0), (100.0, 0.01), (0.0, 1.0), (5.0, f64::NAN)])]);
        // The corners of the drawn area, and nothing of the two points that have no logarithm.
        let points = svg.split("points=\"").nth(1).unwrap().split('"').next().unwrap();
        let points: Vec<f64> = points.split([',', ' ']).map(|v| v.parse().unwrap()).collect();
        assert_eq!(points.len(), 4);
        assert!(points[0] < 90.0 && points[1] < 70.0 && points[2] > 630.0 && points[3] > 370.0, "{points:?}");
        assert!(svg.contains(">0.02<") && svg.contains(">50<") && svg.contains("a &lt; b"), "{svg}");
        for empty in [log_log("x", "y", &[]), log_log("x", "y", &[line(&[])])] {
            assert!(!empty.contains("NaN") && !empty.contains("inf") && empty.ends_with("</svg>\n"));
        }
    }
}
