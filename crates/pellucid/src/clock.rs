//! Runs stages: tells the observer, hands out control, keeps the times.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use pellucid_voxel::Control;

use crate::report::StageTime;
use crate::stage::{Observer, Stage};

pub(crate) struct Clock<'a> {
    observer: &'a dyn Observer,
    cancel: &'a AtomicBool,
    times: Vec<StageTime>,
}

impl<'a> Clock<'a> {
    pub(crate) fn new(observer: &'a dyn Observer, cancel: &'a AtomicBool) -> Self {
        Self { observer, cancel, times: Vec::new() }
    }

    /// Runs one stage; its time counts also when it fails.
    pub(crate) fn run<T>(&mut self, stage: Stage, work: impl FnOnce(&Control<'_>) -> T) -> T {
        let observer = self.observer;
        let progress = |done, total| observer.progress(stage, done, total);
        let control = Control::none().with_cancel(self.cancel).with_progress(&progress);
        observer.begin(stage);
        let start = Instant::now();
        let result = work(&control);
        let seconds = start.elapsed().as_secs_f64();
        observer.end(stage);
        match self.times.iter_mut().find(|t| t.stage == stage.name()) {
            Some(time) => time.seconds += seconds,
            None => self.times.push(StageTime { stage: stage.name(), seconds }),
        }
        result
    }

    /// Cancellation without progress, for short work outside the stages.
    pub(crate) fn quiet(&self) -> Control<'a> {
        Control::none().with_cancel(self.cancel)
    }

    pub(crate) fn warn(&self, message: &str) {
        self.observer.warn(message);
    }

    pub(crate) fn into_times(self) -> Vec<StageTime> {
        self.times
    }
}
