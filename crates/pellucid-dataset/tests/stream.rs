//! The stream of training batches: addressing, and samples against their parts made one by one.

use std::sync::atomic::AtomicBool;

use pellucid_dataset::volume::fill;
use pellucid_dataset::volume::texture::BlueNoise;
use pellucid_dataset::{
    DatasetError, Halftone, LabelledSet, Labelling, Neighbours, Prints, Recipe, STENCIL_VALUES, Sampler,
    SetHeader, ShapeClass, Shard, Split, StoredVolumes, Stream, StreamOptions, generate,
};
use pellucid_stencil::FirstFlight;
use pellucid_trace::{Boundary, TraceOptions, Tracer, Volume};
use pellucid_voxel::{Control, LabelGrid, MaterialTable, Pitch, Surface, SurfaceOptions};

fn recipe() -> Recipe {
    let split = |name: &str, density: f64| Split {
        name: name.into(),
        volumes: 4,
        points: 10,
        spp: 4,
        std_error: None,
        shapes: vec![(ShapeClass::Slab, 2.0), (ShapeClass::Tube, 1.0), (ShapeClass::Sphere, 1.0)],
        density,
        other_inks: None,
        neighbours: None,
        pale: None,
        halftone: Halftone::Ranked,
    };
    Recipe {
        name: "test".into(),
        seed: 5,
        pitch: Pitch::j750(),
        size_mm: [1.0, 2.0],
        large_mm: 2.5,
        large_share: 0.1,
        refractive_index: 1.5,
        splits: vec![split("train", 1.0), split("dense", 4.0)],
    }
}

fn options() -> StreamOptions {
    StreamOptions { batch: 16, window: 4, points: 9, spp: 4, ..StreamOptions::default() }
}

fn stream(options: StreamOptions) -> Stream {
    Stream::new(&recipe(), "train", &MaterialTable::cmykw(), options).unwrap()
}

/// Stencils, flights and radiance.
fn batch(stream: &mut Stream, index: u64) -> (Vec<f32>, Vec<FirstFlight>, Vec<f32>) {
    let batch = stream.options().batch;
    let (mut stencils, mut radiance) = (vec![f32::NAN; batch * STENCIL_VALUES], vec![f32::NAN; batch]);
    let mut flights = vec![FirstFlight::default(); batch];
    stream.batch(index, &mut stencils, &mut flights, &mut radiance, &Control::none()).unwrap();
    (stencils, flights, radiance)
}

#[test]
fn sharers_have_volumes_of_their_own() {
    let share = |index| StreamOptions { share: Shard::new(index, 2).unwrap(), ..options() };
    let [first, second] = [0, 1].map(|index| batch(&mut stream(share(index)), 0).2);
    let alone = batch(&mut stream(options()), 0).2;
    assert!(first != second && first != alone && second != alone);
    assert!(batch(&mut stream(share(1)), 0).2 == second);
}

#[test]
fn a_batch_depends_on_its_index_only() {
    let mut in_order = stream(options());
    let count = 5 * in_order.batches_per_window();
    let expected: Vec<_> = (0..count).map(|i| batch(&mut in_order, i)).collect();
    let mut jumping = stream(StreamOptions { threads: 3, ..options() });
    for i in [count - 1, 0, count / 2, 1, count - 2, 2] {
        assert!(batch(&mut jumping, i) == expected[i as usize], "batch {i}");
    }
    let mut resumed = stream(options());
    for i in 4..count {
        assert!(batch(&mut resumed, i) == expected[i as usize], "batch {i}");
    }
    for (i, a) in expected.iter().enumerate() {
        assert!(a.2.iter().all(|r| (0.0..=1.0).contains(r)) && a.0.iter().all(|v| v.is_finite()));
        assert!(expected[i + 1..].iter().all(|b| a != b), "batch {i} comes twice");
    }
}

#[test]
fn every_sample_of_a_block_comes_once() {
    // Whole windows make a batch, so that no sample is left over.
    let half = 2 * 9 * 3;
    let mut stream = stream(StreamOptions { batch: half, ..options() });
    let materials = MaterialTable::cmykw();
    let sampler = Sampler::new(&recipe(), "train", &materials, Boundary::default()).unwrap();
    let mut expected = Vec::new();
    for volume in 2..4 {
        let samples = sampler.samples(volume, 9, Labelling::Paths(4), &Control::none()).unwrap();
        for (stencil, radiance) in
            samples.stencils.to_f32().chunks_exact(STENCIL_VALUES).zip(samples.radiance)
        {
            expected.push((stencil.iter().map(|v| v.to_bits()).collect::<Vec<_>>(), radiance.to_bits()));
        }
    }
    // Block 1 lies in windows 0 and 1.
    let mut found = Vec::new();
    for window in 0..2 {
        let (stencils, _, radiance) = batch(&mut stream, window);
        for (stencil, radiance) in stencils.chunks_exact(STENCIL_VALUES).zip(radiance) {
            found.push((stencil.iter().map(|v| v.to_bits()).collect::<Vec<_>>(), radiance.to_bits()));
        }
    }
    found.sort();
    for sample in expected {
        let at = found.binary_search(&sample).expect("a sample is missing");
        found.remove(at);
    }
    assert_eq!(found.len(), half);
}

#[test]
fn a_sample_is_what_its_volume_says() {
    let recipe = recipe();
    let control = Control::none();
    for split in ["train", "dense"] {
        let materials = MaterialTable::cmykw();
        let sampler = Sampler::new(&recipe, split, &materials, Boundary::default()).unwrap();
        let samples = sampler.samples(1, 10, Labelling::Paths(4096), &control).unwrap();
        let stencils = samples.stencils.to_f32();

        let (shape, texture) = recipe.draw(recipe.split(split).unwrap(), 1, 5);
        let grid =
            fill(&shape, &texture, recipe.pitch, &BlueNoise::new(Halftone::Ranked, recipe.pitch)).unwrap();
        let density = if split == "dense" { 4.0 } else { 1.0 };
        for (point, voxel) in samples.voxels.iter().enumerate() {
            for channel in 0..3 {
                let stencil = &stencils[(point * 3 + channel) * STENCIL_VALUES..][..STENCIL_VALUES];
                // Levels whose boxes are small enough to sum half voxels one by one.
                for level in 0..4usize {
                    for cell in [0, 31, 67, 68, 90, 134] {
                        let naive = box_mean(&grid, &materials, *voxel, level, cell, channel);
                        for (feature, value) in naive.into_iter().enumerate() {
                            let got: f64 = stencil[(level * 135 + cell) * 2 + feature].into();
                            // Two halves of a unit in the last of 11 bits.
                            let tolerance = value.abs() * density * f64::powi(2.0, -10) + 1e-6;
                            assert!((got - value * density).abs() <= tolerance, "{got} {value}");
                        }
                    }
                }
            }
        }

        // The labels once more, with other random numbers.
        let surface = Surface::extract(&grid, &SurfaceOptions::default(), &control).unwrap();
        let volume = Volume::new(&grid, &surface, &control).unwrap();
        let tracer = Tracer::new(
            &volume,
            sampler.materials(),
            TraceOptions { spp: 4096, seed: 99, ..TraceOptions::default() },
        )
        .unwrap();
        let points: Vec<u32> = samples.voxels.iter().map(|&v| surface.index_of(v).unwrap()).collect();
        let (mut radiance, mut error) = (vec![0.0; 30], vec![0.0; 30]);
        tracer.radiance_with_error(&points, 0, &mut radiance, &mut error, &control).unwrap();
        for i in 0..30 {
            let difference = f64::from(radiance[i] - samples.radiance[i]);
            let error = f64::from(error[i]).hypot(f64::from(samples.std_error[i]));
            assert!(difference.abs() <= 5.0 * error + 1e-6, "{i}: {difference} {error}");
        }
    }
}

#[test]
fn a_stored_set_comes_over_and_over_in_other_orders() {
    let folder = tempfile::tempdir().unwrap();
    let header = SetHeader {
        recipe: recipe(),
        split: "dense".into(),
        materials: MaterialTable::cmykw(),
        shard: Shard::WHOLE,
    };
    let path = generate(folder.path(), &header, &Control::none()).unwrap();
    let set = LabelledSet::load(&[&path], &Control::none()).unwrap();
    // Four volumes of 30 samples: windows of 60, two of them hold as much as the set.
    let options = StreamOptions { batch: 60, window: 4, ..options() };
    let stored = || Stream::stored(StoredVolumes::load(&[&path]).unwrap(), options.clone()).unwrap();
    let mut stream = stored();
    assert_eq!((stream.options().points, stream.options().spp), (10, 4));
    let key = |stencil: &[f32], radiance: f32| {
        (stencil.iter().map(|v| v.to_bits()).collect::<Vec<_>>(), radiance.to_bits())
    };
    let mut all = vec![0.0; set.len() * STENCIL_VALUES];
    set.stencils(0, &mut all);
    let known: Vec<_> =
        all.chunks_exact(STENCIL_VALUES).zip(set.radiance()).map(|(s, r)| key(s, *r)).collect();
    let mut counts = vec![0; known.len()];
    let mut orders = Vec::new();
    for window in 0..16 {
        let (stencils, _, radiance) = batch(&mut stream, window);
        for (stencil, radiance) in stencils.chunks_exact(STENCIL_VALUES).zip(&radiance) {
            let sample = key(stencil, *radiance);
            counts[known.iter().position(|k| *k == sample).expect("a label of the set")] += 1;
        }
        assert!(!orders.contains(&radiance), "window {window} comes twice");
        orders.push(radiance);
    }
    // Eight turns, of which half of the first and of the last block are left out.
    assert!(counts.iter().all(|n| (6..=10).contains(n)), "{counts:?}");
    assert_eq!(batch(&mut stored(), 11).2, orders[11]);
}

/// Mean sigma_s and sigma_a over one cell, summed voxel by voxel with weights.
fn box_mean(
    grid: &pellucid_voxel::LabelGrid,
    materials: &MaterialTable,
    point: [u32; 3],
    level: usize,
    cell: usize,
    channel: usize,
) -> [f64; 2] {
    let edge = f64::from(1u32 << level);
    let at = [cell % 5, cell / 5 % 3, cell / 15];
    let cells = [5.0, 3.0, 9.0];
    let low: [f64; 3] =
        std::array::from_fn(|a| f64::from(point[a]) + 0.5 + (at[a] as f64 - 0.5 * cells[a]) * edge);
    let overlap =
        |a: usize, v: i64| ((v as f64 + 1.0).min(low[a] + edge) - (v as f64).max(low[a])).clamp(0.0, 1.0);
    let range = |a: usize| low[a].floor() as i64..(low[a] + edge).ceil() as i64;
    let mut sums = [0.0; 2];
    for z in range(2) {
        for y in range(1) {
            for x in range(0) {
                let weight = overlap(0, x) * overlap(1, y) * overlap(2, z) / edge.powi(3);
                if let Some(m) = materials.get(grid.at([x, y, z])) {
                    sums[0] += weight * f64::from(m.sigma_s[channel]);
                    sums[1] += weight * f64::from(m.sigma_a[channel]);
                }
            }
        }
    }
    sums
}

#[test]
fn refuses_bad_arguments_and_stops_when_asked() {
    let materials = MaterialTable::cmykw();
    let refused =
        |options: StreamOptions| Stream::new(&recipe(), "train", &materials, options).err().unwrap();
    for (options, field) in [
        (StreamOptions { batch: 0, ..options() }, "batch"),
        (StreamOptions { batch: 1000, ..options() }, "window"),
        (StreamOptions { window: 3, ..options() }, "window"),
        (StreamOptions { points: u32::MAX, window: u32::MAX - 1, ..options() }, "window"),
        (StreamOptions { passes: 0, ..options() }, "passes"),
        (StreamOptions { threads: 0, ..options() }, "threads"),
    ] {
        assert!(refused(options).to_string().contains(field));
    }
    assert!(Stream::new(&recipe(), "nowhere", &materials, options()).is_err());
    let mut stream = stream(options());
    let mut buffers = (vec![0.0; 16 * STENCIL_VALUES], vec![0.0; 16]);
    let mut flights = vec![FirstFlight::default(); 16];
    assert!(stream.batch(0, &mut buffers.0, &mut flights, &mut [0.0; 15], &Control::none()).is_err());
    assert!(stream.batch(u64::MAX, &mut buffers.0, &mut flights, &mut buffers.1, &Control::none()).is_err());
    let stop = AtomicBool::new(true);
    let control = Control::none().with_cancel(&stop);
    let result = stream.batch(7, &mut buffers.0, &mut flights, &mut buffers.1, &control);
    assert!(matches!(result, Err(DatasetError::Cancelled)));
    // It goes on afterwards.
    stream.batch(7, &mut buffers.0, &mut flights, &mut buffers.1, &Control::none()).unwrap();
}

#[test]
fn prints_take_the_place_of_their_share_of_the_volumes() {
    // A block of one material, which no volume of the recipe is.
    let frame = pellucid_voxel::Frame::new([0.0; 3], Pitch::j750(), [30, 16, 44]).unwrap();
    let print = LabelGrid::from_fn(frame, |_| 2);
    let with = |share: f64| {
        let prints = Prints::new(vec![print.clone()], share).unwrap();
        let mut stream =
            Stream::with_prints(&recipe(), "train", &MaterialTable::cmykw(), prints, options()).unwrap();
        (0..stream.batches_per_window()).map(|i| batch(&mut stream, i)).collect::<Vec<_>>()
    };
    let plain: Vec<_> = {
        let mut stream = stream(options());
        (0..stream.batches_per_window()).map(|i| batch(&mut stream, i)).collect()
    };
    assert_eq!(with(0.0), plain);
    let magenta = &MaterialTable::cmykw().materials()[1].clone();
    let of_print = |batches: &[(Vec<f32>, Vec<FirstFlight>, Vec<f32>)]| {
        let stencils = batches.iter().flat_map(|(stencils, ..)| stencils.chunks_exact(STENCIL_VALUES));
        let whole = |s: &[f32]| {
            // The point's own voxel in the finest level, in some channel; halves have 11 bits.
            (0..3).any(|c| (s[67 * 2] / magenta.sigma_s[c] - 1.0).abs() < 1e-3)
        };
        stencils.filter(|s| whole(s)).count() as f64 / (batches.len() * 16) as f64
    };
    assert_eq!(of_print(&with(1.0)), 1.0);
    let half = of_print(&with(0.5));
    assert!(half > 0.1 && half < 0.95, "{half}");
    assert!(Prints::new(vec![print.clone()], 1.5).is_err() && Prints::new(Vec::new(), 0.5).is_err());
    let coarse = pellucid_voxel::Frame::new([0.0; 3], Pitch::new([0.1; 3]).unwrap(), [4; 3]).unwrap();
    for wrong in [LabelGrid::from_fn(coarse, |_| 1), LabelGrid::from_fn(frame, |_| 6), LabelGrid::new(frame)]
    {
        let prints = Prints::new(vec![wrong], 0.5).unwrap();
        let refused = Stream::with_prints(&recipe(), "train", &MaterialTable::cmykw(), prints, options());
        assert!(refused.err().is_some_and(|e| e.to_string().contains("print 0")));
    }
}

#[test]
fn a_second_pass_has_the_same_samples_in_another_order() {
    let (mut once, mut twice) = (stream(options()), stream(StreamOptions { passes: 2, ..options() }));
    let per_pass = once.batches_per_window();
    assert_eq!(twice.batches_per_window(), 2 * per_pass);
    let pass = |stream: &mut Stream, from: u64| -> Vec<Vec<f32>> {
        let batches = (from..from + per_pass).map(|i| batch(stream, i));
        batches
            .flat_map(|(stencils, ..)| {
                stencils.chunks_exact(STENCIL_VALUES).map(<[f32]>::to_vec).collect::<Vec<_>>()
            })
            .collect()
    };
    let (plain, first, second) = (pass(&mut once, 0), pass(&mut twice, 0), pass(&mut twice, per_pass));
    assert!(plain == first && first != second);
    // Batches leave out less than one of them a pass, which need not be the same samples.
    let known = second.iter().filter(|s| first.contains(s)).count();
    assert!(known + options().batch > second.len(), "{known} of {}", second.len());
    // The next window follows.
    assert!(pass(&mut once, per_pass) == pass(&mut twice, 2 * per_pass));
}

#[test]
fn a_neighbours_surroundings_come_with_ones_own_flight_and_label() {
    let sampler = |share: f64| {
        let mut recipe = recipe();
        recipe.splits[0].shapes = vec![(ShapeClass::Sphere, 1.0)];
        recipe.splits[0].neighbours = Some(Neighbours { share, reach_mm: 0.125 });
        Sampler::new(&recipe, "train", &MaterialTable::cmykw(), Boundary::default()).unwrap()
    };
    let of = |share: f64| sampler(share).samples(1, 40, Labelling::Paths(2), &Control::none()).unwrap();
    let (own, shared) = (of(0.0), of(1.0));
    assert_eq!(
        (&own.voxels, &own.flights, &own.radiance),
        (&shared.voxels, &shared.flights, &shared.radiance)
    );
    let (a, b) = (own.stencils.to_f32(), shared.stencils.to_f32());
    let points = |s: &[f32]| s.chunks_exact(3 * STENCIL_VALUES).map(<[f32]>::to_vec).collect::<Vec<_>>();
    let moved = points(&a).iter().zip(points(&b)).filter(|(a, b)| **a != *b).count();
    assert!(moved > 30, "{moved} of 40: nearly every point has a neighbour that faces its way");
    // The widest levels hardly notice a step of 0.125 mm: a cell's edge is 256 voxels.
    let widest = |s: &[f32]| s[8 * 270..].iter().sum::<f32>();
    for (a, b) in a.chunks_exact(STENCIL_VALUES).zip(b.chunks_exact(STENCIL_VALUES)) {
        assert!((widest(a) - widest(b)).abs() <= 0.05 * widest(a), "{} {}", widest(a), widest(b));
    }
}
