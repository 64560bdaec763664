//! Where a chart's patches lie, seen from above: x to the right from the left edge, y down from the far one, in mm.

use super::series::DEEP_READINGS;
use crate::PrintError;

/// Cells in a row.
pub(super) const COLUMNS: usize = 8;
/// Edge of a cell, and of the patch in its middle.
const CELL_MM: f64 = 6.75;
const PATCH_MM: f64 = 6.0;
/// Black around all cells.
pub(super) const MARGIN_MM: f64 = 1.0;
/// The deep white takes so many cells either way, in the far left corner.
const DEEP_CELLS: usize = 3;
/// Its readings are three by three, so far apart.
const DEEP_READING_MM: f64 = 1.5;
/// Corners that are cut off: far left, far right. Since they differ, a mirrored print cannot be turned to look right.
const CUT_MM: [f64; 2] = [2.6, 1.3];
/// Most rows.
const MAX_ROWS: usize = 30;

/// A rectangle: least and greatest corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Area {
    pub low_mm: [f64; 2],
    pub high_mm: [f64; 2],
}

impl Area {
    fn around(center_mm: [f64; 2], edge_mm: f64) -> Self {
        Self { low_mm: center_mm.map(|c| c - 0.5 * edge_mm), high_mm: center_mm.map(|c| c + 0.5 * edge_mm) }
    }

    pub fn contains(&self, at_mm: [f64; 2]) -> bool {
        (0..2).all(|a| at_mm[a] >= self.low_mm[a] && at_mm[a] < self.high_mm[a])
    }

    pub fn center_mm(&self) -> [f64; 2] {
        [0, 1].map(|a| 0.5 * (self.low_mm[a] + self.high_mm[a]))
    }
}

/// Cells in reading order, those of the deep white left out.
pub(super) struct Layout {
    rows: usize,
}

impl Layout {
    /// For so many patches beside the deep white.
    pub fn new(patches: usize) -> Result<Self, PrintError> {
        let rows = (patches + DEEP_CELLS * DEEP_CELLS).div_ceil(COLUMNS).max(DEEP_CELLS);
        if rows > MAX_ROWS {
            return Err(PrintError::invalid(
                "chart",
                "more patches than a chart holds; make one for some inks at a time",
            ));
        }
        Ok(Self { rows })
    }

    pub fn of_rows(rows: usize) -> Self {
        Self { rows }
    }

    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Width and depth of the plate.
    pub fn size_mm(&self) -> [f64; 2] {
        [COLUMNS, self.rows].map(|count| count as f64 * CELL_MM + 2.0 * MARGIN_MM)
    }

    /// The inner part that is not the black margin.
    pub fn bed(&self) -> Area {
        let [width, depth] = self.size_mm();
        Area { low_mm: [MARGIN_MM; 2], high_mm: [width - MARGIN_MM, depth - MARGIN_MM] }
    }

    pub fn deep(&self) -> Area {
        let edge = DEEP_CELLS as f64 * CELL_MM;
        Area::around([MARGIN_MM + 0.5 * edge; 2], edge)
    }

    /// Where the deep white is read.
    pub fn deep_readings(&self) -> [[f64; 2]; DEEP_READINGS] {
        let [x, y] = self.deep().center_mm();
        let off = |i: usize| (i as f64 - 1.0) * DEEP_READING_MM;
        std::array::from_fn(|i| [x + off(i % 3), y + off(i / 3)])
    }

    /// Name and place of the cells that patches may take: a letter a row, a number a column.
    pub fn cells(&self) -> impl Iterator<Item = (String, Area)> + '_ {
        (0..self.rows).flat_map(|row| (0..COLUMNS).map(move |column| (row, column))).filter_map(
            |(row, column)| {
                if row < DEEP_CELLS && column < DEEP_CELLS {
                    return None;
                }
                let letter = char::from(b'A' + (row % 26) as u8);
                let name = format!("{}{letter}{}", if row < 26 { "" } else { "A" }, column + 1);
                let center = [column, row].map(|i| MARGIN_MM + (i as f64 + 0.5) * CELL_MM);
                Some((name, Area::around(center, PATCH_MM)))
            },
        )
    }

    /// Whether a place lies in a corner that is cut off.
    pub fn is_cut(&self, [x, y]: [f64; 2]) -> bool {
        x + y < CUT_MM[0] || self.size_mm()[0] - x + y < CUT_MM[1]
    }

    /// The plate's outline, corner by corner.
    pub fn outline(&self) -> [[f64; 2]; 6] {
        let ([width, depth], [left, right]) = (self.size_mm(), CUT_MM);
        [[left, 0.0], [width - right, 0.0], [width, right], [width, depth], [0.0, depth], [0.0, left]]
    }
}
