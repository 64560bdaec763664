//! The proof page of a prepared print.

use std::borrow::Cow;

use pellucid_core::Control;
use pellucid_proof::ERROR_SCALE;
use pellucid_proof::page::{FieldValues, PageField, PageSize, ProofPage};
use pellucid_slice::RowOrder;

use crate::job::SlicesProof;
use crate::{Prepared, PrintError};

/// Most CIEDE2000 that the page keeps: steps of 0.2.
const MOST_ERROR: f32 = 51.0;
/// Most thickness in mm that it keeps: steps of 0.04.
const MOST_MM: f32 = 10.2;
/// Thickness in mm at the upper end of the colours; thicker parts hardly differ.
const SHOWN_MM: f32 = 4.0;

/// Packs surface and slices; figures come later.
pub(super) fn page_of(prepared: &Prepared, control: &Control<'_>) -> Result<ProofPage, PrintError> {
    let (aimed, judged) = (&prepared.aimed, &prepared.judged);
    let [unrefined, refined] = &judged.appearance;
    let colors = [
        ("target", "Target", &aimed.target),
        ("printable", "Printable target", &aimed.printable_target),
        ("unrefined", "Unrefined", unrefined),
        ("refined", "Refined", refined),
    ];
    let part = |state: usize, i: usize| judged.error_parts[state].iter().map(|p| p[i]).collect();
    let sum = |state: usize| judged.error_parts[state].iter().map(|p| p.iter().sum()).collect();
    let errors: [(&str, &str, Vec<f32>); 5] = [
        ("error", "Error", sum(1)),
        ("gamut", "Out of gamut", part(1, 0)),
        ("thin", "Too thin", part(1, 1)),
        ("cross_talk", "Cross-talk", part(1, 2)),
        ("error_unrefined", "Error, unrefined", sum(0)),
    ];
    let mut fields: Vec<PageField<'_>> = Vec::new();
    for (key, label, colors) in colors {
        fields.push(PageField { key, label, values: FieldValues::Colors(colors) });
    }
    for (key, label, values) in &errors {
        let (most, shown, unit) = (MOST_ERROR, ERROR_SCALE, "dE2000");
        fields.push(PageField { key, label, values: FieldValues::Quantity { values, most, shown, unit } });
    }
    fields.push(thickness(&aimed.thickness_mm));
    let highest_first = prepared.record.settings.printer.row_order() == RowOrder::HighestYFirst;
    let (labels, surface) = (&prepared.refined.labels, aimed.object.surface());
    let page = ProofPage::new(labels, surface, &fields, highest_first, PageSize::default(), control)?;
    match aimed.with_clear(labels) {
        Cow::Owned(printed) => Ok(page.with_slices(&printed, highest_first, PageSize::default(), control)?),
        Cow::Borrowed(_) => Ok(page),
    }
}

/// Packs a proof from slices: what they look like, and thickness.
pub(super) fn page_of_slices(proof: &SlicesProof, control: &Control<'_>) -> Result<ProofPage, PrintError> {
    let colors = FieldValues::Colors(&proof.colors);
    let fields = [PageField { key: "print", label: "Print", values: colors }, thickness(&proof.thickness_mm)];
    let highest_first = proof.manifest.row_order == RowOrder::HighestYFirst;
    let (labels, surface) = (proof.opaque(), proof.object.surface());
    let page = ProofPage::new(labels, surface, &fields, highest_first, PageSize::default(), control)?;
    match proof.has_clear() {
        true => Ok(page.with_slices(&proof.labels, highest_first, PageSize::default(), control)?),
        false => Ok(page),
    }
}

fn thickness(values: &[f32]) -> PageField<'_> {
    let values = FieldValues::Quantity { values, most: MOST_MM, shown: SHOWN_MM, unit: "mm" };
    PageField { key: "thickness", label: "Thickness", values }
}
