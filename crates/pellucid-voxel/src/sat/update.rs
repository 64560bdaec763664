//! Rebuilding the tables of changed tiles only.

use rayon::prelude::*;

use super::build::{GroupLabels, GroupTile, Sweep, add, profile};
use super::tables::{CountTables, LANES, Lanes, TileRecord, across};
use crate::grid::{inside, tile_coords};
use crate::{Control, LabelGrid, TILE, VoxelError};

/// What a changed tile adds to the edge lines: tile coordinates and, per axis, by how much the
/// counts of its first 1..=16 layers grew, modulo 2^32.
struct Growth {
    tile: [usize; 3],
    profile: [[Lanes; TILE]; 3],
}

impl CountTables {
    /// The records of the tiles `changed`, positions in [`LabelGrid::tiles`], with their new tiles;
    /// constant ones that the tables hold already are left out.
    pub(super) fn prepare(
        &self,
        grid: &LabelGrid,
        labels: &GroupLabels,
        changed: &[u32],
        control: &Control,
    ) -> Result<Vec<(usize, GroupTile)>, VoxelError> {
        let mut built = changed
            .par_iter()
            .map(|&i| {
                control.check()?;
                let t = tile_coords(grid.tile_dims(), i as usize);
                let tile = labels.tile(&grid.tiles()[i as usize], inside(t, grid.size()));
                Ok((self.record_index(t), tile))
            })
            .collect::<Result<Vec<_>, VoxelError>>()?;
        built.retain(|(at, tile)| !self.same(*at, tile));
        Ok(built)
    }

    /// Puts the prepared tiles in place and corrects every sum they lie behind.
    pub(super) fn apply(&mut self, built: Vec<(usize, GroupTile)>) {
        if built.is_empty() {
            return;
        }
        let rows: [Vec<bool>; 3] = std::array::from_fn(|axis| {
            let (u, v) = across(axis);
            let mut rows = vec![false; self.dims[u] * self.dims[v]];
            for (at, _) in &built {
                rows[self.row(axis, self.record_tile(*at))] = true;
            }
            rows
        });
        for (axis, rows) in rows.iter().enumerate() {
            self.sweep(axis, Some(rows), Sweep::Separate);
        }
        let growth: Vec<Growth> = built
            .into_iter()
            .map(|(at, new)| {
                let tile = self.record_tile(at);
                let profiles = |this: &Self| {
                    let record = this.records[at];
                    std::array::from_fn::<_, 3, _>(|axis| profile(this, tile, &record, axis))
                };
                let old = profiles(self);
                self.place(at, new);
                let mut grown = profiles(self);
                for (new, old) in grown
                    .as_flattened_mut()
                    .as_flattened_mut()
                    .iter_mut()
                    .zip(old.as_flattened().as_flattened())
                {
                    *new = new.wrapping_sub(*old);
                }
                Growth { tile, profile: grown }
            })
            .collect();
        self.link();
        for (axis, rows) in rows.iter().enumerate() {
            self.sweep(axis, Some(rows), Sweep::Accumulate);
            self.grow_edges(axis, &growth);
        }
    }

    /// True when a record already holds this constant tile.
    fn same(&self, at: usize, tile: &GroupTile) -> bool {
        let TileRecord { table, fill, .. } = self.records[at];
        match tile {
            GroupTile::Constant(lane) => {
                table == 0 && fill == std::array::from_fn::<u32, LANES, _>(|m| u32::from(*lane == Some(m)))
            }
            // Local tables leave the tile's last layers out, so equal ones prove nothing.
            GroupTile::Mixed(_) => false,
        }
    }

    /// Adds the growth of changed tiles to the counts along every edge that they lie behind.
    fn grow_edges(&mut self, axis: usize, growth: &[Growth]) {
        let (u, v) = across(axis);
        let (line, lines) = (self.dims[axis] * TILE, self.dims[u]);
        let mut by_plane: Vec<Vec<&Growth>> = vec![Vec::new(); self.dims[v]];
        for g in growth {
            by_plane[g.tile[v]].push(g);
        }
        let mut sums = vec![[0; LANES]; self.records.len() * TILE];
        // Growth of the planes of tiles before the one in hand, summed along and across lines.
        let mut total = vec![[0; LANES]; line * lines];
        for (plane, grown) in sums.chunks_exact_mut(line * lines).zip(by_plane) {
            plane.copy_from_slice(&total);
            if grown.is_empty() {
                continue;
            }
            let mut columns = vec![[0; LANES]; line * lines];
            for g in grown {
                let column = &mut columns[g.tile[u] * line..(g.tile[u] + 1) * line];
                let start = g.tile[axis] * TILE;
                for (i, value) in column[start..].iter_mut().enumerate().skip(1) {
                    add(value, &g.profile[axis][(i - 1).min(TILE - 1)]);
                }
            }
            // A line counts the tile columns before it.
            let mut before = vec![[0; LANES]; line];
            for (column, total) in columns.chunks_exact(line).zip(total.chunks_exact_mut(line)) {
                for ((before, total), value) in before.iter_mut().zip(total).zip(column) {
                    add(total, before);
                    add(before, value);
                }
            }
        }
        self.add_edges(axis, &sums);
    }
}
