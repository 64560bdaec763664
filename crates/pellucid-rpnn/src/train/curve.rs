//! Loss and validation error over a run.

use std::fmt::Write as _;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::Score;
use crate::RpnnError;
use crate::file::write_whole;

/// One row of a [`Curve`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CurvePoint {
    /// Steps done.
    pub step: u64,
    /// Samples seen.
    pub samples: u64,
    /// Mean squared error in the batches since the row before, label noise included.
    pub loss: f64,
    /// Learning rate of the last step.
    pub rate: f64,
    /// Norm of the last gradient before clipping.
    pub gradient_norm: f64,
    /// Error of the averaged weights on the validation set, where it was measured.
    pub validation: Option<Score>,
}

/// The rows of a run in order of steps.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Curve {
    /// The rows.
    pub points: Vec<CurvePoint>,
}

impl Curve {
    /// A table with a header line; fields that were not measured are empty.
    pub fn csv(&self) -> String {
        let mut out =
            "step,samples,training_rmse,rate,gradient_norm,validation_rmse,validation_bias,validation_p95\n"
                .to_owned();
        for p in &self.points {
            let v =
                p.validation.map_or(",,".to_owned(), |v| format!("{:.5},{:.5},{:.5}", v.rmse, v.bias, v.p95));
            // Writing to a string cannot fail.
            let _ = writeln!(
                out,
                "{},{},{:.5},{:.3e},{:.4},{v}",
                p.step,
                p.samples,
                p.loss.sqrt(),
                p.rate,
                p.gradient_norm
            );
        }
        out
    }

    /// A picture: error against samples, both axes logarithmic.
    pub fn svg(&self) -> String {
        const SIZE: [f64; 2] = [720.0, 440.0];
        const MARGIN: [f64; 2] = [70.0, 50.0];
        type Series = Vec<(f64, f64)>;
        let training: Series = self.points.iter().map(|p| (p.samples as f64, p.loss.sqrt())).collect();
        let validation: Series =
            self.points.iter().filter_map(|p| Some((p.samples as f64, p.validation?.rmse))).collect();
        let drawable = |s: &Series| -> Series {
            s.iter()
                .copied()
                .filter(|(x, y)| *x > 0.0 && *y > 0.0 && y.is_finite())
                .map(|(x, y)| (x.log10(), y.log10()))
                .collect()
        };
        let (training, validation) = (drawable(&training), drawable(&validation));
        let all = || training.iter().chain(&validation);
        let span = |pick: fn(&(f64, f64)) -> f64| {
            let low = all().map(pick).fold(f64::INFINITY, f64::min);
            let high = all().map(pick).fold(f64::NEG_INFINITY, f64::max);
            if low.is_finite() { (low - 0.05, high + 0.05) } else { (0.0, 1.0) }
        };
        let (x, y) = (span(|p| p.0), span(|p| p.1));
        let place = |p: (f64, f64)| {
            let inner = [SIZE[0] - 2.0 * MARGIN[0], SIZE[1] - 2.0 * MARGIN[1]];
            [
                MARGIN[0] + (p.0 - x.0) / (x.1 - x.0) * inner[0],
                SIZE[1] - MARGIN[1] - (p.1 - y.0) / (y.1 - y.0) * inner[1],
            ]
        };
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" font-family=\"sans-serif\" \
             font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
            SIZE[0], SIZE[1]
        );
        let mut ticks = |low: f64, high: f64, horizontal: bool| {
            for decade in low.floor() as i32..=high.ceil() as i32 {
                for digit in [1.0f64, 2.0, 5.0] {
                    let v = f64::from(decade) + digit.log10();
                    if !(low..=high).contains(&v) {
                        continue;
                    }
                    let label = 10f64.powf(v);
                    let (line, text) = if horizontal {
                        let [px, _] = place((v, y.0));
                        (
                            [px, MARGIN[1], px, SIZE[1] - MARGIN[1]],
                            format!(
                                "<text x=\"{px:.1}\" y=\"{}\" text-anchor=\"middle\">{label:.0}</text>",
                                SIZE[1] - 32.0
                            ),
                        )
                    } else {
                        let [_, py] = place((x.0, v));
                        (
                            [MARGIN[0], py, SIZE[0] - MARGIN[0], py],
                            format!(
                                "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{label:.3}</text>",
                                MARGIN[0] - 6.0,
                                py + 4.0
                            ),
                        )
                    };
                    let [x1, y1, x2, y2] = line;
                    let _ =
                        writeln!(out, "<path d=\"M{x1:.1} {y1:.1}L{x2:.1} {y2:.1}\" stroke=\"#ddd\"/>{text}");
                }
            }
        };
        ticks(x.0, x.1, true);
        ticks(y.0, y.1, false);
        for (series, color) in [(&training, "#999"), (&validation, "#06c")] {
            let points: Vec<String> =
                series.iter().map(|&p| place(p)).map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
            let _ = writeln!(
                out,
                "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.5\"/>",
                points.join(" ")
            );
        }
        let _ = writeln!(
            out,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">samples</text>\
             <text x=\"{}\" y=\"24\" fill=\"#777\">training (with label noise)</text>\
             <text x=\"{}\" y=\"24\" fill=\"#06c\">validation, averaged weights</text>\
             <text x=\"8\" y=\"24\">RMSE</text>\n</svg>",
            SIZE[0] / 2.0,
            SIZE[1] - 12.0,
            MARGIN[0] + 40.0,
            MARGIN[0] + 260.0
        );
        out
    }

    /// Writes `curve.csv` and `curve.svg` into a folder.
    ///
    /// # Errors
    /// [`RpnnError::Io`] when a file cannot be written.
    pub fn write(&self, dir: &Path) -> Result<(), RpnnError> {
        write_whole(&dir.join("curve.csv"), self.csv().as_bytes())?;
        write_whole(&dir.join("curve.svg"), self.svg().as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_and_pictures() {
        let score = Score { samples: 5, rmse: 0.02, bias: -0.001, p95: 0.05, label_noise: 0.003 };
        let point = |step: u64, validation| CurvePoint {
            step,
            samples: step * 256,
            loss: 0.01 / step as f64,
            rate: 1e-3,
            gradient_norm: 0.2,
            validation,
        };
        let curve =
            Curve { points: vec![point(100, None), point(200, Some(score)), point(300, Some(score))] };
        let csv = curve.csv();
        assert_eq!(csv.lines().count(), 4);
        assert!(csv.lines().nth(1).unwrap().ends_with(",,,"), "{csv}");
        assert!(csv.lines().nth(2).unwrap().starts_with("200,51200,"), "{csv}");
        let svg = curve.svg();
        assert_eq!(svg.matches("<polyline").count(), 2);
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
        assert!(!Curve::default().svg().contains("NaN"));
        let folder = tempfile::tempdir().unwrap();
        curve.write(folder.path()).unwrap();
        assert_eq!(std::fs::read_to_string(folder.path().join("curve.csv")).unwrap(), csv);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    }
}
