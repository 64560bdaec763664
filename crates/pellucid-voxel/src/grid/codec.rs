//! Label grids as compact bytes, to send or to keep.
//!
//! Little-endian: eight bytes of magic and version, origin and pitch in mm (3 + 3 f64), size in voxels (3 u32), the
//! tiles in list order, and a checksum (u64) of all before it. Tiles are one of
//!
//! - `0`, a count and a label: so many constant tiles;
//! - `1` and pairs of a count and a label until 4096 voxels are told: a tile in runs along `[z][y][x]`;
//! - `2`, the number of labels less 1, the labels ascending, and 4096 positions among them in as few bits as that
//!   takes, lowest first: a tile of a halftone.
//!
//! Counts are LEB128. Of the last two the shorter one is written, so equal grids have equal bytes.

use pellucid_core::random::mix;

use super::codec_reader::{CONSTANT, PACKED, RUNS, Reader, Token, bits_for, damaged};
use super::{inside, normalised, rows, tile_coords};
use crate::{Frame, LabelGrid, Pitch, TILE_VOXELS, Tile, VoxelError};

const MAGIC: [u8; 8] = *b"PELGRID\x01";
const HEADER: usize = 8 + 6 * 8 + 3 * 4;
const CHECKSUM: usize = 8;

impl LabelGrid {
    /// The grid as bytes: the same for equal grids, whichever way their tiles are stored.
    ///
    /// ```
    /// use pellucid_voxel::{Frame, LabelGrid, Pitch};
    /// let frame = Frame::new([0.0; 3], Pitch::j750(), [100, 100, 100])?;
    /// let grid = LabelGrid::from_fn(frame, |[x, ..]| u8::from(x > 50));
    /// let bytes = grid.encode();
    /// assert!(bytes.len() < 100 * 100 * 100 / 10);
    /// assert!(LabelGrid::decode(&bytes, 1 << 20)? == grid);
    /// # Ok::<(), pellucid_voxel::VoxelError>(())
    /// ```
    pub fn encode(&self) -> Vec<u8> {
        let frame = self.frame();
        let mut out = MAGIC.to_vec();
        for v in frame.origin_mm().into_iter().chain(frame.pitch().mm()) {
            out.extend(v.to_le_bytes());
        }
        for v in frame.size() {
            out.extend(v.to_le_bytes());
        }
        let mut run: Option<(u8, u64)> = None;
        for (i, tile) in self.tiles().iter().enumerate() {
            let inside = inside(tile_coords(self.tile_dims(), i), frame.size());
            match (constant(tile, inside), tile) {
                (Some(label), _) => match &mut run {
                    Some((of, count)) if *of == label => *count += 1,
                    _ => {
                        put_run(&mut out, run.replace((label, 1)));
                    }
                },
                (None, Tile::Dense(labels)) => {
                    put_run(&mut out, run.take());
                    put_dense(&mut out, labels);
                }
                (None, Tile::Constant(_)) => unreachable!("a constant tile is constant within any frame"),
            }
        }
        put_run(&mut out, run);
        let sum = checksum(&out);
        out.extend(sum.to_le_bytes());
        out
    }

    /// The grid that [`LabelGrid::encode`] wrote, when it takes at most `max_bytes` of memory.
    ///
    /// Bytes that are cut, changed or made by somebody else are refused; nothing is allocated before all of them were
    /// read once, so that a short input cannot ask for more than `max_bytes`.
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] for anything but a whole encoded grid, [`VoxelError::Unsupported`] for a frame past
    /// the limits of [`Frame`] or more than `max_bytes`.
    pub fn decode(bytes: &[u8], max_bytes: u64) -> Result<Self, VoxelError> {
        let (frame, body) = open(bytes)?;
        let size = frame.size();
        let dims = size.map(|s| s.div_ceil(super::TILE as u32));
        let count: u64 = dims.iter().map(|&d| u64::from(d)).product();
        let dense = count_dense(body, count)?;
        let needed = count * size_of::<Tile>() as u64 + dense * TILE_VOXELS as u64;
        if needed > max_bytes {
            return Err(VoxelError::unsupported(
                "encoded grid",
                format!("takes {needed} bytes of memory; {max_bytes} are allowed"),
            ));
        }
        let mut tiles = Vec::with_capacity(count as usize);
        let mut reader = Reader::new(body);
        while let Some(token) = reader.token()? {
            match token {
                Token::Constant { count, label } => {
                    tiles.extend(std::iter::repeat_with(|| Tile::Constant(label)).take(count as usize));
                }
                Token::Dense(labels) => {
                    let inside = inside(tile_coords(dims, tiles.len()), size);
                    tiles.push(normalised(Tile::Dense(labels.expand()?), inside));
                }
            }
        }
        Ok(Self { frame, tile_dims: dims, tiles })
    }
}

/// The frame, and the bytes of the tiles.
fn open(bytes: &[u8]) -> Result<(Frame, &[u8]), VoxelError> {
    if bytes.get(..MAGIC.len()).is_none_or(|magic| magic != MAGIC) {
        return Err(damaged("does not start as one of this version does"));
    }
    let Some((content, sum)) = bytes.split_last_chunk::<CHECKSUM>().filter(|(c, _)| c.len() >= HEADER) else {
        return Err(damaged("ends early"));
    };
    if checksum(content) != u64::from_le_bytes(*sum) {
        return Err(damaged("its checksum is not that of its bytes; it was cut or changed"));
    }
    let (header, body) = content.split_at(HEADER);
    let mut reader = Reader::new(&header[MAGIC.len()..]);
    let mut mm = [0.0; 6];
    for v in &mut mm {
        *v = f64::from_le_bytes(reader.array()?);
    }
    let mut size = [0; 3];
    for v in &mut size {
        *v = u32::from_le_bytes(reader.array()?);
    }
    let frame = Frame::new([mm[0], mm[1], mm[2]], Pitch::new([mm[3], mm[4], mm[5]])?, size)?;
    Ok((frame, body))
}

/// Reads all tiles, checks that there are `count` and tells how many are dense.
fn count_dense(body: &[u8], count: u64) -> Result<u64, VoxelError> {
    let mut reader = Reader::new(body);
    let (mut tiles, mut dense) = (0u64, 0);
    while let Some(token) = reader.token()? {
        tiles = match token {
            Token::Constant { count, .. } => tiles.saturating_add(count),
            Token::Dense(_) => {
                dense += 1;
                tiles + 1
            }
        };
    }
    if tiles != count {
        return Err(damaged(&format!("holds {tiles} tiles where its frame has {count}")));
    }
    Ok(dense)
}

/// The label of a tile that is the same all over its part within the frame.
fn constant(tile: &Tile, inside: [usize; 3]) -> Option<u8> {
    match tile {
        Tile::Constant(label) => Some(*label),
        Tile::Dense(labels) => {
            let first = labels[0];
            rows(inside).all(|row| labels[row].iter().all(|&l| l == first)).then_some(first)
        }
    }
}

fn put_count(out: &mut Vec<u8>, mut count: u64) {
    while count >= 0x80 {
        out.push(count as u8 | 0x80);
        count >>= 7;
    }
    out.push(count as u8);
}

fn put_run(out: &mut Vec<u8>, run: Option<(u8, u64)>) {
    if let Some((label, count)) = run {
        out.push(CONSTANT);
        put_count(out, count);
        out.push(label);
    }
}

fn put_dense(out: &mut Vec<u8>, labels: &[u8; TILE_VOXELS]) {
    let mut used = [false; 256];
    labels.iter().for_each(|&l| used[usize::from(l)] = true);
    let palette: Vec<u8> = (0..=u8::MAX).filter(|&l| used[usize::from(l)]).collect();
    let bits = bits_for(palette.len());
    let packed = 2 + palette.len() + TILE_VOXELS * bits / 8;
    let start = out.len();
    out.push(RUNS);
    for run in labels.chunk_by(|a, b| a == b) {
        put_count(out, run.len() as u64);
        out.push(run[0]);
        if out.len() - start >= packed {
            break;
        }
    }
    if out.len() - start < packed {
        return;
    }
    out.truncate(start);
    out.push(PACKED);
    out.push((palette.len() - 1) as u8);
    out.extend(&palette);
    let mut position = [0u8; 256];
    palette.iter().enumerate().for_each(|(i, &l)| position[usize::from(l)] = i as u8);
    for eight in labels.as_chunks::<8>().0 {
        let word = eight.iter().rev().fold(0u64, |w, &l| w << bits | u64::from(position[usize::from(l)]));
        out.extend(&word.to_le_bytes()[..bits]);
    }
}

/// A mixing of all words: a changed word always shows, several with a chance of 2^-64 not to.
fn checksum(bytes: &[u8]) -> u64 {
    let (words, rest) = bytes.as_chunks::<8>();
    let mut last = [0; 8];
    last[..rest.len()].copy_from_slice(rest);
    let sum = words.iter().fold(bytes.len() as u64, |sum, word| mix(sum ^ u64::from_le_bytes(*word)));
    mix(sum ^ u64::from_le_bytes(last))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AIR, TILE};
    use proptest::prelude::*;

    const ROOM: u64 = 1 << 24;

    /// Air, a level block, a halftone of `inks` labels and a gradient, side by side.
    fn varied(size: [u32; 3], inks: u8, seed: u64) -> LabelGrid {
        let frame = Frame::new([0.5, -1.0, 2.0], Pitch::j750(), size).unwrap();
        LabelGrid::from_fn(frame, |[x, y, z]| match x / 16 {
            0 => 7,
            1 => {
                let key = u64::from(x) | u64::from(y) << 20 | u64::from(z) << 40;
                (mix(seed ^ key) % u64::from(inks)) as u8
            }
            2 => y as u8,
            _ => AIR,
        })
    }

    /// What `encode` would end with.
    fn sealed(mut content: Vec<u8>) -> Vec<u8> {
        let sum = checksum(&content);
        content.extend(sum.to_le_bytes());
        content
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn grids_come_back(
            size in [1u32..70, 1u32..40, 1u32..40], inks in prop_oneof![2u8..9, Just(200u8)], seed: u64,
        ) {
            let grid = varied(size, inks, seed);
            let bytes = grid.encode();
            let back = LabelGrid::decode(&bytes, ROOM).unwrap();
            prop_assert!(back == grid);
            prop_assert_eq!(back.memory_bytes(), grid.memory_bytes());
            // However its tiles are stored.
            let mut touched = grid.clone();
            let label = touched.get([0; 3]);
            touched.set([0; 3], label.wrapping_add(1));
            touched.set([0; 3], label);
            prop_assert_eq!(touched.encode(), bytes);
        }

        #[test]
        fn damage_shows(
            edits in prop::collection::vec((any::<prop::sample::Index>(), 1u8..), 1..6),
            cut in prop::option::of(any::<prop::sample::Index>()),
        ) {
            let mut bytes = varied([60, 20, 20], 6, 1).encode();
            let whole = bytes.clone();
            for (at, flip) in edits {
                let at = at.index(bytes.len());
                bytes[at] ^= flip;
            }
            if let Some(cut) = cut {
                bytes.truncate(cut.index(bytes.len()));
            }
            if bytes != whole {
                prop_assert!(matches!(LabelGrid::decode(&bytes, ROOM), Err(VoxelError::Invalid(_))));
            }
        }

        /// With a right checksum the content itself is checked: an error, or a grid within its frame.
        #[test]
        fn forged_content_is_a_grid_or_an_error(
            edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
            cut in prop::option::of(any::<prop::sample::Index>()),
        ) {
            let mut content = varied([60, 20, 20], 6, 1).encode();
            content.truncate(content.len() - CHECKSUM);
            for (at, value) in edits {
                let at = at.index(content.len());
                content[at] = value;
            }
            if let Some(cut) = cut {
                content.truncate(cut.index(content.len()));
            }
            match LabelGrid::decode(&sealed(content), ROOM) {
                Ok(grid) => {
                    prop_assert!(grid.memory_bytes() as u64 <= ROOM);
                    prop_assert_eq!(grid.histogram().iter().sum::<u64>(), grid.frame().voxels());
                    prop_assert!(LabelGrid::decode(&grid.encode(), ROOM).unwrap() == grid);
                }
                Err(error) => prop_assert!(!matches!(error, VoxelError::Cancelled)),
            }
        }
    }

    #[test]
    fn a_halftone_takes_the_bits_that_it_needs() {
        let frame = Frame::new([0.0; 3], Pitch::j750(), [160, 160, 160]).unwrap();
        let noise = |v: [u32; 3]| mix(v.iter().fold(7, |s, &c| mix(s ^ u64::from(c))));
        let grid = LabelGrid::from_fn(frame, |v| 1 + (noise(v) % 5) as u8);
        let voxels = 160 * 160 * 160;
        // Three bits for five labels, and a few bytes a tile.
        assert!(grid.encode().len() < voxels * 3 / 8 + 1000 * 8 + 100);
    }

    #[test]
    fn a_short_input_cannot_ask_for_memory() {
        let header = |size: [u32; 3]| {
            let mut content = LabelGrid::new(Frame::new([0.0; 3], Pitch::j750(), [1; 3]).unwrap()).encode();
            content.truncate(HEADER);
            content[HEADER - 12..].copy_from_slice(size.map(u32::to_le_bytes).as_flattened());
            content
        };
        let edge = 1 << 13;
        let mut content = header([edge; 3]);
        content.push(CONSTANT);
        put_count(&mut content, u64::from(edge / TILE as u32).pow(3));
        content.push(5);
        let error = LabelGrid::decode(&sealed(content.clone()), 1 << 30).unwrap_err();
        assert!(matches!(error, VoxelError::Unsupported(_)), "{error}");
        assert!(error.to_string().contains("2147483648 bytes"), "{error}");
        // Past what a frame may have, and tiles that are not told.
        assert!(matches!(
            LabelGrid::decode(&sealed(header([1 << 20; 3])), ROOM),
            Err(VoxelError::Unsupported(_))
        ));
        assert!(matches!(LabelGrid::decode(&sealed(header([edge; 3])), ROOM), Err(VoxelError::Invalid(_))));
        for kind in [RUNS, PACKED, 9] {
            let mut content = header([16; 3]);
            content.extend([kind, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff]);
            assert!(matches!(LabelGrid::decode(&sealed(content), ROOM), Err(VoxelError::Invalid(_))));
        }
        assert!(LabelGrid::decode(b"", ROOM).is_err());
        assert!(LabelGrid::decode(&MAGIC, ROOM).is_err());
    }
}
