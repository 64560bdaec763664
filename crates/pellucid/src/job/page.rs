//! The pages of prepared prints, slices and previews.

use pellucid_core::Control;
use pellucid_proof::ERROR_SCALE;
use pellucid_proof::page::{FieldValues, PageField, PageSize, ProofPage};
use pellucid_slice::RowOrder;
use pellucid_voxel::{LabelGrid, Surface};

use crate::job::{FurtherAim, LightLook, Preview, SlicesProof};
use crate::{Prepared, PrintError};

/// Most CIEDE2000 that the page keeps: steps of 0.2.
const MOST_ERROR: f32 = 51.0;
/// Most thickness in mm that it keeps: steps of 0.04.
const MOST_MM: f32 = 10.2;
/// Thickness in mm at the upper end of the colours; thicker parts hardly differ.
const SHOWN_MM: f32 = 4.0;

/// Inconstancy in CIEDE2000 at the upper end of its colours.
const SHOWN_INCONSTANCY: f32 = 10.0;

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
    let mut errors = errors_in_parts(&judged.error_parts[1]);
    errors.push(("error_unrefined", "Error, unrefined", sums(&judged.error_parts[0])));
    let mut fields = fields_of(&colors, &errors, &aimed.thickness_mm);
    for (aim, look) in aimed.further.iter().zip(&judged.light_looks) {
        fields.extend(under(aim, look));
    }
    let highest_first = prepared.record.settings.printer.row_order() == RowOrder::HighestYFirst;
    let (labels, surface) = (&prepared.refined.labels, aimed.object.surface());
    packed(labels, &aimed.with_clear(labels), surface, &fields, highest_first, control)
}

/// Packs a proof from slices: what they look like, and thickness.
pub(super) fn page_of_slices(proof: &SlicesProof, control: &Control<'_>) -> Result<ProofPage, PrintError> {
    let colors = FieldValues::Colors(&proof.colors);
    let fields = [
        PageField { key: "print", label: "Print", under: None, values: colors },
        thickness(&proof.thickness_mm),
    ];
    let highest_first = proof.manifest.row_order == RowOrder::HighestYFirst;
    packed(proof.opaque(), &proof.labels, proof.object.surface(), &fields, highest_first, control)
}

/// A page of the labels that are seen, with the slices of those that are printed.
fn packed(
    seen: &LabelGrid,
    printed: &LabelGrid,
    surface: &Surface,
    fields: &[PageField<'_>],
    highest_first: bool,
    control: &Control<'_>,
) -> Result<ProofPage, PrintError> {
    let size = PageSize::default();
    let page = ProofPage::of_surface(seen, surface, fields, size, control)?;
    Ok(page.with_slices(printed, highest_first, size, &control.silent())?)
}

/// Packs what is known before refinement: there are no slices to look at.
pub(super) fn page_of_preview(preview: &Preview, control: &Control<'_>) -> Result<ProofPage, PrintError> {
    let aimed = &preview.aimed;
    let colors = [
        ("target", "Target", &aimed.target),
        ("printable", "Printable target", &aimed.printable_target),
        ("unrefined", "Unrefined", &preview.appearance),
    ];
    let errors = errors_in_parts(&preview.error_parts);
    let fields = fields_of(&colors, &errors, &aimed.thickness_mm);
    let size = PageSize::default();
    Ok(ProofPage::of_surface(&preview.unrefined, aimed.object.surface(), &fields, size, control)?)
}

/// An error's name for programs, that for people, and its values.
type Errors = (&'static str, &'static str, Vec<f32>);

fn sums(parts: &[[f32; 3]]) -> Vec<f32> {
    parts.iter().map(|p| p.iter().sum()).collect()
}

fn errors_in_parts(parts: &[[f32; 3]]) -> Vec<Errors> {
    let part = |i: usize| parts.iter().map(|p| p[i]).collect();
    vec![
        ("error", "Error", sums(parts)),
        ("gamut", "Out of gamut", part(0)),
        ("thin", "Too thin", part(1)),
        ("cross_talk", "Cross-talk", part(2)),
    ]
}

/// What is seen under one more light.
fn under<'a>(aim: &'a FurtherAim, look: &'a LightLook) -> impl Iterator<Item = PageField<'a>> {
    let light = Some(aim.illuminant.name());
    let colors = [
        ("target", "Target", &aim.target),
        ("printable", "Printable target", &aim.printable_target),
        ("unrefined", "Unrefined", &look.unrefined),
        ("refined", "Refined", &look.refined),
    ];
    let colors = colors.map(|(key, label, colors)| PageField {
        key,
        label,
        under: light,
        values: FieldValues::Colors(colors),
    });
    let (values, most, shown, unit) = (&look.inconstancy[..], MOST_ERROR, SHOWN_INCONSTANCY, "dE2000");
    let values = FieldValues::Quantity { values, most, shown, unit };
    let map = PageField { key: "inconstancy", label: "Inconstancy", under: light, values };
    colors.into_iter().chain([map])
}

/// Colours, errors and thickness.
fn fields_of<'a>(
    colors: &[(&'a str, &'a str, &'a Vec<[f32; 3]>)],
    errors: &'a [Errors],
    thickness_mm: &'a [f32],
) -> Vec<PageField<'a>> {
    let of_colors = |&(key, label, colors): &(&'a str, &'a str, &'a Vec<[f32; 3]>)| PageField {
        key,
        label,
        under: None,
        values: FieldValues::Colors(colors),
    };
    let of_errors = |(key, label, values): &'a Errors| {
        let (most, shown, unit) = (MOST_ERROR, ERROR_SCALE, "dE2000");
        PageField { key, label, under: None, values: FieldValues::Quantity { values, most, shown, unit } }
    };
    let colors = colors.iter().map(of_colors).chain(errors.iter().map(of_errors));
    colors.chain([thickness(thickness_mm)]).collect()
}

fn thickness(values: &[f32]) -> PageField<'_> {
    let values = FieldValues::Quantity { values, most: MOST_MM, shown: SHOWN_MM, unit: "mm" };
    PageField { key: "thickness", label: "Thickness", under: None, values }
}
