//! Warps: maps from the unit square to the shapes that are sampled, each with its density.

use crate::lanes::{Lanes, Num, Vector, trigonometry};
use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, FRAC_PI_4};

/// The same functions for one point in each lane.
pub mod lanes {
    use super::*;

    /// [`super::disk`].
    #[inline(always)]
    pub fn disk<L: Lanes>([u, v]: [Num<L>; 2]) -> [Num<L>; 2] {
        let (x, y) = (2.0 * u - 1.0, 2.0 * v - 1.0);
        let wide = x.abs().gt(y.abs());
        let (r, other) = (Num::select(wide, x, y), Num::select(wide, y, x));
        let share = Num::select(r.is_zero(), r, other / r);
        let (sine, cosine) = trigonometry::small_sin_cos(share * FRAC_PI_4);
        [r * Num::select(wide, cosine, sine), r * Num::select(wide, sine, cosine)]
    }

    /// [`super::cosine_hemisphere`].
    #[inline(always)]
    pub fn cosine_hemisphere<L: Lanes>(u: [Num<L>; 2]) -> Vector<L> {
        let [x, y] = disk(u);
        Vector::new(x, y, (1.0 - x * x - y * y).clamp(0.0, 1.0).sqrt())
    }

    /// [`super::cosine_hemisphere_pdf`].
    #[inline(always)]
    pub fn cosine_hemisphere_pdf<L: Lanes>(z: Num<L>) -> Num<L> {
        z.clamp(0.0, 1.0) * FRAC_1_PI
    }

    /// [`super::sphere`].
    #[inline(always)]
    pub fn sphere<L: Lanes>([u, v]: [Num<L>; 2]) -> Vector<L> {
        let z = 1.0 - 2.0 * u;
        let r = (1.0 - z * z).clamp(0.0, 1.0).sqrt();
        let (sine, cosine) = trigonometry::sin_cos_turns(v);
        Vector::new(r * cosine, r * sine, z)
    }

    /// [`super::triangle`].
    #[inline(always)]
    pub fn triangle<L: Lanes>([x, y]: [Num<L>; 2]) -> [Num<L>; 2] {
        let upper = y.gt(x);
        let (half_x, half_y) = (0.5 * x, 0.5 * y);
        [Num::select(upper, half_x, x - half_y), Num::select(upper, y - half_x, half_y)]
    }
}

/// Uniform point on the unit disk (Shirley and Chiu's concentric map); density 1/π.
pub fn disk(u: [f32; 2]) -> [f32; 2] {
    lanes::disk(u.map(Num::from)).map(Num::get)
}

/// Cosine-weighted unit direction on the hemisphere around z; density [`cosine_hemisphere_pdf`].
pub fn cosine_hemisphere(u: [f32; 2]) -> Vec3 {
    lanes::cosine_hemisphere(u.map(Num::from)).into()
}

/// Density of [`cosine_hemisphere`] per solid angle, for a direction with cosine `z`; 0 below the hemisphere.
pub fn cosine_hemisphere_pdf(z: f32) -> f32 {
    lanes::cosine_hemisphere_pdf(Num::from(z)).get()
}

/// Uniform unit direction on the sphere; density 1/4π per solid angle.
pub fn sphere(u: [f32; 2]) -> Vec3 {
    lanes::sphere(u.map(Num::from)).into()
}

/// Barycentric weights of the second and third vertex, uniform on a triangle (Heitz 2019, *A Low-Distortion
/// Map Between Triangle and Square*); density 1/area.
pub fn triangle(u: [f32; 2]) -> [f32; 2] {
    lanes::triangle(u.map(Num::from)).map(Num::get)
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
