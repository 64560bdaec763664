//! Several processes that do the same work at the same time, and share out its long parts.
//!
//! Every member runs the same program on the same input and comes to the same state, so nothing but the results of what
//! was shared out has to be sent. Members meet in calls of [`Team`]; all make the same ones in the same order.

use std::ops::Range;
use std::sync::{Arc, Barrier, Mutex, PoisonError};

/// A team as one of its members sees it.
///
/// The calls that take values are made by every member, and return once all have made them. A team that loses a member
/// does not go on: whoever brings the messages ends all of its processes.
pub trait Team: std::fmt::Debug + Send + Sync {
    /// Which member this is, from 0 to below [`Team::size`].
    fn rank(&self) -> usize;

    /// Number of members, at least 1.
    fn size(&self) -> usize;

    /// Replaces each value by its sum over the members, who hold equally many; sums wrap around.
    fn sum(&self, values: &mut [i64]);

    /// Every member's values, in the order of ranks, to `all`. Member `i` gives `counts[i]` values; `own` has this
    /// member's count, and `all` as many as there are in sum.
    fn gather(&self, own: &[f32], counts: &[usize], all: &mut [f32]);

    /// Replaces the bytes by those of member 0.
    fn copy_first(&self, bytes: &mut Vec<u8>);
}

/// A team of one: nothing is shared out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Alone;

impl Team for Alone {
    fn rank(&self) -> usize {
        0
    }

    fn size(&self) -> usize {
        1
    }

    fn sum(&self, _: &mut [i64]) {}

    fn gather(&self, own: &[f32], _: &[usize], all: &mut [f32]) {
        all.copy_from_slice(own);
    }

    fn copy_first(&self, _: &mut Vec<u8>) {}
}

/// Whether every member has the same bytes. Where they differ by chance, it is found but in one of 2^62 cases.
///
/// ```
/// use pellucid_core::team::{Alone, agree};
/// assert!(agree(&Alone, b"labels"));
/// ```
pub fn agree(team: &dyn Team, bytes: &[u8]) -> bool {
    let mut digest = crate::Digest::new();
    digest.add(bytes);
    // The sums of a number and of its square tell n equal ones from others.
    let own = digest.low() as i64;
    let mut sums = [own, own.wrapping_mul(own)];
    let expected = sums.map(|value| value.wrapping_mul(team.size() as i64));
    team.sum(&mut sums);
    sums == expected
}

/// How a list is dealt out: in blocks of neighbours, to one member after the other and then from the first on, so that
/// each gets some of every region and none is left with the slow ones.
///
/// ```
/// use pellucid_core::team::Deal;
/// let deal = Deal::new(10, 2, 3);
/// assert_eq!(deal.blocks(0).collect::<Vec<_>>(), [0..3, 6..9]);
/// assert_eq!(deal.blocks(1).collect::<Vec<_>>(), [3..6, 9..10]);
/// assert_eq!(deal.counts(), [6, 4]);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Deal {
    items: usize,
    members: usize,
    block: usize,
}

impl Deal {
    /// `items` to `members` in blocks of `block`; 0 is taken for 1.
    pub fn new(items: usize, members: usize, block: usize) -> Self {
        Self { items, members: members.max(1), block: block.max(1) }
    }

    /// The blocks of a member, ascending.
    pub fn blocks(self, rank: usize) -> impl Iterator<Item = Range<usize>> {
        (rank * self.block..self.items)
            .step_by(self.members * self.block)
            .map(move |first| first..self.items.min(first + self.block))
    }

    /// How many items each member has.
    pub fn counts(self) -> Vec<usize> {
        (0..self.members).map(|rank| self.blocks(rank).map(|block| block.len()).sum()).collect()
    }
}

/// A member of a team of threads in one process: to try shared work without further machines.
///
/// ```
/// use pellucid_core::team::{Team, Threads};
/// let sums = Threads::run(3, |team| {
///     let mut sum = [team.rank() as i64 + 1];
///     team.sum(&mut sum);
///     sum[0]
/// });
/// assert_eq!(sums, [6, 6, 6]);
/// ```
#[derive(Clone, Debug)]
pub struct Threads {
    rank: usize,
    table: Arc<Table>,
}

/// Where the members lay down what they hold.
#[derive(Debug)]
struct Table {
    barrier: Barrier,
    sums: Vec<Mutex<Vec<i64>>>,
    values: Vec<Mutex<Vec<f32>>>,
    first: Mutex<Vec<u8>>,
}

impl Threads {
    /// Does some work as a team of `size`, each member on a thread of its own; returns what each made of it. A member that
    /// leaves the work early leaves the others waiting.
    ///
    /// # Panics
    /// When a member does.
    pub fn run<T: Send>(size: usize, work: impl Fn(Self) -> T + Sync) -> Vec<T> {
        let some = |_| Mutex::new(Vec::new());
        let table = Arc::new(Table {
            barrier: Barrier::new(size),
            sums: (0..size).map(some).collect(),
            values: (0..size).map(|_| Mutex::new(Vec::new())).collect(),
            first: Mutex::new(Vec::new()),
        });
        let work = &work;
        std::thread::scope(|scope| {
            let members: Vec<_> = (0..size)
                .map(|rank| Self { rank, table: Arc::clone(&table) })
                .map(|member| scope.spawn(move || work(member)))
                .collect();
            let results = members.into_iter().map(|member| member.join());
            results.map(|r| r.unwrap_or_else(|panic| std::panic::resume_unwind(panic))).collect()
        })
    }

    /// Waits until all are here, does something, and waits until all have done it.
    fn meet(&self, work: impl FnOnce()) {
        self.table.barrier.wait();
        work();
        self.table.barrier.wait();
    }
}

fn locked<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Team for Threads {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.table.sums.len()
    }

    fn sum(&self, values: &mut [i64]) {
        *locked(&self.table.sums[self.rank]) = values.to_vec();
        self.meet(|| {
            values.fill(0);
            for sums in &self.table.sums {
                values.iter_mut().zip(&*locked(sums)).for_each(|(v, s)| *v = v.wrapping_add(*s));
            }
        });
    }

    fn gather(&self, own: &[f32], _: &[usize], all: &mut [f32]) {
        *locked(&self.table.values[self.rank]) = own.to_vec();
        self.meet(|| {
            let values: Vec<f32> = self.table.values.iter().flat_map(|v| locked(v).clone()).collect();
            all.copy_from_slice(&values);
        });
    }

    fn copy_first(&self, bytes: &mut Vec<u8>) {
        if self.rank == 0 {
            *locked(&self.table.first) = bytes.clone();
        }
        self.meet(|| *bytes = locked(&self.table.first).clone());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn threads_meet() {
        let all = Threads::run(3, |team| {
            let rank = team.rank();
            let mut gathered = [0.0; 3];
            // 0, 1 and 2 values.
            team.gather(&vec![rank as f32; rank], &[0, 1, 2], &mut gathered);
            let mut bytes = vec![rank as u8; 2 - rank];
            team.copy_first(&mut bytes);
            let same = agree(&team, b"same");
            (gathered, bytes, same, agree(&team, &[(rank == 1) as u8]))
        });
        assert!(all.iter().all(|seen| *seen == ([1.0, 2.0, 2.0], vec![0, 0], true, false)), "{all:?}");
    }

    proptest! {
        #[test]
        fn every_item_is_dealt_out_once(items in 0usize..200, members in 1usize..6, block in 0usize..30) {
            let deal = Deal::new(items, members, block);
            let mut dealt: Vec<usize> = (0..members).flat_map(|r| deal.blocks(r)).flatten().collect();
            prop_assert_eq!(deal.counts().iter().sum::<usize>(), items);
            dealt.sort_unstable();
            prop_assert!(dealt.into_iter().eq(0..items));
        }
    }
}
