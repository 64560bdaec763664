//! A case and what was found.

/// A stiff or extreme case of a part.
pub struct Case {
    /// What is tried.
    pub part: &'static str,
    /// With what.
    pub name: String,
    /// What was measured.
    pub measured: &'static str,
    /// What was found.
    pub found: f64,
    /// The most that it may be; `None` where it is only stated.
    pub bound: Option<f64>,
}

impl Case {
    /// What was found is finite and within the bound.
    pub fn holds(&self) -> bool {
        self.found.is_finite() && self.bound.is_none_or(|bound| self.found <= bound)
    }

    /// That in a word.
    pub fn verdict(&self) -> &'static str {
        match (self.holds(), self.bound) {
            (true, Some(_)) => "holds",
            (true, None) => "stated",
            (false, _) => "FAILS",
        }
    }

    /// The case in a line.
    pub fn line(&self) -> String {
        format!("{}, {}: {} {}, {}", self.part, self.name, self.measured, number(self.found), self.verdict())
    }
}

/// A number with three digits.
pub fn number(value: f64) -> String {
    match value.abs() {
        0.0 => "0".to_owned(),
        v if (0.01..1000.0).contains(&v) => format!("{value:.3}"),
        _ => format!("{value:.2e}"),
    }
}
