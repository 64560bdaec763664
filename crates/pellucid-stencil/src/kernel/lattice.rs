//! Corner sums and cell counts of points whose corners lie in the same tiles; see
//! [`crate::lattice`].
//!
//! Corner by corner for all points: what they look up lies close together, in one tile.

use pellucid_voxel::TILE;
use pellucid_voxel::sat::tables::{BAR, CountTables, INNER, LANES, Lanes, TileTables};

use super::Sums;
use crate::axis::each;
use crate::lattice::{BarAt, Corner, Corners, Lattice, LocalAt, Looks, Member, Places, Site, across};

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

/// A lattice and the points that look it up, with buffers.
pub(crate) struct Pass<'a> {
    lattice: Lattice<'a>,
    places: Places,
    /// The number of each point in its group.
    slots: Vec<u32>,
    /// Of corners in the midst of the grid.
    looks: Looks,
    /// Of one that is not.
    odd: Looks,
    /// Sums of bars for each pair of places: the bar along x, those along y of a row, those along z
    /// of a plane.
    bars: [Vec<Sums>; 3],
}

impl<'a> Pass<'a> {
    /// Those of `group` that reach into the next tile along the axes whose bit is set in `next`;
    /// those of them that reach into no other come first in the group. `None` when there is none.
    pub fn new(
        tables: &'a CountTables,
        size: [u32; 3],
        axes: &[Corners; 3],
        group: &[Member],
        next: u8,
    ) -> Option<Self> {
        let slots: Vec<u32> =
            (0..group.len() as u32).filter(|&i| group[i as usize].split() & next == next).collect();
        if slots.is_empty() {
            return None;
        }
        let members: Vec<Member> = slots.iter().map(|&i| group[i as usize]).collect();
        let (lattice, places) = (Lattice::new(tables, size, axes, next), Places::new(&members));
        let mut looks = Looks::default();
        let regular = |a: usize| lattice.sites[a].iter().find(|s| s.regular());
        if let (Some(x), Some(y), Some(z)) = (regular(0), regular(1), regular(2)) {
            places.looks([x, y, z], &mut looks);
        }
        let n: [usize; 3] = std::array::from_fn(|a| lattice.sites[a].len());
        let rows = [1, n[0], n[0] * n[1]];
        let bars = std::array::from_fn(|a| vec![Sums::default(); rows[a] * places.pairs(a)]);
        Some(Self { lattice, places, slots, looks, odd: Looks::default(), bars })
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
    points: usize,
    k: usize,
    lead: [usize; 2],
    width: usize,
    sums: &mut [Sums],
) {
    let Pass { lattice, places, slots, looks, odd, bars } = pass;
    let places = &*places;
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
                    bar_sums(clusters, bar, &looks.bars[a], rows[a]);
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
            let at = At { corner, next: next.and_then(|next| next.tables), sites, places, looks, bars: rows };
            let lines = at.lines();
            // The points of most groups count alike, and in order.
            let whole = if corner.regular && slots.len() == points { places.whole } else { 0 };
            for (p, sum) in sums[..whole].iter_mut().enumerate() {
                *sum = plus(*sum, at.whole(clusters, &lines, p));
            }
            for (p, &slot) in slots.iter().enumerate().skip(whole) {
                let sum = &mut sums[slot as usize];
                *sum = plus(*sum, at.scaled(clusters, &lines, p));
            }
        }
    }
}

#[inline(always)]
fn row(bars: &mut [Sums], number: usize, pairs: usize) -> &mut [Sums] {
    &mut bars[number * pairs..(number + 1) * pairs]
}

/// Sums of one bar for each pair of places.
#[inline(always)]
fn bar_sums(clusters: impl Clusters, bar: Option<&[Lanes; BAR]>, at: &[BarAt], out: &mut [Sums]) {
    match bar {
        Some(bar) => {
            for (at, out) in at.iter().zip(out) {
                *out = clusters.bar(bar, at);
            }
        }
        None => out.fill(Sums::default()),
    }
}

/// What the points sum at one corner.
struct At<'a> {
    corner: &'a Corner<'a>,
    /// What the next corner looks up.
    next: Option<&'a TileTables>,
    sites: [&'a Site; 3],
    places: &'a Places,
    looks: &'a Looks,
    /// Sums of bars, one a pair of places.
    bars: [&'a [Sums]; 3],
}

impl At<'_> {
    /// What each place counts along the edge of each axis.
    #[inline(always)]
    fn lines(&self) -> [[Sums; TILE]; 3] {
        let mut lines = [[Sums::default(); TILE]; 3];
        for (a, lines) in lines.iter_mut().enumerate() {
            let edges = &self.corner.record.edges[a];
            each(self.places.used[a].into(), |place| {
                let (local, count) = self.sites[a].local(place as u8);
                let mut line = wide(&edges[local & INNER]);
                if count > 1 {
                    line = plus(line, wide(&edges[(local + 1) & INNER]));
                }
                lines[place & INNER] = line;
            });
        }
        lines
    }

    #[inline(always)]
    fn line(&self, lines: &[[Sums; TILE]; 3], axis: usize, p: usize) -> Sums {
        lines[axis][usize::from(self.places.places[p][axis]) & INNER]
    }

    #[inline(always)]
    fn bar(&self, axis: usize, p: usize) -> Sums {
        self.bars[axis][usize::from(self.places.pair[axis][p])]
    }

    /// What constant tiles count.
    #[inline(always)]
    fn filled(&self, p: usize) -> Sums {
        if !self.corner.filled {
            return Sums::default();
        }
        let (record, [x, y, z, all]) = (self.corner.record, self.looks.weights[p]);
        let depth = |a: usize, by: u32| times(wide(&record.depth[a]), by);
        plus(plus(depth(0, x), depth(1, y)), plus(depth(2, z), times(wide(&record.fill), all)))
    }

    /// What the tile itself counts, where it is mixed. Asks for what the next corner looks up.
    #[inline(always)]
    fn local(&self, clusters: impl Clusters, p: usize) -> Sums {
        if let Some(next) = self.next {
            clusters.ask_local(next, &self.looks.locals[p]);
        }
        match self.corner.tables {
            Some(tables) if self.sites.iter().all(|s| s.inner()) => {
                clusters.local(tables, &self.looks.locals[p])
            }
            _ => Sums::default(),
        }
    }

    /// The sum of a point whose cluster lies within the tile, in the midst of the grid.
    #[inline(always)]
    fn whole(&self, clusters: impl Clusters, lines: &[[Sums; TILE]; 3], p: usize) -> Sums {
        let line = plus(plus(self.line(lines, 0, p), self.line(lines, 1, p)), self.line(lines, 2, p));
        let bar = plus(plus(self.bar(0, p), self.bar(1, p)), self.bar(2, p));
        let twice = plus(plus(line, line), bar);
        plus(plus(twice, twice), plus(self.filled(p), self.local(clusters, p)))
    }

    /// The sum of any point.
    #[inline(always)]
    fn scaled(&self, clusters: impl Clusters, lines: &[[Sums; TILE]; 3], p: usize) -> Sums {
        let scales = &self.looks.scales[p];
        let mut sum = plus(self.filled(p), times(self.local(clusters, p), scales.local));
        for a in 0..3 {
            sum = plus(sum, times(self.line(lines, a, p), scales.lines[a]));
            sum = plus(sum, times(self.bar(a, p), scales.bars[a]));
        }
        sum
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
