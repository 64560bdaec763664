//! Reads the tiles of an encoded grid without trust.

use crate::{AIR, TILE_VOXELS, VoxelError};

pub(super) const CONSTANT: u8 = 0;
pub(super) const RUNS: u8 = 1;
pub(super) const PACKED: u8 = 2;

pub(super) fn damaged(reason: &str) -> VoxelError {
    VoxelError::invalid("encoded grid", reason)
}

/// Bits that tell one of `labels` labels.
pub(super) fn bits_for(labels: usize) -> usize {
    (labels.max(2) - 1).ilog2() as usize + 1
}

/// What a reader found.
pub(super) enum Token<'a> {
    Constant { count: u64, label: u8 },
    Dense(Dense<'a>),
}

/// A dense tile's bytes, whose length was checked.
pub(super) enum Dense<'a> {
    Runs(&'a [u8]),
    Packed { palette: &'a [u8], words: &'a [u8] },
}

impl Dense<'_> {
    /// One label a voxel.
    pub(super) fn expand(self) -> Result<Box<[u8; TILE_VOXELS]>, VoxelError> {
        let mut labels = Box::new([AIR; TILE_VOXELS]);
        match self {
            Self::Runs(bytes) => {
                let mut reader = Reader::new(bytes);
                let mut at = 0;
                while at < TILE_VOXELS {
                    let count = reader.count()? as usize;
                    labels[at..at + count].fill(reader.byte()?);
                    at += count;
                }
            }
            Self::Packed { palette, words } => {
                let bits = bits_for(palette.len());
                for (eight, bytes) in labels.as_chunks_mut::<8>().0.iter_mut().zip(words.chunks_exact(bits)) {
                    let mut word = [0; 8];
                    word[..bits].copy_from_slice(bytes);
                    let mut word = u64::from_le_bytes(word);
                    for label in eight {
                        let position = (word & ((1 << bits) - 1)) as usize;
                        *label = *palette.get(position).ok_or_else(|| damaged("a label is not listed"))?;
                        word >>= bits;
                    }
                }
            }
        }
        Ok(labels)
    }
}

/// Takes bytes from the front.
pub(super) struct Reader<'a> {
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], VoxelError> {
        let (taken, rest) = self.rest.split_at_checked(count).ok_or_else(|| damaged("ends within a tile"))?;
        self.rest = rest;
        Ok(taken)
    }

    pub(super) fn array<const N: usize>(&mut self) -> Result<[u8; N], VoxelError> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N)?);
        Ok(out)
    }

    fn byte(&mut self) -> Result<u8, VoxelError> {
        self.array().map(|[byte]| byte)
    }

    /// A count of at least 1 and below 2^42, as no frame has more tiles.
    fn count(&mut self) -> Result<u64, VoxelError> {
        let mut count = 0;
        for shift in (0..42).step_by(7) {
            let byte = self.byte()?;
            count |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return if count == 0 { Err(damaged("a count is 0")) } else { Ok(count) };
            }
        }
        Err(damaged("a count is too long"))
    }

    /// The next tiles; `None` at the end.
    pub(super) fn token(&mut self) -> Result<Option<Token<'a>>, VoxelError> {
        if self.rest.is_empty() {
            return Ok(None);
        }
        let token = match self.byte()? {
            CONSTANT => Token::Constant { count: self.count()?, label: self.byte()? },
            RUNS => {
                let start = self.rest;
                let mut told = 0;
                while told < TILE_VOXELS as u64 {
                    told += self.count()?;
                    self.byte()?;
                }
                if told > TILE_VOXELS as u64 {
                    return Err(damaged("a tile's runs pass its end"));
                }
                Token::Dense(Dense::Runs(&start[..start.len() - self.rest.len()]))
            }
            PACKED => {
                let labels = usize::from(self.byte()?) + 1;
                let palette = self.take(labels)?;
                Token::Dense(Dense::Packed { palette, words: self.take(TILE_VOXELS * bits_for(labels) / 8)? })
            }
            _ => return Err(damaged("a tile is of no known kind")),
        };
        Ok(Some(token))
    }
}
