//! Textures and their one filter.

use glam::{Vec2, Vec4};

/// How stored values relate to light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ColourSpace {
    /// The sRGB transfer function: colours.
    Srgb,
    /// As they are: roughness, normals, alpha.
    Linear,
}

/// What lies beyond the edge of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Wrap {
    /// The image again.
    #[default]
    Repeat,
    /// The image mirrored.
    Mirror,
    /// The edge texel.
    Clamp,
}

/// One of the four channels of a texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// Red.
    R,
    /// Green.
    G,
    /// Blue.
    B,
    /// Alpha.
    A,
    /// The mean of red, green and blue (a grey MTL map read as a scalar).
    Luminance,
}

/// An image of 8-bit texels and how to look it up. Alpha is always linear.
#[derive(Clone, Debug)]
pub struct Texture {
    /// What warnings call it.
    pub name: String,
    /// Columns, ≥ 1.
    pub width: u32,
    /// Rows, ≥ 1.
    pub height: u32,
    /// RGBA, first row first; `width × height` of them.
    pub texels: std::sync::Arc<[[u8; 4]]>,
    /// What red, green and blue mean.
    pub space: ColourSpace,
    /// Horizontally.
    pub wrap_u: Wrap,
    /// Vertically.
    pub wrap_v: Wrap,
}

/// A texture as a material uses it, with glTF's texture transform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureRef {
    /// Index into [`crate::scene::Scene::textures`].
    pub texture: u32,
    /// Added after rotation and scale.
    pub offset: Vec2,
    /// Radians, counter-clockwise in uv as KHR_texture_transform defines it.
    pub rotation: f32,
    /// Applied first.
    pub scale: Vec2,
}

impl TextureRef {
    /// The texture as it lies.
    pub fn plain(texture: u32) -> Self {
        Self { texture, offset: Vec2::ZERO, rotation: 0.0, scale: Vec2::ONE }
    }

    /// Mesh coordinates → texture coordinates.
    pub fn apply(&self, uv: Vec2) -> Vec2 {
        let p = uv * self.scale;
        if self.rotation == 0.0 {
            return p + self.offset;
        }
        let (s, c) = (libm::sinf(self.rotation), libm::cosf(self.rotation));
        Vec2::new(c * p.x + s * p.y, c * p.y - s * p.x) + self.offset
    }
}

impl Texture {
    /// Bilinear lookup, linear values; (0, 0) is the outer corner of the first texel of the first row.
    /// Coordinates that are not finite count as 0.
    pub fn sample(&self, uv: Vec2) -> Vec4 {
        let (x0, x1, fx) = taps(uv.x, self.width, self.wrap_u);
        let (y0, y1, fy) = taps(uv.y, self.height, self.wrap_v);
        let row = |y: u32| self.texel(x0, y) * (1.0 - fx) + self.texel(x1, y) * fx;
        row(y0) * (1.0 - fy) + row(y1) * fy
    }

    /// One channel of [`Texture::sample`].
    pub fn channel(&self, channel: Channel, uv: Vec2) -> f32 {
        let texel = self.sample(uv);
        match channel {
            Channel::R => texel.x,
            Channel::G => texel.y,
            Channel::B => texel.z,
            Channel::A => texel.w,
            Channel::Luminance => (texel.x + texel.y + texel.z) * (1.0 / 3.0),
        }
    }

    fn texel(&self, x: u32, y: u32) -> Vec4 {
        let [r, g, b, a] = self.texels[y as usize * self.width as usize + x as usize];
        let linear = |v: u8| f32::from(v) * (1.0 / 255.0);
        match self.space {
            ColourSpace::Linear => Vec4::new(linear(r), linear(g), linear(b), linear(a)),
            ColourSpace::Srgb => {
                let table = srgb_table();
                Vec4::new(table[r as usize], table[g as usize], table[b as usize], linear(a))
            }
        }
    }
}

/// The two texels around a coordinate and the weight of the second.
fn taps(coordinate: f32, size: u32, wrap: Wrap) -> (u32, u32, f32) {
    let n = f64::from(size);
    let c = if coordinate.is_finite() { f64::from(coordinate) } else { 0.0 };
    let p = match wrap {
        Wrap::Repeat => (c - libm::floor(c)) * n,
        Wrap::Mirror => {
            let m = c - 2.0 * libm::floor(c * 0.5);
            (if m > 1.0 { 2.0 - m } else { m }) * n
        }
        Wrap::Clamp => c.clamp(0.0, 1.0) * n,
    } - 0.5;
    let low = libm::floor(p);
    let at = |i: i64| -> u32 {
        let last = i64::from(size) - 1;
        (match wrap {
            Wrap::Repeat => i.rem_euclid(i64::from(size)),
            // Beyond either edge a mirrored image shows the edge texel again.
            Wrap::Mirror | Wrap::Clamp => i.clamp(0, last),
        }) as u32
    };
    (at(low as i64), at(low as i64 + 1), (p - low) as f32)
}

fn srgb_table() -> &'static [f32; 256] {
    static TABLE: std::sync::OnceLock<[f32; 256]> = std::sync::OnceLock::new();
    TABLE.get_or_init(|| {
        std::array::from_fn(|i| {
            let v = i as f64 / 255.0;
            (if v <= 0.04045 { v / 12.92 } else { libm::pow((v + 0.055) / 1.055, 2.4) }) as f32
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two_by_one(wrap: Wrap) -> Texture {
        Texture {
            name: String::new(),
            width: 2,
            height: 1,
            texels: [[0, 0, 0, 255], [255, 255, 255, 255]].into(),
            space: ColourSpace::Linear,
            wrap_u: wrap,
            wrap_v: wrap,
        }
    }

    #[test]
    fn texel_centres_are_exact_and_edges_wrap() {
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            let t = two_by_one(wrap);
            assert_eq!(t.sample(Vec2::new(0.25, 0.5)).x, 0.0);
            assert_eq!(t.sample(Vec2::new(0.75, 0.5)).x, 1.0);
            assert_eq!(t.sample(Vec2::new(0.5, 0.5)).x, 0.5);
        }
        assert_eq!(two_by_one(Wrap::Repeat).sample(Vec2::new(1.25, 7.0)).x, 0.0);
        assert_eq!(two_by_one(Wrap::Repeat).sample(Vec2::new(0.0, 0.0)).x, 0.5);
        assert_eq!(two_by_one(Wrap::Mirror).sample(Vec2::new(1.25, 0.0)).x, 1.0);
        assert_eq!(two_by_one(Wrap::Clamp).sample(Vec2::new(9.0, -4.0)).x, 1.0);
        assert_eq!(two_by_one(Wrap::Clamp).sample(Vec2::new(f32::NAN, 0.0)).x, 0.0);
    }

    #[test]
    fn srgb_decodes_and_alpha_stays_linear() {
        let mut t = two_by_one(Wrap::Clamp);
        t.texels = [[188, 0, 0, 188]; 2].into();
        t.space = ColourSpace::Srgb;
        let texel = t.sample(Vec2::new(0.25, 0.5));
        assert!((texel.x - 0.5029).abs() < 1e-3);
        assert!((texel.w - 0.7373).abs() < 1e-3);
    }
}
