//! The matrix of a camera.

use super::RasterError;
use glam::{DMat4, DVec4, Mat4};
use raystream::scene::{Camera, Projection};

/// Distance of the near plane, as a share of the distance between eye and target.
const NEAR: f64 = 1e-3;

/// The matrix that takes points of the world to clip space. Depth is 1 at the near plane and 0 infinitely far away.
pub fn clip_matrix(camera: &Camera, [width, height]: [u32; 2]) -> Result<Mat4, RasterError> {
    let is_plain = matches!(camera.projection, Projection::Perspective { .. }) && camera.aperture.is_none();
    let lens = camera.intrinsics(width, height).filter(|_| is_plain && camera.shift == glam::Vec2::ZERO);
    let lens = lens.ok_or_else(|| RasterError::Projection(camera.to_string()))?;
    let near = NEAR * f64::from(camera.eye.distance(camera.target));
    let [x, y] = [2.0 * lens.fx / f64::from(width), 2.0 * lens.fy / f64::from(height)];
    // The camera looks along -z.
    let project = DMat4::from_cols(DVec4::X * x, DVec4::Y * y, -DVec4::W, DVec4::Z * near);
    Ok((project * camera.to_world()?.inverse()).as_mat4())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn a_point_on_a_pixels_ray_is_at_the_pixel() {
        let camera = Camera::new(Vec3::new(3.0, 2.0, 5.0), Vec3::new(0.2, 0.1, -0.3)).with_fov(50.0);
        let matrix = clip_matrix(&camera, [64, 48]).expect("a perspective");
        let lens = camera.lens(64, 48).expect("a view");
        for (x, y) in [(0, 0), (63, 0), (20, 47)] {
            let (origin, direction) = lens.ray(x, y, [0.5; 2]).expect("no distortion");
            let depths = [1.0, 9.0].map(|distance| {
                let clip = matrix * (origin + direction * distance).extend(1.0);
                let at = clip / clip.w;
                let pixel = [(at.x + 1.0) * 32.0, (1.0 - at.y) * 24.0];
                assert!((pixel[0] - x as f32 - 0.5).abs() < 1e-3, "{pixel:?}");
                assert!((pixel[1] - y as f32 - 0.5).abs() < 1e-3, "{pixel:?}");
                at.z
            });
            assert!(1.0 > depths[0] && depths[0] > depths[1] && depths[1] > 0.0, "{depths:?}");
        }
        let wide = camera.with_projection(Projection::Panorama);
        assert!(matches!(clip_matrix(&wide, [8, 8]), Err(RasterError::Projection(_))));
    }
}
