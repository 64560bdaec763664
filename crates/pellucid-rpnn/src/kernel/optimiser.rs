//! The optimiser's sums. Written so that they vectorise in whichever form they are inlined into; every form gives
//! the same bits.

/// The numbers of one step.
#[derive(Clone, Copy)]
pub(crate) struct Update {
    pub scale: f32,
    pub first_rate: f32,
    pub second_rate: f32,
    pub first_scale: f32,
    pub second_scale: f32,
    pub rate: f32,
    pub epsilon: f32,
    pub decay: f32,
    pub average_rate: f32,
}

/// One step over all parameters.
#[inline(always)]
pub(super) fn update(
    u: Update,
    parameters: &mut [f32],
    gradient: &[f32],
    first: &mut [f32],
    second: &mut [f32],
    average: &mut [f32],
) {
    let n = parameters.len();
    // Equal lengths in sight of the compiler: one bound for all vectors.
    let (gradient, first) = (&gradient[..n], &mut first[..n]);
    let (second, average) = (&mut second[..n], &mut average[..n]);
    for i in 0..n {
        let g = gradient[i] * u.scale;
        first[i] += u.first_rate * (g - first[i]);
        second[i] += u.second_rate * (g * g - second[i]);
        let direction = first[i] * u.first_scale / ((second[i] * u.second_scale).sqrt() + u.epsilon);
        parameters[i] -= u.rate * direction + u.decay * parameters[i];
        average[i] += u.average_rate * (parameters[i] - average[i]);
    }
}

/// Sum of squares in f64, in 16 interleaved sums: an order that every form shares.
#[inline(always)]
pub(super) fn sum_of_squares(values: &[f32]) -> f64 {
    let (whole, rest) = values.as_chunks::<16>();
    let mut sums = [0.0f64; 16];
    for values in whole {
        for (s, &v) in sums.iter_mut().zip(values) {
            *s += f64::from(v) * f64::from(v);
        }
    }
    sums.iter().sum::<f64>() + rest.iter().map(|&v| f64::from(v) * f64::from(v)).sum::<f64>()
}
