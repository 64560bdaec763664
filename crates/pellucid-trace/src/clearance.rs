//! How far every solid voxel is from air, as a 4-bit class: the distance a path may fly without
//! looking for the surface.
//!
//! Class c means that every point of the voxel is at least `radius_mm(c)` from any air. Classes
//! come from eroding the solid by boxes, sixteen voxels deep at most, so a tile needs only its
//! neighbours. They depend on which voxels are solid, not on their materials.

use pellucid_voxel::{AIR, Frame, LabelGrid, TILE, Tile};
use rayon::prelude::*;

/// Most classes: class 15 is the farthest told apart.
pub(crate) const CLASSES: usize = 16;
/// Rows of x voxels in a tile.
const ROWS: usize = TILE * TILE;
/// Edge of a tile with its neighbours.
const WIDE: usize = 3 * TILE;

/// Which voxels of a tile are solid: bit x of row `z * 16 + y`.
type SolidRows = [u16; ROWS];
/// Bit k of the class of voxel (x, row) is bit x of `planes[row][k]`.
type ClassPlanes = [[u16; 4]; ROWS];

enum Solidity {
    Empty,
    Full,
    Partial(Box<SolidRows>),
}

/// The classes of one tile.
pub(crate) enum TileClearance {
    /// No solid voxel.
    Empty,
    /// Every voxel is solid and of class 15.
    Deep,
    /// One class a voxel.
    Mixed(Box<ClassPlanes>),
}

impl TileClearance {
    /// Classes of the sixteen voxels of row `z * 16 + y`.
    #[inline]
    pub(crate) fn row(&self, row: usize) -> [u8; TILE] {
        match self {
            Self::Empty => [0; TILE],
            Self::Deep => [CLASSES as u8 - 1; TILE],
            Self::Mixed(planes) => {
                let p = planes[row];
                std::array::from_fn(|x| (0..4).fold(0, |class, k| class | (((p[k] >> x) & 1) << k)) as u8)
            }
        }
    }
}

/// Clearance classes of a grid.
pub(crate) struct Clearance {
    pub(crate) tiles: Vec<TileClearance>,
    pub(crate) radii_mm: [f32; CLASSES],
}

impl Clearance {
    /// Classifies every solid voxel.
    pub(crate) fn build(grid: &LabelGrid) -> Self {
        let dims = grid.tile_dims();
        let solidity: Vec<_> =
            (0..grid.tiles().len()).into_par_iter().map(|i| solidity(grid, coords(dims, i))).collect();
        let steps = erosion_steps(grid.frame());
        let tiles = (0..solidity.len())
            .into_par_iter()
            .map(|i| classify(&solidity, dims, coords(dims, i), &steps))
            .collect();
        Self { tiles, radii_mm: radii(grid.frame()) }
    }
}

/// Tile coordinates of a position in the tile list.
pub(crate) fn coords(dims: [u32; 3], index: usize) -> [u32; 3] {
    let (dx, dy) = (dims[0] as usize, dims[1] as usize);
    [(index % dx) as u32, (index / dx % dy) as u32, (index / dx / dy) as u32]
}

fn solidity(grid: &LabelGrid, t: [u32; 3]) -> Solidity {
    let inside: [usize; 3] =
        std::array::from_fn(|a| ((grid.size()[a] as usize) - t[a] as usize * TILE).min(TILE));
    let whole = inside == [TILE; 3];
    let mut rows: SolidRows = [0; ROWS];
    match grid.tile(t) {
        Tile::Constant(AIR) => return Solidity::Empty,
        Tile::Constant(_) if whole => return Solidity::Full,
        Tile::Constant(_) => {
            let bits = ((1u32 << inside[0]) - 1) as u16;
            for z in 0..inside[2] {
                rows[z * TILE..z * TILE + inside[1]].fill(bits);
            }
        }
        Tile::Dense(labels) => {
            for (row, values) in rows.iter_mut().zip(labels.chunks_exact(TILE)) {
                *row = values.iter().enumerate().fold(0, |bits, (x, &l)| bits | (u16::from(l != AIR) << x));
            }
        }
    }
    if rows.iter().all(|&r| r == u16::MAX) {
        Solidity::Full
    } else if rows.iter().all(|&r| r == 0) {
        Solidity::Empty
    } else {
        Solidity::Partial(Box::new(rows))
    }
}

fn max_radius(frame: &Frame) -> f64 {
    TILE as f64 * frame.pitch().min_mm()
}

/// Class radii in mm, a little short so that rounding never carries a flight into air.
fn radii(frame: &Frame) -> [f32; CLASSES] {
    let max = max_radius(frame);
    std::array::from_fn(|c| (max * c as f64 / (CLASSES - 1) as f64 * 0.999) as f32)
}

/// By how many voxels more class c erodes than class c - 1, along `[x, y, z]`.
fn erosion_steps(frame: &Frame) -> [[usize; 3]; CLASSES] {
    let mm = frame.pitch().mm();
    let reach = |c: usize, a: usize| {
        let r = max_radius(frame) * c as f64 / (CLASSES - 1) as f64;
        ((r / mm[a] - 1e-9).ceil().max(0.0) as usize).min(TILE)
    };
    std::array::from_fn(
        |c| {
            if c == 0 { [0; 3] } else { std::array::from_fn(|a| reach(c, a) - reach(c - 1, a)) }
        },
    )
}

fn classify(all: &[Solidity], dims: [u32; 3], t: [u32; 3], steps: &[[usize; 3]; CLASSES]) -> TileClearance {
    let index =
        |t: [u32; 3]| (t[2] as usize * dims[1] as usize + t[1] as usize) * dims[0] as usize + t[0] as usize;
    if matches!(all[index(t)], Solidity::Empty) {
        return TileClearance::Empty;
    }
    let neighbour = |o: [usize; 3]| -> &Solidity {
        let mut n = [0u32; 3];
        for a in 0..3 {
            let at = i64::from(t[a]) + o[a] as i64 - 1;
            if at < 0 || at >= i64::from(dims[a]) {
                return &Solidity::Empty;
            }
            n[a] = at as u32;
        }
        &all[index(n)]
    };
    let offsets = || (0..27).map(|i| [i % 3, i / 3 % 3, i / 9]);
    if offsets().all(|o| matches!(neighbour(o), Solidity::Full)) {
        return TileClearance::Deep;
    }
    let mut rows = vec![0u64; WIDE * WIDE];
    for o in offsets() {
        let from = neighbour(o);
        for row in 0..ROWS {
            let bits = match from {
                Solidity::Empty => break,
                Solidity::Full => u16::MAX,
                Solidity::Partial(solid) => solid[row],
            };
            let (z, y) = (row / TILE + o[2] * TILE, row % TILE + o[1] * TILE);
            rows[z * WIDE + y] |= u64::from(bits) << (o[0] * TILE);
        }
    }
    TileClearance::Mixed(Box::new(erode(rows, steps)))
}

/// Counts, for every voxel of the middle tile, the erosions it survives.
fn erode(mut rows: Vec<u64>, steps: &[[usize; 3]; CLASSES]) -> ClassPlanes {
    let mut planes: ClassPlanes = [[0; 4]; ROWS];
    for step in &steps[1..] {
        for _ in 0..step[0] {
            rows.iter_mut().for_each(|r| *r &= (*r << 1) & (*r >> 1));
        }
        for _ in 0..step[1] {
            for plane in rows.chunks_exact_mut(WIDE) {
                let before: [u64; WIDE] = std::array::from_fn(|y| plane[y]);
                for y in 1..WIDE - 1 {
                    plane[y] = before[y - 1] & before[y] & before[y + 1];
                }
                plane[0] = 0;
                plane[WIDE - 1] = 0;
            }
        }
        for _ in 0..step[2] {
            let mut below = [0u64; WIDE];
            for z in 0..WIDE {
                for y in 0..WIDE {
                    let here = rows[z * WIDE + y];
                    let above = if z + 1 < WIDE { rows[(z + 1) * WIDE + y] } else { 0 };
                    rows[z * WIDE + y] = below[y] & here & above;
                    below[y] = here;
                }
            }
        }
        let mut any = 0u16;
        for (row, plane) in planes.iter_mut().enumerate() {
            let bits = (rows[(row / TILE + TILE) * WIDE + row % TILE + TILE] >> TILE) as u16;
            any |= bits;
            let mut carry = bits;
            for p in plane {
                let next = *p & carry;
                *p ^= carry;
                carry = next;
            }
        }
        if any == 0 {
            break;
        }
    }
    planes
}

#[cfg(test)]
mod tests {
    use super::*;
    use pellucid_voxel::Pitch;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        /// A class never promises more than the box distance to the nearest air allows, and is
        /// the largest class that keeps the promise.
        #[test]
        fn classes_are_the_largest_safe_ones(
            size in [1u32..40, 1u32..30, 1u32..60],
            holes in prop::collection::vec((0u32..40, 0u32..30, 0u32..60), 0..6),
            probes in prop::collection::vec((0u32..40, 0u32..30, 0u32..60), 40),
            aspect in 0usize..2,
        ) {
            let pitch = [Pitch::j750(), Pitch::new([0.5, 0.02, 1.0]).unwrap()][aspect];
            let frame = Frame::new([0.0; 3], pitch, size).unwrap();
            let mut grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(3));
            for (x, y, z) in holes {
                if x < size[0] && y < size[1] && z < size[2] {
                    grid.set([x, y, z], 0);
                }
            }
            let clearance = Clearance::build(&grid);
            let steps = erosion_steps(&frame);
            for (x, y, z) in probes {
                let v = [x, y, z];
                if (0..3).any(|a| v[a] >= size[a]) || grid.get(v) == 0 {
                    continue;
                }
                let t = grid.tile_index(v.map(|c| c / 16));
                let row = ((z % 16) * 16 + y % 16) as usize;
                let class = clearance.tiles[t].row(row)[(x % 16) as usize] as usize;
                let mut reach = [0i64; 3];
                let mut largest = 0;
                for c in 1..CLASSES {
                    (0..3).for_each(|a| reach[a] += steps[c][a] as i64);
                    let v = v.map(i64::from);
                    let solid = (-reach[2]..=reach[2]).all(|dz| (-reach[1]..=reach[1]).all(|dy| {
                        (-reach[0]..=reach[0]).all(|dx| grid.at([v[0] + dx, v[1] + dy, v[2] + dz]) != 0)
                    }));
                    if !solid {
                        break;
                    }
                    largest = c;
                    for a in 0..3 {
                        prop_assert!(f64::from(clearance.radii_mm[c]) <= reach[a] as f64 * pitch.mm()[a]);
                    }
                }
                prop_assert_eq!(class, largest);
            }
        }
    }
}
