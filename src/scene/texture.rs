//! Textures and their filter.

use super::{Averaging, Footprint, Mipmap, srgb};
use crate::lanes::{Int, Lanes, Num, OutlinedTask, SingleLane};
use glam::{Vec2, Vec4};
use serde::{Deserialize, Serialize};

/// Relation of stored values to light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[non_exhaustive]
pub enum ColourSpace {
    /// The sRGB transfer function, for colours.
    Srgb,
    /// Linear values, for roughness, normals and alpha.
    Linear,
}

/// Addressing mode beyond the edges of an image (glTF's `wrapS` and `wrapT`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Wrap {
    /// The image repeats.
    #[default]
    Repeat,
    /// The image repeats, every second time mirrored.
    Mirror,
    /// The edge texel continues.
    Clamp,
}

/// A scalar derived from a texture's RGBA.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Channel {
    /// Red.
    R,
    /// Green.
    G,
    /// Blue.
    B,
    /// Alpha.
    A,
    /// The mean of red, green and blue, for grey MTL maps that are read as a scalar.
    Luminance,
}

impl Channel {
    /// This channel of RGBA values.
    #[inline(always)]
    pub fn of<L: Lanes>(self, [r, g, b, a]: [Num<L>; 4]) -> Num<L> {
        match self {
            Self::R => r,
            Self::G => g,
            Self::B => b,
            Self::A => a,
            Self::Luminance => (r + g + b) * (1.0 / 3.0),
        }
    }
}

/// An image of 8-bit texels and its addressing. Alpha is always linear.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Name for warnings.
    pub name: String,
    /// Columns, ≥ 1.
    pub width: u32,
    /// Rows, ≥ 1.
    pub height: u32,
    /// RGBA, row major, first row on top: `width × height` texels of the image, then the texels of its mipmap levels.
    pub texels: std::sync::Arc<[[u8; 4]]>,
    /// Encoding of red, green and blue.
    pub space: ColourSpace,
    /// Horizontal addressing mode.
    pub wrap_u: Wrap,
    /// Vertical addressing mode.
    pub wrap_v: Wrap,
    /// Place of the mipmap levels in `texels`. Footprints of more than a texel look them up.
    pub mipmap: Mipmap,
}

/// Value of a byte's unit in linear images.
const BYTE_SCALE: f32 = 1.0 / 255.0;

/// A material's reference to a texture, with glTF's texture transform (KHR_texture_transform).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TextureRef {
    /// Index into [`crate::scene::Scene::textures`].
    pub texture: u32,
    /// The set of the mesh's texture coordinates ([`super::TriangleMesh::uv_set`]).
    pub set: u32,
    /// Offset in texture coordinates, added after scale and rotation.
    pub offset: Vec2,
    /// Rotation in radians, counter-clockwise in uv, applied after the scale.
    pub rotation: f32,
    /// Factor of the mesh's texture coordinates, applied first.
    pub scale: Vec2,
}

impl TextureRef {
    /// A reference without a transform.
    pub fn plain(texture: u32) -> Self {
        Self { texture, set: 0, offset: Vec2::ZERO, rotation: 0.0, scale: Vec2::ONE }
    }

    /// Transforms the mesh's texture coordinates.
    #[inline(always)]
    pub fn transform<L: Lanes>(&self, [u, v]: [Num<L>; 2]) -> [Num<L>; 2] {
        let (x, y) = (u * self.scale.x, v * self.scale.y);
        let Some([s, c]) = self.sine_and_cosine() else {
            return [x + self.offset.x, y + self.offset.y];
        };
        [c * x + s * y + self.offset.x, c * y - s * x + self.offset.y]
    }

    /// Sine and cosine of the rotation, if there is one.
    #[inline(always)]
    pub(crate) fn sine_and_cosine(&self) -> Option<[f32; 2]> {
        (self.rotation != 0.0).then(|| [libm::sinf(self.rotation), libm::cosf(self.rotation)])
    }

    /// Scales a footprint's width from mesh coordinates to texture coordinates.
    #[inline(always)]
    pub fn scaled<L: Lanes>(&self, footprint: &Footprint<L>) -> Footprint<L> {
        let scale = (self.scale.x * self.scale.y).abs().sqrt();
        Footprint { width: footprint.width * scale, ..*footprint }
    }
}

impl Texture {
    /// The texels of the image without its mipmap levels.
    pub fn image(&self) -> &[[u8; 4]] {
        &self.texels[..(self.width * self.height) as usize]
    }

    /// Computes the mipmap levels.
    pub fn add_mipmap(&mut self, mean: Averaging) {
        (self.texels, self.mipmap) = Mipmap::new(self.image(), (self.width, self.height), self.space, mean);
    }

    /// True if alpha of the mipmap levels stores the roughness of averaged normals ([`Averaging::Normals`]).
    #[inline(always)]
    pub fn stores_roughness(&self) -> bool {
        self.mipmap.mean() == Averaging::Normals
    }

    /// Bilinear lookup in the mipmap level whose texels are as large as the footprint. Returns linear values. (0, 0)
    /// is the outer corner of the first texel of the first row. If the footprint is at least a texel of the image,
    /// the lookup reads one of the four texels, each with its bilinear weight as probability (Pharr et al. 2024,
    /// *Filtering After Shading with Stochastic Texture Filtering*). Coordinates that are not finite count as 0. With
    /// [`Averaging::Normals`], alpha is what the level stores of the bumps' roughness, and 1 in the image itself.
    #[inline(always)]
    pub fn look_up<L: Lanes>(&self, place: [Num<L>; 2], footprint: &Footprint<L>) -> [Num<L>; 4] {
        place[0].lanes().outlined(LookUp { texture: self, place, footprint: *footprint })
    }

    /// One channel of [`Texture::look_up`].
    #[inline(always)]
    pub fn channel<L: Lanes>(
        &self,
        channel: Channel,
        place: [Num<L>; 2],
        footprint: &Footprint<L>,
    ) -> Num<L> {
        channel.of(self.look_up(place, footprint))
    }

    /// The bytes of a channel in the image itself, one plane or three whose mean is the channel, and each byte's value.
    pub(crate) fn planes(&self, channel: Channel) -> (Vec<Vec<u8>>, [f32; 256]) {
        let plane = |index: usize| self.image().iter().map(|texel| texel[index]).collect();
        let linear = std::array::from_fn(|byte| byte as f32 * BYTE_SCALE);
        let colours = if self.space == ColourSpace::Srgb { *srgb::table() } else { linear };
        match channel {
            Channel::R => (vec![plane(0)], colours),
            Channel::G => (vec![plane(1)], colours),
            Channel::B => (vec![plane(2)], colours),
            Channel::A if self.stores_roughness() => (vec![plane(3)], [1.0; 256]),
            Channel::A => (vec![plane(3)], linear),
            Channel::Luminance => ([0, 1, 2].map(plane).into(), colours),
        }
    }

    /// [`Texture::look_up`] of the image itself at one point.
    pub fn sample(&self, uv: Vec2) -> Vec4 {
        self.look_up(uv.to_array().map(Num::from), &Footprint::point(SingleLane)).map(Num::get).into()
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn filter<L: Lanes>(&self, [u, v]: [Num<L>; 2], footprint: &Footprint<L>) -> [Num<L>; 4] {
        let l = u.lanes();
        let mut first = Int::splat(l, 0);
        let (mut width, mut height) = (Int::splat(l, self.width), Int::splat(l, self.height));
        let texels = footprint.width * (self.width as f32 * self.height as f32).sqrt();
        let level = self.level(texels, footprint.dither);
        let is_image = level.is(0);
        if !is_image.all() {
            [first, width, height] = level.rows(self.mipmap.levels());
        }
        let (x, fx) = taps(u, width, self.wrap_u);
        let (y, fy) = taps(v, height, self.wrap_v);
        let [above, below] = [first + y[0] * width, first + y[1] * width];
        let wide = texels.ge(Num::splat(l, 1.0));
        let [right, low] = footprint.chosen([fx, fy]);
        let mut filtered = if wide.all() {
            let row = Int::select(low, below, above);
            self.texel(row + Int::select(right, x[1], x[0]))
        } else {
            let (a, b) = (self.texel(above + x[0]), self.texel(above + x[1]));
            let (c, d) = (self.texel(below + x[0]), self.texel(below + x[1]));
            let mut filtered = a;
            for k in 0..4 {
                let all = a[k].lerp(b[k], fx).lerp(c[k].lerp(d[k], fx), fy);
                let one = Num::select(low, Num::select(right, d[k], c[k]), Num::select(right, b[k], a[k]));
                filtered[k] = Num::select(wide, one, all);
            }
            filtered
        };
        if self.stores_roughness() {
            filtered[3] = Num::select(is_image, Num::splat(l, 1.0), filtered[3]);
        }
        filtered
    }

    /// The mipmap level for footprints of `texels` texels of the image. Level 0 is the image.
    #[inline(always)]
    fn level<L: Lanes>(&self, texels: Num<L>, dither: Num<L>) -> Int<L> {
        // The bits of a float, read as an integer, are its logarithm up to a small error.
        let bits = texels.clamp(1.0, 1e9).to_bits().to_num();
        let octaves = bits * (1.0 / (1 << 23) as f32) - 127.0;
        (octaves + dither).clamp(0.0, self.mipmap.last() as f32).to_int()
    }

    #[inline(always)]
    fn texel<L: Lanes>(&self, index: Int<L>) -> [Num<L>; 4] {
        // `Arc` aligns texels to words, because its counters precede them.
        let [texel] = index.rows(bytemuck::cast_slice(&self.texels));
        let (r, g, b) = (texel & 0xff, (texel >> 8) & 0xff, (texel >> 16) & 0xff);
        let linear = |byte: Int<L>| byte.to_num() * BYTE_SCALE;
        let alpha = linear(texel >> 24);
        match self.space {
            ColourSpace::Linear => [linear(r), linear(g), linear(b), alpha],
            ColourSpace::Srgb => {
                let table = srgb::table();
                [r.of(table), g.of(table), b.of(table), alpha]
            }
        }
    }
}

/// A lookup, outlined because materials have many lookups.
struct LookUp<'a, L: Lanes> {
    texture: &'a Texture,
    place: [Num<L>; 2],
    footprint: Footprint<L>,
}

impl<L: Lanes> OutlinedTask<L> for LookUp<'_, L> {
    type Output = [Num<L>; 4];

    #[inline(always)]
    fn run(self, _: L) -> [Num<L>; 4] {
        self.texture.filter(self.place, &self.footprint)
    }
}

/// The two texels around a coordinate, and the weight of the second.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn taps<L: Lanes>(coordinate: Num<L>, size: Int<L>, wrap: Wrap) -> ([Int<L>; 2], Num<L>) {
    let c = coordinate.only(coordinate.is_finite());
    let share = match wrap {
        Wrap::Repeat => c - c.floor(),
        Wrap::Mirror => {
            let m = c - 2.0 * (c * 0.5).floor();
            Num::select(m.above(1.0), 2.0 - m, m)
        }
        Wrap::Clamp => c.clamp(0.0, 1.0),
    };
    let count = size.to_num();
    let place = share * count - 0.5;
    let low = place.floor();
    let next = (low + 1.0).clamp(0.0, f32::INFINITY).min(count);
    let (at_start, at_end, next) = (next.is_zero(), next.same(count), next.to_int());
    let (zero, last) = (Int::splat(c.lanes(), 0), size + u32::MAX);
    // Beyond either edge a mirrored image repeats the edge texel.
    let (before, after) = match wrap {
        Wrap::Repeat => (last, zero),
        Wrap::Mirror | Wrap::Clamp => (zero, last),
    };
    let first = Int::select(at_start, before, next + u32::MAX);
    let second = Int::select(at_end, after, next);
    ([first, second], place - low)
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
            mipmap: Mipmap::default(),
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

    #[test]
    fn wide_footprints_read_the_mean_and_narrow_ones_the_image() {
        let mut t = two_by_one(Wrap::Repeat);
        t.add_mipmap(Averaging::Light);
        let at = |width: f32, dither: f32| {
            let [width, dither] = [width, dither].map(Num::from);
            let footprint = Footprint { width, dither, ..Footprint::point(SingleLane) };
            t.look_up([0.25, 0.5].map(Num::from), &footprint)[0].get()
        };
        assert_eq!(at(0.0, 0.99), 0.0);
        assert_eq!(at(0.7, 0.0), 0.0, "a texel is 1 / sqrt(2) wide in the mean");
        assert!((at(1.42, 0.0) - 0.5).abs() < 0.01);
        assert!((at(1e6, 0.5) - 0.5).abs() < 0.01, "there is no smaller copy");
        assert_eq!(at(f32::NAN, 0.5), 0.0);
        // Between two levels each is chosen with its share.
        let smaller =
            (0..100).filter(|&i| at(std::f32::consts::FRAC_1_SQRT_2 * 1.5, i as f32 / 100.0) > 0.0).count();
        assert!((49..=51).contains(&smaller), "{smaller}");
    }

    #[test]
    fn edges_wrap_in_every_level() {
        // Four columns, the last one white. In the level of two columns, that white is half of the second column.
        for (wrap, before, after) in
            [(Wrap::Repeat, 0.25, 0.25), (Wrap::Mirror, 0.0, 0.5), (Wrap::Clamp, 0.0, 0.5)]
        {
            let mut t = two_by_one(wrap);
            (t.width, t.texels) = (4, [[0; 4], [0; 4], [0; 4], [255; 4]].into());
            t.add_mipmap(Averaging::Light);
            // The mean over many hits; each reads one texel.
            let at = |u: f32| {
                let hits = 4000;
                let seen = (0..hits).map(|i| {
                    let dither = Num::from((i * 19) as f32 / (1 << 17) as f32);
                    let footprint = Footprint { width: 1.01.into(), dither, ..Footprint::point(SingleLane) };
                    t.look_up([u, 0.5].map(Num::from), &footprint)[0].get()
                });
                seen.sum::<f32>() / hits as f32
            };
            assert_eq!(
                t.level(2.02.into(), 0.5.into()).get(),
                1,
                "two texels of the geometric mean of 4 and 1"
            );
            for (u, expected) in [(0.25, 0.0), (0.75, 0.5), (0.5, 0.25), (0.0, before), (1.0, after)] {
                assert!((at(u) - expected).abs() < 0.01, "{wrap:?} at {u}: {}", at(u));
            }
        }
    }

    #[test]
    fn levels_report_shortened_normals_and_the_image_does_not() {
        let mut t = two_by_one(Wrap::Clamp);
        t.texels = [[255, 128, 128, 0], [0, 128, 128, 0]].into();
        t.add_mipmap(Averaging::Normals);
        let at = |width: f32| {
            let footprint = Footprint { width: width.into(), ..Footprint::point(SingleLane) };
            t.look_up([0.25, 0.5].map(Num::from), &footprint)[3].get()
        };
        assert_eq!(at(0.0), 1.0, "whatever the file's alpha says");
        assert!(at(2.0) < 0.1, "opposite normals have no length left");
    }
}
