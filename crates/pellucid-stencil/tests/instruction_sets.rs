//! Descriptors do not depend on the instruction set, and one that is lacking is refused.

mod common;

use common::*;
use pellucid_stencil::{Coefficients, Features, InstructionSet, StencilError, StencilSpec, Stencils};
use pellucid_voxel::Control;

#[test]
fn every_instruction_set_gives_the_same_bits() {
    let spec = StencilSpec::paper();
    // Seven materials take two groups; the points fill windows, lattices and single look-ups.
    let grid = test_grid(0, 7, [90, 60, 110], 12);
    let sat = sat_of(&grid, 7);
    let table = table_of(7, 3, 9, 1.0);
    let points: Vec<[u32; 3]> = (0..400).map(|i| [i * 7 % 90, i * i % 60, i / 4]).collect();
    for features in [Features::ScatterAbsorb, Features::WithOccupancy] {
        let coefficients = Coefficients::all(&table, features).unwrap();
        let mut results = InstructionSet::available().map(|set| {
            let stencils = Stencils::new(spec, &grid, &sat).unwrap().with_instruction_set(set).unwrap();
            let mut out = vec![f32::NAN; points.len() * coefficients.values_per_point(&spec)];
            stencils.extract(&coefficients, &points, &mut out, &Control::none()).unwrap();
            (set, out.iter().map(|v| v.to_bits()).collect::<Vec<_>>())
        });
        let (_, portable) = results.next().unwrap();
        for (set, bits) in results {
            assert!(bits == portable, "{set}");
        }
    }
}

#[test]
fn a_set_is_taken_as_asked_and_one_that_is_lacking_is_refused() {
    let grid = test_grid(1, 2, [20, 20, 20], 3);
    let sat = sat_of(&grid, 2);
    for set in InstructionSet::ALL {
        let stencils = Stencils::new(StencilSpec::paper(), &grid, &sat).unwrap().with_instruction_set(set);
        if set > InstructionSet::detect() {
            assert!(matches!(stencils, Err(StencilError::Unsupported(_))), "{set}");
            continue;
        }
        // Forms: AVX-512 and the portable one.
        let form =
            if set >= InstructionSet::Avx512 { InstructionSet::Avx512 } else { InstructionSet::Portable };
        assert_eq!(stencils.unwrap().instruction_set(), form, "{set}");
    }
}
