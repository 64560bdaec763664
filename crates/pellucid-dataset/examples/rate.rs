//! Where the time of making training samples goes: `cargo run --release --example rate -- RECIPE SPLIT VOLUMES POINTS`.
use std::time::Instant;

use pellucid_dataset::{Recipe, volume};
use pellucid_stencil::{Coefficients, Features, StencilSpec, Stencils};
use pellucid_trace::{TraceOptions, Tracer, Volume};
use pellucid_voxel::{Control, CountSat, MaterialTable, Surface, SurfaceOptions};

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let recipe: Recipe = serde_json::from_str(&std::fs::read_to_string(&args[1]).unwrap()).unwrap();
    let split = recipe.split(&args[2]).unwrap();
    let (volumes, points): (u32, usize) = (args[3].parse().unwrap(), args[4].parse().unwrap());
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().unwrap();
    let materials = MaterialTable::cmykw();
    let control = Control::none();
    let blue = volume::texture::BlueNoise::new(split.halftone, recipe.pitch);
    let mut sums = [0.0; 6];
    for v in 0..volumes {
        let mut t = [0.0; 6];
        let mut clock = Instant::now();
        let mut lap = |slot: usize| {
            t[slot] = clock.elapsed().as_secs_f64() * 1e3;
            clock = Instant::now();
        };
        let (shape, texture) = recipe.draw(split, v, 5);
        let grid = volume::fill(&shape, &texture, recipe.pitch, &blue).unwrap();
        lap(0);
        let surface = Surface::extract(&grid, &SurfaceOptions::default(), &control).unwrap();
        lap(1);
        let sat = CountSat::build(&grid, 5, &control).unwrap();
        lap(2);
        let traced = Volume::new(&grid, &surface, &control).unwrap();
        lap(3);
        let chosen: Vec<u32> =
            (0..points).map(|i| (i as u64 * surface.len() as u64 / points as u64) as u32).collect();
        let voxels: Vec<_> = chosen.iter().map(|&p| surface.voxels()[p as usize]).collect();
        let stencils = Stencils::new(StencilSpec::paper(), &grid, &sat).unwrap();
        let coefficients = Coefficients::all(&materials, Features::ScatterAbsorb).unwrap();
        let mut out = vec![0.0; points * coefficients.values_per_point(stencils.spec())];
        stencils.extract(&coefficients, &voxels, &mut out, &control).unwrap();
        lap(4);
        let tracer =
            Tracer::new(&traced, &materials, TraceOptions { spp: split.spp, ..Default::default() }).unwrap();
        let mut radiance = vec![0.0; points * 3];
        tracer.radiance(&chosen, 0, &mut radiance, &control).unwrap();
        lap(5);
        let name = format!("{shape:?}");
        println!(
            "{v:3} fill {:6.0} surface {:6.0} sat {:6.0} volume {:6.0} stencil {:6.0} trace {:6.0} ms; {:8} surface voxels {:?} {:.22} {:?} {:.2} mm, depth {:.2}",
            t[0],
            t[1],
            t[2],
            t[3],
            t[4],
            t[5],
            surface.len(),
            grid.size(),
            name,
            texture.pattern,
            texture.scale_mm,
            texture.depth_mm
        );
        sums.iter_mut().zip(t).for_each(|(s, t)| *s += t / f64::from(volumes));
    }
    let total: f64 = sums.iter().sum();
    println!("mean {sums:.0?} ms of {total:.0}; {:.0} samples/s", points as f64 * 3e3 / total);
}
