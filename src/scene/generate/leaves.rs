//! A tree of leaves that an alpha mask cuts out of cards.

use super::builder::Builder;
use super::nature::noise;
use crate::scene::{
    Alpha, AlphaMode, Channel, ColourSpace, Material, Mipmap, Scalar, Scene, Texture, TextureRef, Wrap,
};
use glam::Vec3;

/// Edge of the mask, texels.
const TEXELS: u32 = 64;

/// Radius of the foliage.
const RADIUS: f32 = 3.0;

/// A trunk with foliage of `count` square cards of two triangles, each with the mask of a leaf, under a lamp. A ray
/// through the foliage meets some ten cards, and a little more than half of their area lets it through.
pub fn leaves(count: u32) -> Scene {
    let mut builder = Builder::seen(Vec3::new(3.0, 3.5, 11.0), Vec3::new(0.0, 4.0, 0.0), 40.0);
    let (ground, bark) = (builder.matte("ground", 0.5), builder.matte("bark", 0.3));
    let lamp = builder.lamp();
    builder.scene().textures.push(mask());
    let value = Scalar { factor: 1.0, texture: Some((TextureRef::plain(0), Channel::A)) };
    let alpha = Alpha { mode: AlphaMode::Mask { cutoff: 0.5 }, value, vertex: false };
    let leaf = builder.material(Material { alpha, ..Material::matte("leaf", Vec3::new(0.2, 0.5, 0.1)) });
    builder.quad(Vec3::new(-20.0, 0.0, -20.0), Vec3::Z * 40.0, Vec3::X * 40.0, 1, ground);
    builder.quad(Vec3::new(-2.0, 14.0, -2.0), Vec3::X * 4.0, Vec3::Z * 4.0, 1, lamp);
    builder.turned(Vec3::ZERO, 4.0, &[0.3, 0.25, 0.2], 11, bark);
    // The cards have ten times the area of the foliage's sphere.
    let edge = RADIUS * (10.0 * 4.0 * std::f32::consts::PI / count as f32).sqrt().min(1.0);
    let centre = Vec3::new(0.0, 4.5, 0.0);
    for card in 0..count {
        let direction = |salt: u32| {
            let v = Vec3::new(noise(card, salt), noise(card, salt + 1), noise(card, salt + 2));
            v.try_normalize().unwrap_or(Vec3::X)
        };
        // More of them outside than inside.
        let place = centre + direction(0) * (RADIUS * (1.0 - 0.5 * noise(card, 3).abs()));
        let u = direction(4);
        let v = u.cross(direction(7)).try_normalize().unwrap_or(u.any_orthonormal_vector());
        builder.quad(place, u * edge, v * edge, 1, leaf);
    }
    builder.finish()
}

/// A leaf with a serrated edge: alpha is 255 inside, 0 outside.
fn mask() -> Texture {
    let texel = |i: u32| {
        let [x, y] = [i % TEXELS, i / TEXELS].map(|k| (k as f32 + 0.5) / TEXELS as f32 * 2.0 - 1.0);
        let teeth = 0.06 * libm::fabsf(libm::sinf(20.0 * y));
        let half_width = 0.75 * (1.0 - y * y).max(0.0) - teeth;
        [255, 255, 255, if x.abs() < half_width { 255 } else { 0 }]
    };
    Texture {
        name: "leaf".to_owned(),
        width: TEXELS,
        height: TEXELS,
        texels: (0..TEXELS * TEXELS).map(texel).collect(),
        space: ColourSpace::Linear,
        wrap_u: Wrap::Clamp,
        wrap_v: Wrap::Clamp,
        mipmap: Mipmap::default(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_card_is_a_little_less_than_half_leaf() {
        let scene = leaves(5);
        let card = scene.mesh.triangles.len() as u32 - 1;
        assert!(scene.is_masked(card) && scene.is_masked(card - 9) && !scene.is_masked(card - 10));
        let (mut inside, mut all) = (0, 0);
        for (i, j) in (0..32).flat_map(|i| (0..32 - i).map(move |j| (i as f32, j as f32))) {
            let place = [(i + 0.25) / 32.0, (j + 0.25) / 32.0];
            for triangle in [card - 1, card] {
                inside += usize::from(scene.alpha_accepts(triangle, place[0], place[1]));
                all += 1;
            }
        }
        let share = inside as f32 / all as f32;
        assert!((0.4..0.5).contains(&share), "{share}");
    }
}
