//! A small scene with every kind of surface that raystream has, plain and textured.

use crate::geom::mix;
use crate::scene::{
    Anisotropy, Averaging, Channel, Coat, Coats, Colour, ColourSpace, DiffuseTransmission, Emission,
    Iridescence, Material, Mipmap, NormalMap, Principled, Scalar, Scene, Sheen, Surface, Texture, TextureRef,
    Wrap,
};
use glam::{Vec2, Vec3, Vec4};

/// A number of 0 to 1 for each seed.
fn random(seed: u32) -> f32 {
    (mix(seed) >> 8) as f32 / (1 << 24) as f32
}

/// An image of random texels.
fn texture(number: u32, space: ColourSpace, wrap: Wrap, mean: Averaging) -> Texture {
    let (width, height) = (5, 4);
    let texel = |i: u32| mix(number * 100 + i).to_le_bytes();
    let mut texture = Texture {
        name: String::new(),
        width,
        height,
        texels: (0..width * height).map(texel).collect(),
        space,
        wrap_u: wrap,
        wrap_v: wrap,
        mipmap: Mipmap::default(),
    };
    texture.add_mipmap(mean);
    texture
}

/// Triangles with all that vertices may have. Some vertices lack a normal or a tangent.
pub fn scene() -> Scene {
    let mut scene = Scene::default();
    let mesh = &mut scene.mesh;
    let unit = |seed: u32| {
        let v = Vec3::new(random(seed), random(seed + 1), random(seed + 2)) * 2.0 - 1.0;
        v.normalize_or(Vec3::X)
    };
    for vertex in 0..9 {
        let seed = 1000 + 20 * vertex;
        mesh.positions.push(unit(seed) * 3.0);
        mesh.normals.push(if vertex == 4 { Vec3::ZERO } else { unit(seed + 3) });
        mesh.uvs.push(Vec2::new(random(seed + 6), random(seed + 7)) * 3.0 - 1.0);
        mesh.colours.push(Vec4::new(random(seed + 8), random(seed + 9), random(seed + 10), 1.0));
        mesh.tangents.push(if vertex == 7 { Vec4::ZERO } else { unit(seed + 11).extend(-1.0) });
    }
    mesh.more_uvs = vec![(0..9).map(|i| Vec2::new(random(2000 + i), random(2100 + i))).collect()];
    mesh.triangles = vec![[0, 1, 2], [3, 2, 1], [4, 5, 6], [6, 7, 8], [0, 5, 7], [8, 3, 1]];
    mesh.materials = vec![0; 6];
    scene.textures = vec![
        texture(1, ColourSpace::Srgb, Wrap::Repeat, Averaging::Light),
        texture(2, ColourSpace::Linear, Wrap::Mirror, Averaging::Light),
        texture(3, ColourSpace::Linear, Wrap::Clamp, Averaging::Normals),
    ];
    scene
}

fn colour(factor: [f32; 3]) -> Colour {
    Colour::constant(factor.into())
}

fn textured(factor: f32, texture: u32) -> Colour {
    Colour { texture: Some(placed(texture)), ..colour([factor; 3]) }
}

fn scalar(factor: f32, texture: u32, channel: Channel) -> Scalar {
    Scalar { factor, texture: Some((placed(texture), channel)) }
}

/// A reference with a transform, to the second set of coordinates for odd textures.
fn placed(texture: u32) -> TextureRef {
    let (offset, scale) = (Vec2::new(0.1, 0.2), Vec2::new(1.5, -0.7));
    TextureRef { set: texture % 2, offset, rotation: 0.4, scale, ..TextureRef::plain(texture) }
}

fn normal_map(scale: f32) -> Option<NormalMap> {
    Some(NormalMap { texture: placed(2), scale })
}

/// A material of a surface.
fn material(name: &str, surface: Surface) -> Material {
    Material { surface, ..Material::matte(name, Vec3::ONE) }
}

/// A principled surface of a roughness.
fn principled(roughness: f32, edit: impl FnOnce(&mut Principled)) -> Principled {
    let mut surface = Principled {
        roughness: Scalar::constant(roughness),
        base_colour: colour([0.8, 0.5, 0.2]),
        ..Default::default()
    };
    edit(&mut surface);
    surface
}

fn sheen(surface: &mut Principled) {
    surface.sheen = Some(Sheen { colour: colour([0.3, 0.9, 0.5]), roughness: Scalar::constant(0.4) });
}

fn film(surface: &mut Principled) {
    surface.iridescence = Some(Iridescence {
        strength: Scalar::constant(0.9),
        ior: 1.33,
        thickness_nm: [150.0, 600.0],
        thickness_texture: Some((placed(1), Channel::G)),
    });
}

fn brushed(surface: &mut Principled) {
    let strength = Scalar::constant(0.6);
    surface.anisotropy = Some(Anisotropy { strength, rotation: 0.7, direction: Some(placed(1)) });
}

fn clear_coat(share: f32, roughness: f32) -> impl FnOnce(&mut Principled) {
    move |surface| {
        surface.clearcoat = Scalar::constant(share);
        surface.clearcoat_roughness = Scalar::constant(roughness);
    }
}

/// Three coats over each other, tinted, rough and smooth.
fn varnish(surface: &mut Principled) {
    let coat = |roughness: f32, tint: f32| Coat {
        weight: 0.9,
        ior: 1.4,
        roughness,
        tint: Vec3::new(1.0, tint, 0.6),
    };
    surface.coats = Coats::new(&[coat(0.0, 1.0), coat(0.3, 0.8), Coat::CLEAR]).expect("not too many");
}

fn translucent(surface: &mut Principled) {
    surface.diffuse_transmission =
        Some(DiffuseTransmission { share: Scalar::constant(0.5), colour: textured(0.9, 0) });
}

fn body(surface: &mut Principled) {
    surface.transmission = Scalar::constant(0.9);
    surface.thin = false;
}

fn thin(surface: &mut Principled) {
    surface.transmission = scalar(0.9, 1, Channel::R);
}

/// Every kind of surface.
pub fn materials() -> Vec<Material> {
    let vertex = Colour { vertex: true, ..textured(0.9, 0) };
    let mut all = vec![
        Material::matte("matte", Vec3::new(0.7, 0.3, 0.9)),
        material("textured matte", Surface::Matte { reflectance: vertex }),
        material("mirror", Surface::Mirror { reflectance: textured(0.8, 1) }),
        material("glass", Surface::Dielectric { ior: 1.5, transmittance: Vec3::new(0.9, 1.0, 0.8) }),
        material("dense liquid", Surface::Dielectric { ior: 0.8, transmittance: Vec3::ONE }),
    ];
    all[1].normal_map = normal_map(0.8);
    all[2].normal_map = normal_map(1.0);
    all[0].emission = Some(Emission { radiance: textured(3.0, 0), two_sided: false, is_light: true });
    let mut add = |name: &str, roughness: f32, edit: &dyn Fn(&mut Principled)| {
        all.push(material(name, Surface::Principled(principled(roughness, edit))));
    };
    for roughness in [0.0, 0.1, 0.7] {
        add("plastic", roughness, &|_| {});
        add("metal", roughness, &|s| s.metallic = Scalar::constant(1.0));
        add("coated", roughness, &|s| clear_coat(0.8, 0.2)(s));
        add("brushed", roughness, &brushed);
        add("film", roughness, &film);
        add("thin glass", roughness, &thin);
        add("body of glass", roughness, &body);
    }
    for roughness in [0.0, 0.4] {
        add("velvet", roughness, &sheen);
        add("mirror coat", roughness, &|s| clear_coat(1.0, 0.0)(s));
        add("varnished", roughness, &varnish);
        add("varnished under a coat", roughness, &|s| {
            varnish(s);
            clear_coat(0.7, 0.3)(s);
        });
        add("coated body of glass", roughness, &|s| {
            body(s);
            clear_coat(0.5, 0.1)(s);
        });
        add("film on a body of glass", roughness, &|s| {
            body(s);
            film(s);
        });
        add("leaf", roughness, &translucent);
        add("translucent body", roughness, &|s| {
            body(s);
            s.transmission = Scalar::constant(0.3);
            translucent(s);
        });
        add("coats with normals", roughness, &|s| {
            clear_coat(0.8, 0.0)(s);
            varnish(s);
            s.coat_normal_map = normal_map(0.5);
        });
        add("glossy", roughness, &|s| {
            s.glossiness = Some(scalar(0.9, 1, Channel::A));
            s.specular = Scalar::constant(0.5);
            s.specular_colour = textured(0.9, 0);
        });
        add("all at once", roughness, &|s| {
            s.base_colour = textured(1.0, 0);
            s.metallic = scalar(0.4, 1, Channel::B);
            s.roughness = scalar(1.0, 1, Channel::G);
            brushed(s);
            sheen(s);
            film(s);
            clear_coat(0.5, 0.3)(s);
            translucent(s);
        });
    }
    all
}
