//! Time for studies.

use std::time::Instant;

/// Processor seconds of this process where the system tells, else seconds on the clock: other
/// work on the machine lengthens only the latter.
pub fn seconds() -> f64 {
    thread_local!(static START: Instant = Instant::now());
    let mut total = 0u64;
    if let Ok(tasks) = std::fs::read_dir("/proc/self/task") {
        for task in tasks.flatten() {
            let text = std::fs::read_to_string(task.path().join("schedstat")).unwrap_or_default();
            total += text.split(' ').next().and_then(|n| n.parse::<u64>().ok()).unwrap_or(0);
        }
    }
    if total > 0 { total as f64 * 1e-9 } else { START.with(|s| s.elapsed().as_secs_f64()) }
}

/// Shortest time that is trusted: the system counts in ticks of some milliseconds.
const LONG_ENOUGH: f64 = 0.4;

/// Repeats work until it has taken long enough to be measured; its result and the seconds of one run.
pub fn time<T, E>(mut work: impl FnMut() -> Result<T, E>) -> Result<(T, f64), E> {
    let start = seconds();
    let mut runs = 0.0;
    loop {
        let result = work()?;
        runs += 1.0;
        let passed = seconds() - start;
        if passed >= LONG_ENOUGH {
            return Ok((result, passed / runs));
        }
    }
}

/// Does work on one thread, as times of one are taken.
pub fn on_one_thread<T, E>(work: impl FnOnce() -> Result<T, E> + Send) -> Result<T, E>
where
    T: Send,
    E: From<rayon::ThreadPoolBuildError> + Send,
{
    rayon::ThreadPoolBuilder::new().num_threads(1).build()?.install(work)
}
