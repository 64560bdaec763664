//! Figures of report and manifest in the page's text.

use std::sync::Arc;

use minijinja::value::{Kwargs, Serde};
use minijinja::{AutoEscape, Environment, Error, ErrorKind, UndefinedBehavior, Value, context};

use crate::ProofError;

/// Separates thousands: a narrow space that does not break.
const THOUSANDS: char = '\u{202f}';
/// Stands before numbers below 0.
const MINUS: char = '\u{2212}';

/// What the page may say: `report` and `manifest` of a print.
pub(super) struct Facts(Arc<serde_json::Value>);

impl Facts {
    pub fn new(report: &serde_json::Value, manifest: &serde_json::Value) -> Self {
        Self(Arc::new(serde_json::json!({ "report": report, "manifest": manifest })))
    }

    /// Fills in the template: texts, and `data` by name as it is.
    pub fn render(
        &self,
        template: &str,
        title: &str,
        style: &str,
        script: &str,
        data: &[(&str, String)],
    ) -> Result<String, ProofError> {
        let mut environment = Environment::new();
        // What is missing may be asked for, but not shown.
        environment.set_undefined_behavior(UndefinedBehavior::SemiStrict);
        environment.set_auto_escape_callback(|_| AutoEscape::Html);
        let facts = self.0.clone();
        environment.add_function("figure", move |path: &str, options: Kwargs| {
            let shown = figure(&facts, path, &options)?;
            options.assert_all_used()?;
            Ok::<_, Error>(Value::from_safe_string(shown))
        });
        let data = data.iter().map(|(name, text)| (*name, Value::from_safe_string(text.clone())));
        let data = Value::from_pairs(data);
        let context = context! {
            title,
            style => Value::from_safe_string(style.into()),
            script => Value::from_safe_string(script.into()),
            data,
            report => Serde(&self.0["report"]),
            manifest => Serde(&self.0["manifest"]),
        };
        let page = environment.render_named_str("page", template, context);
        page.map_err(|e| ProofError::invalid("report", format!("does not fill the page: {e:#}")))
    }
}

/// A figure as an element that says where it is from: `path` such as `report.thin.least_mm`, times `scale` (1), with
/// `digits` (0) decimals.
fn figure(facts: &serde_json::Value, path: &str, options: &Kwargs) -> Result<String, Error> {
    let pointer = format!("/{}", path.replace('.', "/"));
    let value = facts.pointer(&pointer).and_then(serde_json::Value::as_f64);
    let missing = || Error::new(ErrorKind::UndefinedError, format!("there is no number {path}"));
    let value = value.ok_or_else(missing)?;
    let scale = options.get::<Option<f64>>("scale")?.unwrap_or(1.0);
    let digits = options.get::<Option<usize>>("digits")?.unwrap_or(0);
    let shown = grouped(value * scale, digits);
    let scale = if scale == 1.0 { String::new() } else { format!(" data-scale=\"{scale}\"") };
    Ok(format!("<data value=\"{value}\" data-from=\"{path}\" data-digits=\"{digits}\"{scale}>{shown}</data>"))
}

/// A number with decimals and its thousands apart.
fn grouped(value: f64, digits: usize) -> String {
    let text = format!("{:.digits$}", value.abs());
    let (whole, rest) = text.split_once('.').map_or((&text[..], None), |(whole, rest)| (whole, Some(rest)));
    let mut shown = String::new();
    if value < 0.0 && text.bytes().any(|b| (b'1'..=b'9').contains(&b)) {
        shown.push(MINUS);
    }
    for (i, digit) in whole.chars().enumerate() {
        if i > 0 && (whole.len() - i).is_multiple_of(3) && whole.len() > 4 {
            shown.push(THOUSANDS);
        }
        shown.push(digit);
    }
    if let Some(rest) = rest {
        shown.push('.');
        shown.push_str(rest);
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn numbers_are_rounded_and_grouped() {
        let shown = [(1234.0, 0), (12_345.678, 1), (-0.04, 1), (-1.26, 1), (1_234_567.0, 0), (0.5, 2)];
        let shown = shown.map(|(value, digits)| grouped(value, digits));
        assert_eq!(
            shown,
            ["1234", "12\u{202f}345.7", "0.0", "\u{2212}1.3", "1\u{202f}234\u{202f}567", "0.50"]
        );
    }

    #[test]
    fn figures_say_where_they_are_from_and_texts_are_escaped() {
        let facts =
            Facts::new(&json!({ "thin": { "share": 0.1234 }, "name": "<b>" }), &json!({ "size": [3, 4] }));
        let template = "{{ title }} {{ report.name }} {{ figure('report.thin.share', digits=1, scale=100) }} \
                        {{ figure('manifest.size.1') }} {{ data.blob }}";
        let page = facts.render(template, "a & b", "", "", &[("blob", "<raw>".into())]).unwrap();
        let wanted = "a &amp; b &lt;b&gt; <data value=\"0.1234\" data-from=\"report.thin.share\" data-digits=\"1\" \
                      data-scale=\"100\">12.3</data> <data value=\"4\" data-from=\"manifest.size.1\" \
                      data-digits=\"0\">4</data> <raw>";
        assert_eq!(page, wanted);
        let missing = facts.render("{{ figure('report.thin.none') }}", "", "", "", &[]).unwrap_err();
        assert!(missing.to_string().contains("report.thin.none"), "{missing}");
        assert!(facts.render("{{ figure('report.thin.share', digit=1) }}", "", "", "", &[]).is_err());
    }
}
