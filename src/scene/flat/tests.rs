//! Scenes are the same after writing and reading, and damaged files are refused.

use super::{FlatError, VERSION, read, triangles, write};
use crate::lanes::Lanes;
use crate::memory::MemoryBudget;
use crate::scene::{
    AnimatedNode, AnimationSpan, Camera, CameraMotion, Coat, Coats, Colour, ColourSpace, Environment,
    EnvironmentMap, Finish, Interpolation, Key, Light, LightShape, Material, Mipmap, NamedCamera, Object,
    Points, Principled, Procedural, ProceduralSurface, Scene, Surface, SurfaceRequest, Texture, TextureRef,
    Track, TriangleMesh, VertexAttribute, Wrap,
};
use glam::{DQuat, DVec3, Vec2, Vec3, Vec4};
use std::path::PathBuf;

/// A scene with something in each field that a file may fill.
fn scene() -> Scene {
    let mut mesh = TriangleMesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z], vec![[0, 1, 2], [0, 2, 3]]);
    mesh.uvs = vec![Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE];
    mesh.more_uvs = vec![mesh.uvs.clone()];
    let values = mesh.uvs.iter().flat_map(|uv| uv.to_array()).collect();
    mesh.attributes = vec![VertexAttribute { name: "wetness".into(), width: 2, values }];
    mesh.colours = vec![Vec4::splat(0.5); 4];
    mesh.normals = vec![Vec3::Z; 4];
    mesh.materials = vec![0, 1];
    let coats = Coats::new(&[Coat::CLEAR, Coat { roughness: 0.2, ..Coat::CLEAR }]).expect("two");
    let textured = Colour { texture: Some(TextureRef::plain(1)), ..Colour::constant(Vec3::ONE) };
    let lacquer = Principled { coats, base_colour: textured, ..Principled::default() };
    let lacquer = Material { surface: Surface::Principled(lacquer), ..Material::fallback() };
    let mut scene = Scene::new(mesh, vec![Material::matte("wall", Vec3::splat(0.25)), lacquer]);
    let texels = vec![[10, 20, 30, 255]; 12];
    let texture = Texture {
        name: "grid".into(),
        width: 4,
        height: 3,
        texels: texels.into(),
        space: ColourSpace::Srgb,
        wrap_u: Wrap::Repeat,
        wrap_v: Wrap::Mirror,
        mipmap: Mipmap::default(),
    };
    scene.textures = vec![texture];
    scene.add_mipmaps();
    // Two textures of one image.
    scene.textures.push(Texture { name: "twin".into(), wrap_u: Wrap::Clamp, ..scene.textures[0].clone() });
    let room = scene.objects.add(Object::new("room"));
    scene.objects.assign(0, room);
    scene.lights = vec![Light {
        name: "lamp".into(),
        intensity: Vec3::ONE,
        shape: LightShape::Point { position: Vec3::splat(2.0) },
    }];
    let map = EnvironmentMap { width: 2, height: 1, texels: [[1.0; 3]; 2].into(), rotation_degrees: 15.0 };
    scene.environment = Environment::Map(map);
    let key = |value: DVec3| Key { arriving: DVec3::ZERO, value, leaving: DVec3::X };
    let track = Track::new(vec![0.0, 1.5], vec![key(DVec3::Y), key(DVec3::Z)], Interpolation::Cubic);
    let node = AnimatedNode {
        translation: track.expect("two keys"),
        rotation: Track::constant(DQuat::IDENTITY),
        scale: Track::constant(DVec3::ONE),
    };
    let camera = Camera::new(Vec3::splat(3.0), Vec3::ZERO);
    let motion = CameraMotion::new(40.0, vec![node]);
    scene.camera = Some(camera);
    scene.camera_motion = Some(motion.clone());
    scene.cameras = vec![NamedCamera::new("front", camera).with_motion(Some(motion))];
    let options = [("scale".to_owned(), "2".to_owned())].into();
    scene.surface_requests = vec![SurfaceRequest { material: 0, surface: "wood.wgsl".into(), options }];
    scene.options = [("path.depth".to_owned(), "3".to_owned())].into();
    scene.warnings = vec!["A sentence.".into()];
    scene.is_animated = true;
    scene.animations = vec![AnimationSpan::new("walk", 0.25, 1.5)];
    scene.stroke_width = Some(0.25);
    scene.variants = vec!["red".into()];
    scene.files = vec![PathBuf::from("wood.png")];
    scene.validate().expect("a valid scene");
    scene
}

fn bytes(scene: &Scene) -> Vec<u8> {
    let mut bytes = Vec::new();
    write(scene, &mut bytes).expect("memory");
    bytes
}

fn read_bytes(bytes: &[u8]) -> Result<Scene, FlatError> {
    let file = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(file.path(), bytes).expect("a disk");
    read(file.path(), &MemoryBudget::of_bytes(1 << 30))
}

#[test]
fn a_scene_is_the_same_again() {
    let scene = scene();
    let bytes = bytes(&scene);
    assert_eq!(bytes.len() % 16, 0);
    let same = read_bytes(&bytes).expect("a scene");
    assert_eq!(same.fingerprint(), scene.fingerprint());
    // The text has every field, names included, which the fingerprint lacks.
    assert_eq!(format!("{same:?}"), format!("{scene:?}"));
    assert_eq!(self::bytes(&same), bytes, "the same bytes again");
    let file = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(file.path(), &bytes).expect("a disk");
    assert_eq!(triangles(file.path()).expect("a head"), 2);
    let small = read(file.path(), &MemoryBudget::of_bytes(100)).expect_err("too large");
    assert!(matches!(small, FlatError::Memory(_)), "{small}");
}

#[test]
fn every_changed_bit_is_found() {
    let whole = bytes(&scene());
    for at in 0..whole.len() {
        let mut changed = whole.clone();
        changed[at] ^= 1 << (at % 8);
        let error = read_bytes(&changed).expect_err("a changed bit");
        let expected = match at {
            0..8 => matches!(error, FlatError::Kind),
            8..12 => matches!(error, FlatError::Version { found } if found != VERSION),
            _ => matches!(error, FlatError::Damaged(_) | FlatError::Scene(_)),
        };
        assert!(expected, "byte {at}: {error}");
    }
    for length in 0..whole.len() {
        let error = read_bytes(&whole[..length]).expect_err("a cut file");
        assert!(matches!(error, FlatError::Kind | FlatError::Damaged(_)), "{length} bytes: {error}");
    }
    assert!(read_bytes(&[&whole[..], &[0; 16]].concat()).is_err(), "bytes at the end");
}

/// Files whose hash is right, as a hostile writer could make them: whatever they say, there is a scene or an error.
#[test]
fn hostile_files_with_right_hashes_are_scenes_or_errors() {
    let whole = bytes(&scene());
    let tries = std::env::var("RAYSTREAM_FLAT_FILES").ok().and_then(|text| text.parse().ok());
    let (mut random, mut scenes) = (7_u64, 0);
    let mut next = move |below: usize| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 33) as usize % below
    };
    for _ in 0..tries.unwrap_or(3000) {
        let mut changed = whole.clone();
        for _ in 0..=next(4) {
            let at = 8 + next(changed.len() - 8);
            match next(3) {
                0 => changed[at] = next(256) as u8,
                1 => changed[at] = [0, 1, 127, 128, 255][next(5)],
                _ => changed.truncate(64 + next(changed.len() - 63)),
            }
        }
        let length = changed.len() as u64;
        changed[8..12].copy_from_slice(&VERSION.to_le_bytes());
        changed[16..24].copy_from_slice(&length.to_le_bytes());
        let mut hash = xxhash_rust::xxh3::Xxh3::new();
        hash.update(&changed[..48]);
        hash.update(&changed[64..]);
        changed[48..64].copy_from_slice(&hash.digest128().to_le_bytes());
        scenes += usize::from(read_bytes(&changed).is_ok());
    }
    assert!(scenes > 0, "some changes leave a scene");
}

#[derive(Debug)]
struct Plain;

impl Procedural for Plain {
    fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        Finish::matte(points)
    }
}

#[test]
fn surfaces_of_user_code_are_refused() {
    let mut scene = scene();
    scene.add_surface(ProceduralSurface::new(Plain));
    assert!(matches!(write(&scene, Vec::new()), Err(FlatError::Coded)));
}
