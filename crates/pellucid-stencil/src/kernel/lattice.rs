//! Corner sums and cell counts of points whose corners lie in the same tiles; see
//! [`crate::lattice`].
//!
//! Corner by corner for all points: what they look up lies close together, in one tile.

use pellucid_voxel::TILE;
use pellucid_voxel::sat::tables::{BAR, INNER, LANES, Lanes, TileTables};

use super::Sums;
use crate::axis::each;
use crate::lattice::{BarAt, Corner, Lattice, LocalAt, Looks, Places, Site, across};

/// How entries around a corner are summed.
pub(super) trait Clusters: Copy {
    /// Over entries of a bar table.
    fn bar(self, bars: &[Lanes; BAR], at: &BarAt) -> Sums;
    /// Over counts within a tile.
    fn local(self, tables: &TileTables, at: &LocalAt) -> Sums;
    /// Asks for what `bar` looks up.
    fn ask_bar(self, bars: &[Lanes; BAR], at: &BarAt);
    /// Asks for what `local` looks up.
    fn ask_local(self, tables: &TileTables, at: &LocalAt);
}

/// One part of a group's clusters, with buffers.
pub(crate) struct Pass<'a> {
    pub lattice: Lattice<'a>,
    /// Of corners in the midst of the grid.
    looks: Looks,
    /// Of one that is not.
    odd: Looks,
    /// Sums of bars for each pair of places: the bar along x, those along y of a row, those along z
    /// of a plane.
    bars: [Vec<Sums>; 3],
}

impl<'a> Pass<'a> {
    pub fn new(lattice: Lattice<'a>, places: &Places) -> Self {
        let mut looks = Looks::default();
        let regular = |a: usize| lattice.sites[a].iter().find(|s| s.regular());
        if let (Some(x), Some(y), Some(z)) = (regular(0), regular(1), regular(2)) {
            places.looks([x, y, z], &mut looks);
        }
        let n: [usize; 3] = std::array::from_fn(|a| lattice.sites[a].len());
        let rows = [1, n[0], n[0] * n[1]];
        let bars = std::array::from_fn(|a| vec![Sums::default(); rows[a] * places.pairs(a)]);
        Self { lattice, looks, odd: Looks::default(), bars }
    }
}

#[inline(always)]
fn plus(a: Sums, b: Sums) -> Sums {
    std::array::from_fn(|m| a[m].wrapping_add(b[m]))
}

#[inline(always)]
fn times(a: Sums, by: u32) -> Sums {
    std::array::from_fn(|m| a[m].wrapping_mul(by))
}

#[inline(always)]
fn wide(counts: &Lanes) -> Sums {
    let mut out = [0; 8];
    out[..LANES].copy_from_slice(counts);
    out
}

/// Adds the sums of plane `k` to `sums`, ordered `[y][x][point]` with `width` corners a row, the
/// `lead`ing ones among them.
#[inline(always)]
pub(super) fn plane_sums(
    clusters: impl Clusters,
    pass: &mut Pass,
    places: &Places,
    k: usize,
    lead: [usize; 2],
    width: usize,
    sums: &mut [Sums],
) {
    let Pass { lattice, looks, odd, bars } = pass;
    let points = places.places.len();
    let [nx, ny] = [lattice.sites[0].len(), lattice.sites[1].len()];
    for j in 0..ny {
        for i in 0..nx {
            let sites = [&lattice.sites[0][i], &lattice.sites[1][j], &lattice.sites[2][k]];
            let at = (k * ny + j) * nx + i;
            let corner = &lattice.corners[at];
            let next = lattice.corners.get(at + 1);
            let looks = if corner.regular {
                &*looks
            } else {
                places.looks(sites, odd);
                &*odd
            };
            let [x, y, z] = bars;
            let rows = [&mut x[..], row(y, i, places.pairs(1)), row(z, j * nx + i, places.pairs(2))];
            for a in 0..3 {
                if !corner.repeats[a] {
                    let (u, v) = across(a);
                    let bar = corner.bars[a].filter(|_| sites[u].inner() && sites[v].inner());
                    bar_sums(clusters, bar, sites[a].count(), &looks.bars[a], rows[a]);
                }
                if let Some(bar) = next.filter(|next| !next.repeats[a]).and_then(|next| next.bars[a]) {
                    for at in &looks.bars[a] {
                        clusters.ask_bar(bar, at);
                    }
                }
            }
            let start = ((j + lead[1]) * width + i + lead[0]) * points;
            let sums = &mut sums[start..start + points];
            let rows = [&*rows[0], &*rows[1], &*rows[2]];
            corner_sums(clusters, [corner, next.unwrap_or(corner)], sites, places, looks, rows, sums);
        }
    }
}

#[inline(always)]
fn row(bars: &mut [Sums], number: usize, pairs: usize) -> &mut [Sums] {
    &mut bars[number * pairs..(number + 1) * pairs]
}

/// Sums of one bar for each pair of places.
#[inline(always)]
fn bar_sums(clusters: impl Clusters, bar: Option<&[Lanes; BAR]>, count: u32, at: &[BarAt], out: &mut [Sums]) {
    match bar {
        Some(bar) => {
            for (at, out) in at.iter().zip(out) {
                *out = times(clusters.bar(bar, at), count);
            }
        }
        None => out.fill(Sums::default()),
    }
}

/// Adds the sums of the first corner, one a point; asks for what the second looks up.
#[inline(always)]
fn corner_sums(
    clusters: impl Clusters,
    [corner, next]: [&Corner; 2],
    sites: [&Site; 3],
    places: &Places,
    looks: &Looks,
    bars: [&[Sums]; 3],
    sums: &mut [Sums],
) {
    let record = corner.record;
    // What a place counts along the edge of each axis.
    let mut lines = [[Sums::default(); TILE]; 3];
    for (a, lines) in lines.iter_mut().enumerate() {
        let (u, v) = across(a);
        let across = sites[u].count() * sites[v].count();
        each(places.used[a].into(), |place| {
            let (local, count) = sites[a].local(place as u8);
            let mut line = wide(&record.edges[a][local & INNER]);
            if count > 1 {
                line = plus(line, wide(&record.edges[a][(local + 1) & INNER]));
            }
            lines[place & INNER] = times(line, across);
        });
    }
    let doubled = sites.iter().map(|s| s.doublings()).sum::<u32>();
    let depth = record.depth.map(|d| wide(&d));
    let fill = wide(&record.fill);
    let tables = corner.tables.filter(|_| sites.iter().all(|s| s.inner()));
    let next = next.tables;
    for (p, sum) in sums.iter_mut().enumerate() {
        if let Some(next) = next {
            clusters.ask_local(next, &looks.locals[p]);
        }
        let place = places.places[p].map(|l| usize::from(l) & INNER);
        let line = plus(plus(lines[0][place[0]], lines[1][place[1]]), lines[2][place[2]]);
        let bar = |a: usize| bars[a][usize::from(places.pair[a][p])];
        let mut total = plus(plus(line, bar(0)), plus(bar(1), bar(2)));
        if corner.filled {
            let [x, y, z, all] = looks.weights[p];
            let behind = plus(times(depth[0], x), times(depth[1], y));
            total = plus(total, plus(behind, plus(times(depth[2], z), times(fill, all))));
        }
        if let Some(tables) = tables {
            total = plus(total, clusters.local(tables, &looks.locals[p]));
        }
        *sum = plus(*sum, std::array::from_fn(|m| total[m] << doubled));
    }
}

/// The cells of one layer that a group of points has between two planes of corners.
pub(crate) struct Cells {
    /// Corners along x and y, the leading ones among them.
    pub corners: [usize; 2],
    pub points: usize,
    /// The first cell's place in a layer.
    pub first: usize,
    /// Cells along x in a layer.
    pub width: usize,
    /// Counts of a point.
    pub stride: usize,
}

/// Differences of a plane of corner sums, ordered `[y][x][point]`, against the plane before:
/// `columns` holds the latter's differences, ordered `[y][x][point]` over cells, and gets the new
/// ones; `counts` gets those of the cells between.
#[inline(always)]
pub(super) fn plane_cells(cells: &Cells, sums: &[Sums], columns: &mut [Sums], counts: &mut [Sums]) {
    let ([mx, my], points) = (cells.corners, cells.points);
    let corner = |j: usize, i: usize| &sums[(j * mx + i) * points..][..points];
    for j in 0..my - 1 {
        for i in 0..mx - 1 {
            let (a, b, c, d) = (corner(j, i), corner(j, i + 1), corner(j + 1, i), corner(j + 1, i + 1));
            let columns = &mut columns[(j * (mx - 1) + i) * points..][..points];
            let cell = cells.first + j * cells.width + i;
            for p in 0..points {
                let new: Sums = std::array::from_fn(|m| {
                    d[p][m].wrapping_sub(c[p][m]).wrapping_sub(b[p][m]).wrapping_add(a[p][m])
                });
                counts[p * cells.stride + cell] = std::array::from_fn(|m| new[m].wrapping_sub(columns[p][m]));
                columns[p] = new;
            }
        }
    }
}
