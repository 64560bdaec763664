//! All forms of the kernel against sums in f64.

use proptest::prelude::*;
use rand_core::Rng;
use rand_pcg::Pcg64;

use super::*;

fn values(seed: u64, n: usize) -> Vec<f32> {
    let mut rng = Pcg64::new(u128::from(seed), 3);
    (0..n).map(|_| (rng.next_u32() >> 8) as f32 / (1 << 23) as f32 - 1.0).collect()
}

/// Every form that this machine runs.
fn forms() -> Vec<Form> {
    let mut forms: Vec<Form> = InstructionSet::available().map(Form::of).collect();
    forms.dedup();
    forms
}

/// The nearest number with eight significant bits, by way of f64.
fn rounded(v: f32) -> f32 {
    if v == 0.0 {
        return v;
    }
    let scale = f64::powi(2.0, 7 - f64::from(v.abs()).log2().floor() as i32);
    ((f64::from(v) * scale).round_ties_even() / scale) as f32
}

#[derive(Clone, Copy, Debug)]
struct Case {
    extents: [usize; 3],
    transposed: [bool; 2],
    add: usize,
    flags: [bool; 3],
    half: bool,
}

fn check(case: Case, seed: u64) {
    let [m, k, n] = case.extents;
    let (a, b) = (values(seed, m * k), values(seed + 1, k * n));
    let (start, other, mask, bias) =
        (values(seed + 2, m * n), values(seed + 3, m * n), values(seed + 4, m * n), values(seed + 5, n));
    let [has_bias, relu, has_mask] = case.flags;
    let finish = Finish {
        add: [Add::Nothing, Add::Output, Add::Other(&other)][case.add],
        bias: has_bias.then_some(&bias),
        relu,
        mask: has_mask.then_some(&mask),
    };
    let precision = if case.half { Precision::Bf16 } else { Precision::F32 };
    let matrix = |data, rows, cols, transposed| {
        if transposed { Matrix::rows(data, cols, rows).t() } else { Matrix::rows(data, rows, cols) }
    };
    let [a_t, b_t] = case.transposed;
    let round = |v: f32| f64::from(if case.half { rounded(v) } else { v });
    let at = |data: &[f32], rows: usize, cols: usize, t: bool, i: usize, j: usize| {
        round(if t { data[j * rows + i] } else { data[i * cols + j] })
    };
    for form in forms() {
        let mut out = start.clone();
        let mut products = Products::new(form);
        products.product_once(&mut out, matrix(&a, m, k, a_t), matrix(&b, k, n, b_t), precision, finish);
        for i in 0..m {
            for j in 0..n {
                let mut sum: f64 = (0..k).map(|l| at(&a, m, k, a_t, i, l) * at(&b, k, n, b_t, l, j)).sum();
                sum += [0.0, f64::from(start[i * n + j]), f64::from(other[i * n + j])][case.add];
                sum += if has_bias { f64::from(bias[j]) } else { 0.0 };
                sum = if relu { sum.max(0.0) } else { sum };
                sum = if has_mask && mask[i * n + j] <= 0.0 { 0.0 } else { sum };
                let got = f64::from(out[i * n + j]);
                let bound = 1e-6 * (1.0 + k as f64);
                assert!((got - sum).abs() < bound, "{form:?} {case:?} ({i}, {j}): {got} {sum}");
            }
        }
        let mut alone = vec![0.0; n];
        if m > 0 && !a_t {
            // A row's result does not depend on the rows beside it.
            for i in [0, m / 2, m - 1] {
                let row = |v: &[f32]| v[i * n..(i + 1) * n].to_vec();
                let (other, mask) = (row(&other), row(&mask));
                alone.copy_from_slice(&start[i * n..(i + 1) * n]);
                let finish = Finish {
                    add: [Add::Nothing, Add::Output, Add::Other(&other)][case.add],
                    mask: has_mask.then_some(&mask),
                    ..finish
                };
                let left = matrix(&a[i * k..(i + 1) * k], 1, k, false);
                products.product_once(&mut alone, left, matrix(&b, k, n, b_t), precision, finish);
                assert_eq!(alone, out[i * n..(i + 1) * n], "{form:?} {case:?} row {i}");
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn products_agree_with_sums(
        extents in prop::array::uniform3(0usize..70),
        transposed in prop::array::uniform2(any::<bool>()),
        add in 0usize..3,
        flags in prop::array::uniform3(any::<bool>()),
        half in any::<bool>(),
        seed in any::<u32>(),
    ) {
        check(Case { extents, transposed, add, flags, half }, u64::from(seed));
    }
}

/// The extents that the networks use.
#[test]
fn the_networks_shapes_agree() {
    for (i, extents) in [
        [25, 480, 480],
        [480, 33, 480],
        [17, 270, 270],
        [60, 200, 60],
        [100, 60, 60],
        [90, 60, 1],
        [1, 90, 60],
    ]
    .into_iter()
    .enumerate()
    {
        for half in [false, true] {
            let transposed = [i % 2 == 1, i % 3 == 1];
            check(Case { extents, transposed, add: i % 3, flags: [true, i % 2 == 0, i % 3 == 0], half }, 5);
        }
    }
}

#[test]
fn rows_are_summed() {
    let v = values(3, 7 * 45);
    for form in forms() {
        let mut sums = vec![1.0; 45];
        Products::new(form).add_rows(&v, &mut sums);
        for (j, sum) in sums.iter().enumerate() {
            let expected: f32 = 1.0 + (0..7).map(|i| v[i * 45 + j]).sum::<f32>();
            assert!((sum - expected).abs() < 1e-5);
        }
    }
}

/// The transform and the optimiser give the same bits in every form.
#[test]
fn elementwise_work_does_not_depend_on_the_form() {
    let n = 1003;
    let positive: Vec<f32> = values(4, n).iter().map(|v| 9.0 * v.abs()).collect();
    let step = Update {
        scale: 0.7,
        first_rate: 0.1,
        second_rate: 0.01,
        first_scale: 1.3,
        second_scale: 2.1,
        rate: 1e-3,
        epsilon: 1e-8,
        decay: 1e-5,
        average_rate: 0.02,
    };
    let mut results = InstructionSet::available().map(|set| {
        let mut features = positive.clone();
        log_features(set, &mut features, 4.0);
        let [mut parameters, mut first, mut average] = [5, 6, 7].map(|seed| values(seed, n));
        let mut second = positive.clone();
        update(set, step, &mut parameters, &values(8, n), &mut first, &mut second, &mut average);
        let squares = sum_of_squares(set, &values(9, n));
        let bits: Vec<u32> =
            [features, parameters, first, second, average].concat().iter().map(|v| v.to_bits()).collect();
        (bits, squares.to_bits())
    });
    let portable = results.next().unwrap();
    assert!(results.all(|of_set| of_set == portable));
}

/// Forms that count as one instruction set give the same bits: a record of the one may stand for the other.
#[test]
fn forms_of_one_instruction_set_agree_to_the_bit() {
    let [m, k, n] = [29, 131, 77];
    let (a, b, mask) = (values(10, m * k), values(11, k * n), values(12, m * n));
    for precision in [Precision::F32, Precision::Bf16] {
        let results: Vec<(InstructionSet, Vec<u32>)> = forms()
            .into_iter()
            .map(|form| {
                let mut out = values(13, m * n);
                let finish = Finish { add: Add::Output, bias: Some(&b[..n]), relu: true, mask: Some(&mask) };
                let mut products = Products::new(form);
                let (left, right) = (Matrix::rows(&a, m, k), Matrix::rows(&b, k, n));
                products.product_once(&mut out, left, right, precision, finish);
                products.add_rows(&values(14, m * n), &mut out[..n]);
                (form.instruction_set(precision), out.iter().map(|v| v.to_bits()).collect())
            })
            .collect();
        for pair in results.windows(2) {
            assert!(pair[0].0 <= pair[1].0);
            assert!(pair[0].0 < pair[1].0 || pair[0].1 == pair[1].1, "{precision:?} {}", pair[0].0);
        }
    }
}

#[test]
fn a_form_is_the_best_that_its_set_allows() {
    for set in InstructionSet::available() {
        let form = Form::of(set);
        assert_eq!(form == Form::Portable, set == InstructionSet::Portable, "{set}");
        #[cfg(target_arch = "x86_64")]
        match set {
            InstructionSet::Avx2 => assert!(matches!(form, Form::Avx2(_))),
            InstructionSet::Avx512 => assert!(matches!(form, Form::Avx512(proof) if !proof.bf16())),
            InstructionSet::Avx512Bf16 => assert!(matches!(form, Form::Avx512(proof) if proof.bf16())),
            _ => {}
        }
    }
}

#[test]
#[should_panic(expected = "a matrix of another extent")]
fn extents_are_checked() {
    Matrix::rows(&[0.0; 10], 2, 6);
}
