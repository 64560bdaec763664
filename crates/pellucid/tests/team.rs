//! A job of a team is the job of one, and goes on with its checkpoints on another number of members.

mod common;

use std::path::Path;
use std::sync::Arc;

use pellucid::core::Team;
use pellucid::core::team::Threads;
use pellucid::refine::Evaluation;
use pellucid::voxel::{Frame, LabelGrid};
use pellucid::{Monitor, PrintJob, PrintSettings, StrategyKind, Workspace};

use common::quick;

/// Labels and errors of a small print.
fn printed(job: &PrintJob, workspace: &Workspace) -> (LabelGrid, Evaluation) {
    let frame = Frame::new([0.0; 3], job.settings().printer.pitch(), [20, 10, 30]).unwrap();
    let block = LabelGrid::from_fn(frame, |_| 1);
    let color = |[x, ..]: [u32; 3]| if x < 10 { [0.8, 0.2, 0.1] } else { [0.2, 0.7, 0.9] };
    let prepared = job.prepare_volume("block", &block, color, workspace, &Monitor::silent()).unwrap();
    (prepared.refined.labels, prepared.judged.evaluation)
}

#[test]
fn members_come_to_the_bytes_of_one_and_resume_on_another_number() {
    for strategy in [StrategyKind::SurfaceFirst, StrategyKind::Descent] {
        let job = PrintJob::new(PrintSettings { strategy, ..quick() }).unwrap();
        let alone = printed(&job, &Workspace::none());
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("print");
        let by = |size: usize, first: &(dyn Fn(&Path) -> Workspace + Sync)| {
            Threads::run(size, |team| {
                let own = if team.rank() == 0 { first(&out) } else { Workspace::none() };
                let team: Arc<dyn Team> = Arc::new(team);
                let workspace = own.of_team(Arc::clone(&team));
                printed(&job.clone().with_team(team).unwrap(), &workspace)
            })
        };
        let two = by(2, &|out| Workspace::create(out).unwrap());
        assert!(two.iter().all(|member| *member == alone), "{}", strategy.name());
        assert!(out.with_file_name("print.job").join("refinement.bin").exists());
        let three = by(3, &Workspace::resume);
        assert!(three.iter().all(|member| *member == alone), "{}", strategy.name());
    }
}
