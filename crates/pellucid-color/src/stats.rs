//! Summary of many colour differences.

use crate::ColorError;

/// Count, mean, median, 95th percentile and maximum of colour differences.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct DeltaEStats {
    /// Number of values.
    pub count: usize,
    /// Arithmetic mean.
    pub mean: f64,
    /// Median.
    pub median: f64,
    /// 95th percentile.
    pub p95: f64,
    /// Largest value.
    pub max: f64,
}

impl DeltaEStats {
    /// Of a list; all zero when it is empty. Percentiles interpolate linearly between the
    /// sorted values. The result does not depend on the order of the list.
    ///
    /// ```
    /// use pellucid_color::DeltaEStats;
    /// let stats = DeltaEStats::of(&[4.0, 1.0, 2.0, 3.0])?;
    /// assert_eq!((stats.mean, stats.median, stats.max), (2.5, 2.5, 4.0));
    /// # Ok::<(), pellucid_color::ColorError>(())
    /// ```
    ///
    /// # Errors
    /// [`ColorError::Invalid`] when a value is not finite.
    pub fn of(values: &[f32]) -> Result<Self, ColorError> {
        if let Some((i, bad)) = values.iter().enumerate().find(|(_, v)| !v.is_finite()) {
            return Err(ColorError::invalid(
                format!("colour difference {i}"),
                format!("{bad} is not finite"),
            ));
        }
        let Some(last) = values.len().checked_sub(1) else {
            return Ok(Self::default());
        };
        let mut sorted = values.to_vec();
        sorted.sort_unstable_by(f32::total_cmp);
        let percentile = |p: f64| {
            let at = p * last as f64;
            let low = at.floor() as usize;
            let (a, b) = (f64::from(sorted[low]), f64::from(sorted[(low + 1).min(last)]));
            a + (b - a) * (at - low as f64)
        };
        Ok(Self {
            count: values.len(),
            mean: sorted.iter().copied().map(f64::from).sum::<f64>() / values.len() as f64,
            median: percentile(0.5),
            p95: percentile(0.95),
            max: f64::from(sorted[last]),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_percentiles_in_any_order() {
        let mut values: Vec<f32> = (0..=100).map(|i| i as f32).collect();
        let stats = DeltaEStats::of(&values).unwrap();
        assert_eq!(stats, DeltaEStats { count: 101, mean: 50.0, median: 50.0, p95: 95.0, max: 100.0 });
        values.reverse();
        assert_eq!(DeltaEStats::of(&values).unwrap(), stats);
        assert_eq!(DeltaEStats::of(&[2.0, 4.0]).unwrap().p95, 3.9);
    }

    #[test]
    fn empty_and_bad_lists() {
        assert_eq!(DeltaEStats::of(&[]).unwrap(), DeltaEStats::default());
        let error = DeltaEStats::of(&[0.0, f32::NAN]).unwrap_err();
        assert!(error.to_string().contains("difference 1"), "{error}");
    }
}
