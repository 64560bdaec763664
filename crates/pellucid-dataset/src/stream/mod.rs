//! An endless stream of training batches, of fresh volumes made while they are used or of a stored set.

mod block;
mod options;
mod prints;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use pellucid_stencil::FirstFlight;
use pellucid_trace::Boundary;
use pellucid_voxel::{Control, MaterialTable};

use crate::labels::permutation;
use crate::{DatasetError, Recipe, STENCIL_VALUES, Sampler, StoredVolumes};
use block::{Block, Volumes, make_block};

pub use options::StreamOptions;
pub use prints::Prints;

/// An endless, addressable stream of training samples. One sample is one surface point in one channel.
///
/// Volumes come in blocks of half a window. A window holds the second half of one block's samples and the
/// first half of the next one's, drawn and shuffled at random, so that most volumes appear in two windows but
/// every sample in one (but for the first half of block 0, which no window holds). Batch `i` is a function of
/// recipe, split, materials, options and `i` only: a training run resumes at any batch, bit for bit.
///
/// A background thread makes the next block while the current window is used; three blocks are in memory at
/// the most. Stencils are kept as f16, 4860 bytes a sample. The split's own numbers of volumes, points and
/// paths do not bound a stream; its volumes go on to number 2^32.
///
/// ```
/// use pellucid_stencil::FirstFlight;
/// use pellucid_dataset::{Recipe, STENCIL_VALUES, Stream, StreamOptions};
/// use pellucid_voxel::{Control, MaterialTable};
/// let recipe: Recipe = serde_json::from_str(
///     r#"{"name": "tiny", "seed": 1, "pitch": [0.0423, 0.0847, 0.027], "size_mm": [1.0, 1.5], "large_mm": 1.5,
///     "large_share": 0.0, "refractive_index": 1.5, "splits": [{"name": "train", "volumes": 8, "points": 8,
///     "spp": 8, "density": 1.0, "shapes": [["sphere", 1.0], ["slab", 1.0]]}]}"#,
/// )
/// .unwrap();
/// let options = StreamOptions { batch: 16, window: 2, points: 8, spp: 8, ..StreamOptions::default() };
/// let mut stream = Stream::new(&recipe, "train", &MaterialTable::cmykw(), options).unwrap();
/// let (mut stencils, mut radiance) = (vec![0.0; 16 * STENCIL_VALUES], vec![0.0; 16]);
/// let mut flights = vec![FirstFlight::default(); 16];
/// stream.batch(3, &mut stencils, &mut flights, &mut radiance, &Control::none()).unwrap();
/// assert!(radiance.iter().all(|l| (0.0..=1.0).contains(l)));
/// ```
pub struct Stream {
    options: StreamOptions,
    /// Samples a block, and so a window.
    samples: usize,
    /// Batches of a window, all passes, and of one pass.
    per_window: u64,
    per_pass: u64,
    jobs: Option<Sender<Job>>,
    made: Receiver<(u64, Result<Block, DatasetError>)>,
    worker: Option<JoinHandle<()>>,
    tickets: u64,
    asked: Vec<Asked>,
    held: Vec<(u64, Block)>,
    /// The window and pass at hand, and their samples in order.
    order: Option<((u64, u64), Vec<u32>)>,
}

/// A block asked for and not yet received.
struct Asked {
    block: u64,
    ticket: u64,
    cancel: Arc<AtomicBool>,
}

struct Job {
    block: u64,
    ticket: u64,
    cancel: Arc<AtomicBool>,
}

/// Marks samples of a window's second block.
const LATER: u32 = 1 << 31;

impl Stream {
    /// A stream of a split of a recipe, of `materials` of which the last is white.
    ///
    /// # Errors
    /// [`DatasetError::Invalid`] when recipe or options are out of range, the split is unknown, or a window
    /// holds less than one batch; [`DatasetError::Worker`] when no thread can be started.
    pub fn new(
        recipe: &Recipe,
        split: &str,
        materials: &MaterialTable,
        options: StreamOptions,
    ) -> Result<Self, DatasetError> {
        Self::with_prints(recipe, split, materials, Prints::none(), options)
    }

    /// As [`Stream::new`], with prints in the place of some of the volumes; inks vary with the volumes' numbers as they
    /// do otherwise.
    ///
    /// # Errors
    /// As [`Stream::new`]; [`DatasetError::Invalid`] naming a print of another pitch, of labels that `materials` lacks,
    /// or without a solid voxel.
    pub fn with_prints(
        recipe: &Recipe,
        split: &str,
        materials: &MaterialTable,
        prints: Prints,
        options: StreamOptions,
    ) -> Result<Self, DatasetError> {
        let sampler = Sampler::new(recipe, split, materials, options.boundary)?;
        prints.check(recipe, materials)?;
        Self::of(Volumes::Fresh(Box::new(sampler), prints), options)
    }

    /// A stream of a finished set's volumes with the labels they have, over and over, in another order each
    /// time. Points, paths and boundary are the set's; stencils are made anew.
    ///
    /// # Errors
    /// As [`Stream::new`]; [`Stream::batch`] fails when this version makes other volumes of the recipe.
    pub fn stored(volumes: StoredVolumes, options: StreamOptions) -> Result<Self, DatasetError> {
        let split = volumes.header().split()?;
        let boundary = Boundary::with_index(volumes.header().recipe.refractive_index)?;
        let options = StreamOptions { points: split.points, spp: split.spp, boundary, ..options };
        if volumes.is_empty() {
            return Err(DatasetError::invalid("files", "hold no volume"));
        }
        Self::of(Volumes::Stored(Box::new(volumes)), options)
    }

    fn of(volumes: Volumes, options: StreamOptions) -> Result<Self, DatasetError> {
        options.check()?;
        let samples = (u64::from(options.window / 2) * u64::from(options.points))
            .saturating_mul(volumes.channels() as u64);
        if samples >= u64::from(LATER) || samples < options.batch as u64 {
            return Err(DatasetError::invalid(
                "window and points",
                format!("half a window has {samples} samples; it needs from a batch to 2^31 - 1"),
            ));
        }
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(options.threads)
            .build()
            .map_err(|e| DatasetError::Worker(e.into()))?;
        let (jobs, queue) = channel::<Job>();
        let (send, made) = channel();
        let settings = options.clone();
        let worker = std::thread::Builder::new()
            .name("samples".into())
            .spawn(move || {
                for job in queue {
                    let control = Control::none().with_cancel(&job.cancel);
                    let block = pool.install(|| make_block(&volumes, &settings, job.block, &control));
                    // Nobody listens any more: the stream is gone.
                    if send.send((job.ticket, block)).is_err() {
                        return;
                    }
                }
            })
            .map_err(|e| DatasetError::Worker(e.into()))?;
        Ok(Self {
            samples: samples as usize,
            per_window: samples / options.batch as u64 * u64::from(options.passes),
            per_pass: samples / options.batch as u64,
            options,
            jobs: Some(jobs),
            made,
            worker: Some(worker),
            tickets: 0,
            asked: Vec::new(),
            held: Vec::new(),
            order: None,
        })
    }

    /// The options.
    pub fn options(&self) -> &StreamOptions {
        &self.options
    }

    /// Batches in a window.
    pub fn batches_per_window(&self) -> u64 {
        self.per_window
    }

    /// Writes batch `index`: `stencils` ordered `[sample][level 9][z 9][y 3][x 5][sigma_s, sigma_a]` in 1/mm,
    /// as long as the batch times [`STENCIL_VALUES`], `flights` and `radiance`, one a sample.
    ///
    /// Batches in turn are cheap; another index waits until its window is made.
    ///
    /// # Errors
    /// [`DatasetError::Invalid`] for buffers of other lengths or an index past the last volume,
    /// [`DatasetError::Cancelled`], and what [`Sampler::samples`] says.
    pub fn batch(
        &mut self,
        index: u64,
        stencils: &mut [f32],
        flights: &mut [FirstFlight],
        radiance: &mut [f32],
        control: &Control<'_>,
    ) -> Result<(), DatasetError> {
        let batch = self.options.batch;
        if stencils.len() != batch * STENCIL_VALUES || [flights.len(), radiance.len()] != [batch; 2] {
            return Err(DatasetError::invalid(
                "buffers",
                format!(
                    "{}, {} and {} values for {batch} samples of {STENCIL_VALUES}, 1 and 1",
                    stencils.len(),
                    flights.len(),
                    radiance.len()
                ),
            ));
        }
        let window = index / self.per_window;
        let volumes = u64::from(self.options.window / 2) * u64::from(self.options.share.count);
        if (window + 3).saturating_mul(volumes) > u64::from(u32::MAX) {
            return Err(DatasetError::invalid("batch", format!("{index} lies past volume 2^32")));
        }
        self.hold(window, control)?;
        let pass = index % self.per_window / self.per_pass;
        if self.order.as_ref().is_none_or(|(at, _)| *at != (window, pass)) {
            self.order = Some(((window, pass), self.window_order(window, pass)));
        }
        let find = |block: u64| self.held.iter().find(|(b, _)| *b == block).map(|(_, block)| block);
        let (Some((_, order)), Some(now), Some(later)) = (&self.order, find(window), find(window + 1)) else {
            return Err(DatasetError::Worker("a block is missing".into()));
        };
        let first = (index % self.per_pass) as usize * batch;
        let samples = order[first..first + batch].iter();
        let outputs = stencils.chunks_exact_mut(STENCIL_VALUES).zip(flights).zip(radiance);
        for (&sample, ((stencil, flight), radiance)) in samples.zip(outputs) {
            let block = if sample & LATER == 0 { now } else { later };
            let at = (sample & !LATER) as usize;
            block.stencils.write(at, stencil);
            *flight = block.flights[at];
            *radiance = block.radiance[at];
        }
        Ok(())
    }

    /// Waits until the blocks of a window are there, and has the next one made.
    fn hold(&mut self, window: u64, control: &Control<'_>) -> Result<(), DatasetError> {
        let wanted = window..window + 3;
        self.held.retain(|(block, _)| wanted.contains(block));
        self.asked.retain(|asked| {
            let keep = wanted.contains(&asked.block);
            if !keep {
                asked.cancel.store(true, Ordering::Relaxed);
            }
            keep
        });
        for block in wanted {
            let known = self.held.iter().any(|(b, _)| *b == block)
                || self.asked.iter().any(|asked| asked.block == block);
            if !known {
                self.ask(block)?;
            }
        }
        loop {
            let missing = (window..window + 2).any(|b| !self.held.iter().any(|(held, _)| *held == b));
            let received = if missing {
                control.check()?;
                match self.made.recv_timeout(Duration::from_millis(50)) {
                    Err(RecvTimeoutError::Timeout) => continue,
                    Err(RecvTimeoutError::Disconnected) => {
                        return Err(DatasetError::Worker("it ended early".into()));
                    }
                    Ok(received) => received,
                }
            } else {
                match self.made.try_recv() {
                    Ok(received) => received,
                    Err(_) => return Ok(()),
                }
            };
            let (ticket, result) = received;
            // What was cancelled since arrives late, and is of no use.
            if let Some(at) = self.asked.iter().position(|asked| asked.ticket == ticket) {
                let block = self.asked.remove(at).block;
                self.held.push((block, result?));
            }
        }
    }

    fn ask(&mut self, block: u64) -> Result<(), DatasetError> {
        self.tickets += 1;
        let (ticket, cancel) = (self.tickets, Arc::new(AtomicBool::new(false)));
        let job = Job { block, ticket, cancel: Arc::clone(&cancel) };
        let sent = self.jobs.as_ref().is_some_and(|jobs| jobs.send(job).is_ok());
        if !sent {
            return Err(DatasetError::Worker("it ended early".into()));
        }
        self.asked.push(Asked { block, ticket, cancel });
        Ok(())
    }

    /// Which samples a window holds, in the order of a pass.
    fn window_order(&self, window: u64, pass: u64) -> Vec<u32> {
        let half = self.samples / 2;
        let order = |block| permutation(self.samples, crate::recipe::draw::rng(self.options.seed, 2, block));
        let now = order(window);
        let later = order(window + 1);
        let members: Vec<u32> =
            now[half..].iter().copied().chain(later[..half].iter().map(|&s| s | LATER)).collect();
        // The first pass has purpose 3, the others high numbers of their own.
        permutation(members.len(), crate::recipe::draw::rng(self.options.seed, 3 + (pass << 32), window))
            .into_iter()
            .map(|i| members[i as usize])
            .collect()
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        self.asked.iter().for_each(|asked| asked.cancel.store(true, Ordering::Relaxed));
        self.jobs = None;
        if let Some(worker) = self.worker.take() {
            // A panic of the worker was reported when it happened.
            let _ = worker.join();
        }
    }
}
