//! Curves as SVG, both axes logarithmic.

use std::fmt::Write;

const PANEL: [f64; 2] = [300.0, 240.0];
/// Room for tick labels at the left and below, and for titles above.
const LEFT: f64 = 46.0;
const BELOW: f64 = 24.0;
const ABOVE: f64 = 22.0;
const RIGHT: f64 = 10.0;
/// A letter's width in a font of 10 pixels, a little more than most have.
const LETTER: f64 = 5.6;
const LEGEND_LINE: f64 = 16.0;
/// Colours that people with colour blindness tell apart (Okabe and Ito 2008).
const COLORS: [&str; 8] =
    ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#999999"];

/// A logarithmic axis.
#[derive(Clone, Debug)]
pub struct Axis {
    /// What it shows, with the unit.
    pub title: String,
    /// Its ends, above 0 and in ascending order; values beyond are drawn at them.
    pub range: [f64; 2],
}

impl Axis {
    /// An axis that holds some values with a little room; those not above 0 are left out.
    pub fn around(title: &str, values: impl IntoIterator<Item = f64>) -> Self {
        let drawn = values.into_iter().filter(|v| *v > 0.0 && v.is_finite());
        let (low, high) =
            drawn.fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), v| (low.min(v), high.max(v)));
        let range = if high > 0.0 { [low / 1.1, high * 1.1] } else { [1.0, 10.0] };
        Self { title: title.to_owned(), range }
    }
}

/// A named curve, or points.
#[derive(Clone, Debug)]
pub struct Series {
    /// The name; series of one name have one colour in all panels.
    pub name: String,
    /// Points `[x, y]`; those not above 0 are left out. A single one is drawn as a dot.
    pub points: Vec<[f64; 2]>,
}

/// A diagram.
#[derive(Clone, Debug)]
pub struct Panel {
    /// What it shows.
    pub title: String,
    /// Its curves.
    pub series: Vec<Series>,
}

/// Panels side by side on the same axes, with one legend.
#[derive(Clone, Debug)]
pub struct Plot {
    /// The axis across.
    pub x: Axis,
    /// The axis upwards.
    pub y: Axis,
    /// The panels, three a row.
    pub panels: Vec<Panel>,
}

impl Plot {
    /// The picture.
    pub fn svg(&self) -> String {
        let columns = self.panels.len().clamp(1, 3);
        let rows = self.panels.len().div_ceil(columns);
        let names = self.names();
        let bottom = rows as f64 * PANEL[1];
        let axes = format!("{} against {}", self.y.title, self.x.title);
        let longest = names.iter().map(|n| n.len()).chain([axes.len()]).max().unwrap_or(0);
        let width = (columns as f64 * PANEL[0]).max(longest as f64 * LETTER + 16.0);
        let height = bottom + LEGEND_LINE * (1 + names.len()) as f64 + 8.0;
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" \
             height=\"{height}\" font-family=\"sans-serif\" font-size=\"10\">\n\
             <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
        );
        for (i, panel) in self.panels.iter().enumerate() {
            let corner = [(i % columns) as f64 * PANEL[0], (i / columns) as f64 * PANEL[1]];
            self.panel(panel, corner, &names, &mut out);
        }
        let _ = writeln!(out, "<text x=\"8\" y=\"{:.1}\">{}</text>", bottom + 14.0, escape(&axes));
        for (i, name) in names.iter().enumerate() {
            let y = bottom + LEGEND_LINE * (i + 1) as f64 + 14.0;
            let _ = writeln!(
                out,
                "<text x=\"8\" y=\"{y:.1}\" fill=\"{}\">{}</text>",
                COLORS[i % COLORS.len()],
                escape(name)
            );
        }
        out + "</svg>\n"
    }

    /// Names of all series, each once.
    fn names(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for series in self.panels.iter().flat_map(|p| &p.series) {
            if !names.contains(&series.name.as_str()) {
                names.push(&series.name);
            }
        }
        names
    }

    fn panel(&self, panel: &Panel, [x0, y0]: [f64; 2], names: &[&str], out: &mut String) {
        let (left, right) = (x0 + LEFT, x0 + PANEL[0] - RIGHT);
        let (top, bottom) = (y0 + ABOVE, y0 + PANEL[1] - BELOW);
        let x = |v: f64| left + part(&self.x, v) * (right - left);
        let y = |v: f64| bottom - part(&self.y, v) * (bottom - top);
        let _ = writeln!(
            out,
            "<text x=\"{:.1}\" y=\"{:.1}\" font-size=\"12\" text-anchor=\"middle\">{}</text>",
            0.5 * (left + right),
            y0 + 14.0,
            escape(&panel.title)
        );
        for (tick, labelled) in ticks(&self.x) {
            let at = x(tick);
            let _ = writeln!(out, "<path d=\"M{at:.1} {top:.1}V{bottom:.1}\" stroke=\"#ddd\"/>");
            if labelled {
                let below = bottom + 14.0;
                let _ = writeln!(
                    out,
                    "<text x=\"{at:.1}\" y=\"{below:.1}\" text-anchor=\"middle\">{tick}</text>"
                );
            }
        }
        for (tick, _) in ticks(&self.y) {
            let at = y(tick);
            let _ = writeln!(
                out,
                "<path d=\"M{left:.1} {at:.1}H{right:.1}\" stroke=\"#ddd\"/><text x=\"{:.1}\" y=\"{:.1}\" \
                 text-anchor=\"end\">{tick}</text>",
                left - 4.0,
                at + 3.0
            );
        }
        for series in &panel.series {
            let color = names.iter().position(|n| *n == series.name).unwrap_or(0) % COLORS.len();
            let points: Vec<[f64; 2]> = series
                .points
                .iter()
                .filter(|p| p.iter().all(|v| *v > 0.0 && v.is_finite()))
                .map(|p| [x(p[0]), y(p[1])])
                .collect();
            curve(&points, COLORS[color], out);
        }
    }
}

/// A line; dots where there is one point, or several of one x, which are no curve.
fn curve(points: &[[f64; 2]], color: &str, out: &mut String) {
    if points.windows(2).all(|pair| pair[0][0] == pair[1][0]) {
        for [x, y] in points {
            let _ = writeln!(out, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\" fill=\"{color}\"/>");
        }
        return;
    }
    let list: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
    let _ = writeln!(
        out,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.8\"/>",
        list.join(" ")
    );
}

/// Where a value lies on an axis, 0 to 1.
fn part(axis: &Axis, value: f64) -> f64 {
    let [low, high] = axis.range;
    ((value / low).ln() / (high / low).ln()).clamp(0.0, 1.0)
}

/// Powers of ten and their threefold within an axis, of which only the former are labelled on crowded axes; of an axis too
/// short for two of those, even steps.
fn ticks(axis: &Axis) -> Vec<(f64, bool)> {
    let logarithmic = decades(axis);
    if logarithmic.len() >= 2 {
        return logarithmic;
    }
    let [low, high] = axis.range;
    let power = 10f64.powf((high - low).log10().floor());
    let step = if high - low < 3.0 * power { power / 2.0 } else { power };
    let first = (low / step - 1e-9).ceil() as u64;
    (first..).map(|i| i as f64 * step).take_while(|v| *v <= high * (1.0 + 1e-9)).map(|v| (v, true)).collect()
}

fn decades(axis: &Axis) -> Vec<(f64, bool)> {
    let [low, high] = axis.range;
    let decades = (high / low).log10();
    (low.log10().floor() as i32..=high.log10().ceil() as i32)
        .flat_map(|decade| [(1.0, decade), (3.0, decade)])
        .map(|(digit, decade)| {
            // Division keeps 0.3 exact where multiplication gives 0.30000000000000004.
            let value = match decade < 0 {
                true => digit / 10f64.powi(-decade),
                false => digit * 10f64.powi(decade),
            };
            (value, digit == 1.0 || decades <= 3.0)
        })
        .filter(|(value, _)| (low * (1.0 - 1e-9)..=high * (1.0 + 1e-9)).contains(value))
        .collect()
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_stand_where_their_logarithms_do() {
        let axis = |range| Axis { title: "t".into(), range };
        let plot = Plot {
            x: axis([1.0, 100.0]),
            y: axis([0.01, 1.0]),
            panels: vec![Panel {
                title: "a < b".into(),
                series: vec![
                    Series {
                        name: "line".into(),
                        points: vec![[1.0, 1.0], [10.0, 0.1], [100.0, 0.01], [0.0, 1.0]],
                    },
                    Series { name: "dot".into(), points: vec![[1000.0, 0.1]] },
                    Series { name: "seeds".into(), points: vec![[10.0, 1.0], [10.0, 0.01]] },
                ],
            }],
        };
        let svg = plot.svg();
        assert!(svg.contains("points=\"46.0,22.0 168.0,119.0 290.0,216.0\""), "{svg}");
        assert!(svg.contains("<circle cx=\"290.0\" cy=\"119.0\""), "beyond the axis: at its end");
        for seed in ["cy=\"22.0\"", "cy=\"216.0\""] {
            assert!(svg.contains(&format!("<circle cx=\"168.0\" {seed}")), "{svg}");
        }
        assert!(svg.contains("a &lt; b"));
        assert_eq!(Axis::around("t", [22.0, 0.0, 1.1, f64::NAN]).range, [1.0, 22.0 * 1.1]);
        assert_eq!(Axis::around("t", []).range, [1.0, 10.0]);
        for label in [">0.03<", ">0.3<", ">1<", ">30<"] {
            assert!(svg.contains(label), "{label}");
        }
        let at = |range| ticks(&axis(range)).iter().map(|t| t.0).collect::<Vec<_>>();
        assert_eq!(at([400.0, 700.0]), [400.0, 500.0, 600.0, 700.0]);
        assert_eq!(at([1.5, 2.6]), [1.5, 2.0, 2.5]);
    }
}
