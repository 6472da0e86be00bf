//! Camera paths: through key poses from frame to frame, or around the scene.

use super::{Camera, CameraError};
use glam::{Quat, Vec3};
use serde::Deserialize;

/// A camera path through key poses.
///
/// ```json
/// { "interpolation": "catmull-rom",
///   "keys": [ { "frame": 0, "eye": [0, 2, 6], "target": [0, 1, 0], "fov_degrees": 35 },
///             { "frame": 24, "eye": [6, 2, 0], "target": [0, 1, 0], "up": [0, 1, 0], "fov_degrees": 50 } ] }
/// ```
///
/// Before the first key and after the last key the camera does not move.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraPath {
    #[serde(default)]
    interpolation: Interpolation,
    keys: Vec<Key>,
}

/// Movement of a camera between two keys.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Interpolation {
    /// Linear interpolation.
    Linear,
    /// Cubic interpolation. The slope at a key is that of the line from the previous key to the next (Catmull and Rom
    /// 1974).
    #[default]
    CatmullRom,
}

#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Key {
    frame: f64,
    eye: Vec3,
    target: Vec3,
    #[serde(default = "upright")]
    up: Vec3,
    fov_degrees: f32,
}

fn upright() -> Vec3 {
    Vec3::Y
}

/// Error of an invalid camera path.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CameraPathError {
    /// The text is not the JSON of a camera path.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
    /// The path has no keys.
    #[error("the path has no keys; it needs at least one")]
    Empty,
    /// The keys are not in the order of their frames.
    #[error("keys[{0}]: its frame must be finite and greater than the previous key's")]
    Order(usize),
    /// The camera of a key is invalid.
    #[error("keys[{0}]: {1}")]
    Pose(usize, CameraError),
}

impl CameraPath {
    /// Parses a camera path.
    ///
    /// # Errors
    /// When the text is not a camera path, or a key's camera is invalid.
    pub fn parse(text: &str) -> Result<Self, CameraPathError> {
        let path: Self = serde_json::from_str(text)?;
        if path.keys.is_empty() {
            return Err(CameraPathError::Empty);
        }
        for (index, key) in path.keys.iter().enumerate() {
            let after = index == 0 || path.keys[index - 1].frame < key.frame;
            if !(after && key.frame.is_finite()) {
                return Err(CameraPathError::Order(index));
            }
            key.camera().lens(1, 1).map_err(|error| CameraPathError::Pose(index, error))?;
        }
        Ok(path)
    }

    /// The camera of a frame.
    pub fn at(&self, frame: f64) -> Camera {
        let keys = &self.keys;
        let after = keys.partition_point(|key| key.frame <= frame);
        if after == 0 || after == keys.len() {
            return keys[after.saturating_sub(1)].camera();
        }
        let (from, to) = (after - 1, after);
        let span = keys[to].frame - keys[from].frame;
        let t = (frame - keys[from].frame) / span;
        // Slopes per frame at both ends. There is no further key beyond the ends of the path.
        let slope = |key: usize, of: fn(&Key) -> f64| {
            let (before, after) = (key.saturating_sub(1), (key + 1).min(keys.len() - 1));
            (of(&keys[after]) - of(&keys[before])) / (keys[after].frame - keys[before].frame)
        };
        let number = |of: fn(&Key) -> f64| {
            let (a, b) = (of(&keys[from]), of(&keys[to]));
            (match self.interpolation {
                Interpolation::Linear => a + t * (b - a),
                Interpolation::CatmullRom => hermite(t, a, b, span * slope(from, of), span * slope(to, of)),
            }) as f32
        };
        let vector = |of: [fn(&Key) -> f64; 3]| Vec3::from_array(of.map(number));
        let eye = vector([|k| k.eye.x.into(), |k| k.eye.y.into(), |k| k.eye.z.into()]);
        let target = vector([|k| k.target.x.into(), |k| k.target.y.into(), |k| k.target.z.into()]);
        let up = vector([|k| k.up.x.into(), |k| k.up.y.into(), |k| k.up.z.into()]);
        Camera::new(eye, target).with_up(up).with_fov(number(|k| k.fov_degrees.into()))
    }
}

/// The cubic from `a` to `b` with these slopes at its ends.
fn hermite(t: f64, a: f64, b: f64, slope_a: f64, slope_b: f64) -> f64 {
    let (t2, t3) = (t * t, t * t * t);
    (2.0 * t3 - 3.0 * t2 + 1.0) * a
        + (t3 - 2.0 * t2 + t) * slope_a
        + (3.0 * t2 - 2.0 * t3) * b
        + (t3 - t2) * slope_b
}

impl Key {
    fn camera(&self) -> Camera {
        let Self { eye, target, up, fov_degrees, .. } = *self;
        Camera::new(eye, target).with_up(up).with_fov(fov_degrees)
    }
}

impl Camera {
    /// The camera rotated around `centre` by an angle, about its up direction.
    pub fn turned(&self, centre: Vec3, degrees: f32) -> Self {
        let Some(axis) = self.up.try_normalize() else { return *self };
        let half = 0.5 * degrees.to_radians();
        let turn = Quat::from_vec4((axis * libm::sinf(half)).extend(libm::cosf(half)));
        let carry = |point: Vec3| centre + turn * (point - centre);
        Self { eye: carry(self.eye), target: carry(self.target), ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(interpolation: &str) -> CameraPath {
        let text = format!(
            r#"{{ "interpolation": "{interpolation}", "keys": [
                {{ "frame": 0, "eye": [0, 0, 9], "target": [0, 0, 0], "fov_degrees": 30 }},
                {{ "frame": 10, "eye": [10, 0, 9], "target": [1, 0, 0], "fov_degrees": 50 }},
                {{ "frame": 30, "eye": [20, 4, 9], "target": [1, 0, 0], "fov_degrees": 40 }} ] }}"#
        );
        CameraPath::parse(&text).expect("a path")
    }

    #[test]
    fn paths_pass_their_keys_and_are_constant_beyond() {
        for interpolation in ["linear", "catmull-rom"] {
            let path = path(interpolation);
            assert_eq!(path.at(-5.0).eye, Vec3::new(0.0, 0.0, 9.0));
            assert_eq!(path.at(10.0).eye, Vec3::new(10.0, 0.0, 9.0));
            let key = path.at(10.0);
            assert_eq!((key.with_fov(50.0), key.target.x), (key, 1.0));
            assert_eq!(path.at(31.0).eye, Vec3::new(20.0, 4.0, 9.0));
        }
        assert_eq!(path("linear").at(5.0).eye, Vec3::new(5.0, 0.0, 9.0));
        assert_eq!(path("linear").at(20.0).eye, Vec3::new(15.0, 2.0, 9.0));
    }

    #[test]
    fn a_smooth_path_has_no_kink_at_a_key() {
        let speed =
            |path: &CameraPath, a: f64, b: f64| (path.at(b).eye - path.at(a).eye).length() / (b - a) as f32;
        let kink = |path: &CameraPath| (speed(path, 9.99, 10.0) - speed(path, 10.0, 10.01)).abs();
        assert!(kink(&path("catmull-rom")) < 0.02, "{}", kink(&path("catmull-rom")));
        assert!(kink(&path("linear")) > 0.3);
    }

    #[test]
    fn four_quarter_turns_are_the_identity() {
        let camera = Camera::new(Vec3::new(3.0, 1.0, 5.0), Vec3::X);
        let centre = Vec3::new(1.0, 0.0, 2.0);
        let quarter = camera.turned(centre, 90.0);
        assert!((quarter.eye - Vec3::new(4.0, 1.0, 0.0)).length() < 1e-5, "{}", quarter.eye);
        let whole = (0..3).fold(quarter, |camera, _| camera.turned(centre, 90.0));
        assert!((whole.eye - camera.eye).length() + (whole.target - camera.target).length() < 1e-4);
    }

    #[test]
    fn bad_paths_are_refused() {
        let key = r#"{ "frame": 1, "eye": [0, 0, 9], "target": [0, 0, 0], "fov_degrees": 30 }"#;
        let blind = key.replace("[0, 0, 9]", "[0, 0, 0]");
        for (keys, says) in [
            (String::new(), "no keys"),
            (format!("{key}, {key}"), "keys[1]"),
            (blind, "keys[0]"),
            (key.replace("frame", "time"), "line 1"),
        ] {
            let error = CameraPath::parse(&format!("{{ \"keys\": [{keys}] }}")).expect_err("refused");
            assert!(error.to_string().contains(says), "{error}");
        }
    }
}
