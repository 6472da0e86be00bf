//! Textures and their one filter.

use crate::lanes::{Int, Lanes, Num, Piece};
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
    #[inline(always)]
    pub fn place<L: Lanes>(&self, [u, v]: [Num<L>; 2]) -> [Num<L>; 2] {
        let (x, y) = (u * self.scale.x, v * self.scale.y);
        if self.rotation == 0.0 {
            return [x + self.offset.x, y + self.offset.y];
        }
        let (s, c) = (libm::sinf(self.rotation), libm::cosf(self.rotation));
        [c * x + s * y + self.offset.x, c * y - s * x + self.offset.y]
    }
}

impl Texture {
    /// Bilinear lookup, linear values; (0, 0) is the outer corner of the first texel of the first row.
    /// Coordinates that are not finite count as 0.
    #[inline(always)]
    pub fn look_up<L: Lanes>(&self, place: [Num<L>; 2]) -> [Num<L>; 4] {
        place[0].lanes().apart(LookUp { texture: self, place })
    }

    /// One channel of [`Texture::look_up`].
    #[inline(always)]
    pub fn channel<L: Lanes>(&self, channel: Channel, place: [Num<L>; 2]) -> Num<L> {
        let [r, g, b, a] = self.look_up(place);
        match channel {
            Channel::R => r,
            Channel::G => g,
            Channel::B => b,
            Channel::A => a,
            Channel::Luminance => (r + g + b) * (1.0 / 3.0),
        }
    }

    /// [`Texture::look_up`] at one place.
    pub fn sample(&self, uv: Vec2) -> Vec4 {
        self.look_up(uv.to_array().map(Num::from)).map(Num::get).into()
    }

    #[inline(always)]
    fn filter<L: Lanes>(&self, [u, v]: [Num<L>; 2]) -> [Num<L>; 4] {
        let (x, fx) = taps(u, self.width, self.wrap_u);
        let (y, fy) = taps(v, self.height, self.wrap_v);
        let [above, below] = [y[0] * self.width, y[1] * self.width];
        let (a, b) = (self.texel(above + x[0]), self.texel(above + x[1]));
        let (c, d) = (self.texel(below + x[0]), self.texel(below + x[1]));
        let mut filtered = a;
        for k in 0..4 {
            filtered[k] = a[k].lerp(b[k], fx).lerp(c[k].lerp(d[k], fx), fy);
        }
        filtered
    }

    #[inline(always)]
    fn texel<L: Lanes>(&self, index: Int<L>) -> [Num<L>; 4] {
        // Behind the counters of an `Arc` texels are aligned like words.
        let [texel] = index.rows::<1>(bytemuck::cast_slice(&self.texels));
        let (r, g, b) = (texel & 0xff, (texel >> 8) & 0xff, (texel >> 16) & 0xff);
        const SCALE: f32 = 1.0 / 255.0;
        let alpha = (texel >> 24).to_num() * SCALE;
        match self.space {
            ColourSpace::Linear => [r.to_num() * SCALE, g.to_num() * SCALE, b.to_num() * SCALE, alpha],
            ColourSpace::Srgb => {
                let table = srgb_table();
                [r.of(table), g.of(table), b.of(table), alpha]
            }
        }
    }
}

/// A lookup, done apart: materials have many.
struct LookUp<'a, L: Lanes> {
    texture: &'a Texture,
    place: [Num<L>; 2],
}

impl<L: Lanes> Piece<L> for LookUp<'_, L> {
    type Output = [Num<L>; 4];

    #[inline(always)]
    fn run(self, _: L) -> [Num<L>; 4] {
        self.texture.filter(self.place)
    }
}

/// The two texels around a coordinate and the weight of the second.
#[inline(always)]
pub(crate) fn taps<L: Lanes>(coordinate: Num<L>, size: u32, wrap: Wrap) -> ([Int<L>; 2], Num<L>) {
    let c = coordinate.only(coordinate.is_finite());
    let share = match wrap {
        Wrap::Repeat => c - c.floor(),
        Wrap::Mirror => {
            let m = c - 2.0 * (c * 0.5).floor();
            Num::select(m.above(1.0), 2.0 - m, m)
        }
        Wrap::Clamp => c.clamp(0.0, 1.0),
    };
    let place = share * size as f32 - 0.5;
    let low = place.floor();
    let next = (low + 1.0).clamp(0.0, size as f32).to_int();
    let l = c.lanes();
    // Beyond either edge a mirrored image shows the edge texel again.
    let (before, after) = match wrap {
        Wrap::Repeat => (size - 1, 0),
        Wrap::Mirror | Wrap::Clamp => (0, size - 1),
    };
    let first = Int::select(next.is(0), Int::splat(l, before), next + u32::MAX);
    let second = Int::select(next.is(size), Int::splat(l, after), next);
    ([first, second], place - low)
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
