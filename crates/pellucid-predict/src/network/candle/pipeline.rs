//! Work of the processor beside that of a device.

use std::panic::resume_unwind;
use std::sync::mpsc::sync_channel;
use std::thread;

/// Batches that wait for the device: what it does next is ready, and memory stays bounded.
const WAITING: usize = 1;

/// Has `consume` take what `produce` makes of each of `count` batches, in their order.
///
/// With `beside`, `consume` runs on a thread of its own while the calling one, with its rayon pool, produces the next
/// batches; it must not wait for that pool then. Otherwise they take turns on the calling thread.
///
/// # Errors
/// The first error of `consume`, or else of `produce`; no batch is begun after it.
pub(super) fn run<T: Send, E: Send>(
    count: usize,
    beside: bool,
    mut produce: impl FnMut(usize) -> Result<T, E>,
    mut consume: impl FnMut(usize, T) -> Result<(), E> + Send,
) -> Result<(), E> {
    if !beside {
        return (0..count).try_for_each(|batch| consume(batch, produce(batch)?));
    }
    let (sender, receiver) = sync_channel(WAITING);
    thread::scope(|scope| {
        let consumer =
            scope.spawn(move || receiver.into_iter().enumerate().try_for_each(|(i, made)| consume(i, made)));
        let mut produced = Ok(());
        for batch in 0..count {
            match produce(batch) {
                Ok(made) => {
                    if sender.send(made).is_err() {
                        // Nobody takes batches any more: the consumer's error says why.
                        break;
                    }
                }
                Err(error) => {
                    produced = Err(error);
                    break;
                }
            }
        }
        drop(sender);
        consumer.join().unwrap_or_else(|panic| resume_unwind(panic)).and(produced)
    })
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn batches_arrive_in_order_and_few_wait() {
        for beside in [false, true] {
            let (made, taken) = (AtomicUsize::new(0), AtomicUsize::new(0));
            let mut got = Vec::new();
            let produce = |batch| {
                made.fetch_add(1, Ordering::SeqCst);
                // One is being made, one waits, one is being taken.
                let ahead = made.load(Ordering::SeqCst) - taken.load(Ordering::SeqCst);
                assert!(ahead <= WAITING + 2, "{ahead} batches are in memory");
                Ok::<usize, ()>(batch * batch)
            };
            let consume = |batch, made| {
                thread::sleep(std::time::Duration::from_micros(200));
                got.push((batch, made));
                taken.fetch_add(1, Ordering::SeqCst);
                Ok(())
            };
            run(50, beside, produce, consume).unwrap();
            assert!(got.into_iter().eq((0..50).map(|batch| (batch, batch * batch))));
            run(0, beside, |_| Ok::<(), ()>(()), |_, ()| Err(())).unwrap();
        }
    }

    #[test]
    fn errors_of_either_side_end_both() {
        for beside in [false, true] {
            let failing = |side: &'static str| {
                let (mut made, mut taken) = (0, 0);
                let result = run(
                    1000,
                    beside,
                    |batch| {
                        made += 1;
                        if side == "produce" && batch == 5 { Err(side) } else { Ok(()) }
                    },
                    |batch, ()| {
                        taken += 1;
                        if side == "consume" && batch == 5 { Err(side) } else { Ok(()) }
                    },
                );
                (result, made, taken)
            };
            assert_eq!(failing("produce"), (Err("produce"), 6, 5));
            let (result, made, taken) = failing("consume");
            assert_eq!((result, taken), (Err("consume"), 6));
            assert!((6..=6 + WAITING + 1).contains(&made), "{made}");
        }
    }
}
