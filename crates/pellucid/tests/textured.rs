//! A model goes in and comes back with a compensated texture, in every format.

use pellucid::mesh::export::MeshFormat;
use pellucid::mesh::{
    BaseColor, Image, ImportLimits, Model, Sampler, Scale, Texture, Triangle, Vertex, import_path,
};
use pellucid::{Monitor, PrintError, PrintJob, PrintSettings, StrategyKind, Workspace};

/// A box of 4 x 2.5 x 2 mm, each face on its own part of a striped texture; `tiled` repeats it twice.
fn striped(tiled: bool) -> Model {
    let size = [4.0, 2.5, 2.0];
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for face in 0..6u32 {
        let (axis, high) = (face as usize / 2, face % 2);
        let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
        let first = vertices.len() as u32;
        for [s, t] in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
            let mut position_m = [0.0; 3];
            position_m[axis] = f64::from(high) * size[axis] / 1000.0;
            (position_m[a], position_m[b]) = (s * size[a] / 1000.0, t * size[b] / 1000.0);
            let part = |v: f64, cell: u32, cells: u32| {
                ((f64::from(cell) + 0.05 + 0.9 * v) / f64::from(cells)) as f32
            };
            let mut uv = [part(s, face % 3, 3), part(t, face / 3, 2)];
            if tiled {
                uv = uv.map(|v| 2.0 * v);
            }
            vertices.push(Vertex { position_m, uv, color: [1.0; 4] });
        }
        let quad = if high == 1 { [[0, 1, 2], [0, 2, 3]] } else { [[0, 2, 1], [0, 3, 2]] };
        triangles.extend(quad.map(|t| Triangle { vertices: t.map(|k| first + k), material: 0 }));
    }
    let texel = |i: usize| {
        if (i % 96 / 6).is_multiple_of(2) { [60, 90, 200] } else { [240, 200, 60] }
    };
    let image = Image::from_srgb8(96, 64, (0..96 * 64).map(texel).collect()).unwrap();
    let texture = Texture::new(std::sync::Arc::new(image), Sampler::default());
    let material = BaseColor { name: String::new(), factor: [1.0; 4], texture: Some(0), double_sided: false };
    Model::new("striped.glb", vertices, triangles, vec![material], vec![texture]).unwrap()
}

fn job(strategy: StrategyKind, iterations: u32) -> PrintJob {
    let mut settings = PrintSettings {
        scale: Scale::Native,
        strategy,
        spp: Some(8),
        judge_point_spp: 64,
        proof_edge: 48,
        ..PrintSettings::default()
    };
    settings.refine.iterations = Some(iterations);
    PrintJob::new(settings).unwrap()
}

#[test]
fn the_texture_written_is_compensated_and_predicted_to_gain() {
    let folder = tempfile::tempdir().unwrap();
    let monitor = Monitor::silent();
    let job = job(StrategyKind::SurfaceColor, 6);
    for tiled in [false, true] {
        let model = striped(tiled);
        let prepared = job.prepare(&model, &Workspace::none(), &monitor).unwrap();
        let formats = MeshFormat::ALL.into_iter().filter(|f| f.is_available());
        for format in formats.take(if tiled { 1 } else { 3 }) {
            let out = folder.path().join(format!("{tiled}-{}", format.name()));
            job.check_texture_output(&out, format, false).unwrap();
            let report = prepared.write_texture(&out, &model, format, false, &monitor).unwrap();
            let texture = report.texture.unwrap();
            assert_eq!(texture.own_uv_map, !tiled);
            assert!(texture.gain > 0.05, "{texture:?}");
            // The stripes are pushed apart: blue is bluer than it was, yellow yellower.
            let back = import_path(out.join(&texture.files[0]), &ImportLimits::default()).unwrap();
            assert_eq!(back.triangles().len(), 12);
            let spread = |model: &Model| {
                let (mut least, mut most) = (f32::INFINITY, f32::NEG_INFINITY);
                for t in 0..12 {
                    for k in 1..40 {
                        let s = f64::from(k) / 80.0;
                        let [r, _, b] = model.color_at(t, [s, 0.9 - s, 0.1], 0.0);
                        (least, most) = (least.min(r - b), most.max(r - b));
                    }
                }
                most - least
            };
            assert!(spread(&back) > spread(&model), "{} {}", spread(&back), spread(&model));
            for file in texture.files.iter().map(String::as_str).chain(["report.json", "proof.png"]) {
                assert!(out.join(file).metadata().unwrap().len() > 0, "{file}");
            }
            assert!(job.check_texture_output(&out, format, false).is_err());
            job.check_texture_output(&out, format, true).unwrap();
        }
        // Printed from that file, it shows what was predicted.
        let back =
            import_path(folder.path().join(format!("{tiled}-glb/textured.glb")), &ImportLimits::default());
        let mut reprint = prepared.aimed.clone();
        reprint.target = job.place(&back.unwrap(), &monitor).unwrap().texture;
        let as_it_is = self::job(StrategyKind::SurfaceColor, 0);
        let printed = as_it_is.refine(&reprint, &Workspace::none(), &monitor).unwrap();
        let judged = job.judge(&prepared.aimed, &printed, &Workspace::none(), &monitor).unwrap();
        let error = |e: &pellucid::refine::StateErrors| e.at_0_1_mm.printable.mean;
        let [before, predicted, shown] = [
            error(&prepared.judged.evaluation.unrefined),
            error(&prepared.judged.evaluation.refined),
            error(&judged.evaluation.refined),
        ];
        assert!(shown < predicted + 0.25 * (before - predicted), "{before} {predicted} {shown}");
        let other = striped(!tiled);
        assert!(matches!(prepared.bake(&other, &monitor), Err(PrintError::Invalid(_))));
    }
}

#[test]
fn every_format_gives_the_same_labels() {
    let folder = tempfile::tempdir().unwrap();
    let monitor = Monitor::silent();
    let model = striped(false);
    let prepared = job(StrategyKind::SurfaceColor, 1).prepare(&model, &Workspace::none(), &monitor).unwrap();
    let as_it_is = job(StrategyKind::SurfaceFirst, 0);
    let mut labels = Vec::new();
    for format in MeshFormat::ALL.into_iter().filter(|f| f.is_available()) {
        let out = folder.path().join(format.name());
        let report = prepared.write_texture(&out, &model, format, false, &monitor).unwrap();
        let file = &report.texture.unwrap().files[0];
        let back = import_path(out.join(file), &ImportLimits::default()).unwrap();
        let aimed = as_it_is.aim(as_it_is.place(&back, &monitor).unwrap(), &monitor).unwrap();
        labels.push((format, as_it_is.refine(&aimed, &Workspace::none(), &monitor).unwrap().labels));
    }
    let (_, first) = &labels[0];
    assert!(first.histogram()[1..].iter().filter(|&&n| n > 100).count() > 2, "several inks");
    for (format, other) in &labels[1..] {
        assert!(first == other, "{} gives other labels", format.name());
    }
}

#[test]
fn other_strategies_make_no_texture() {
    let folder = tempfile::tempdir().unwrap();
    let job = job(StrategyKind::SurfaceFirst, 0);
    let error = job.check_texture_output(folder.path(), MeshFormat::Glb, false).unwrap_err();
    assert!(error.to_string().contains("surface-color"), "{error}");
    let model = striped(false);
    let prepared = job.prepare(&model, &Workspace::none(), &Monitor::silent()).unwrap();
    let out = folder.path().join("out");
    let error = prepared.write_texture(&out, &model, MeshFormat::Glb, false, &Monitor::silent()).unwrap_err();
    assert!(error.to_string().contains("surface-color") && !out.exists(), "{error}");
}
