//! Animated cameras: channels move the camera's node and its ancestors.

use super::{Camera, Projection};
use glam::{DMat4, DQuat, DVec3, Vec3};
use serde::{Deserialize, Serialize};

/// The animation of a camera's node and its ancestors. Before its first key and after its last key a track keeps that
/// key's value (glTF 2.0, appendix C).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraMotion {
    /// The camera in any pose.
    camera: Camera,
    /// The nodes from the root to the camera's node.
    nodes: Vec<AnimatedNode>,
    /// The vertical angle of view in radians, or half the height of what an orthographic camera sees.
    lens: Option<Track<f64>>,
}

/// The animated transform of a node relative to its parent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AnimatedNode {
    /// Translation in the parent's space.
    pub translation: Track<DVec3>,
    /// Rotation, a unit quaternion.
    pub rotation: Track<DQuat>,
    /// Scale along each axis.
    pub scale: Track<DVec3>,
}

/// Values at increasing times. A track has at least one key.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Keys<T>", bound(deserialize = "T: Interpolate + Deserialize<'de>"))]
pub struct Track<T> {
    times: Vec<f64>,
    /// One key for each time.
    keys: Vec<Key<T>>,
    interpolation: Interpolation,
}

/// A value. Cubic interpolation also uses the tangents before and after it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Key<T> {
    /// Tangent before the key (glTF's in-tangent), per second.
    pub arriving: T,
    /// Value at the key's time.
    pub value: T,
    /// Tangent after the key (glTF's out-tangent), per second.
    pub leaving: T,
}

impl<T: Copy> Key<T> {
    fn all(&self, test: impl Fn(T) -> bool) -> bool {
        test(self.arriving) && test(self.value) && test(self.leaving)
    }
}

/// Interpolation between two keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Interpolation {
    /// Keeps the value of the previous key.
    Step,
    /// Linear interpolation, or spherical linear interpolation of rotations.
    Linear,
    /// The cubic Hermite spline through the keys with their tangents.
    Cubic,
}

/// A type of values that tracks interpolate.
pub trait Interpolate: Copy {
    /// Linear interpolation from `self` to `other`, spherical for rotations.
    fn between(self, other: Self, t: f64) -> Self;
    /// A weighted sum, normalised for rotations.
    fn sum(terms: [(f64, Self); 4]) -> Self;
}

impl Interpolate for f64 {
    fn between(self, other: Self, t: f64) -> Self {
        self + (other - self) * t
    }

    fn sum(terms: [(f64, Self); 4]) -> Self {
        terms.into_iter().map(|(weight, value)| weight * value).sum()
    }
}

impl Interpolate for DVec3 {
    fn between(self, other: Self, t: f64) -> Self {
        self.lerp(other, t)
    }

    fn sum(terms: [(f64, Self); 4]) -> Self {
        terms.into_iter().map(|(weight, value)| weight * value).sum()
    }
}

impl Interpolate for DQuat {
    fn between(self, other: Self, t: f64) -> Self {
        self.slerp(other, t)
    }

    fn sum(terms: [(f64, Self); 4]) -> Self {
        let sum = terms
            .into_iter()
            .fold(DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), |sum, (weight, value)| sum + value * weight);
        unit_rotation(sum)
    }
}

/// A quaternion scaled to length 1. The identity if its length is 0.
pub fn unit_rotation(rotation: DQuat) -> DQuat {
    let length = rotation.length();
    if length > 0.0 { rotation * (1.0 / length) } else { DQuat::IDENTITY }
}

/// A track as files have it.
#[derive(Deserialize)]
struct Keys<T> {
    times: Vec<f64>,
    keys: Vec<Key<T>>,
    interpolation: Interpolation,
}

impl<T: Interpolate> TryFrom<Keys<T>> for Track<T> {
    type Error = &'static str;

    fn try_from(Keys { times, keys, interpolation }: Keys<T>) -> Result<Self, Self::Error> {
        Self::new(times, keys, interpolation)
            .ok_or("the times of a track do not increase, or are not those of its keys")
    }
}

impl<T: Interpolate> Track<T> {
    /// A track with a constant value.
    pub fn constant(value: T) -> Self {
        let key = Key { arriving: value, value, leaving: value };
        Self { times: vec![0.0], keys: vec![key], interpolation: Interpolation::Step }
    }

    /// A track of keys. `None` unless there is at least one key, there is one key for each time, and times are finite
    /// and increase.
    pub fn new(times: Vec<f64>, keys: Vec<Key<T>>, interpolation: Interpolation) -> Option<Self> {
        let increase = times.windows(2).all(|pair| pair[0] < pair[1]) && times.iter().all(|t| t.is_finite());
        let sound = !times.is_empty() && times.len() == keys.len() && increase;
        sound.then_some(Self { times, keys, interpolation })
    }

    /// The value at a time.
    pub fn at(&self, seconds: f64) -> T {
        let after = self.times.partition_point(|&time| time <= seconds);
        if after == 0 || after == self.keys.len() {
            return self.keys[after.saturating_sub(1)].value;
        }
        let (from, to) = (&self.keys[after - 1], &self.keys[after]);
        let span = self.times[after] - self.times[after - 1];
        let t = (seconds - self.times[after - 1]) / span;
        match self.interpolation {
            Interpolation::Step => from.value,
            Interpolation::Linear => from.value.between(to.value, t),
            Interpolation::Cubic => {
                let (t2, t3) = (t * t, t * t * t);
                T::sum([
                    (2.0 * t3 - 3.0 * t2 + 1.0, from.value),
                    (span * (t3 - 2.0 * t2 + t), from.leaving),
                    (3.0 * t2 - 2.0 * t3, to.value),
                    (span * (t3 - t2), to.arriving),
                ])
            }
        }
    }
}

/// Greatest difference of a unit quaternion's squared length from 1 once its numbers are rounded to `f32`.
const ROUNDED_ROTATION: f64 = 1e-6;

impl AnimatedNode {
    /// The matrix at a time, relative to the parent.
    pub fn matrix_at(&self, seconds: f64) -> DMat4 {
        let (scale, mut rotation) = (self.scale.at(seconds), self.rotation.at(seconds));
        // Some files have three digits.
        if (rotation.length_squared() - 1.0).abs() > ROUNDED_ROTATION {
            rotation = unit_rotation(rotation);
        }
        DMat4::from_scale_rotation_translation(scale, rotation, self.translation.at(seconds))
    }
}

impl CameraMotion {
    /// The animation of a perspective camera that looks along −z with y up, at the end of a chain of nodes.
    pub fn new(fov_degrees: f32, nodes: Vec<AnimatedNode>) -> Self {
        Self { camera: Camera::new(Vec3::ZERO, Vec3::NEG_Z).with_fov(fov_degrees), nodes, lens: None }
    }

    /// The same animation with the projection, shift and aperture of a camera.
    pub fn with_optics_of(self, camera: Camera) -> Self {
        Self { camera, ..self }
    }

    /// The same animation of a camera whose lens changes, too: the track is of the vertical angle of view in radians,
    /// or of half the height of what an orthographic camera sees.
    pub fn with_lens(self, lens: Track<f64>) -> Self {
        Self { lens: Some(lens), ..self }
    }

    /// Index of the first node with a key that is not finite.
    pub(super) fn broken_node(&self) -> Option<usize> {
        let is_finite = |node: &AnimatedNode| {
            let AnimatedNode { translation, rotation, scale } = node;
            let values = |track: &Track<DVec3>| track.keys.iter().all(|key| key.all(DVec3::is_finite));
            values(translation) && values(scale) && rotation.keys.iter().all(|key| key.all(DQuat::is_finite))
        };
        self.nodes.iter().position(|node| !is_finite(node))
    }

    /// The camera at a time. If the transforms give it no direction it is invalid, and [`Camera::lens`] returns the
    /// error.
    pub fn at(&self, seconds: f64) -> Camera {
        let matrix = self
            .nodes
            .iter()
            .map(|node| node.matrix_at(seconds))
            .fold(DMat4::IDENTITY, |above, node| above * node);
        let camera = self.camera.posed_as(&Camera::transformed(&matrix, 40.0));
        let Some(lens) = &self.lens else { return camera };
        let lens = lens.at(seconds) as f32;
        camera.with_projection(match camera.projection {
            Projection::Orthographic { .. } => Projection::Orthographic { height: 2.0 * lens.abs() },
            _ => Projection::Perspective { fov_degrees: lens.to_degrees() },
        })
    }
}

impl Camera {
    /// A perspective camera in the origin that looks along −z with y up, transformed by a matrix. If the matrix gives
    /// it no direction, its target equals its eye.
    pub fn transformed(matrix: &DMat4, fov_degrees: f32) -> Self {
        let turned = |axis| matrix.transform_vector3(axis).try_normalize().unwrap_or(DVec3::ZERO);
        let eye = matrix.w_axis.truncate();
        // The target is so far away that its rounding does not change the view.
        let distance = eye.abs().max_element().max(1.0);
        let target = eye + turned(DVec3::NEG_Z) * distance;
        let up = turned(DVec3::Y).as_vec3();
        Self::new(eye.as_vec3(), target.as_vec3()).with_up(up).with_fov(fov_degrees)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys<T: Interpolate>(values: impl IntoIterator<Item = [T; 3]>) -> Vec<Key<T>> {
        values.into_iter().map(|[arriving, value, leaving]| Key { arriving, value, leaving }).collect()
    }

    fn motion(translation: Track<DVec3>, rotation: Track<DQuat>) -> CameraMotion {
        let rest = || Track::constant(DVec3::ONE);
        let above = AnimatedNode { translation, rotation: Track::constant(DQuat::IDENTITY), scale: rest() };
        let camera = AnimatedNode { translation: Track::constant(DVec3::Z), rotation, scale: rest() };
        CameraMotion::new(40.0, vec![above, camera])
    }

    #[test]
    fn rotations_of_few_digits_scale_nothing() {
        let rotation = |z: f64, w: f64| {
            let value = DQuat::from_xyzw(0.0, 0.0, z, w);
            Track::new(vec![0.0, 1.0], keys([[value; 3]; 2]), Interpolation::Linear).expect("keys")
        };
        let node = |rotation| AnimatedNode {
            translation: Track::constant(DVec3::ZERO),
            rotation,
            scale: Track::constant(DVec3::ONE),
        };
        for seconds in [0.0, 0.5, 2.0] {
            let turned = node(rotation(0.383, 0.924)).matrix_at(seconds).x_axis.truncate();
            assert!((turned.length() - 1.0).abs() < 1e-12, "{turned}");
        }
        // Those of 32 bits keep their bits.
        let half = f64::from(std::f32::consts::FRAC_1_SQRT_2);
        let matrix = DMat4::from_quat(DQuat::from_xyzw(0.0, 0.0, half, half));
        assert_eq!(node(rotation(half, half)).matrix_at(0.0), matrix);
    }

    #[test]
    fn tracks_pass_their_keys_and_are_constant_beyond() {
        let still = || Track::constant(DQuat::IDENTITY);
        for interpolation in [Interpolation::Step, Interpolation::Linear, Interpolation::Cubic] {
            let values = [0.0, 4.0, 2.0].map(|x| [DVec3::ZERO, DVec3::X * x, DVec3::ZERO]);
            let track = Track::new(vec![1.0, 2.0, 4.0], keys(values), interpolation).expect("keys");
            let motion = motion(track, still());
            let x = |seconds| motion.at(seconds).eye.x;
            assert_eq!([0.0, 1.0, 2.0, 4.0, 9.0].map(x), [0.0, 0.0, 4.0, 2.0, 2.0]);
            // With tangents of 0 at both ends, the cubic passes the middle value at the middle time and is behind
            // before.
            let expected = match interpolation {
                Interpolation::Step => [0.0, 0.0],
                Interpolation::Linear => [1.0, 2.0],
                Interpolation::Cubic => [0.625, 2.0],
            };
            assert_eq!([1.25, 1.5].map(x), expected);
        }
    }

    #[test]
    fn cubics_have_the_slopes_of_their_keys() {
        let values = [[DVec3::ZERO, DVec3::ZERO, DVec3::X * 3.0], [DVec3::X, DVec3::X, DVec3::ZERO]];
        let track = Track::new(vec![0.0, 2.0], keys(values), Interpolation::Cubic).expect("keys");
        let speed = |a: f64, b: f64| (track.at(b) - track.at(a)).x / (b - a);
        assert!((speed(0.0, 1e-6) - 3.0).abs() < 1e-4 && (speed(2.0 - 1e-6, 2.0 - 1e-9) - 1.0).abs() < 1e-4);
    }

    #[test]
    fn rotations_take_the_short_way_and_turn_the_view() {
        let quarter = DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2);
        let values = [DQuat::IDENTITY, -quarter].map(|q| [q, q, q]);
        let turn = Track::new(vec![0.0, 1.0], keys(values), Interpolation::Linear).expect("keys");
        let motion = motion(Track::constant(DVec3::Y), turn);
        let forward = |seconds| {
            let camera = motion.at(seconds);
            assert_eq!(camera.eye, Vec3::new(0.0, 1.0, 1.0));
            (camera.target - camera.eye).normalize()
        };
        assert!((forward(0.0) - Vec3::NEG_Z).length() < 1e-6 && (forward(1.0) - Vec3::NEG_X).length() < 1e-6);
        let half = Vec3::new(-1.0, 0.0, -1.0).normalize();
        assert!((forward(0.5) - half).length() < 1e-6, "{}", forward(0.5));
    }

    #[test]
    fn invalid_tracks_are_refused() {
        let track =
            |times: Vec<f64>, n| Track::new(times, keys(vec![[DVec3::ONE; 3]; n]), Interpolation::Step);
        assert!(track(vec![0.0, 1.0], 2).is_some());
        for times in [vec![], vec![0.0, 0.0], vec![1.0, 0.0], vec![0.0, f64::NAN]] {
            assert!(track(times.clone(), times.len()).is_none(), "{times:?}");
        }
        assert!(track(vec![0.0, 1.0], 1).is_none());
        let singular = Camera::transformed(&DMat4::from_scale(DVec3::ZERO), 40.0);
        assert!(singular.lens(1, 1).is_err());
    }
}
