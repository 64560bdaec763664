//! A small test print that shows whether the printer mirrors.

use pellucid_voxel::{Frame, LabelGrid, MaterialTable, TILE, TILE_VOXELS, Tile};

use crate::{PrintTarget, SliceError};

/// The letter F, as seen from above, top row first.
const LETTER: [&str; 7] = ["#####", "#....", "#....", "####.", "#....", "#....", "#...."];
/// Edge of one cell of the letter, in millimetres.
const CELL_MM: f64 = 1.5;
/// Margin around the letter, in cells.
const MARGIN: f64 = 1.5;
/// Thickness of the plate and of the raised letter, in millimetres.
const LAYER_MM: f64 = 1.2;

/// A plate of 12 x 15 mm in `plate` with a raised letter F in `letter`, for checking a printer's
/// handedness: looking down on the print, the F must read as it does on this page. When it comes
/// out mirrored, change `row_order` in the printer's profile.
///
/// # Errors
/// [`SliceError::Invalid`] when the table has no material of one of the names.
///
/// ```
/// use pellucid_slice::{PrintTarget, coupon};
/// use pellucid_voxel::MaterialTable;
/// let grid = coupon(&PrintTarget::j750(), &MaterialTable::cmykw(), "white", "black").unwrap();
/// assert!(grid.histogram()[5] > grid.histogram()[4]);
/// ```
pub fn coupon(
    target: &PrintTarget,
    materials: &MaterialTable,
    plate: &str,
    letter: &str,
) -> Result<LabelGrid, SliceError> {
    let label = |name: &str| {
        materials.label_of(name).ok_or_else(|| {
            SliceError::invalid("test coupon", format!("material {name:?} is not in the table"))
        })
    };
    let (plate, letter) = (label(plate)?, label(letter)?);
    let mm = target.pitch().mm();
    let extent = [
        (LETTER[0].len() as f64 + 2.0 * MARGIN) * CELL_MM,
        (LETTER.len() as f64 + 2.0 * MARGIN) * CELL_MM,
        2.0 * LAYER_MM,
    ];
    let size = std::array::from_fn(|a| (extent[a] / mm[a]).round().max(1.0) as u32);
    let frame = Frame::new([0.0; 3], target.pitch(), size)?;
    let at = |voxel: [u32; 3]| {
        let [x, y, z] = frame.centre_mm(voxel.map(i64::from));
        if z < LAYER_MM {
            return plate;
        }
        let column = (x / CELL_MM - MARGIN).floor();
        let row = (LETTER.len() as f64 - (y / CELL_MM - MARGIN)).floor();
        let inside = column >= 0.0 && row >= 0.0;
        let cell = LETTER.get(row as usize).and_then(|line| line.as_bytes().get(column as usize));
        if inside && cell == Some(&b'#') { letter } else { pellucid_voxel::AIR }
    };
    Ok(LabelGrid::from_tiles(frame, |t| {
        let mut labels = Box::new([pellucid_voxel::AIR; TILE_VOXELS]);
        for (i, out) in labels.iter_mut().enumerate() {
            let local = [i % TILE, i / TILE % TILE, i / TILE / TILE];
            *out = at(std::array::from_fn(|a| t[a] * TILE as u32 + local[a] as u32));
        }
        Tile::Dense(labels)
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_top_layer_reads_as_an_f_with_y_up() {
        let grid = coupon(&PrintTarget::j750(), &MaterialTable::cmykw(), "white", "black").unwrap();
        let [width, height, depth] = grid.size();
        let mm = grid.frame().pitch().mm();
        for (row, line) in LETTER.iter().enumerate() {
            for (column, cell) in line.bytes().enumerate() {
                let x = ((column as f64 + MARGIN + 0.5) * CELL_MM / mm[0]) as u32;
                let y = height - 1 - ((row as f64 + MARGIN + 0.5) * CELL_MM / mm[1]) as u32;
                assert_eq!(grid.get([x, y, depth - 1]) == 4, cell == b'#', "row {row} column {column}");
            }
        }
        assert_eq!(grid.get([0, 0, 0]), 5);
        assert_eq!(grid.get([width - 1, height - 1, depth - 1]), 0);
        assert!(coupon(&PrintTarget::j750(), &MaterialTable::cmykw(), "white", "gold").is_err());
    }
}
