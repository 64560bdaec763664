//! Reflection at the inside of a smooth dielectric surface.

pub use pellucid_voxel::internal_reflectance;

/// As [`internal_reflectance`], in the kernel's precision.
#[inline(always)]
pub(crate) fn internal_reflectance_f32(cosine: f32, index: f32) -> f32 {
    let c = cosine.clamp(0.0, 1.0);
    let transmitted = 1.0 - index * index * (1.0 - c * c);
    if transmitted <= 0.0 {
        return 1.0;
    }
    let t = transmitted.sqrt();
    let s = (index * c - t) / (index * c + t);
    let p = (c - index * t) / (c + index * t);
    0.5 * (s * s + p * p)
}
