//! A process that is lost.

use std::fs;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::{folder, mpirun, print, run};

/// The processes that a process started.
fn children(of: u32) -> Vec<u32> {
    let processes = fs::read_dir("/proc").expect("Linux").filter_map(|entry| {
        let process: u32 = entry.ok()?.file_name().to_str()?.parse().ok()?;
        let stat = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
        // After the name in brackets: state and parent.
        let parent: u32 = stat.rsplit_once(") ")?.1.split_whitespace().nth(1)?.parse().ok()?;
        (parent == of).then_some(process)
    });
    processes.collect()
}

#[test]
fn a_killed_rank_ends_the_job_which_another_number_of_ranks_goes_on_with() {
    let folder = folder();
    let line = "prepare a.glb --height-mm 1.2 --settings quick.json --iterations 12";
    run(1, folder.path(), &format!("{line} --out whole"));
    let arguments = format!("{line} --out print");
    let mut job = mpirun(2, folder.path());
    let mut job = job.args(arguments.split_whitespace()).stderr(Stdio::null()).spawn().unwrap();
    let state = folder.path().join("print.job/refinement.bin");
    let start = Instant::now();
    while !state.exists() {
        assert!(job.try_wait().unwrap().is_none(), "it ended before its first checkpoint");
        assert!(start.elapsed() < Duration::from_secs(600), "no checkpoint");
        std::thread::sleep(Duration::from_millis(5));
    }
    let last = *children(job.id()).last().expect("mpirun has children");
    assert!(Command::new("kill").args(["-9", &last.to_string()]).status().unwrap().success());
    assert!(!job.wait().unwrap().success());
    assert!(!folder.path().join("print").exists() && state.exists());
    run(3, folder.path(), &format!("{arguments} --resume"));
    assert!(print(&folder.path().join("print")) == print(&folder.path().join("whole")));
    assert!(!folder.path().join("print.job").exists());
}
