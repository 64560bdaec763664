//! `pellucid prepare` as a user meets it: exit statuses, messages, files, interruption.

use std::fs;
use std::path::Path;

use crate::common::{cube, quick, run, slices, stderr, stdout, text};

#[test]
fn help_names_every_command_and_option() {
    let help = stdout(&run(&["--help"]));
    for command in ["prepare", "proof", "coupon", "calibrate", "train", "dataset", "validate"] {
        assert!(help.contains(command), "{help}");
    }
    let help = stdout(&run(&["prepare", "--help"]));
    for option in [
        "--out",
        "--output",
        "--texture-format",
        "--settings",
        "--unit",
        "--up",
        "--color",
        "--height-mm",
        "--printer",
        "--format",
        "--materials",
        "--clear-from-alpha",
        "--spectral-texture",
        "--refractive-index",
        "--predictor",
        "--weights",
        "--device",
        "--spp",
        "--iterations",
        "--seed",
        "--threads",
        "--absolute",
        "--memory",
        "--resume",
        "--force",
    ] {
        assert!(help.contains(option), "{option}: {help}");
    }
}

#[test]
fn a_print_is_complete_and_its_manifest_makes_it_again() {
    let folder = tempfile::tempdir().unwrap();
    let (model, out, again) =
        (cube(folder.path()), folder.path().join("a/b/print"), folder.path().join("again"));
    let done = run(&quick(text(&model), text(&out), &["--seed", "7"]));
    assert!(done.status.success(), "{}", stderr(&done));
    assert!(stdout(&done).contains("colour error"), "{}", stdout(&done));
    assert!(stdout(&done).contains("% out of gamut"), "{}", stdout(&done));
    for file in [
        "slices/slice_00000.png",
        "manifest.json",
        "report.json",
        "proof.html",
        "proof.glb",
        "proof.png",
        "proof.exr",
        "error.png",
    ] {
        assert!(out.join(file).metadata().unwrap().len() > 0, "{file}");
    }
    assert!(!folder.path().join("a/b/print.job").exists());
    let report: serde_json::Value =
        serde_json::from_slice(&fs::read(out.join("report.json")).unwrap()).unwrap();
    for state in ["unrefined", "refined"] {
        for level in ["voxel", "at_0_045_mm", "at_0_1_mm", "at_0_2_mm"] {
            for figure in ["mean", "median", "p95", "max", "noise"] {
                let value = &report["evaluation"][state][level][figure];
                assert!(value.is_number(), "evaluation.{state}.{level}.{figure}: {value}");
            }
            assert!(report["evaluation"][state][level]["raw"]["mean"].is_number());
        }
        assert!(report["evaluation"][state]["sharpness"]["slope"].is_number());
        let classes = report["evaluation"][state]["colour_classes"].as_array().unwrap();
        for class in classes {
            for color in ["target", "printable", "shown"] {
                assert!(class[color]["chroma"].as_f64().is_some_and(|c| c > 0.0), "{color} {class}");
            }
        }
        let share = |name: &str| report["evaluation"][state]["shares"][name].as_f64().unwrap();
        let sum = share("out_of_gamut") + share("too_thin") + share("cross_talk");
        assert!((sum - 1.0).abs() < 1e-9 && share("too_thin") > 0.0 && !classes.is_empty(), "{state} {sum}");
    }
    // Nothing in the record tells where it was made.
    for file in ["manifest.json", "report.json"] {
        let written = fs::read_to_string(out.join(file)).unwrap();
        assert!(!written.contains(text(folder.path())), "{file}");
    }
    let manifest = out.join("manifest.json");
    let repeated = run(&["prepare", text(&model), "--settings", text(&manifest), "--out", text(&again)]);
    assert!(repeated.status.success(), "{}", stderr(&repeated));
    assert!(slices(&out) == slices(&again));
    assert_eq!(fs::read(&manifest).unwrap(), fs::read(again.join("manifest.json")).unwrap());
}

#[cfg(all(feature = "gcvf", feature = "nrrd", feature = "npy"))]
#[test]
fn slices_are_written_in_the_format_that_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let mut grids = Vec::new();
    for (format, file) in [
        ("png", "slices/slice_00000.png"),
        ("gcvf", "slices.gcvf"),
        ("nrrd", "labels.nrrd"),
        ("npy", "labels.npy"),
    ] {
        let out = folder.path().join(format);
        let printer = ["--printer", "j750-high-quality-vivid"];
        let done = run(&["coupon", "--out", text(&out), "--format", format, printer[0], printer[1]]);
        assert!(done.status.success(), "{}", stderr(&done));
        assert!(out.join(file).metadata().unwrap().len() > 0, "{file}");
        assert_eq!(fs::read_dir(&out).unwrap().count(), 2);
        grids.push(pellucid::slice::read_stack(&out, &pellucid::core::Control::none()).unwrap().0);
    }
    assert!(grids.iter().all(|grid| *grid == grids[0]));

    // A print in one of them, and its manifest makes it again in the same.
    let (model, out, again) = (cube(folder.path()), folder.path().join("print"), folder.path().join("again"));
    let done = run(&quick(text(&model), text(&out), &["--format", "gcvf"]));
    assert!(done.status.success(), "{}", stderr(&done));
    let manifest = out.join("manifest.json");
    let repeated = run(&["prepare", text(&model), "--settings", text(&manifest), "--out", text(&again)]);
    assert!(repeated.status.success(), "{}", stderr(&repeated));
    assert_eq!(fs::read(out.join("slices.gcvf")).unwrap(), fs::read(again.join("slices.gcvf")).unwrap());

    // More inks than the printer's mode takes are refused before the model is read.
    let fast =
        run(&quick("none.glb", text(&folder.path().join("x")), &["--printer", "j750-high-speed-opaque"]));
    assert!(!fast.status.success());
    let message = stderr(&fast);
    assert!(message.contains("5 are needed") && message.contains("takes 3"), "{message}");
}

#[test]
fn a_model_without_unit_and_colour_is_read_as_asked_and_so_again() {
    let folder = tempfile::tempdir().unwrap();
    // A tetrahedron, its edges 0.1 of a unit long.
    let corners = ["0 0 0", "0.1 0 0", "0 0.1 0", "0 0 0.1"];
    let facet = |[a, b, c]: [usize; 3]| {
        let vertex = |i: usize| format!("vertex {}\n", corners[i]);
        format!("facet normal 0 0 0\nouter loop\n{}{}{}endloop\nendfacet\n", vertex(a), vertex(b), vertex(c))
    };
    let facets: String = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]].map(facet).concat();
    let model = folder.path().join("part.stl");
    fs::write(&model, format!("solid part\n{facets}endsolid part\n")).unwrap();
    let (out, again) = (folder.path().join("print"), folder.path().join("again"));
    let asked = ["--unit", "in", "--up", "y", "--color", "ff0000", "--iterations", "0"];
    let done = run(&quick(text(&model), text(&out), &asked));
    assert!(done.status.success(), "{}", stderr(&done));
    assert!(!stderr(&done).contains("says nothing of units"), "{}", stderr(&done));
    let read =
        |file: &Path| -> serde_json::Value { serde_json::from_slice(&fs::read(file).unwrap()).unwrap() };
    let expected = serde_json::json!({ "format": "stl", "unit": "in", "up": "y", "color": [1.0, 0.0, 0.0] });
    let report = read(&out.join("report.json"));
    assert_eq!(report["record"]["model"]["read_as"], expected);
    assert!((report["extent_mm"][2].as_f64().unwrap() - 2.54).abs() < 1e-6, "{}", report["extent_mm"]);
    // The record alone makes it again.
    let manifest = out.join("manifest.json");
    let repeated = run(&["prepare", text(&model), "--settings", text(&manifest), "--out", text(&again)]);
    assert!(repeated.status.success(), "{}", stderr(&repeated));
    assert!(slices(&out) == slices(&again));
    let said = stderr(&repeated);
    assert!(!said.contains("another model") && !said.contains("says nothing of units"), "{said}");
}

#[test]
fn arguments_out_of_range_say_what_is_allowed() {
    let cases = [
        (["--height-mm", "-5"], "0.05 to 10000 mm"),
        (["--height-mm", "1e-9"], "0.05 to 10000 mm"),
        (["--height-mm", "1e300"], "0.05 to 10000 mm"),
        (["--seed", "-1"], "0 to 18446744073709551615"),
        (["--spp", "0"], "from 1"),
        (["--iterations", "-3"], "from 0"),
        (["--refractive-index", "0.5"], "1 (index-matched) to 3"),
        (["--instruction-set", "sse"], "portable, avx2"),
        (["--device", "tpu"], "cpu, cuda, metal"),
        (["--format", "tiff"], "png, gcvf, nrrd, npy"),
        (["--unit", "yd"], "um, mm, cm, in, ft, m"),
        (["--up", "x"], "y or z"),
        (["--color", "red"], "six hexadecimal digits"),
    ];
    for (option, allowed) in cases {
        let refused = run(&quick("none.glb", "none", &option));
        assert_eq!(refused.status.code(), Some(2), "{option:?}");
        assert!(stderr(&refused).contains(allowed), "{option:?}: {}", stderr(&refused));
    }
}

#[test]
fn refusals_come_before_work_with_their_cause_once() {
    let folder = tempfile::tempdir().unwrap();
    let (model, out) = (cube(folder.path()), folder.path().join("deep/print"));
    let missing = run(&quick("missing.glb", text(&out), &[]));
    assert_eq!(missing.status.code(), Some(1));
    let message = stderr(&missing);
    assert!(message.contains("missing.glb"), "{message}");
    assert_eq!(message.matches("No such file").count(), 1, "{message}");
    let junk = folder.path().join("junk.safetensors");
    fs::write(&junk, [0xff; 64]).unwrap();
    let refused = run(&quick(text(&model), text(&out), &["--predictor", "rpnn", "--weights", text(&junk)]));
    assert!(stderr(&refused).contains("junk.safetensors"), "{}", stderr(&refused));
    assert!(stderr(&refused).contains("pellucid train"), "{}", stderr(&refused));
    let refused = run(&quick(text(&model), text(&out), &["--printer", "laserjet"]));
    assert!(stderr(&refused).contains("j750"), "{}", stderr(&refused));
    let refused = run(&quick(text(&model), text(&out), &["--height-mm", "500"]));
    assert!(stderr(&refused).contains("490 x 390 x 200"), "{}", stderr(&refused));
    let settings = folder.path().join("settings.json");
    fs::write(&settings, "{ \"spp\": \"many\" }").unwrap();
    let refused = run(&quick(text(&model), text(&out), &["--settings", text(&settings)]));
    assert!(stderr(&refused).contains("settings.json"), "{}", stderr(&refused));
    assert!(!stderr(&refused).contains("u32"), "{}", stderr(&refused));
    // Before the model is looked at.
    for (device, feature, built) in [
        ("cpu", "candle", cfg!(feature = "candle")),
        ("cuda", "cuda", cfg!(feature = "cuda")),
        ("metal", "metal", cfg!(feature = "metal")),
    ] {
        let takes_one = [
            ["--predictor", "rpnn", "--strategy", "descent"],
            ["--predictor", "auto", "--strategy", "surface-first"],
        ];
        for named in takes_one.into_iter().filter(|_| !built) {
            let named = [&named[..], &["--device", device]].concat();
            let refused = run(&quick("missing.glb", text(&out), &named));
            assert_eq!(refused.status.code(), Some(1));
            let message = stderr(&refused);
            assert!(message.contains(&format!("feature {feature:?}")), "{message}");
        }
    }
    // By paths, which `auto` takes for descent.
    for named in [&[][..], &["--predictor", "auto"]] {
        for network in [["--device", "cpu"], ["--weights", text(&junk)]] {
            let refused = run(&quick("missing.glb", text(&out), &[named, &network].concat()));
            assert!(stderr(&refused).contains("add --predictor rpnn"), "{}", stderr(&refused));
        }
    }
    // No refusal leaves a folder.
    assert!(!folder.path().join("deep").exists());
}

#[test]
fn force_replaces_prints_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("print");
    fs::create_dir(&out).unwrap();
    let model = cube(&out);
    let refused = run(&quick(text(&model), text(&out), &["--force"]));
    assert_eq!(refused.status.code(), Some(1));
    assert!(stderr(&refused).contains("cube.glb"), "{}", stderr(&refused));
    assert!(model.exists());
    let elsewhere = cube(folder.path());
    fs::remove_file(&model).unwrap();
    for force in [true, true] {
        let done = run(&quick(text(&elsewhere), text(&out), if force { &["--force"] } else { &[] }));
        assert!(done.status.success(), "{}", stderr(&done));
    }
    let refused = run(&quick(text(&elsewhere), text(&out), &[]));
    assert!(stderr(&refused).contains("--force"), "{}", stderr(&refused));
}

#[test]
fn notes_of_import_are_shown() {
    let folder = tempfile::tempdir().unwrap();
    let model = cube(folder.path());
    let mut bytes = fs::read(&model).unwrap();
    // The file is written anew with a material that alpha cuts out.
    let json_length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let json = String::from_utf8(bytes[20..20 + json_length].to_vec()).unwrap();
    let mut json = json
        .trim_end()
        .replace("\"indices\":2}", "\"indices\":2,\"material\":0}")
        .replace("\"buffers\"", "\"materials\":[{\"name\":\"leaf\",\"alphaMode\":\"MASK\"}],\"buffers\"");
    while !json.len().is_multiple_of(4) {
        json.push(' ');
    }
    let rest = bytes.split_off(20 + json_length);
    let mut glb = b"glTF\x02\0\0\0".to_vec();
    glb.extend(((20 + json.len() + rest.len()) as u32).to_le_bytes());
    glb.extend((json.len() as u32).to_le_bytes());
    glb.extend(b"JSON");
    glb.extend(json.as_bytes());
    glb.extend(rest);
    fs::write(&model, glb).unwrap();
    let done = run(&quick(text(&model), text(&folder.path().join("print")), &["--iterations", "0"]));
    assert!(done.status.success(), "{}", stderr(&done));
    assert!(stderr(&done).contains("leaf"), "{}", stderr(&done));
}

#[cfg(unix)]
mod interrupted {
    use super::*;
    use std::os::unix::process::ExitStatusExt;
    use std::process::{Child, Stdio};
    use std::time::Duration;

    const LONG: [&str; 4] = ["--iterations", "40", "--spp", "4"];

    fn start(model: &Path, out: &Path, more: &[&str]) -> Child {
        let mut arguments = vec!["prepare", text(model), "--out", text(out)];
        arguments.extend(LONG);
        arguments.extend(more);
        crate::common::pellucid()
            .args(arguments)
            .stderr(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .unwrap()
    }

    /// Waits until a checkpoint of the refinement is there, then sends a signal.
    fn stop_at_checkpoint(mut child: Child, out: &Path, signal: &str) -> std::process::ExitStatus {
        let checkpoint = out.with_file_name("print.job").join("refinement.bin");
        while !checkpoint.exists() {
            assert!(child.try_wait().unwrap().is_none(), "the job ended before its first checkpoint");
            std::thread::sleep(Duration::from_millis(5));
        }
        let id = child.id().to_string();
        assert!(std::process::Command::new("kill").args([signal, &id]).status().unwrap().success());
        child.wait().unwrap()
    }

    #[test]
    fn a_killed_job_goes_on_and_ends_with_the_same_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let model = cube(folder.path());
        let whole = folder.path().join("whole/print");
        assert!(start(&model, &whole, &[]).wait().unwrap().success());

        let out = folder.path().join("killed/print");
        let status = stop_at_checkpoint(start(&model, &out, &[]), &out, "-KILL");
        assert_eq!(status.signal(), Some(9));
        assert!(!out.exists());
        // Its remains are told, and neither used nor deleted.
        let refused = run(&[&["prepare", text(&model), "--out", text(&out)], &LONG[..]].concat());
        assert_eq!(refused.status.code(), Some(1));
        assert!(
            stderr(&refused).contains("print.job") && stderr(&refused).contains("--resume"),
            "{}",
            stderr(&refused)
        );
        // They are of these settings and this model only.
        let refused = start(&model, &out, &["--resume", "--seed", "9"]).wait_with_output().unwrap();
        assert!(!refused.status.success());
        let message = stderr(&refused);
        assert!(message.contains("seed") && message.contains("is 9"), "{message}");
        let resumed = start(&model, &out, &["--resume"]).wait_with_output().unwrap();
        assert!(resumed.status.success(), "{}", stderr(&resumed));
        assert!(slices(&out) == slices(&whole));
        let read = |dir: &Path, file: &str| fs::read(dir.join(file)).unwrap();
        assert_eq!(read(&out, "manifest.json"), read(&whole, "manifest.json"));
        let errors = |dir: &Path| {
            let report: serde_json::Value = serde_json::from_slice(&read(dir, "report.json")).unwrap();
            report["evaluation"].clone()
        };
        assert_eq!(errors(&out), errors(&whole));
        assert!(!out.with_file_name("print.job").exists());
    }

    #[test]
    fn ctrl_c_and_termination_end_with_130_and_say_how_to_go_on() {
        for signal in ["-INT", "-TERM"] {
            let folder = tempfile::tempdir().unwrap();
            let (model, out) = (cube(folder.path()), folder.path().join("print"));
            let child = start(&model, &out, &[]);
            let status = stop_at_checkpoint(child, &out, signal);
            assert_eq!(status.code(), Some(130), "{signal}");
            assert!(!out.exists());
            assert!(out.with_file_name("print.job").exists());
        }
    }

    #[test]
    fn a_second_job_into_the_same_folder_is_refused_and_the_first_goes_on() {
        let folder = tempfile::tempdir().unwrap();
        let (model, out) = (cube(folder.path()), folder.path().join("print"));
        let mut first = start(&model, &out, &[]);
        while !out.with_file_name("print.job").join("lock").exists() {
            assert!(first.try_wait().unwrap().is_none(), "the job ended before it claimed its folder");
            std::thread::sleep(Duration::from_millis(5));
        }
        for more in [&[][..], &["--resume"], &["--force"]] {
            let second = start(&model, &out, more).wait_with_output().unwrap();
            assert_eq!(second.status.code(), Some(1), "{more:?}");
            assert!(stderr(&second).contains("another process is at work"), "{}", stderr(&second));
        }
        assert!(first.wait().unwrap().success());
        assert!(out.join("report.json").exists() && !out.with_file_name("print.job").exists());
    }

    #[test]
    fn nobody_listening_is_no_panic_and_the_print_is_kept() {
        if !Path::new("/dev/full").exists() {
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let (model, out) = (cube(folder.path()), folder.path().join("print"));
        let full = || Stdio::from(fs::OpenOptions::new().write(true).open("/dev/full").unwrap());
        let quick = quick(text(&model), text(&out), &[]);
        let done = crate::common::pellucid().args(quick).stdout(full()).stderr(full()).status().unwrap();
        assert_eq!(done.code(), Some(1));
        assert!(out.join("report.json").exists());
    }
}

#[test]
fn memory_is_told_before_the_work_and_past_its_limit_refused_with_what_would_do() {
    let folder = tempfile::tempdir().unwrap();
    let (model, out) = (cube(folder.path()), folder.path().join("print"));
    let told = run(&quick(text(&model), text(&out), &["--memory", "16GiB"]));
    assert!(told.status.success() && stderr(&told).contains("memory: about "), "{}", stderr(&told));
    let (large, more) = (folder.path().join("large"), ["--height-mm", "80", "--memory", "2GiB"]);
    let refused = run(&quick(text(&model), text(&large), &more));
    let says = stderr(&refused);
    assert_eq!(refused.status.code(), Some(1), "{says}");
    for part in ["and 2.0 GiB are allowed", "mm high (--height-mm)", "allow more (--memory)"] {
        assert!(says.contains(part), "{part}: {says}");
    }
    assert!(!large.exists() && !folder.path().join("large.job").exists());
    let wrong = run(&quick(text(&model), text(&out), &["--memory", "8"]));
    assert_eq!(wrong.status.code(), Some(2));
    assert!(stderr(&wrong).contains("such as 8GiB"), "{}", stderr(&wrong));
}
