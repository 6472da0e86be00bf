//! Small scenes with known answers.

use crate::scene::{
    Anisotropy, Camera, Channel, Coat, Coats, Colour, ColourSpace, Emission, Environment, EnvironmentMap,
    Iridescence, Light, LightShape, Material, Medium, Mipmap, Mix, NormalMap, Principled, Scalar, Scene,
    Sheen, Surface, Texture, TextureRef, Wrap,
};
use glam::{Vec2, Vec3};

/// Looks along −z at the origin from distance 4.
pub fn camera() -> Camera {
    Camera::new(Vec3::new(0.0, 0.0, 4.0), Vec3::ZERO)
}

/// Adds a material; returns its index.
pub fn add_material(scene: &mut Scene, material: Material) -> u32 {
    scene.materials.push(material);
    scene.materials.len() as u32 - 1
}

/// A material with this surface.
pub fn of(surface: Surface) -> Material {
    Material { surface, ..Material::fallback() }
}

/// Adds a mix of two materials; returns its index.
pub fn add_mix(scene: &mut Scene, of: [u32; 2], share: Scalar) -> u32 {
    scene.mixes.push(Mix { of, share });
    let mix = Surface::Mix(scene.mixes.len() as u32 - 1);
    add_material(scene, self::of(mix))
}

/// A metallic-roughness material.
pub fn principled(edit: impl FnOnce(&mut Principled)) -> Material {
    let mut surface = Principled::default();
    edit(&mut surface);
    of(Surface::Principled(surface))
}

/// A matte material that shines on both sides.
pub fn shining(radiance: f32, albedo: f32) -> Material {
    let radiance = Colour::constant(Vec3::splat(radiance));
    Material {
        emission: Some(Emission { radiance, two_sided: true, is_light: true }),
        ..Material::matte("lamp", Vec3::splat(albedo))
    }
}

/// Adds the parallelogram `corner + a·x + b·y`; its front is where `a × b` points.
pub fn add_quad(scene: &mut Scene, corner: Vec3, a: Vec3, b: Vec3, material: u32) {
    let base = scene.mesh.positions.len() as u32;
    scene.mesh.positions.extend([corner, corner + a, corner + a + b, corner + b]);
    scene.mesh.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
    scene.mesh.materials.extend([material; 2]);
}

/// Adds the six faces of a cube around the origin, fronts outside.
pub fn add_cube(scene: &mut Scene, half: f32, material: u32) {
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            let mut n = Vec3::ZERO;
            n[axis] = side;
            let (mut a, mut b) = (Vec3::ZERO, Vec3::ZERO);
            a[(axis + 1) % 3] = 2.0 * half;
            b[(axis + 2) % 3] = 2.0 * half;
            if side < 0.0 {
                (a, b) = (b, a);
            }
            add_quad(scene, n * half - 0.5 * (a + b), a, b, material);
        }
    }
}

/// Adds a sphere around the origin: an octahedron, its faces split `levels` times, with vertex
/// normals or without.
pub fn add_sphere(scene: &mut Scene, radius: f32, levels: u32, smooth: bool, material: u32) {
    let mut faces = Vec::new();
    for (x, y, z) in octants() {
        let (a, b, c) = (Vec3::X * x, Vec3::Y * y, Vec3::Z * z);
        faces.push(if x * y * z > 0.0 { [a, b, c] } else { [a, c, b] });
    }
    for _ in 0..levels {
        faces = faces
            .into_iter()
            .flat_map(|[a, b, c]| {
                let (p, q, r) = ((a + b).normalize(), (b + c).normalize(), (c + a).normalize());
                [[a, p, r], [p, b, q], [r, q, c], [p, q, r]]
            })
            .collect();
    }
    for face in faces {
        let base = scene.mesh.positions.len() as u32;
        scene.mesh.positions.extend(face.map(|p| p * radius));
        if smooth {
            scene.mesh.normals.resize(base as usize, Vec3::ZERO);
            scene.mesh.normals.extend(face);
        }
        scene.mesh.triangles.push([base, base + 1, base + 2]);
        scene.mesh.materials.push(material);
    }
}

fn octants() -> impl Iterator<Item = (f32, f32, f32)> {
    (0..8u32).map(|i| {
        let sign = |bit: u32| if i >> bit & 1 == 0 { 1.0 } else { -1.0 };
        (sign(0), sign(1), sign(2))
    })
}

/// A sphere of one material in an even white environment.
pub fn furnace(material: Material, levels: u32, smooth: bool) -> Scene {
    let mut scene = Scene { environment: Environment::Constant(Vec3::ONE), ..Scene::default() };
    let material = add_material(&mut scene, material);
    add_sphere(&mut scene, 1.0, levels, smooth, material);
    scene
}

/// A small room: matte walls, open to the viewer, a lamp, a dim sky, a rough metal cube and glass.
pub fn room() -> Scene {
    let mut scene =
        Scene { environment: Environment::Constant(Vec3::new(0.1, 0.2, 0.3)), ..Scene::default() };
    let walls = add_material(&mut scene, Material::matte("walls", Vec3::new(0.7, 0.5, 0.3)));
    let lamp = add_material(&mut scene, shining(6.0, 0.0));
    let metal = add_material(
        &mut scene,
        principled(|s| {
            s.base_colour = Colour::constant(Vec3::new(0.9, 0.6, 0.4));
            s.metallic = Scalar::constant(0.7);
            s.roughness = Scalar::constant(0.4);
            s.clearcoat = Scalar::constant(0.5);
        }),
    );
    let (x, y, z) = (Vec3::X * 4.0, Vec3::Y * 4.0, Vec3::Z * 4.0);
    let corner = Vec3::splat(-2.0);
    add_quad(&mut scene, corner, x, y, walls);
    add_quad(&mut scene, corner, z, x, walls);
    add_quad(&mut scene, corner, y, z, walls);
    add_quad(&mut scene, Vec3::new(-0.7, 1.5, -0.7), x * 0.35, z * 0.35, lamp);
    add_cube(&mut scene, 0.6, metal);
    scene
}

/// `count` parallel sheets across the z axis, at a distance of one unit, the camera of [`camera`] between the
/// middle two.
pub fn sheets(count: u32, material: Material) -> Scene {
    let mut scene = Scene { environment: Environment::Constant(Vec3::ONE), ..Scene::default() };
    let material = add_material(&mut scene, material);
    for i in 0..count {
        let z = 4.5 + i as f32 - (count / 2) as f32;
        let side = 1e4;
        add_quad(
            &mut scene,
            Vec3::new(-side, -side, z),
            Vec3::X * 2.0 * side,
            Vec3::Y * 2.0 * side,
            material,
        );
    }
    scene
}

/// A normal map of steep bumps.
pub fn bumps() -> Texture {
    let texels = (0..64u32)
        .map(|i| {
            let (x, y) = (i % 8, i / 8);
            [if x < 4 { 40 } else { 215 }, if y < 4 { 60 } else { 195 }, 200, 255]
        })
        .collect();
    Texture {
        name: "bumps".into(),
        width: 8,
        height: 8,
        texels,
        space: ColourSpace::Linear,
        wrap_u: Wrap::Repeat,
        wrap_v: Wrap::Repeat,
        mipmap: Mipmap::default(),
    }
}

/// A cube of nothing but a medium that lets half of the red and a quarter of the green light through.
pub fn ink() -> Scene {
    let mut scene = Scene { environment: Environment::Constant(Vec3::ONE), ..Scene::default() };
    let medium = Medium::tinting(Vec3::new(0.5, 0.25, 1.0), 1.0);
    let surface = Surface::Dielectric { ior: 1.0, transmittance: Vec3::ONE };
    let ink = add_material(&mut scene, Material { medium, ..of(surface) });
    add_cube(&mut scene, 0.5, ink);
    scene
}

/// A room with one of everything that is shaded: textures, bumps, coats, grooves, fibres, films, mixes, glass,
/// lamps, a sky.
pub fn one_of_everything() -> Scene {
    let mut scene = room();
    scene.textures.push(bumps());
    let texture = TextureRef { scale: Vec2::splat(3.0), rotation: 0.3, ..TextureRef::plain(0) };
    let painted = Principled {
        base_colour: Colour { texture: Some(texture), ..Colour::constant(Vec3::new(0.9, 0.7, 0.5)) },
        metallic: Scalar::constant(0.3),
        roughness: Scalar { factor: 0.6, texture: Some((texture, Channel::G)) },
        transmission: Scalar::constant(0.3),
        thin: false,
        clearcoat: Scalar::constant(0.6),
        clearcoat_roughness: Scalar { factor: 0.3, texture: Some((texture, Channel::R)) },
        ..Principled::default()
    };
    let surfaces = [
        Surface::Principled(painted),
        Surface::Principled(Principled { thin: true, clearcoat: Scalar::constant(0.0), ..painted }),
        Surface::Dielectric { ior: 1.5, transmittance: Vec3::new(0.9, 1.0, 0.8) },
        Surface::Mirror { reflectance: Colour::constant(Vec3::splat(0.9)) },
        Surface::Principled(Principled {
            anisotropy: Some(Anisotropy {
                strength: Scalar { factor: 0.8, texture: Some((texture, Channel::B)) },
                rotation: 0.4,
                direction: Some(texture),
            }),
            sheen: Some(Sheen {
                colour: Colour { texture: Some(texture), ..Colour::constant(Vec3::new(0.4, 0.6, 0.8)) },
                roughness: Scalar { factor: 0.5, texture: Some((texture, Channel::A)) },
            }),
            transmission: Scalar::constant(0.0),
            ..painted
        }),
        Surface::Principled(Principled {
            iridescence: Some(Iridescence {
                strength: Scalar { factor: 0.9, texture: Some((texture, Channel::R)) },
                ior: 1.4,
                thickness_nm: [100.0, 700.0],
                thickness_texture: Some((texture, Channel::G)),
            }),
            ..painted
        }),
        Surface::Principled(Principled {
            transmission: Scalar::constant(0.0),
            coats: Coats::new(&[
                Coat { tint: Vec3::new(0.9, 0.6, 0.8), ior: 1.7, ..Coat::CLEAR },
                Coat { weight: 0.5, roughness: 0.4, ..Coat::CLEAR },
            ])
            .expect("two"),
            coat_normal_map: Some(NormalMap { texture, scale: -0.3 }),
            ..painted
        }),
    ];
    for (i, surface) in surfaces.into_iter().enumerate() {
        let map = NormalMap { texture, scale: 0.5 };
        let medium = Medium::tinting(Vec3::new(0.9, 0.5, 0.3), 0.2);
        let normal_map = (i % 2 == 0).then_some(map);
        let material = Material { surface, normal_map, medium, ..Material::fallback() };
        let id = add_material(&mut scene, material);
        let corner = Vec3::new(-0.9 + 0.35 * i as f32, -0.7, -0.2 * i as f32);
        add_quad(&mut scene, corner, Vec3::new(0.35, 0.1, 0.1), Vec3::new(0.0, 1.2, 0.2), id);
    }
    let last = scene.materials.len() as u32 - 1;
    let stripes = Scalar { factor: 1.0, texture: Some((texture, Channel::R)) };
    let inner = add_mix(&mut scene, [last - 3, last], stripes);
    let mix = add_mix(&mut scene, [inner, last - 1], Scalar::constant(0.3));
    add_quad(&mut scene, Vec3::new(-0.9, -0.9, 0.2), Vec3::X * 1.8, Vec3::new(0.0, 0.8, 0.1), mix);
    scene.mesh.uvs = scene.mesh.positions.iter().map(|p| Vec2::new(p.x + p.z, p.y - p.z)).collect();
    scene.mesh.normals =
        scene.mesh.positions.iter().map(|p| (*p + Vec3::new(0.0, 0.1, 3.0)).normalize()).collect();
    for shape in [
        LightShape::Point { position: Vec3::new(0.3, 0.5, 0.9) },
        LightShape::Directional { direction: Vec3::new(0.0, -0.6, -0.8) },
        LightShape::Spot {
            position: Vec3::new(-0.3, 0.5, 0.9),
            direction: Vec3::NEG_Z,
            cos_inner: 0.9,
            cos_outer: 0.6,
        },
    ] {
        scene.lights.push(Light { name: String::new(), intensity: Vec3::splat(0.5), shape });
    }
    let texels: Vec<[f32; 3]> = (0..32u32).map(|i| [(i % 8) as f32 * 0.2, 0.4, (i / 8) as f32]).collect();
    scene.environment = Environment::Map(EnvironmentMap {
        width: 8,
        height: 4,
        texels: texels.into(),
        rotation_degrees: 40.0,
    });
    scene.add_mipmaps();
    scene
}
