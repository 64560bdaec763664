//! From crossings along x to a label grid.

use std::sync::atomic::AtomicU64;

use pellucid_voxel::{AIR, Control, Frame, LabelGrid, TILE, TILE_VOXELS, Tile};
use rayon::prelude::*;

use super::cap_field::CapField;
use super::scan::{Axes, SLAB, Slabs, scan};
use crate::MeshError;
use crate::geometry::{Bounds, Vec3};

/// Edge of the blocks within a tile that are tested against the cap field at once.
const BLOCK: usize = 4;
/// Edge of the blocks that those are divided in where it may decide.
const SMALL: usize = 2;

/// Signed crossings of every x-row of one slab of layers, by row, ascending along x.
struct RowSlab {
    /// `[layer][y]` starts into `entries`, one more at the end.
    starts: Vec<u32>,
    /// First voxel past the crossing in the high bits; lowest bit set where the line leaves.
    entries: Vec<u32>,
}

/// Integer winding numbers along x-rows.
pub(crate) struct Rows {
    slabs: Vec<RowSlab>,
    lines: usize,
}

impl Rows {
    /// Scans triangles (in voxels, centres at integers) that together form closed surfaces.
    pub fn scan(corners: &[[Vec3; 3]], frame: &Frame, control: &Control) -> Result<Self, MeshError> {
        let [width, lines, layers] = frame.size();
        let slabs = Slabs::new(corners, Axes::X.v, layers);
        let done = AtomicU64::new(0);
        let rows = (0..slabs.len())
            .into_par_iter()
            .map(|s| {
                control.check()?;
                let mut keys: Vec<u64> = Vec::new();
                for &i in slabs.triangles(s) {
                    scan(&corners[i as usize], Axes::X, Slabs::layers(s), lines, |c| {
                        let row = (c.v as usize % SLAB) as u64 * u64::from(lines) + u64::from(c.u);
                        let voxel = c.t.ceil().clamp(0.0, f64::from(width)) as u64;
                        keys.push(row << 32 | voxel << 1 | u64::from(c.sign < 0));
                    });
                }
                keys.sort_unstable();
                let mut starts = vec![0u32; SLAB * lines as usize + 1];
                keys.iter().for_each(|k| starts[(k >> 32) as usize + 1] += 1);
                (1..starts.len()).for_each(|r| starts[r] += starts[r - 1]);
                control.advance(&done, 1, slabs.len() as u64);
                Ok(RowSlab { starts, entries: keys.into_iter().map(|k| k as u32).collect() })
            })
            .collect::<Result<_, MeshError>>()?;
        Ok(Self { slabs: rows, lines: lines as usize })
    }

    fn row(&self, y: usize, z: usize) -> &[u32] {
        let slab = &self.slabs[z / SLAB];
        let r = z % SLAB * self.lines + y;
        &slab.entries[slab.starts[r] as usize..slab.starts[r + 1] as usize]
    }

    /// Winding numbers of the 16 voxels from `x0` on; `None` when all are equal, with that number.
    fn windings(&self, x0: u32, y: usize, z: usize) -> (i32, Option<[i32; TILE]>) {
        let row = self.row(y, z);
        let step = |e: u32| if e & 1 == 0 { 1 } else { -1 };
        let before = row.iter().take_while(|&&e| e >> 1 <= x0).count();
        let start: i32 = row[..before].iter().map(|&e| step(e)).sum();
        let end = x0 + TILE as u32;
        if row.get(before).is_none_or(|&e| e >> 1 >= end) {
            return (start, None);
        }
        let mut values = [start; TILE];
        for &e in row[before..].iter().take_while(|&&e| e >> 1 < end) {
            values[(e >> 1).saturating_sub(x0) as usize..].iter_mut().for_each(|v| *v += step(e));
        }
        (start, Some(values))
    }
}

/// Tiles in which the cap field may decide, by tile index.
fn undecided(frame: &Frame, dims: [u32; 3], field: &CapField, control: &Control) -> Vec<bool> {
    let mut marks = vec![false; dims.iter().map(|&d| d as usize).product()];
    if field.is_empty() {
        return marks;
    }
    for t in undecided_within(frame, [0; 3], dims, field, control) {
        marks[(t[2] as usize * dims[1] as usize + t[1] as usize) * dims[0] as usize + t[0] as usize] = true;
    }
    marks
}

/// Splits a box of tiles until the cap field is negligible in it or it is one tile.
fn undecided_within(
    frame: &Frame,
    low: [u32; 3],
    high: [u32; 3],
    field: &CapField,
    control: &Control,
) -> Vec<[u32; 3]> {
    let corner = |t: [u32; 3], by: i64| frame.centre_mm(t.map(|c| i64::from(c) * TILE as i64 - by));
    let area = Bounds { min: corner(low, 0), max: corner(high, 1) };
    if control.cancelled() || field.negligible(&area) {
        return Vec::new();
    }
    let edges: [u32; 3] = std::array::from_fn(|a| high[a] - low[a]);
    let axis = (0..3).fold(0, |best, a| if edges[a] > edges[best] { a } else { best });
    if edges[axis] == 1 {
        return vec![low];
    }
    let middle = low[axis] + edges[axis] / 2;
    let (mut first_end, mut second_start) = (high, low);
    first_end[axis] = middle;
    second_start[axis] = middle;
    let (mut first, second) = rayon::join(
        || undecided_within(frame, low, first_end, field, control),
        || undecided_within(frame, second_start, high, field, control),
    );
    first.extend(second);
    first
}

/// Builds the grid: `label` where the generalised winding number is at least one half in size.
pub(crate) fn fill(
    frame: Frame,
    rows: &Rows,
    field: &CapField,
    label: u8,
    control: &Control,
) -> Result<LabelGrid, MeshError> {
    let dims = frame.size().map(|s| s.div_ceil(TILE as u32));
    let marks = undecided(&frame, dims, field, control);
    control.check()?;
    let done = AtomicU64::new(0);
    let total: u64 = dims.iter().map(|&d| u64::from(d)).product();
    let grid = LabelGrid::from_tiles(frame, |t| {
        if control.cancelled() {
            return Tile::Constant(AIR);
        }
        let index = (t[2] as usize * dims[1] as usize + t[1] as usize) * dims[0] as usize + t[0] as usize;
        let tile = build_tile(&frame, t, rows, marks[index].then_some(field), label);
        if t[0] + 1 == dims[0] {
            control.advance(&done, u64::from(dims[0]), total);
        }
        tile
    });
    control.check()?;
    Ok(grid)
}

/// One tile from its rows; `field` where the caps may matter.
fn build_tile(frame: &Frame, t: [u32; 3], rows: &Rows, field: Option<&CapField>, label: u8) -> Tile {
    let first = t.map(|c| c * TILE as u32);
    let inside: [usize; 3] = std::array::from_fn(|a| ((frame.size()[a] - first[a]) as usize).min(TILE));
    let mut windings: Option<Box<[i32; TILE_VOXELS]>> = field.map(|_| Box::new([0; TILE_VOXELS]));
    let mut labels: Option<Box<[u8; TILE_VOXELS]>> = None;
    let mut constant: Option<u8> = None;
    for z in 0..inside[2] {
        for y in 0..inside[1] {
            let r = (z * TILE + y) * TILE;
            let (start, values) = rows.windings(first[0], first[1] as usize + y, first[2] as usize + z);
            if let Some(windings) = &mut windings {
                windings[r..r + TILE].copy_from_slice(&values.unwrap_or([start; TILE]));
                continue;
            }
            let solid = |w: i32| if w == 0 { AIR } else { label };
            let begin = *constant.get_or_insert(solid(start));
            if labels.is_none() && (values.is_some() || solid(start) != begin) {
                // Rows before this one all had the first row's label.
                let mut new = Box::new([AIR; TILE_VOXELS]);
                for k in 0..r / TILE {
                    if k % TILE < inside[1] {
                        new[k * TILE..(k + 1) * TILE].fill(begin);
                    }
                }
                labels = Some(new);
            }
            if let Some(labels) = &mut labels {
                match values {
                    Some(values) => labels[r..r + TILE].copy_from_slice(&values.map(solid)),
                    None => labels[r..r + TILE].fill(solid(start)),
                }
            }
        }
    }
    match (field, windings) {
        (Some(field), Some(windings)) => {
            let mut labels = Box::new([AIR; TILE_VOXELS]);
            decide(frame, first, field, &windings, label, &mut labels);
            Tile::Dense(labels)
        }
        _ => labels.map_or(Tile::Constant(constant.unwrap_or(AIR)), Tile::Dense),
    }
}

/// Labels a tile near a hole, block by block.
fn decide(
    frame: &Frame,
    first: [u32; 3],
    field: &CapField,
    windings: &[i32; TILE_VOXELS],
    label: u8,
    labels: &mut [u8; TILE_VOXELS],
) {
    let centre =
        |local: [usize; 3]| frame.centre_mm(std::array::from_fn(|a| i64::from(first[a]) + local[a] as i64));
    let mut decide_one = |[x, y, z]: [usize; 3], plain: bool| {
        let i = (z * TILE + y) * TILE + x;
        let solid = if plain { windings[i] != 0 } else { field.solid(centre([x, y, z]), windings[i]) };
        labels[i] = if solid { label } else { AIR };
    };
    let plain = |low: [usize; 3], edge: usize| {
        field.negligible(&Bounds { min: centre(low), max: centre(low.map(|c| c + edge - 1)) })
    };
    for block in cells([0; 3], TILE, BLOCK) {
        if plain(block, BLOCK) {
            cells(block, BLOCK, 1).for_each(|v| decide_one(v, true));
            continue;
        }
        for small in cells(block, BLOCK, SMALL) {
            let plain = plain(small, SMALL);
            cells(small, SMALL, 1).for_each(|v| decide_one(v, plain));
        }
    }
}

/// Low corners of the cells of one edge that fill a cube of another.
fn cells(low: [usize; 3], cube: usize, cell: usize) -> impl Iterator<Item = [usize; 3]> {
    let steps = move |a: usize| (low[a]..low[a] + cube).step_by(cell);
    steps(2).flat_map(move |z| steps(1).flat_map(move |y| steps(0).map(move |x| [x, y, z])))
}
