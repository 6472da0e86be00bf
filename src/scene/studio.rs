//! The studio: the sky of pictures whose scene has no light. A grey backdrop, a bright soft box in front on the left,
//! and a narrow one behind on the right, as seen from the camera of [`super::Camera::framing`].

use super::EnvironmentMap;
use glam::Vec3;
use std::f32::consts::PI;
use std::sync::{Arc, OnceLock};

const WIDTH: u32 = 256;
const HEIGHT: u32 = 128;

/// A rectangle of light.
struct SoftBox {
    /// Direction of its middle, of any length.
    towards: Vec3,
    /// Half of its width and height, divided by its distance.
    half: [f32; 2],
    /// Width of its soft edges, in the same measure.
    edge: f32,
    radiance: Vec3,
}

const BOXES: [SoftBox; 2] = [
    SoftBox {
        towards: Vec3::new(-0.55, 0.85, 0.75),
        half: [0.42, 0.30],
        edge: 0.06,
        radiance: Vec3::new(6.9, 6.6, 6.2),
    },
    SoftBox {
        towards: Vec3::new(0.9, 0.45, -0.7),
        half: [0.14, 0.55],
        edge: 0.05,
        radiance: Vec3::new(3.0, 3.2, 3.5),
    },
];

impl SoftBox {
    fn radiance(&self, direction: Vec3) -> Vec3 {
        let middle = self.towards.normalize();
        let across = Vec3::Y.cross(middle).normalize();
        let along = direction.dot(middle);
        if along <= 0.0 {
            return Vec3::ZERO;
        }
        let [x, y] = [across, middle.cross(across)].map(|axis| (direction.dot(axis) / along).abs());
        let inside = |x: f32, half: f32| 1.0 - smooth_step(half - self.edge, half + self.edge, x);
        self.radiance * (inside(x, self.half[0]) * inside(y, self.half[1]))
    }
}

/// 0 up to `from`, 1 from `to` on, smooth between them.
fn smooth_step(from: f32, to: f32, x: f32) -> f32 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Radiance from a direction.
fn radiance(direction: Vec3) -> Vec3 {
    let y = direction.y;
    let above = Vec3::new(0.36, 0.37, 0.38).lerp(Vec3::new(0.60, 0.62, 0.65), smooth_step(0.0, 1.0, y));
    let below = Vec3::new(0.30, 0.30, 0.30).lerp(Vec3::new(0.16, 0.16, 0.16), smooth_step(0.0, 0.7, -y));
    let backdrop = below.lerp(above, smooth_step(-0.12, 0.12, y));
    BOXES.iter().fold(backdrop, |sum, light| sum + light.radiance(direction))
}

fn texels() -> &'static Arc<[[f32; 3]]> {
    static TEXELS: OnceLock<Arc<[[f32; 3]]>> = OnceLock::new();
    TEXELS.get_or_init(|| {
        let texel = |i: u32| {
            let (column, row) = (i % WIDTH, i / WIDTH);
            let (sin_down, cos_down) = libm::sincosf((row as f32 + 0.5) * (PI / HEIGHT as f32));
            let turn = (column as f32 + 0.5) * (2.0 * PI / WIDTH as f32) - PI;
            let (sin_turn, cos_turn) = libm::sincosf(turn);
            radiance(Vec3::new(sin_down * sin_turn, cos_down, -sin_down * cos_turn)).to_array()
        };
        (0..WIDTH * HEIGHT).map(texel).collect()
    })
}

impl EnvironmentMap {
    /// The studio: a grey backdrop with a large and bright soft box above on the left, and a narrow one behind on the
    /// right. Surfaces that face up get about as much light as from a sky of radiance 1. The same bytes on every
    /// machine.
    pub fn studio() -> Self {
        Self { width: WIDTH, height: HEIGHT, texels: texels().clone(), rotation_degrees: 0.0 }
    }

    /// True if this is [`EnvironmentMap::studio`], turned or not.
    pub fn is_studio(&self) -> bool {
        Arc::ptr_eq(&self.texels, texels())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Irradiance of a surface, divided by that under a sky of radiance 1.
    fn brightness(normal: Vec3) -> f32 {
        let studio = EnvironmentMap::studio();
        let mut sum = 0.0;
        for (i, &texel) in (0..).zip(studio.texels.iter()) {
            let (sin_down, cos_down) = libm::sincosf(((i / WIDTH) as f32 + 0.5) * (PI / HEIGHT as f32));
            let turn = ((i % WIDTH) as f32 + 0.5) * (2.0 * PI / WIDTH as f32) - PI;
            let direction = Vec3::new(sin_down * libm::sinf(turn), cos_down, -sin_down * libm::cosf(turn));
            let angle = sin_down * (PI / HEIGHT as f32) * (2.0 * PI / WIDTH as f32);
            sum += texel[1] * direction.dot(normal).max(0.0) * angle / PI;
        }
        sum
    }

    #[test]
    fn surfaces_are_lit_from_all_sides_and_most_from_above() {
        let [up, front, left, right, back, down] =
            [Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::X, Vec3::NEG_Z, Vec3::NEG_Y].map(brightness);
        assert!((1.0..1.4).contains(&up), "{up}");
        assert!((0.7..1.1).contains(&front), "{front}");
        assert!(left > right && right > 0.3 && back > 0.3 && down > 0.15, "{left} {right} {back} {down}");
    }

    #[test]
    fn bytes_are_the_same_on_every_machine() {
        let bytes: Vec<u8> =
            EnvironmentMap::studio().texels.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(xxhash_rust::xxh3::xxh3_64(&bytes), 0x186a_7d37_913d_984a);
        assert!(EnvironmentMap::studio().is_studio());
        let copied = EnvironmentMap {
            texels: EnvironmentMap::studio().texels.to_vec().into(),
            ..EnvironmentMap::studio()
        };
        assert!(!copied.is_studio());
    }
}
