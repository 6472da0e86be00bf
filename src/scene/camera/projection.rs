//! Projections: which direction each pixel sees.

use super::CameraError;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Mapping of the points in front of a camera to the picture.
///
/// Picture coordinates are in pixels, x to the right and y down. (0, 0) is the top left corner of the picture, and
/// (0.5, 0.5) is the centre of its top left pixel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Projection {
    /// A central projection with square pixels. The view axis meets the middle of the picture.
    Perspective {
        /// Vertical field of view in degrees, between 0 and 180.
        fov_degrees: f32,
    },
    /// A parallel projection with square pixels. What lies behind the plane through the eye is not seen.
    Orthographic {
        /// Height of the picture in world units, above 0.
        height: f32,
    },
    /// A calibrated camera.
    Intrinsics(Intrinsics),
    /// Everything around the eye (equirectangular): longitude from −180° to 180° from left to right, latitude from 90°
    /// to −90° from top to bottom. The middle of the picture is the view axis.
    Panorama,
}

/// The intrinsic parameters of a calibrated camera, in pixels of the picture that is rendered.
///
/// A point (x, y, z) in the axes of the camera, x right, y down and z forward, is seen at (`fx`·x″ + `cx`,
/// `fy`·y″ + `cy`), where (x″, y″) is (x/z, y/z) after [`Distortion`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Intrinsics {
    /// Focal length over the width of a pixel, above 0.
    pub fx: f64,
    /// Focal length over the height of a pixel, above 0.
    pub fy: f64,
    /// Place where the view axis meets the picture, from its left edge. Half the width for a centred lens.
    pub cx: f64,
    /// Place where the view axis meets the picture, from its upper edge. Half the height for a centred lens.
    pub cy: f64,
    /// The distortion of the lens.
    pub distortion: Distortion,
}

/// Difference of a lens from a pinhole. The models and the order of coefficients are OpenCV's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Distortion {
    /// A pinhole.
    #[default]
    None,
    /// The rational model (Brown 1966; OpenCV's `calib3d`):
    /// x″ = x′·R + 2 p1 x′y′ + p2 (r² + 2x′²) + s1 r² + s2 r⁴ and
    /// y″ = y′·R + p1 (r² + 2y′²) + 2 p2 x′y′ + s3 r² + s4 r⁴, where r² = x′² + y′² and
    /// R = (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶).
    BrownConrady {
        /// Radial coefficients k1 to k6.
        k: [f64; 6],
        /// Tangential coefficients p1 and p2.
        p: [f64; 2],
        /// Coefficients s1 to s4 of a thin prism.
        s: [f64; 4],
    },
    /// The fisheye model (Kannala and Brandt 2006; OpenCV's `fisheye`): (x″, y″) has the direction of (x, y) and the
    /// length θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸), where θ is the angle to the view axis, 0 to π.
    Fisheye {
        /// Coefficients k1 to k4.
        k: [f64; 4],
    },
}

impl Distortion {
    /// The rational model from coefficients in OpenCV's order: k1, k2, p1, p2, then k3, then k4, k5, k6, then s1 to s4.
    /// `None` unless there are 4, 5, 8 or 12.
    ///
    /// ```
    /// use raystream::scene::Distortion;
    ///
    /// let Some(Distortion::BrownConrady { k, p, .. }) = Distortion::brown_conrady(&[-0.2, 0.05, 1e-3, -1e-3, 0.01])
    /// else { panic!("five coefficients") };
    /// assert_eq!((k[..3].to_vec(), p), (vec![-0.2, 0.05, 0.01], [1e-3, -1e-3]));
    /// ```
    pub fn brown_conrady(coefficients: &[f64]) -> Option<Self> {
        if ![4, 5, 8, 12].contains(&coefficients.len()) {
            return None;
        }
        let [k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4] =
            std::array::from_fn(|i| coefficients.get(i).copied().unwrap_or(0.0));
        Some(Self::BrownConrady { k: [k1, k2, k3, k4, k5, k6], p: [p1, p2], s: [s1, s2, s3, s4] })
    }

    fn coefficients(&self) -> Vec<f64> {
        match self {
            Self::None => Vec::new(),
            Self::BrownConrady { k, p, s } => [&k[..], p, s].concat(),
            Self::Fisheye { k } => k.to_vec(),
        }
    }
}

impl Intrinsics {
    /// Intrinsics without distortion.
    pub const fn new(fx: f64, fy: f64, cx: f64, cy: f64) -> Self {
        Self { fx, fy, cx, cy, distortion: Distortion::None }
    }

    /// These intrinsics with a distortion.
    pub const fn with_distortion(self, distortion: Distortion) -> Self {
        Self { distortion, ..self }
    }

    /// The intrinsics of the same camera for a picture whose sides are multiplied by `x` and `y`.
    pub fn scaled(self, x: f64, y: f64) -> Self {
        Self { fx: self.fx * x, cx: self.cx * x, fy: self.fy * y, cy: self.cy * y, ..self }
    }

    fn validate(&self) -> Result<(), CameraError> {
        let Self { fx, fy, cx, cy, distortion } = self;
        // The range in which single precision has digits to spare.
        let is_focal = |f: f64| (1e-6..=1e9).contains(&f);
        if !(is_focal(*fx) && is_focal(*fy)) {
            return Err(CameraError::Focal { fx: *fx, fy: *fy });
        }
        if !(cx.abs() <= 1e9 && cy.abs() <= 1e9) {
            return Err(CameraError::PrincipalPoint { cx: *cx, cy: *cy });
        }
        match distortion.coefficients().iter().find(|c| !(-1e9..=1e9).contains(*c)) {
            Some(&coefficient) => Err(CameraError::Distortion(coefficient)),
            None => Ok(()),
        }
    }
}

impl Projection {
    /// Checks all numbers.
    pub(super) fn validate(&self) -> Result<(), CameraError> {
        match *self {
            Self::Perspective { fov_degrees } if !(fov_degrees > 0.0 && fov_degrees < 180.0) => {
                Err(CameraError::Fov(fov_degrees))
            }
            Self::Orthographic { height } if !(1e-20..=crate::geom::MAX_COORDINATE).contains(&height) => {
                Err(CameraError::Height(height))
            }
            Self::Intrinsics(intrinsics) => intrinsics.validate(),
            _ => Ok(()),
        }
    }

    /// Name of the projection.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Perspective { .. } => "perspective",
            Self::Orthographic { .. } => "orthographic",
            Self::Intrinsics(Intrinsics { distortion: Distortion::Fisheye { .. }, .. }) => "fisheye",
            Self::Intrinsics(_) => "intrinsics",
            Self::Panorama => "panorama",
        }
    }
}

/// All numbers, each as the shortest decimal fraction that gives its bits.
impl fmt::Display for Projection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Perspective { fov_degrees } => write!(f, "fov {fov_degrees}"),
            Self::Orthographic { height } => write!(f, "orthographic {height}"),
            Self::Intrinsics(Intrinsics { fx, fy, cx, cy, distortion }) => {
                write!(f, "K {fx},{fy},{cx},{cy}")?;
                let model = match distortion {
                    Distortion::None => return Ok(()),
                    Distortion::BrownConrady { .. } => "brown-conrady",
                    Distortion::Fisheye { .. } => "fisheye",
                };
                let numbers: Vec<String> = distortion.coefficients().iter().map(f64::to_string).collect();
                write!(f, " {model} {}", numbers.join(","))
            }
            Self::Panorama => f.write_str("panorama"),
        }
    }
}
