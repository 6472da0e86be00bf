//! Warps from the unit square to the shapes that are sampled, each with its density.

use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, PI, TAU};

/// Uniform point on the unit disk (Shirley and Chiu's concentric map).
pub fn disk(u: [f32; 2]) -> [f32; 2] {
    let x = 2.0 * u[0] - 1.0;
    let y = 2.0 * u[1] - 1.0;
    if x == 0.0 && y == 0.0 {
        return [0.0, 0.0];
    }
    let (r, theta) =
        if x.abs() > y.abs() { (x, PI / 4.0 * (y / x)) } else { (y, PI / 2.0 - PI / 4.0 * (x / y)) };
    [r * libm::cosf(theta), r * libm::sinf(theta)]
}

/// Cosine-weighted direction on the upper hemisphere; density [`cosine_hemisphere_pdf`].
pub fn cosine_hemisphere(u: [f32; 2]) -> Vec3 {
    let [x, y] = disk(u);
    Vec3::new(x, y, (1.0 - x * x - y * y).max(0.0).sqrt())
}

/// Density per solid angle of [`cosine_hemisphere`] for a direction with cosine `z`.
pub fn cosine_hemisphere_pdf(z: f32) -> f32 {
    z.max(0.0) * FRAC_1_PI
}

/// Uniform direction on the sphere; density 1/4π.
pub fn sphere(u: [f32; 2]) -> Vec3 {
    let z = 1.0 - 2.0 * u[0];
    let r = (1.0 - z * z).max(0.0).sqrt();
    let phi = TAU * u[1];
    Vec3::new(r * libm::cosf(phi), r * libm::sinf(phi), z)
}

/// Uniform barycentric weights (of the second and third vertex) on a triangle; density 1/area.
pub fn triangle(u: [f32; 2]) -> [f32; 2] {
    // Heitz 2019, A Low-Distortion Map Between Triangle and Square.
    let (x, y) = (u[0], u[1]);
    if y > x { [0.5 * x, y - 0.5 * x] } else { [x - 0.5 * y, 0.5 * y] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Sampler;

    #[test]
    fn warps_have_the_moments_of_their_densities() {
        let n = 1 << 14;
        let (mut cos, mut dir, mut bary) = (0.0, Vec3::ZERO, [0.0; 2]);
        for i in 0..n {
            let u = Sampler::new(0, i, 1).pair(0);
            let c = cosine_hemisphere(u);
            assert!((c.length() - 1.0).abs() < 1e-5);
            cos += c.z;
            dir += sphere(u);
            let b = triangle(u);
            assert!(b[0] >= 0.0 && b[1] >= 0.0 && b[0] + b[1] <= 1.0);
            bary[0] += b[0];
            bary[1] += b[1];
        }
        let n = n as f32;
        assert!((cos / n - 2.0 / 3.0).abs() < 1e-3);
        assert!((dir / n).length() < 1e-3);
        assert!((bary[0] / n - 1.0 / 3.0).abs() < 1e-3 && (bary[1] / n - 1.0 / 3.0).abs() < 1e-3);
    }
}
