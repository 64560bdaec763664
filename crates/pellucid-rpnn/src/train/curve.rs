//! Loss and validation error over a run.

use std::fmt::Write as _;
use std::path::Path;

use pellucid_core::files::write_whole_bytes;
use serde::{Deserialize, Serialize};

use super::Score;
use crate::RpnnError;

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

    /// Writes [`Curve::csv`] to a file, by way of a temporary one.
    ///
    /// # Errors
    /// [`RpnnError::Io`] when the file cannot be written.
    pub fn write_csv(&self, path: &Path) -> Result<(), RpnnError> {
        Ok(write_whole_bytes(path, self.csv().as_bytes())?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_a_point() {
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
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("curve.csv");
        curve.write_csv(&path).unwrap();
        assert_eq!(std::fs::read_to_string(path).unwrap(), csv);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
