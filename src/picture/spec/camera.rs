//! The camera: where it is, where it looks.

use super::form;
use super::option::spec_group;
use crate::scene::Camera;

spec_group! {
    /// The camera: where it is, where it looks.
    pub struct CameraSpec {
        /// Camera position [default: the scene's camera, else one that frames the scene].
        maybe "eye" eye: form::Vector, "X,Y,Z";
        /// Point that the camera looks at.
        maybe "target" target: form::Vector, "X,Y,Z";
        /// Up direction.
        maybe "up" up: form::Vector, "X,Y,Z";
        /// Vertical field of view, in degrees.
        maybe "fov" fov: form::Plain, "DEG";
    }
}

impl CameraSpec {
    /// True if no option is given.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// Returns the scene's own camera, or one that frames it, changed by the options.
    pub fn apply(&self, own: Option<Camera>, framed: impl FnOnce() -> Camera) -> Camera {
        let base = own.unwrap_or_else(framed);
        // A moved camera keeps its target.
        let (eye, target) = (self.eye.unwrap_or(base.eye), self.target.unwrap_or(base.target));
        let camera = base.posed_as(&Camera::new(eye, target).with_up(self.up.unwrap_or(base.up)));
        self.fov.map_or(camera, |fov| camera.with_fov(fov))
    }
}
