//! Parts of the facade that a tool does not ask for.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use pellucid_benches::appearance::Error;

use super::Saving;

/// What some tools need, beside everything.
const NEEDS: [(&str, &str); 5] = [
    ("voxels alone", ""),
    ("slices", "slice"),
    ("tracing", "mc"),
    ("the network", "weights"),
    ("the whole job (default)", "job,obj,ply,stl"),
];
const EVERYTHING: &str = concat!(
    "calibration,obj,ply,stl,3mf,meshopt,webp,icc,spectral,cases,gcvf,nrrd,npy,html,glb,",
    "weights,candle,ndarray,training"
);

pub fn savings(full: bool) -> Result<Vec<Saving>, Error> {
    let all = crates(EVERYTHING)?;
    let all_seconds = if full { Some(build_seconds(EVERYTHING)?) } else { None };
    let mut savings = Vec::new();
    for (need, features) in NEEDS {
        let row = |unit, without, with| Saving {
            what: "features of the facade that a tool does not need".into(),
            object: need.to_owned(),
            unit: String::from(unit),
            without,
            with,
            changes: "what is offered".into(),
        };
        savings.push(row("crates compiled", all as f64, crates(features)? as f64));
        if let Some(all) = all_seconds {
            savings.push(row("s to check from nothing, on the clock", all, build_seconds(features)?));
        }
    }
    if full {
        savings.extend(programs()?);
    }
    Ok(savings)
}

/// The command with everything that any machine can build, beside less.
fn programs() -> Result<Vec<Saving>, Error> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("leave-out-program");
    let sizes =
        ["--features=candle", "--features=", "--no-default-features"].map(|features| -> Result<f64, Error> {
            let status = cargo()
                .args([
                    "build",
                    "--locked",
                    "--offline",
                    "--quiet",
                    "--release",
                    "-p",
                    "pellucid-cli",
                    features,
                ])
                .envs([("CARGO_PROFILE_RELEASE_STRIP", "true"), ("CARGO_PROFILE_RELEASE_DEBUG", "none")])
                .env("CARGO_TARGET_DIR", &folder)
                .status()?;
            let program = folder.join("release").join(format!("pellucid{}", std::env::consts::EXE_SUFFIX));
            match status.success() {
                true => Ok(std::fs::metadata(program)?.len() as f64 / f64::from(1 << 20)),
                false => Err("cargo build failed".into()),
            }
        });
    let [all, usual, least] = sizes;
    let all = all?;
    let row = |object: &str, with| Saving {
        what: "features of the command".into(),
        object: object.to_owned(),
        unit: "MiB of the program, stripped".into(),
        without: all,
        with,
        changes: "what is offered".into(),
    };
    let rows = vec![
        row("default: without candle", usual?),
        row("none: slices as PNGs, no proof as a page or a model", least?),
    ];
    std::fs::remove_dir_all(folder)?;
    Ok(rows)
}

fn cargo() -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(".."));
    command
}

/// Crates that the facade with these features is compiled from.
fn crates(features: &str) -> Result<usize, Error> {
    let out = cargo()
        .args([
            "tree",
            "--locked",
            "--offline",
            "-p",
            "pellucid",
            "--no-default-features",
            "--features",
            features,
        ])
        .args(["-e", "normal,build", "--prefix", "none", "--format", "{p}"])
        .output()?;
    if !out.status.success() {
        return Err(String::from_utf8_lossy(&out.stderr).into_owned().into());
    }
    let text = String::from_utf8_lossy(&out.stdout).into_owned();
    let names: BTreeSet<&str> = text.lines().map(|line| line.trim_end_matches(" (*)")).collect();
    Ok(names.len())
}

/// Seconds that `cargo check` of the facade with these features takes in an empty folder.
fn build_seconds(features: &str) -> Result<f64, Error> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("leave-out-check");
    if folder.exists() {
        std::fs::remove_dir_all(&folder)?;
    }
    let start = Instant::now();
    let status = cargo()
        .args(["check", "--locked", "--offline", "--quiet", "-p", "pellucid", "--no-default-features"])
        .args(["--features", features])
        .env("CARGO_TARGET_DIR", &folder)
        .status()?;
    let seconds = start.elapsed().as_secs_f64();
    std::fs::remove_dir_all(&folder)?;
    if status.success() { Ok(seconds) } else { Err("cargo check failed".into()) }
}
