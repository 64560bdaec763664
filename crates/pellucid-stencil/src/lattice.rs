//! Corners of the levels whose cells are whole tiles long.
//!
//! There all corners of a point have the same place within their tiles, and points of one tile
//! have their corners in the same tiles. So what a corner looks up is found once for all points of
//! a tile, and a bar that several corners in a row have behind them (only constant tiles lie
//! between) is summed once for all of those.
//!
//! A corner's cluster of voxel corners has two along each axis. From the last place of a tile the
//! second lies in the next tile: it is left out here and added by a lattice of the next tiles.

use pellucid_voxel::TILE;
use pellucid_voxel::sat::tables::{BAR, CountTables, INNER, Lanes, TileRecord, TileTables};

use crate::axis::Extent;

/// A point of a group.
#[derive(Clone, Copy)]
pub(crate) struct Member {
    /// The tile of its first corner.
    pub tile: [i32; 3],
    /// The place of its corners within their tiles.
    pub place: [u8; 3],
    /// Its number among the points given.
    pub index: u32,
}

impl Member {
    /// A point whose cells are `edge` voxels long, whole tiles.
    pub fn new(point: [u32; 3], index: usize, cells: [usize; 3], edge: u32) -> Self {
        let first: [i64; 3] =
            std::array::from_fn(|a| i64::from(point[a]) - i64::from(edge) * cells[a] as i64 / 2);
        Self {
            tile: first.map(|v| v.div_euclid(TILE as i64) as i32),
            place: first.map(|v| v.rem_euclid(TILE as i64) as u8),
            index: index as u32,
        }
    }

    /// Along which axes its clusters reach into the next tile, one bit an axis.
    pub fn split(&self) -> u8 {
        (0..3).map(|a| u8::from(usize::from(self.place[a]) == INNER) << a).sum()
    }
}

/// Where one corner's clusters lie along one axis.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Site {
    tile: u32,
    /// The one place counted, where it is not the point's own with the next one.
    single: Option<u8>,
    /// Beyond the table both voxel corners count what its end counts.
    doubled: bool,
    /// Voxels of the tile within the grid.
    inside: u8,
}

impl Site {
    /// True when points are summed as in the midst of the grid.
    pub fn regular(&self) -> bool {
        !self.doubled && usize::from(self.inside) == TILE
    }

    /// True past the table, whose end is looked up instead.
    fn beyond(&self) -> bool {
        self.single == Some(INNER as u8)
    }

    /// The place within the tile, and how many from there on.
    #[inline(always)]
    pub fn local(&self, place: u8) -> (usize, usize) {
        match self.single {
            Some(single) => (single.into(), 1),
            None => (place.into(), if usize::from(place) == INNER { 1 } else { 2 }),
        }
    }

    /// False at the first place of a tile alone, where bars and counts within the tile are none.
    #[inline(always)]
    pub fn inner(&self) -> bool {
        self.single != Some(0)
    }

    /// How often all that is counted counts.
    fn times(&self, place: u8) -> u32 {
        if self.doubled && usize::from(place) != INNER { 2 } else { 1 }
    }

    /// Voxels of the tile before each voxel corner, added.
    #[inline(always)]
    fn before(&self, place: u8) -> u32 {
        let (local, count) = self.local(place);
        (local..local + count).map(|l| l.min(self.inside.into()) as u32).sum()
    }
}

/// The corners of one axis that must be looked up.
pub(crate) struct Corners {
    /// The first of the level's cells that can hold something.
    pub first_cell: usize,
    /// A corner with nothing before it comes first.
    pub lead: bool,
    /// The tiles of the corners after it.
    pub tiles: Vec<i64>,
}

impl Corners {
    /// Corners of `cells` cells, `edge` voxels long (whole tiles), the first in tile `first`. `None`
    /// when all cells lie beyond the bounds.
    pub fn new(cells: usize, edge: u32, first: i64, extent: Extent) -> Option<Self> {
        let (low, high, size) = (i64::from(extent.low), i64::from(extent.high), TILE as i64);
        let tile = |corner: usize| first + i64::from(edge) / size * corner as i64;
        let zero = (0..=cells).take_while(|&c| size * (tile(c) + 1) <= low).count();
        let near = (0..=cells).take_while(|&c| size * tile(c) < high).count();
        if zero > cells || near == 0 {
            return None;
        }
        // From the bound on all corners count the same: one is enough.
        let tiles = (zero..=near.min(cells)).map(tile).collect();
        Some(Self { first_cell: zero.saturating_sub(1), lead: zero > 0, tiles })
    }

    /// Corners with the leading one.
    pub fn len(&self) -> usize {
        self.tiles.len() + usize::from(self.lead)
    }

    /// Where the corners' clusters lie, or what of them lies in the next tiles.
    fn sites(&self, next: bool, size: u32, dim: usize) -> Vec<Site> {
        let last = dim as i64 - 1;
        let site = |tile: i64| {
            let tile = tile + i64::from(next);
            let at = tile.min(last);
            let inside = (i64::from(size) - at * TILE as i64).clamp(0, TILE as i64) as u8;
            // The table's last place lies past the grid.
            let single = if tile > last { Some(INNER as u8) } else { next.then_some(0) };
            Site { tile: at as u32, single, doubled: tile > last && !next, inside }
        };
        self.tiles.iter().map(|&tile| site(tile)).collect()
    }
}

/// What one corner looks up.
pub(crate) struct Corner<'a> {
    pub record: &'a TileRecord,
    pub tables: Option<&'a TileTables>,
    /// Per axis, the bar behind, where there is one.
    pub bars: [Option<&'a [Lanes; BAR]>; 3],
    /// Per axis, whether the corner before has the same bar.
    pub repeats: [bool; 3],
    /// Whether constant tiles lie behind or the tile is one.
    pub filled: bool,
    /// Whether points are summed as in the midst of the grid.
    pub regular: bool,
}

/// All corners of a group of points, or of those that reach into the next tiles.
pub(crate) struct Lattice<'a> {
    pub sites: [Vec<Site>; 3],
    /// Ordered `[z][y][x]`.
    pub corners: Vec<Corner<'a>>,
}

/// The axes across a bar along `axis`, the faster one first.
#[inline(always)]
pub(crate) const fn across(axis: usize) -> (usize, usize) {
    [(1, 2), (0, 2), (0, 1)][axis]
}

impl<'a> Lattice<'a> {
    /// Finds what the corners look up, in the next tiles along the axes whose bit is set in `next`.
    pub fn new(tables: &'a CountTables, size: [u32; 3], axes: &[Corners; 3], next: u8) -> Self {
        let sites: [Vec<Site>; 3] =
            std::array::from_fn(|a| axes[a].sites(next >> a & 1 == 1, size[a], tables.dims()[a]));
        let n: [usize; 3] = std::array::from_fn(|a| sites[a].len());
        let (strides, dims) = ([1, n[0], n[0] * n[1]], tables.strides());
        let midst = sites.iter().all(|sites| sites.iter().any(Site::regular));
        let mut corners: Vec<Corner> = Vec::with_capacity(n[0] * n[1] * n[2]);
        for k in 0..n[2] {
            for j in 0..n[1] {
                for i in 0..n[0] {
                    let c = [i, j, k];
                    let at: usize = (0..3).map(|a| sites[a][c[a]].tile as usize * dims[a]).sum();
                    let record = &tables.records()[at];
                    let repeats = std::array::from_fn(|a| {
                        c[a] > 0 && corners[corners.len() - strides[a]].record.behind[a] == record.behind[a]
                    });
                    let behind =
                        |a: usize| (record.behind[a] != 0).then(|| &tables.table(record.behind[a]).bars[a]);
                    let filled = record.fill.iter().chain(record.depth.as_flattened()).any(|&n| n > 0);
                    let site: [&Site; 3] = std::array::from_fn(|a| &sites[a][c[a]]);
                    corners.push(Corner {
                        record,
                        tables: (record.table != 0).then(|| tables.table(record.table)),
                        bars: [behind(0), behind(1), behind(2)],
                        repeats,
                        filled,
                        // The grid's end cuts only what constant tiles count.
                        regular: midst && site.iter().all(|s| s.regular() || !s.beyond() && !filled),
                    });
                }
            }
        }
        Self { sites, corners }
    }
}

/// Entries of a bar around a corner.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BarAt {
    /// Of the first place on both axes; one before and one row before it is added where `u` and
    /// `v` ask for it.
    pub entry: u16,
    /// All ones where the first place on the faster axis has an entry, and where there is a second.
    pub u: [u16; 2],
    /// The same of the slower axis.
    pub v: [u16; 2],
}

/// Counts within a tile around a corner.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LocalAt {
    pub entry: u16,
    /// As in [`BarAt`], per axis.
    pub axes: [[u8; 2]; 3],
}

/// Where the points of a group look within the tiles of a corner.
#[derive(Default)]
pub(crate) struct Looks {
    /// Per axis, for each pair of places across.
    pub bars: [Vec<BarAt>; 3],
    /// For each point.
    pub locals: Vec<LocalAt>,
    /// For each point, what a voxel line behind along each axis, and a full tile, count.
    pub weights: Vec<[u32; 4]>,
    /// For each point, how often its lines and bars along each axis, and its local counts, count.
    pub scales: Vec<Scales>,
}

/// How often sums count at a point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scales {
    pub lines: [u32; 3],
    pub bars: [u32; 3],
    pub local: u32,
}

/// The places of a group of points and what they have in common.
pub(crate) struct Places {
    pub places: Vec<[u8; 3]>,
    /// How many of them, the first ones, do not reach into a next tile.
    pub whole: usize,
    /// Per axis, the places that some point has.
    pub used: [u16; 3],
    /// Per axis, the different pairs of places across.
    pairs: [Vec<[u8; 2]>; 3],
    /// Per axis, which pair each point has.
    pub pair: [Vec<u16>; 3],
}

impl Places {
    pub fn new(members: &[Member]) -> Self {
        let places: Vec<[u8; 3]> = members.iter().map(|m| m.place).collect();
        let used = std::array::from_fn(|a| places.iter().fold(0, |bits, p| bits | 1u16 << p[a]));
        let mut pairs: [Vec<[u8; 2]>; 3] = Default::default();
        let pair = std::array::from_fn(|a| {
            let (u, v) = across(a);
            let mut number = [u16::MAX; TILE * TILE];
            places
                .iter()
                .map(|p| {
                    let number = &mut number[usize::from(p[v]) * TILE + usize::from(p[u])];
                    if *number == u16::MAX {
                        *number = pairs[a].len() as u16;
                        pairs[a].push([p[u], p[v]]);
                    }
                    *number
                })
                .collect()
        });
        let whole = members.iter().take_while(|m| m.split() == 0).count();
        Self { places, whole, used, pairs, pair }
    }

    /// How many different pairs there are across an axis.
    pub fn pairs(&self, axis: usize) -> usize {
        self.pairs[axis].len()
    }

    /// The looks into the tile of a corner at these sites.
    pub fn looks(&self, sites: [&Site; 3], looks: &mut Looks) {
        let ones =
            |local: usize, count: usize| [local > 0, count > 1].map(|on| if on { u16::MAX } else { 0 });
        for a in 0..3 {
            let (u, v) = across(a);
            looks.bars[a].clear();
            looks.bars[a].extend(self.pairs[a].iter().map(|pair| {
                let ((lu, nu), (lv, nv)) = (sites[u].local(pair[0]), sites[v].local(pair[1]));
                BarAt { entry: (lv * INNER + lu) as u16, u: ones(lu, nu), v: ones(lv, nv) }
            }));
        }
        looks.locals.clear();
        looks.weights.clear();
        looks.scales.clear();
        for place in &self.places {
            let local: [(usize, usize); 3] = std::array::from_fn(|a| sites[a].local(place[a]));
            let [x, y, z] = local.map(|(l, _)| l);
            looks.locals.push(LocalAt {
                entry: ((z * INNER + y) * INNER + x) as u16,
                axes: local.map(|(l, n)| ones(l, n).map(|on| on as u8)),
            });
            let all: u32 = (0..3).map(|a| sites[a].times(place[a])).product();
            let [bx, by, bz] = std::array::from_fn(|a| sites[a].before(place[a]));
            let [nx, ny, nz] = local.map(|(_, n)| all * n as u32);
            looks.weights.push([nx * by * bz, ny * bx * bz, nz * bx * by, all * bx * by * bz]);
            let [x, y, z] = local.map(|(_, n)| n as u32);
            let lines = [all * y * z, all * x * z, all * x * y];
            looks.scales.push(Scales { lines, bars: [nx, ny, nz], local: all });
        }
    }
}
