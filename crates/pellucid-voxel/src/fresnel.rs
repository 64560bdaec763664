//! Reflection at the inside of a smooth dielectric surface.

/// Unpolarised Fresnel reflectance for light inside a medium of refractive index `index` that
/// meets the outside at angle acos(`cosine`) to the normal; 1 past the critical angle.
///
/// ```
/// use pellucid_voxel::internal_reflectance;
/// assert!((internal_reflectance(1.0, 1.5) - 0.04).abs() < 1e-12);
/// assert_eq!(internal_reflectance(0.7, 1.5), 1.0);
/// ```
pub fn internal_reflectance(cosine: f64, index: f64) -> f64 {
    let c = cosine.clamp(0.0, 1.0);
    let transmitted = 1.0 - index * index * (1.0 - c * c);
    if transmitted <= 0.0 {
        return 1.0;
    }
    let t = transmitted.sqrt();
    let s = (index * c - t) / (index * c + t);
    let p = (c - index * t) / (c + index * t);
    (0.5 * (s * s + p * p)).min(1.0)
}
