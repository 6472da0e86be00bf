//! Cameras as clients send and receive them.

use glam::Vec3;
use raystream::picture::RenderSpec;
use raystream::scene::{Aperture, Camera, Projection};
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
    /// Gives a spec this camera. What the pose does not say, such as another projection or blades, stays that of
    /// `own`, the scene's camera.
    pub fn write(&self, own: Option<&Camera>, spec: &mut RenderSpec) {
        let has_fov = own.is_none_or(|own| matches!(own.projection, Projection::Perspective { .. }));
        (spec.camera.eye, spec.camera.target, spec.camera.up) =
            (Some(self.eye), Some(self.target), Some(self.up));
        spec.camera.fov = self.fov.filter(|_| has_fov);
        let closed = own.is_some_and(|own| own.aperture.is_some()).then_some(0.0);
        spec.optics.aperture_radius = self.lens.map(|lens| lens.radius).or(closed);
        spec.optics.focus_distance = self.lens.map(|lens| lens.focus_distance);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use raystream::picture::Frames;
    use raystream::scene::Scene;

    /// The camera of a spec with the camera of a pose, in a scene with its own.
    fn camera(pose: &Pose, own: Camera) -> Camera {
        let (mut spec, mut scene) = (RenderSpec::default(), Scene::default());
        pose.write(Some(&own), &mut spec);
        scene.camera = Some(own);
        let frames = Frames::new(&spec, &scene).expect("a still");
        frames.camera(&spec, 0).expect("a camera")
    }

    #[test]
    fn a_pose_keeps_what_it_does_not_say() {
        let base = Camera::new(Vec3::new(0.0, 1.0, 5.0), Vec3::ZERO)
            .with_aperture(Aperture::new(0.1, 5.0).with_blades(6, 10.0));
        let pose = Pose { eye: Vec3::new(3.0, 1.0, 0.0), fov: Some(30.0), ..Pose::from(&base) };
        let moved = camera(&pose, base);
        assert_eq!(moved.aperture, base.aperture);
        assert_eq!(Pose::from(&moved), pose);
        let sharp = Pose { lens: None, ..pose };
        assert_eq!(Pose::from(&camera(&sharp, base)), sharp);
        let flat = base.with_projection(Projection::Orthographic { height: 2.0 });
        let pose = Pose { fov: Some(30.0), ..Pose::from(&flat) };
        assert_eq!(camera(&pose, flat).projection, flat.projection);
    }
}
