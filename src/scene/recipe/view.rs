//! Cameras of recipes.

use crate::scene::{Aperture, Camera, Distortion, Intrinsics, Projection};
use glam::{Vec2, Vec3};
use serde::Deserialize;

/// A camera: its pose, one projection, and optionally shift and aperture.
///
/// ```json
/// "camera": { "eye": [0, 2, 6], "target": [0, 1, 0], "fov_degrees": 35, "shift": [0, 0.1],
///             "aperture": { "radius": 0.02, "focus_distance": 6, "blades": 6, "rotation_degrees": 15 } },
/// "cameras": { "plan": { "eye": [0, 9, 0], "target": [0, 0, 0], "up": [0, 0, -1], "orthographic_height": 4 },
///              "left": { "eye": [-0.06, 1, 0], "target": [-0.06, 1, -1],
///                        "intrinsics": { "fx": 610, "fy": 608.5, "cx": 322.4, "cy": 241,
///                                        "distortion": [-0.28, 0.07, 1e-3, -5e-4] } },
///              "door": { "eye": [0, 2, 0], "target": [0, 2, -1],
///                        "intrinsics": { "fx": 285, "fy": 285, "cx": 320, "cy": 240, "fisheye": [0.01, 0, 0, 0] } },
///              "dome": { "eye": [0, 1, 0], "target": [0, 1, -1], "panorama": true } }
/// ```
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct View {
    /// Position.
    pub eye: Vec3,
    /// A point on the view axis.
    pub target: Vec3,
    /// The up direction; +y by default.
    pub up: Option<Vec3>,
    /// Vertical field of view in degrees, for a perspective camera.
    pub fov_degrees: Option<f32>,
    /// Height of the picture in world units, for an orthographic camera.
    pub orthographic_height: Option<f32>,
    /// The numbers of a calibrated camera.
    pub intrinsics: Option<IntrinsicsRecipe>,
    /// True if the camera sees to all sides.
    #[serde(default)]
    pub panorama: bool,
    /// Lens shift to the right and up, in widths and heights of the picture.
    pub shift: Option<Vec2>,
    /// The opening of a thin lens.
    pub aperture: Option<ApertureRecipe>,
}

/// Intrinsics in pixels of the picture: see [`Intrinsics`].
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct IntrinsicsRecipe {
    /// Focal length over the width of a pixel.
    pub fx: f64,
    /// Focal length over the height of a pixel.
    pub fy: f64,
    /// The principal point from the left edge.
    pub cx: f64,
    /// The principal point from the upper edge.
    pub cy: f64,
    /// k1, k2, p1, p2, then k3, then k4 to k6, then s1 to s4.
    pub distortion: Option<Vec<f64>>,
    /// k1 to k4 of the fisheye model.
    pub fisheye: Option<[f64; 4]>,
}

/// An aperture: see [`Aperture`].
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct ApertureRecipe {
    /// Radius in world units.
    pub radius: f32,
    /// Distance of the plane that is sharp.
    pub focus_distance: f32,
    /// Number of blades; 0, the default, for a disk.
    #[serde(default)]
    pub blades: u32,
    /// Rotation of the blades in degrees.
    #[serde(default)]
    pub rotation_degrees: f32,
}

impl View {
    /// The camera.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn camera(&self) -> Result<Camera, String> {
        let given = [
            self.fov_degrees.map(|fov_degrees| Ok(Projection::Perspective { fov_degrees })),
            self.orthographic_height.map(|height| Ok(Projection::Orthographic { height })),
            self.intrinsics.as_ref().map(IntrinsicsRecipe::projection),
            self.panorama.then_some(Ok(Projection::Panorama)),
        ];
        let mut given = given.into_iter().flatten();
        let (Some(projection), None) = (given.next(), given.next()) else {
            return Err(
                "give exactly one of fov_degrees, orthographic_height, intrinsics and \"panorama\": true"
                    .into(),
            );
        };
        let camera = Camera::new(self.eye, self.target)
            .with_up(self.up.unwrap_or(Vec3::Y))
            .with_projection(projection?)
            .with_shift(self.shift.unwrap_or_default());
        let camera = match self.aperture {
            None => camera,
            Some(ApertureRecipe { radius, focus_distance, blades, rotation_degrees }) => {
                let aperture = Aperture::new(radius, focus_distance).with_blades(blades, rotation_degrees);
                camera.with_aperture(aperture)
            }
        };
        camera.lens(1, 1).map_err(|error| error.to_string())?;
        Ok(camera)
    }
}

impl IntrinsicsRecipe {
    fn projection(&self) -> Result<Projection, String> {
        let Self { fx, fy, cx, cy, ref distortion, fisheye } = *self;
        let distortion = match (distortion, fisheye) {
            (None, None) => Distortion::None,
            (None, Some(k)) => Distortion::Fisheye { k },
            (Some(numbers), None) => Distortion::brown_conrady(numbers).ok_or_else(|| {
                format!("distortion has {} numbers; it must have 4, 5, 8 or 12", numbers.len())
            })?,
            (Some(_), Some(_)) => return Err("give distortion or fisheye, not both".into()),
        };
        Ok(Projection::Intrinsics(Intrinsics::new(fx, fy, cx, cy).with_distortion(distortion)))
    }
}
