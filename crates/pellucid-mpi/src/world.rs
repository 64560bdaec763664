//! All processes that `mpirun` started, as a team.

use mpi::Count;
use mpi::collective::SystemOperation;
use mpi::datatype::PartitionMut;
use mpi::environment::Universe;
use mpi::topology::SimpleCommunicator;
use mpi::traits::{Communicator, CommunicatorCollectives, Root};
use pellucid::core::Team;

use crate::traffic::{Meter, Traffic};

/// Most values of one message: MPI counts in 32 bits.
const MESSAGE: usize = 1 << 28;

/// The team of MPI's world communicator. MPI ends all processes when one is lost, or a message is.
///
/// Meetings are for the thread that started MPI: a predictor is asked on it.
#[derive(Debug)]
pub struct World {
    rank: usize,
    size: usize,
    meter: Meter,
}

impl World {
    /// The team of this process, while MPI is up.
    pub fn of(universe: &Universe) -> Self {
        let world = universe.world();
        Self { rank: world.rank() as usize, size: world.size() as usize, meter: Meter::default() }
    }

    /// What this member's messages took so far.
    pub fn traffic(&self) -> Traffic {
        self.meter.traffic()
    }

    /// Ends every process of the team with an exit status.
    pub fn abort(&self, status: i32) -> ! {
        SimpleCommunicator::world().abort(status)
    }
}

impl Team for World {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.size
    }

    fn sum(&self, values: &mut [i64]) {
        let world = SimpleCommunicator::world();
        self.meter.meet(size_of_val(values), || {
            for values in values.chunks_mut(MESSAGE) {
                let own = values.to_vec();
                world.all_reduce_into(&own[..], values, SystemOperation::sum());
            }
        });
    }

    fn gather(&self, own: &[f32], counts: &[usize], all: &mut [f32]) {
        self.meter.meet(size_of_val(all), || match all.len() {
            ..=MESSAGE => gather_at_once(own, counts, all),
            _ => self.gather_one_by_one(own, counts, all),
        });
    }

    fn copy_first(&self, bytes: &mut Vec<u8>) {
        let world = SimpleCommunicator::world();
        let first = world.process_at_rank(0);
        self.meter.meet(bytes.len(), || {
            let mut length = bytes.len() as u64;
            first.broadcast_into(&mut length);
            bytes.resize(length as usize, 0);
            bytes.chunks_mut(MESSAGE).for_each(|part| first.broadcast_into(part));
        });
    }
}

impl World {
    /// What does not fit in one message.
    fn gather_one_by_one(&self, own: &[f32], counts: &[usize], all: &mut [f32]) {
        let world = SimpleCommunicator::world();
        let mut rest = all;
        for (rank, &count) in counts.iter().enumerate() {
            let (part, after) = rest.split_at_mut(count);
            if rank == self.rank {
                part.copy_from_slice(own);
            }
            let root = world.process_at_rank(rank as i32);
            part.chunks_mut(MESSAGE).for_each(|part| root.broadcast_into(part));
            rest = after;
        }
    }
}

fn gather_at_once(own: &[f32], counts: &[usize], all: &mut [f32]) {
    let counts: Vec<Count> = counts.iter().map(|&count| count as Count).collect();
    let before = |rank: usize| counts[..rank].iter().sum();
    let starts: Vec<Count> = (0..counts.len()).map(before).collect();
    SimpleCommunicator::world().all_gather_varcount_into(own, &mut PartitionMut::new(all, counts, starts));
}
