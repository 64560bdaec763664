//! The kernel's plain Rust compiled for more than the compiler may use everywhere.

/// Defines, for one form's features, safe functions that run the plain ones compiled for them. Expects the form's
/// `Proof` in scope.
macro_rules! compile_plain_work {
    ($features:literal) => {
        compile_plain_work!($features, pack::pack_right(right: Matrix<'_>, packed: &mut Packed));
        compile_plain_work!($features, pack::pack_left(left: Matrix<'_>, words: &mut [u32]));
        compile_plain_work!($features, pack::add_rows(values: &[f32], sums: &mut [f32]));
        compile_plain_work!($features, features::log_features(level: &mut [f32], scale: f32));
        compile_plain_work!($features, optimiser::sum_of_squares(values: &[f32]) -> f64);
        compile_plain_work!($features, optimiser::update(
            u: Update,
            parameters: &mut [f32],
            gradient: &[f32],
            first: &mut [f32],
            second: &mut [f32],
            average: &mut [f32]
        ));
    };
    ($features:literal, $module:ident::$name:ident($($arg:ident: $type:ty),*) $(-> $out:ty)?) => {
        pub(super) fn $name(_: Proof, $($arg: $type),*) $(-> $out)? {
            #[target_feature(enable = $features)]
            fn compiled($($arg: $type),*) $(-> $out)? {
                $module::$name($($arg),*)
            }
            // SAFETY: the proof says that the machine has these features.
            unsafe { compiled($($arg),*) }
        }
    };
}

pub(super) use compile_plain_work;
