//! Transforms of components and build items.

use glam::{DMat4, DVec3, DVec4};

/// A transform of twelve numbers: rows of the matrix that a row vector is multiplied by, so that the
/// first three are where the x axis goes and the last three where the origin goes.
pub(super) fn parse(text: &str) -> Option<DMat4> {
    let mut values = [0.0; 12];
    let mut words = text.split_ascii_whitespace();
    for value in &mut values {
        *value = words.next()?.parse().ok().filter(|v: &f64| v.is_finite())?;
    }
    if words.next().is_some() {
        return None;
    }
    let column = |k: usize, w: f64| DVec4::new(values[3 * k], values[3 * k + 1], values[3 * k + 2], w);
    Some(DMat4::from_cols(column(0, 0.0), column(1, 0.0), column(2, 0.0), column(3, 1.0)))
}

/// A point moved by a transform.
pub(super) fn apply(transform: &DMat4, point: [f64; 3]) -> [f64; 3] {
    transform.transform_point3(DVec3::from(point)).into()
}

/// Whether a transform turns the outside in.
pub(super) fn mirrors(transform: &DMat4) -> bool {
    glam::DMat3::from_mat4(*transform).determinant() < 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_is_multiplied_from_the_left() {
        // x goes to y, y to z, z to x, then 1, 2, 3 is added.
        let turn = parse("0 1 0  0 0 1  1 0 0  1 2 3").unwrap();
        assert_eq!(apply(&turn, [10.0, 20.0, 30.0]), [31.0, 12.0, 23.0]);
        assert!(!mirrors(&turn) && mirrors(&parse("-1 0 0 0 1 0 0 0 1 0 0 0").unwrap()));
        for text in ["", "1 0 0 0 1 0 0 0 1 0 0", "1 0 0 0 1 0 0 0 1 0 0 0 0", "nan 0 0 0 1 0 0 0 1 0 0 0"] {
            assert!(parse(text).is_none(), "{text}");
        }
    }
}
