//! Cameras as clients send and receive them.

use glam::Vec3;
use raystream::scene::{Aperture, Camera, CameraError, Projection};
use serde::{Deserialize, Serialize};

/// The position, direction, field of view and lens of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Position in world space.
    pub eye: Vec3,
    /// A point on the view axis.
    pub target: Vec3,
    /// The up direction.
    pub up: Vec3,
    /// Vertical field of view in degrees. `None` for projections other than perspective.
    pub fov: Option<f32>,
    /// The opening of the lens. `None` if everything is sharp.
    pub lens: Option<Lens>,
}

/// The opening of a lens.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lens {
    /// Radius in world units, above 0.
    pub radius: f32,
    /// Distance of the sharp plane along the view axis in world units, above 0.
    pub focus_distance: f32,
}

impl From<&Camera> for Pose {
    fn from(camera: &Camera) -> Self {
        let fov = match camera.projection {
            Projection::Perspective { fov_degrees } => Some(fov_degrees),
            _ => None,
        };
        let lens =
            camera.aperture.map(|Aperture { radius, focus_distance, .. }| Lens { radius, focus_distance });
        Self { eye: camera.eye, target: camera.target, up: camera.up, fov, lens }
    }
}

impl Pose {
    /// A camera with this pose. What the pose does not say, such as another projection or blades, is `base`'s.
    ///
    /// # Errors
    /// If a picture of this size has no view from there.
    pub fn camera(&self, base: &Camera, [width, height]: [u32; 2]) -> Result<Camera, CameraError> {
        let mut camera = *base;
        (camera.eye, camera.target, camera.up) = (self.eye, self.target, self.up);
        if let (Some(fov_degrees), Projection::Perspective { .. }) = (self.fov, base.projection) {
            camera.projection = Projection::Perspective { fov_degrees };
        }
        camera.aperture = self.lens.map(|lens| {
            let mut aperture = base.aperture.unwrap_or(Aperture::new(0.0, 0.0));
            (aperture.radius, aperture.focus_distance) = (lens.radius, lens.focus_distance);
            aperture
        });
        camera.lens(width, height)?;
        Ok(camera)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pose_keeps_what_it_does_not_say() {
        let base = Camera::new(Vec3::new(0.0, 1.0, 5.0), Vec3::ZERO)
            .with_aperture(Aperture::new(0.1, 5.0).with_blades(6, 10.0));
        let pose = Pose { eye: Vec3::new(3.0, 1.0, 0.0), fov: Some(30.0), ..Pose::from(&base) };
        let moved = pose.camera(&base, [64, 64]).expect("a view");
        assert_eq!(moved.aperture, base.aperture);
        assert_eq!(Pose::from(&moved), pose);
        let flat = base.with_projection(Projection::Orthographic { height: 2.0 });
        let moved = Pose { fov: Some(30.0), ..Pose::from(&flat) }.camera(&flat, [64, 64]).expect("a view");
        assert_eq!(moved.projection, flat.projection);
    }

    #[test]
    fn a_pose_without_a_view_is_refused() {
        let base = Camera::new(Vec3::Z, Vec3::ZERO);
        let here = Pose { target: Vec3::Z, ..Pose::from(&base) };
        assert!(here.camera(&base, [64, 64]).is_err());
        let nowhere = Pose { eye: Vec3::splat(f32::NAN), ..Pose::from(&base) };
        assert!(nowhere.camera(&base, [64, 64]).is_err());
    }
}
