//! Rays into hemispheres: ambient occlusion, visibility of the sky, form factors.

use super::shares::in_parts;
use crate::geom::{Basis, Sampler, warp};
use glam::Vec3;

/// Distribution of directions over a hemisphere.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Hemisphere {
    /// As many towards each as the cosine of its angle with the normal: the mean over rays is that of light on a matte
    /// surface.
    Cosine,
    /// As many towards each solid angle.
    Uniform,
}

/// The most rays that a thread makes at a time.
const MADE_AT_ONCE: usize = 1 << 14;

/// Rays from points into the hemispheres about their normals, as rows of an origin and a direction of length 1: `count`
/// of the first point, then `count` of the next. They are stratified, and a pure function of the point's index, the
/// ray's and `seed`. Origins are `offset` away from the points, along the normals. On the current rayon pool.
///
/// ```
/// use raystream_rays::query::{Hemisphere, hemispheres};
///
/// let mut rays = [[0.0; 6]; 64];
/// hemispheres(&[[1.0, 2.0, 3.0]], &[[0.0, 0.0, 2.0]], Hemisphere::Cosine, 0.5, 7, &mut rays);
/// assert!(rays.iter().all(|ray| ray[..3] == [1.0, 2.0, 3.5] && ray[5] >= 0.0));
/// ```
///
/// # Panics
/// If there are not as many normals as points, or not as many rays for each point as for the others.
pub fn hemispheres(
    points: &[[f32; 3]],
    normals: &[[f32; 3]],
    over: Hemisphere,
    offset: f32,
    seed: u64,
    rays: &mut [[f32; 6]],
) {
    assert_eq!(points.len(), normals.len(), "one normal per point");
    let count = rays.len().checked_div(points.len()).unwrap_or(0);
    assert_eq!(rays.len(), count * points.len(), "as many rays for each point");
    in_parts(rays.len(), rays, MADE_AT_ONCE, |first, _, rays| {
        for (index, ray) in (first..).zip(rays) {
            let (point, sample) = (index / count, index % count);
            let normal = Vec3::from_array(normals[point]).normalize_or(Vec3::Z);
            let numbers = Sampler::new(point as u32, sample as u32, seed).pair(0);
            let local = match over {
                Hemisphere::Cosine => warp::cosine_hemisphere(numbers),
                Hemisphere::Uniform => {
                    let [x, y, z] = warp::sphere(numbers).to_array();
                    Vec3::new(x, y, z.abs())
                }
            };
            let [dx, dy, dz] = Basis::from_normal(normal).to_world(local).to_array();
            let [x, y, z] = (Vec3::from_array(points[point]) + offset * normal).to_array();
            *ray = [x, y, z, dx, dy, dz];
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_spread_as_asked() {
        let (points, normals) =
            ([[0.0; 3]; 4], [[0.6, 0.0, 0.8], [0.0, -3.0, 0.0], [1.0, 1.0, 1.0], [0.0, 0.0, -1.0]]);
        for (over, mean) in [(Hemisphere::Cosine, 2.0 / 3.0), (Hemisphere::Uniform, 0.5)] {
            let mut rays = vec![[0.0; 6]; 4 * 4096];
            hemispheres(&points, &normals, over, 0.0, 3, &mut rays);
            for (normal, rays) in normals.iter().zip(rays.chunks(4096)) {
                let normal = Vec3::from_array(*normal).normalize();
                let cosines = rays.iter().map(|&[.., x, y, z]| {
                    assert!((Vec3::new(x, y, z).length() - 1.0).abs() < 1e-5);
                    Vec3::new(x, y, z).dot(normal)
                });
                assert!(cosines.clone().all(|cosine| cosine > -1e-6));
                let found = cosines.sum::<f32>() / 4096.0;
                assert!((found - mean).abs() < 2e-3, "{over:?}: {found}");
            }
        }
    }

    #[test]
    fn rays_depend_on_the_seed_and_not_on_threads() {
        let make = |seed, threads| {
            let mut rays = vec![[0.0; 6]; 3 * 20_000];
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            let (points, normals) = ([[1.0; 3]; 3], [[0.0, 1.0, 0.0]; 3]);
            pool.install(|| hemispheres(&points, &normals, Hemisphere::Cosine, 0.1, seed, &mut rays));
            rays
        };
        assert_eq!(make(1, 1), make(1, 3));
        assert_ne!(make(1, 1), make(2, 1));
        assert_ne!(make(1, 1)[..20_000], make(1, 1)[20_000..40_000]);
    }
}
