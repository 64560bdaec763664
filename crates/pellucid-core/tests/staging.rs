//! Output folders over the public API: what is replaced, what is never touched, and what killed runs leave.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, SystemTime};

use pellucid_core::staging::{OwnFiles, StagedDir, StagingError, check, remains, remove_remains};

fn own() -> OwnFiles {
    OwnFiles::new(["manifest.json", "slices/slice_*.png"])
        .marked_by("manifest.json", |b| b.starts_with(b"ours"))
}

/// What a complete run leaves.
fn output(folder: &Path, text: &str) {
    fs::create_dir_all(folder.join("slices")).unwrap();
    fs::write(folder.join("slices/slice_00000.png"), text).unwrap();
    fs::write(folder.join("manifest.json"), format!("ours {text}")).unwrap();
}

fn text(folder: &Path) -> String {
    fs::read_to_string(folder.join("manifest.json")).unwrap()
}

fn entries(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Both the look and the begin refuse, with the same words; the error of the begin.
fn refused(target: &Path, force: bool) -> StagingError {
    let looked = check(target, force, &own()).unwrap_err();
    let error = StagedDir::begin(target, force, &own()).unwrap_err();
    assert_eq!(looked.to_string(), error.to_string());
    error
}

#[test]
fn an_own_output_is_replaced_with_force_only_and_at_once() {
    let temp = tempfile::tempdir().unwrap();
    let out = temp.path().join("out");
    output(&out, "first");
    assert!(refused(&out, false).to_string().contains("--force"));
    check(&out, true, &own()).unwrap();
    let staged = StagedDir::begin(&out, true, &own()).unwrap();
    output(staged.path(), "second");
    assert_eq!(text(&out), "ours first");
    staged.commit().unwrap();
    assert_eq!(text(&out), "ours second");
    assert_eq!(entries(&out), ["manifest.json", "slices"], "the lock file is gone");
    assert_eq!(entries(temp.path()), ["out"]);
}

#[test]
fn foreign_files_are_named_and_kept() {
    let temp = tempfile::tempdir().unwrap();
    let out = temp.path().join("out");
    output(&out, "first");
    fs::write(out.join("model.glb"), "the input").unwrap();
    fs::write(out.join("slices/notes.txt"), "mine").unwrap();
    for force in [true, false] {
        match refused(&out, force) {
            StagingError::Foreign { files, .. } => {
                assert_eq!(files, ["model.glb", "slices/notes.txt"].map(PathBuf::from))
            }
            other => panic!("{other}"),
        }
    }
    assert_eq!(fs::read_to_string(out.join("model.glb")).unwrap(), "the input");
    assert_eq!(text(&out), "ours first");

    let theirs = temp.path().join("extension");
    fs::create_dir(&theirs).unwrap();
    fs::write(theirs.join("manifest.json"), "another program's").unwrap();
    assert!(refused(&theirs, true).to_string().contains("manifest.json"));

    let file = temp.path().join("file");
    fs::write(&file, "x").unwrap();
    assert!(matches!(refused(&file, true), StagingError::Exists { .. }));
    assert!(matches!(refused(Path::new("/"), true), StagingError::Invalid(_)));
    assert!(matches!(refused(Path::new(".."), true), StagingError::Invalid(_)));
    assert_eq!(entries(temp.path()), ["extension", "file", "out"]);
}

#[test]
fn a_file_that_comes_into_the_output_meanwhile_is_kept() {
    let temp = tempfile::tempdir().unwrap();
    let out = temp.path().join("out");
    output(&out, "first");
    let staged = StagedDir::begin(&out, true, &own()).unwrap();
    output(staged.path(), "second");
    fs::write(out.join("note.txt"), "written while it ran").unwrap();
    assert!(matches!(staged.commit(), Err(StagingError::Foreign { .. })));
    assert_eq!(text(&out), "ours first");

    let other = temp.path().join("other");
    let staged = StagedDir::begin(&other, false, &own()).unwrap();
    output(&other, "another run's");
    assert!(matches!(staged.commit(), Err(StagingError::Exists { .. })));
    assert_eq!(text(&other), "ours another run's");
    assert_eq!(entries(temp.path()), ["other", "out"]);
}

#[test]
fn a_failed_commit_keeps_the_old_output() {
    let temp = tempfile::tempdir().unwrap();
    let out = temp.path().join("out");
    output(&out, "old");
    let staged = StagedDir::begin(&out, true, &own()).unwrap();
    fs::remove_dir_all(staged.path()).unwrap();
    assert!(matches!(staged.commit(), Err(StagingError::File(_))));
    assert_eq!(text(&out), "ours old");
    assert_eq!(entries(temp.path()), ["out"]);
}

#[test]
fn parents_that_were_made_for_a_failed_run_go_again() {
    let temp = tempfile::tempdir().unwrap();
    fs::create_dir(temp.path().join("a")).unwrap();
    let out = temp.path().join("a/b/c/out");
    check(&out, false, &own()).unwrap();
    assert!(entries(&temp.path().join("a")).is_empty(), "looking makes nothing");
    drop(StagedDir::begin(&out, false, &own()).unwrap());
    assert_eq!(entries(temp.path()), ["a"]);
    assert!(entries(&temp.path().join("a")).is_empty(), "the folder that was there stays");

    let staged = StagedDir::begin(&out, false, &own()).unwrap();
    fs::write(temp.path().join("a/b/file"), "another's").unwrap();
    drop(staged);
    assert_eq!(entries(&temp.path().join("a/b")), ["file"]);

    let staged = StagedDir::begin(&out, false, &own()).unwrap();
    output(staged.path(), "new");
    staged.commit().unwrap();
    assert_eq!(text(&out), "ours new");

    let below_a_file = temp.path().join("a/b/file/x/out");
    assert!(matches!(check(&below_a_file, false, &own()), Err(StagingError::File(_))));
    assert!(matches!(StagedDir::begin(&below_a_file, false, &own()), Err(StagingError::File(_))));
}

#[test]
fn an_empty_folder_is_filled() {
    let temp = tempfile::tempdir().unwrap();
    let out = temp.path().join("out/");
    fs::create_dir(&out).unwrap();
    let staged = StagedDir::begin(&out, false, &own()).unwrap();
    output(staged.path(), "new");
    staged.commit().unwrap();
    assert_eq!(text(&out), "ours new");
}

/// No check by itself: the run that [`a_killed_run_is_told_and_removed_on_request`] kills.
#[test]
fn run_to_be_killed() {
    let Some(out) = std::env::var_os("STAGING_OUT") else { return };
    let staged = StagedDir::begin(&out, false, &own()).unwrap();
    output(staged.path(), "half");
    println!("\nstaged");
    std::io::stdout().flush().unwrap();
    std::thread::sleep(Duration::from_secs(60));
}

#[test]
fn a_killed_run_is_told_and_removed_on_request() {
    use std::io::BufRead;
    let temp = tempfile::tempdir().unwrap();
    let out = temp.path().join("out");
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["run_to_be_killed", "--exact", "--nocapture"])
        .env("STAGING_OUT", &out)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let lines = std::io::BufReader::new(child.stdout.take().unwrap()).lines();
    assert!(lines.map_while(Result::ok).any(|line| line == "staged"));

    assert!(remains(&out).unwrap().is_empty(), "it is at work");
    assert!(remove_remains(&out, &own()).unwrap().is_empty());
    child.kill().unwrap();
    child.wait().unwrap();
    let left = remains(&out).unwrap();
    assert_eq!(left.len(), 1);
    assert_eq!(text(&left[0]), "ours half");

    let staged = StagedDir::begin(&out, false, &own()).unwrap();
    assert_eq!(staged.remains(), left);
    assert_ne!(staged.path(), left[0]);
    output(staged.path(), "whole");
    staged.commit().unwrap();
    assert_eq!(text(&left[0]), "ours half", "told, and left alone");
    assert_eq!(remove_remains(&out, &own()).unwrap(), left);
    assert_eq!(entries(temp.path()), ["out"]);
}

#[test]
fn remains_with_the_next_names_are_in_nobodys_way() {
    let temp = tempfile::tempdir().unwrap();
    let out = temp.path().join("out");
    output(&out, "first");
    for n in 0..200 {
        let kind = if n % 2 == 0 { "partial" } else { "old" };
        output(&temp.path().join(format!(".out.{kind}-{}-{n}", std::process::id())), "left");
    }
    let staged = StagedDir::begin(&out, true, &own()).unwrap();
    output(staged.path(), "second");
    staged.commit().unwrap();
    assert_eq!(text(&out), "ours second");
    assert_eq!(entries(temp.path()).len(), 201);
}

#[test]
fn an_interrupted_replacement_is_mended() {
    let temp = tempfile::tempdir().unwrap();
    let out = temp.path().join("out");
    let old = temp.path().join(".out.old-7-0");
    output(&old, "kept");
    output(&temp.path().join(".outer.old-7-0"), "of another output");
    fs::write(temp.path().join(".out.old-7-1"), "a file").unwrap();
    // A look sees the old output under its name, and moves nothing.
    assert!(matches!(check(&out, false, &own()), Err(StagingError::Exists { .. })));
    check(&out, true, &own()).unwrap();
    assert!(old.exists() && !out.exists());
    assert!(remains(&out).unwrap().is_empty(), "what is put back is no remainder");
    assert!(matches!(StagedDir::begin(&out, false, &own()), Err(StagingError::Exists { .. })));
    assert_eq!(text(&out), "ours kept");
    assert!(!old.exists());
    assert!(temp.path().join(".outer.old-7-0").exists() && temp.path().join(".out.old-7-1").exists());
}

#[test]
fn a_replaced_output_goes_only_when_all_in_it_is_own() {
    let temp = tempfile::tempdir().unwrap();
    let out = temp.path().join("out");
    output(&out, "new");
    let [clean, mixed] = ["1", "2"].map(|n| temp.path().join(format!(".out.old-7-{n}")));
    output(&clean, "old");
    fs::remove_file(clean.join("manifest.json")).unwrap();
    output(&mixed, "old");
    fs::write(mixed.join("photo.jpg"), "x").unwrap();
    assert_eq!(remains(&out).unwrap(), [clean.clone(), mixed.clone()]);
    assert_eq!(remove_remains(&out, &own()).unwrap(), [clean]);
    assert!(mixed.join("photo.jpg").exists());
}

#[cfg(unix)]
#[test]
fn a_partial_folder_without_a_lock_is_dead_once_it_is_no_longer_fresh() {
    let temp = tempfile::tempdir().unwrap();
    let out = temp.path().join("out");
    let partial = temp.path().join(".out.partial-7-0");
    fs::create_dir(&partial).unwrap();
    assert!(remains(&out).unwrap().is_empty(), "it may be made this moment");
    let folder = fs::File::open(&partial).unwrap();
    folder.set_modified(SystemTime::now() - Duration::from_secs(3600)).unwrap();
    assert_eq!(remains(&out).unwrap(), [partial]);
}

#[cfg(unix)]
#[test]
fn a_link_stays_and_what_it_leads_to_is_replaced() {
    use std::os::unix::fs::symlink;
    let temp = tempfile::tempdir().unwrap();
    let disk = temp.path().join("disk");
    let real = disk.join("real");
    output(&real, "first");
    let link = temp.path().join("link");
    symlink(&real, &link).unwrap();
    assert!(matches!(refused(&link, false), StagingError::Exists { .. }));
    for target in [link.clone(), temp.path().join("link/")] {
        let staged = StagedDir::begin(&target, true, &own()).unwrap();
        assert_eq!(staged.path().parent().unwrap(), disk.canonicalize().unwrap());
        output(staged.path(), "second");
        staged.commit().unwrap();
    }
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    assert_eq!(text(&real), "ours second");
    assert_eq!(entries(temp.path()), ["disk", "link"]);
    assert_eq!(entries(&disk), ["real"]);

    let nowhere = temp.path().join("nowhere");
    symlink(temp.path().join("gone"), &nowhere).unwrap();
    assert!(refused(&nowhere, true).to_string().contains("leads nowhere"));
}

#[cfg(unix)]
#[test]
fn a_parent_that_may_not_be_written_is_refused() {
    use std::os::unix::fs::PermissionsExt;
    let temp = tempfile::tempdir().unwrap();
    let locked = temp.path().join("locked");
    fs::create_dir(&locked).unwrap();
    fs::set_permissions(&locked, fs::Permissions::from_mode(0o555)).unwrap();
    for out in [locked.join("out"), locked.join("a/out")] {
        match check(&out, false, &own()) {
            Err(StagingError::File(e)) => assert_eq!(e.path, locked),
            other => panic!("{other:?}"),
        }
        // The super-user may write anywhere; others are refused by the begin too.
        match StagedDir::begin(&out, false, &own()) {
            Ok(staged) => drop(staged),
            Err(error) => assert!(matches!(error, StagingError::File(_))),
        }
        assert!(entries(&locked).is_empty());
    }
    fs::set_permissions(&locked, fs::Permissions::from_mode(0o755)).unwrap();
}

#[cfg(target_os = "linux")]
#[test]
fn a_mount_point_is_refused_before_work() {
    assert!(refused(Path::new("/proc"), true).to_string().contains("mounted"));
}
