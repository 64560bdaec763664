//! What a stream consists of.

use pellucid_trace::Boundary;

use crate::{DatasetError, Shard};

/// What a stream consists of.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamOptions {
    /// Samples a batch.
    pub batch: usize,
    /// Volumes whose samples are shuffled together, even.
    pub window: u32,
    /// Times that each window's samples are used, in another order and by the trainer mirrored otherwise each time.
    pub passes: u32,
    /// Surface points drawn from each volume; each is a sample in every channel.
    pub points: u32,
    /// Paths a point and channel of the labels.
    pub spp: u32,
    /// The object's surface.
    pub boundary: Boundary,
    /// Seed of the shuffle; volumes and labels follow from the recipe's.
    pub seed: u64,
    /// Threads that make samples in the background.
    pub threads: usize,
    /// Which of the volumes: every one of that remainder, where several trainers share them.
    pub share: Shard,
}

impl Default for StreamOptions {
    /// Batches of 256 from windows of 48 volumes with 1024 points, 64 paths a label, one thread: 1.1 GB.
    fn default() -> Self {
        Self {
            batch: 256,
            window: 48,
            passes: 1,
            points: 1024,
            spp: 64,
            boundary: Boundary::default(),
            seed: 0,
            threads: 1,
            share: Shard::WHOLE,
        }
    }
}

impl StreamOptions {
    /// Checks ranges.
    ///
    /// # Errors
    /// [`DatasetError::Invalid`] naming the field.
    pub fn check(&self) -> Result<(), DatasetError> {
        let positive = [
            ("batch", self.batch as u64),
            ("passes", u64::from(self.passes)),
            ("points", u64::from(self.points)),
            ("spp", u64::from(self.spp)),
            ("threads", self.threads as u64),
        ];
        if let Some((field, _)) = positive.iter().find(|(_, n)| *n == 0) {
            return Err(DatasetError::invalid(*field, "must be at least 1"));
        }
        Shard::new(self.share.index, self.share.count)?;
        if self.window < 2 || !self.window.is_multiple_of(2) {
            return Err(DatasetError::invalid("window", format!("{}; it must be even", self.window)));
        }
        Ok(())
    }
}
