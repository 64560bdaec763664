//! Sums at cell corners, for one plane of corners and a batch of points at a time, and the
//! conversion of counts to features.
//!
//! A corner of a level above the first lies half a voxel off the voxel corners. The sum there, in
//! eighths of a voxel, is the sum of the table over the 2 x 2 x 2 voxel corners around it.
//!
//! The AVX-512 form is chosen at run time; the scalar form is its twin under the same tests. All
//! unsafe code of the crate is in [`avx512`] and [`wide`].

#[cfg(target_arch = "x86_64")]
mod avx512;
mod lattice;
pub(crate) mod packed;
mod scalar;
#[cfg(target_arch = "x86_64")]
mod wide;

use pellucid_core::InstructionSet;
use pellucid_voxel::sat::tables::CountTables;
#[cfg(target_arch = "x86_64")]
use pellucid_voxel::sat::tables::LANES;

use crate::axis::{Axis, Set, each};

pub(crate) use lattice::{Cells, Pass};

/// Sums of the five materials of a group; the three spare lanes are undefined.
pub(crate) type Sums = [u32; 8];

/// The corners of one plane: all along x and y, the `k`-th along z.
pub(crate) struct Plane<'a> {
    pub tables: &'a CountTables,
    pub axes: &'a [Axis; 3],
    /// Corners along `[x, y]`.
    pub n: [usize; 2],
    pub k: usize,
}

/// Fills `sums`, ordered `[point][y corner][x corner]`, where nothing must be looked up, and calls
/// `look_up(i, j, word, points, splits)` with the corner and sets of the other points: 64 from
/// `64 word` on, and those of them that reach into the next tile along each axis.
#[inline(always)]
fn each_corner(
    plane: &Plane,
    sums: &mut [Sums],
    mut look_up: impl FnMut(&mut [Sums], [usize; 3], u64, [u64; 3]),
) {
    let [nx, ny] = plane.n;
    let [ax, ay, az] = plane.axes;
    let words = az.points().div_ceil(64);
    for j in 0..ny {
        for i in 0..nx {
            let at = j * nx + i;
            for word in 0..words {
                // Where the plane counts the same as the one before it, that one's sums stay.
                let open = az.all(word) & !az.set(plane.k, Set::Same, word);
                let zero = az.set(plane.k, Set::Zero, word)
                    | ax.set(i, Set::Zero, word)
                    | ay.set(j, Set::Zero, word);
                let same_x = ax.set(i, Set::Same, word) & !zero;
                let same_y = ay.set(j, Set::Same, word) & !zero & !same_x;
                let start = |p: usize| (64 * word + p) * nx * ny + at;
                each(open & zero, |p| sums[start(p)] = [0; 8]);
                each(open & same_x, |p| sums[start(p)] = sums[start(p) - 1]);
                each(open & same_y, |p| sums[start(p)] = sums[start(p) - nx]);
                let fresh = open & !zero & !same_x & !same_y;
                if fresh != 0 {
                    let splits = [
                        ax.set(i, Set::Split, word),
                        ay.set(j, Set::Split, word),
                        az.set(plane.k, Set::Split, word),
                    ];
                    look_up(sums, [i, j, word], fresh, splits);
                }
            }
        }
    }
}

/// Coefficients ordered `[material][channel][lane]`, each row padded with zeros to a multiple of
/// eight. A channel has `features` values in the next power of two of lanes.
pub(crate) struct Rows<'a> {
    pub values: &'a [f64],
    pub width: usize,
    /// 2 or 3.
    pub features: usize,
    /// Power of two that every value is multiplied by.
    pub factor: f64,
}

/// Which form of the kernels runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kernel {
    Scalar,
    #[cfg(target_arch = "x86_64")]
    Avx512(avx512::Avx512),
}

impl Kernel {
    /// The fastest form that is not above `set`.
    pub fn of(set: InstructionSet) -> Self {
        #[cfg(target_arch = "x86_64")]
        if set >= InstructionSet::Avx512
            && let Some(avx512) = avx512::Avx512::detect()
        {
            return Kernel::Avx512(avx512);
        }
        let _ = set;
        Kernel::Scalar
    }

    /// What it needs.
    pub fn instruction_set(self) -> InstructionSet {
        match self {
            Kernel::Scalar => InstructionSet::Portable,
            #[cfg(target_arch = "x86_64")]
            Kernel::Avx512(_) => InstructionSet::Avx512,
        }
    }

    /// Fills `sums`, ordered `[point][y corner][x corner]`. Where the plane counts the same as the
    /// one before it, that one's sums must still be in place.
    pub fn corner_sums(self, plane: &Plane, sums: &mut [Sums]) {
        match self {
            Kernel::Scalar => scalar::corner_sums(plane, sums),
            #[cfg(target_arch = "x86_64")]
            Kernel::Avx512(avx512) => avx512.corner_sums(plane, sums),
        }
    }

    /// Differences of one point's plane of corner sums, `nx + 1` by `ny + 1`, against the plane
    /// before: `columns` holds the latter's differences and gets the new ones, `cells` gets the
    /// counts of the cells between.
    pub fn cell_counts(self, nx: usize, sums: &[Sums], columns: &mut [Sums], cells: &mut [Sums]) {
        match self {
            Kernel::Scalar => scalar::cell_counts(nx, sums, columns, cells),
            #[cfg(target_arch = "x86_64")]
            Kernel::Avx512(avx512) => avx512.cell_counts(nx, sums, columns, cells),
        }
    }

    /// [`lattice::plane_sums`].
    pub fn plane_sums(
        self,
        pass: &mut Pass,
        points: usize,
        k: usize,
        lead: [usize; 2],
        width: usize,
        sums: &mut [Sums],
    ) {
        match self {
            Kernel::Scalar => lattice::plane_sums(scalar::Plain, pass, points, k, lead, width, sums),
            #[cfg(target_arch = "x86_64")]
            Kernel::Avx512(avx512) => avx512.plane_sums(pass, points, k, lead, width, sums),
        }
    }

    /// [`lattice::plane_cells`].
    pub fn plane_cells(self, planes: &Cells, sums: &[Sums], columns: &mut [Sums], counts: &mut [Sums]) {
        match self {
            Kernel::Scalar => lattice::plane_cells(planes, sums, columns, counts),
            #[cfg(target_arch = "x86_64")]
            Kernel::Avx512(avx512) => avx512.plane_cells(planes, sums, columns, counts),
        }
    }

    /// [`packed::sum_labels`].
    pub fn window_sums(
        self,
        size: [usize; 3],
        labels: &[u8],
        units: &[u64; 256],
        pair: &mut Vec<u64>,
        sums: &mut [u64],
    ) {
        match self {
            Kernel::Scalar => packed::sum_labels(size, labels, units, pair, sums),
            #[cfg(target_arch = "x86_64")]
            Kernel::Avx512(avx512) => avx512.window_sums(size, labels, units, pair, sums),
        }
    }

    /// [`packed::cells_between`].
    pub fn window_cells(self, n: [usize; 3], strides: [usize; 3], sums: &[u64], cells: &mut [u64]) {
        match self {
            Kernel::Scalar => packed::cells_between(n, strides, sums, cells),
            #[cfg(target_arch = "x86_64")]
            Kernel::Avx512(avx512) => avx512.window_cells(n, strides, sums, cells),
        }
    }

    /// [`packed::unpack`] of each word.
    pub fn unpack(self, words: &[u64], cells: &mut [Sums]) {
        match self {
            Kernel::Scalar => words.iter().zip(cells).for_each(|(word, cell)| *cell = packed::unpack(*word)),
            #[cfg(target_arch = "x86_64")]
            Kernel::Avx512(avx512) => avx512.unpack(words, cells),
        }
    }

    /// Adds up counts times coefficients: `counts` ordered `[group][cell]`, the features of the
    /// `cells` cells in a row from each channel's start in `out`.
    pub fn features(
        self,
        rows: &Rows,
        materials: usize,
        counts: &[Sums],
        cells: usize,
        starts: impl Iterator<Item = usize>,
        out: &mut [f32],
    ) {
        #[cfg(target_arch = "x86_64")]
        if let Kernel::Avx512(avx512) = self
            && (rows.features, materials.div_ceil(LANES)) == (2, 1)
            && cells >= 8
        {
            avx512.paired_features(rows, materials, &counts[..cells], starts, out);
            return;
        }
        let lanes = rows.features.next_power_of_two();
        let mut starts = starts.fuse();
        for at in (0..rows.width).step_by(8) {
            // The channels in eight lanes: two or four, fewer at the end.
            let channels: [Option<usize>; 4] =
                std::array::from_fn(|i| if i < 8 / lanes { starts.next() } else { None });
            match self {
                Kernel::Scalar => scalar::features(rows, materials, at, counts, cells, channels, out),
                #[cfg(target_arch = "x86_64")]
                Kernel::Avx512(avx512) => avx512.features(rows, materials, at, counts, cells, channels, out),
            }
        }
    }
}

#[cfg(test)]
mod tests;
