//! Options of the view: camera, light, picture size.

use crate::scene::Camera;
use clap::Args;
use glam::Vec3;

/// The camera.
#[derive(Debug, Args)]
pub struct CameraArgs {
    /// Camera position [default: the scene's camera, else one that frames the scene].
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = vector)]
    pub eye: Option<Vec3>,
    /// Point that the camera looks at.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = vector)]
    pub target: Option<Vec3>,
    /// Up direction.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = vector)]
    pub up: Option<Vec3>,
    /// Vertical field of view, in degrees.
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    pub fov: Option<f32>,
}

impl CameraArgs {
    /// Whether no option is given.
    pub fn is_default(&self) -> bool {
        let Self { eye, target, up, fov } = self;
        eye.is_none() && target.is_none() && up.is_none() && fov.is_none()
    }

    /// The scene's own camera, or one that frames it, changed by the options.
    pub fn apply(&self, own: Option<Camera>, framed: impl FnOnce() -> Camera) -> Camera {
        let base = own.unwrap_or_else(framed);
        // A moved camera keeps its target.
        let (eye, target) = (self.eye.unwrap_or(base.eye), self.target.unwrap_or(base.target));
        let camera = base.posed_as(&Camera::new(eye, target).with_up(self.up.unwrap_or(base.up)));
        self.fov.map_or(camera, |fov| camera.with_fov(fov))
    }
}

/// Light besides the scene's own.
#[derive(Debug, Args)]
pub struct LightArgs {
    /// Environment: an equirectangular .hdr or .exr file, or a constant R,G,B
    /// [default: the scene's; 1,1,1 if the scene has no light].
    #[arg(long, value_name = "FILE|R,G,B", allow_hyphen_values = true)]
    pub env: Option<String>,
    /// Rotate the environment map around the vertical axis.
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, default_value_t = 0.0, value_parser = angle)]
    pub env_rotation: f32,
}

/// `WxH`, both at least 1 and at most 2²⁸ pixels together.
pub(super) fn size(text: &str) -> Result<(u32, u32), String> {
    let (w, h) = text.split_once(['x', 'X']).ok_or("write WIDTHxHEIGHT, as in 960x540")?;
    let number = |s: &str| s.trim().parse::<u32>().map_err(|e| format!("{s:?}: {e}"));
    let (w, h) = (number(w)?, number(h)?);
    if w == 0 || h == 0 || u64::from(w) * u64::from(h) > 1 << 28 {
        return Err("width and height must be at least 1, and the picture at most 268435456 pixels".into());
    }
    Ok((w, h))
}

/// A finite angle in degrees.
pub(super) fn angle(text: &str) -> Result<f32, String> {
    match text.trim().parse::<f32>() {
        Ok(degrees) if degrees.is_finite() => Ok(degrees),
        _ => Err("write a finite angle in degrees, as in 90".into()),
    }
}

/// `X,Y,Z`, all finite.
pub fn vector(text: &str) -> Result<Vec3, String> {
    let parts: Vec<f32> = text
        .split(',')
        .map(|s| s.trim().parse::<f32>().map_err(|e| format!("{s:?}: {e}")))
        .collect::<Result<_, _>>()?;
    match parts[..] {
        [x, y, z] if parts.iter().all(|p| p.is_finite()) => Ok(Vec3::new(x, y, z)),
        _ => Err("write three finite numbers, as in 1,-2.5,3".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_size_or_vector_is_refused() {
        for bad in ["0x0", "4", "-1x3", "99999x99999", "x"] {
            assert!(size(bad).is_err(), "{bad}");
        }
        for bad in ["1,2", "1,2,nan", "a,b,c", "1,2,3,4", ""] {
            assert!(vector(bad).is_err(), "{bad}");
        }
    }
}
