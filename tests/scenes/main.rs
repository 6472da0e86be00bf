//! Scenes that cannot be rendered are refused, and other appearances keep what they can.

mod appearances;
mod damage;
mod refusals;

use glam::{Vec2, Vec3, Vec4};
use raystream::engine::{PreparedScene, Units};
use raystream::film::Image;
use raystream::geom::Placement;
use raystream::render::{AmbientOcclusion, Integrator, PathTracer, Settings, Whitted};
use raystream::scene::{
    Alpha, AlphaMode, Anisotropy, Camera, Channel, Coat, Coats, Colour, ColourSpace, Emission, Environment,
    EnvironmentMap, Instance, Iridescence, Light, LightShape, Material, Medium, Mipmap, Mix, NormalMap,
    Principled, Scalar, Scene, Shape, Sheen, Surface, Texture, TextureRef, TriangleMesh, VertexAttribute,
    Wrap,
};
use raystream::schedule::{JobOptions, Renderer, Service, ServiceOptions};
use std::sync::Arc;

/// A service of two threads.
fn service() -> Service {
    Service::new(ServiceOptions::default().with_host_threads(2)).expect("threads")
}

/// The hash of a small path-traced picture.
fn picture(service: &Service, prepared: &PreparedScene) -> String {
    let path = prepared.path(&camera(), settings()).expect("valid settings");
    hash(service, prepared, path)
}

fn settings() -> Settings {
    Settings::new(24, 24).with_spp(2).with_max_bounces(4).with_seed(9)
}

fn camera() -> Camera {
    Camera::new(Vec3::new(0.3, 1.6, 5.0), Vec3::new(0.0, 0.5, 0.0)).with_fov(50.0)
}

fn hash<I: Integrator + Renderer>(service: &Service, prepared: &PreparedScene, integrator: Arc<I>) -> String {
    let job = prepared.submit(service, integrator.clone(), JobOptions::default()).expect("a job");
    job.wait().expect("a picture");
    let Settings { width, height, .. } = *integrator.frame().settings();
    Image::new(width, height, integrator.frame().film().resolve()).hash()
}

/// A scene with every kind of part: two textures, a mix of mixes, all layers, a shape with two instances, lights of
/// every kind, an environment map, normals, two sets of texture coordinates, tangents and colours.
fn everything() -> Scene {
    let mut scene = Scene::new(TriangleMesh::default(), materials());
    scene.textures = vec![texture(0), texture(1)];
    let share = Scalar { factor: 0.5, texture: Some((TextureRef::plain(0), Channel::R)) };
    scene.mixes = vec![Mix { of: [0, 1], share }, Mix { of: [5, 2], share: Scalar::constant(0.25) }];
    scene.lights = lights();
    scene.environment = Environment::Map(EnvironmentMap {
        width: 4,
        height: 2,
        texels: (0..8).map(|i| [0.1 * i as f32, 0.2, 0.3]).collect(),
        rotation_degrees: 20.0,
    });
    scene.camera = Some(camera());
    let count = scene.materials.len() as u32;
    for material in 0..count {
        let left = material as f32 * 0.5 - 2.0;
        quad(&mut scene, Vec3::new(left, 0.2 * material as f32 - 0.5, -0.3 * material as f32), material);
    }
    instances(&mut scene);
    scene.add_mipmaps();
    scene
}

fn texture(seed: u8) -> Texture {
    Texture {
        name: format!("texture {seed}"),
        width: 4,
        height: 4,
        texels: (0..16u8).map(|i| [i * 16 + seed, 255 - i * 8, 128, 255 - i * 10]).collect(),
        space: ColourSpace::Linear,
        wrap_u: Wrap::Repeat,
        wrap_v: Wrap::Mirror,
        mipmap: Mipmap::default(),
    }
}

fn materials() -> Vec<Material> {
    let textured = Colour { texture: Some(TextureRef::plain(0)), ..Colour::constant(Vec3::splat(0.8)) };
    let map = NormalMap { texture: TextureRef { set: 1, ..TextureRef::plain(1) }, scale: 0.5 };
    let of = |name: &str, surface| Material { surface, ..Material::matte(name, Vec3::ONE) };
    let layered = Principled {
        base_colour: textured,
        metallic: Scalar::constant(0.3),
        roughness: Scalar { factor: 0.5, texture: Some((TextureRef::plain(1), Channel::G)) },
        clearcoat: Scalar::constant(0.5),
        coats: Coats::new(&[Coat::CLEAR]).expect("one coat"),
        coat_normal_map: Some(map),
        anisotropy: Some(Anisotropy {
            strength: Scalar::constant(0.4),
            rotation: 0.3,
            direction: Some(TextureRef::plain(1)),
        }),
        sheen: Some(Sheen { colour: Colour::constant(Vec3::splat(0.2)), roughness: Scalar::constant(0.4) }),
        iridescence: Some(Iridescence {
            strength: Scalar::constant(0.5),
            ior: 1.3,
            thickness_nm: [100.0, 400.0],
            thickness_texture: Some((TextureRef::plain(0), Channel::B)),
        }),
        ..Principled::default()
    };
    let emission = Emission {
        radiance: Colour { factor: Vec3::splat(4.0), ..textured },
        two_sided: true,
        is_light: true,
    };
    let alpha = Alpha {
        mode: AlphaMode::Mask { cutoff: 0.5 },
        value: Scalar { factor: 1.0, texture: Some((TextureRef::plain(0), Channel::A)) },
        vertex: true,
    };
    let glass = Surface::Dielectric { ior: 1.5, transmittance: Vec3::splat(0.9) };
    vec![
        Material { normal_map: Some(map), ..of("layered", Surface::Principled(layered)) },
        of("matte", Surface::Matte { reflectance: Colour { vertex: true, ..textured } }),
        of("mirror", Surface::Mirror { reflectance: Colour::constant(Vec3::splat(0.9)) }),
        Material {
            medium: Some(Medium { absorption: Vec3::splat(0.1), ..Medium::default() }),
            ..of("glass", glass)
        },
        Material { emission: Some(emission), ..Material::matte("lamp", Vec3::ZERO) },
        of("mix", Surface::Mix(0)),
        of("mix of mixes", Surface::Mix(1)),
        Material { alpha, ..Material::matte("leaf", Vec3::new(0.2, 0.7, 0.2)) },
    ]
}

fn lights() -> Vec<Light> {
    let light = |name: &str, shape| Light { name: name.into(), intensity: Vec3::splat(2.0), shape };
    let (position, direction) = (Vec3::new(0.0, 3.0, 1.0), Vec3::NEG_Y);
    vec![
        light("bulb", LightShape::Point { position }),
        light("spot", LightShape::Spot { position, direction, cos_inner: 0.9, cos_outer: 0.7 }),
        light("sun", LightShape::Directional { direction }),
    ]
}

/// Adds a unit square that faces z, with all attributes of vertices.
fn quad(scene: &mut Scene, corner: Vec3, material: u32) {
    let TriangleMesh {
        positions,
        normals,
        uvs,
        more_uvs,
        tangents,
        colours,
        attributes,
        triangles,
        materials,
        ..
    } = &mut *scene.mesh;
    more_uvs.resize(1, Vec::new());
    if attributes.is_empty() {
        attributes.push(VertexAttribute { name: "wetness".into(), width: 1, values: Vec::new() });
    }
    let base = positions.len() as u32;
    for uv in [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y] {
        positions.push(corner + uv.extend(0.0));
        normals.push(Vec3::Z);
        uvs.push(uv);
        more_uvs[0].push(uv * 0.5);
        attributes[0].values.push(uv.x);
        colours.push(Vec4::new(1.0, uv.x, uv.y, 0.5 + 0.5 * uv.x));
        tangents.push(Vec4::new(1.0, 0.0, 0.0, 1.0));
    }
    triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
    materials.extend([material; 2]);
}

/// Adds a shape of two triangles with two instances.
fn instances(scene: &mut Scene) {
    let mut shape = Shape {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::ONE.with_z(0.0), Vec3::Y],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        instances: Vec::new(),
    };
    for x in [-1.0, 0.5] {
        let mut placement = Placement::IDENTITY;
        (placement.rows[0][3], placement.rows[2][3]) = (x, -1.0);
        let first = scene.mesh.triangles.len() as u32;
        quad(scene, Vec3::new(x, 0.0, -1.0), 1);
        shape.instances.push(Instance { placement, first });
    }
    scene.shapes = vec![shape].into();
}

#[test]
fn the_scene_with_everything_is_valid_and_renders() {
    let (scene, service) = (everything(), service());
    scene.validate().expect("a valid scene");
    let prepared = PreparedScene::new(scene, &Units::cpu()).expect("a valid scene");
    let whitted = Whitted::new(prepared.lit(), &camera(), settings()).expect("valid settings");
    let occlusion =
        AmbientOcclusion::new(prepared.lit(), &camera(), settings(), 1.0).expect("valid settings");
    let path =
        PathTracer::new(prepared.scene.clone(), &camera(), settings(), Some(2)).expect("valid settings");
    hash(&service, &prepared, Arc::new(whitted));
    hash(&service, &prepared, Arc::new(occlusion));
    let by_scene = hash(&service, &prepared, Arc::new(path));
    assert_eq!(by_scene, picture(&service, &prepared), "the prepared lights are those of the scene");
}
