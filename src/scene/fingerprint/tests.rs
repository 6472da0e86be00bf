//! Tests that every field of every type is encoded, and that the encoding does not change by accident.

use super::{Encode, Encoder, FINGERPRINT_VERSION};
use crate::lanes::Lanes;
use crate::scene::{
    Alpha, AlphaMode, Anisotropy, Averaging, Channel, Coat, Coats, Colour, ColourSpace, DiffuseTransmission,
    Emission, Environment, EnvironmentMap, Finish, Iridescence, Light, LightShape, Material, Medium, Mipmap,
    Mix, NormalMap, Object, OpenPbr, OpenPbrCoat, OpenPbrFuzz, OpenPbrSubsurface, Points, Principled,
    Procedural, ProceduralSurface, Scalar, Scene, Sheen, Surface, Texture, TextureRef, TriangleMesh,
    VertexAttribute, Wrap,
};
use glam::{Vec2, Vec3, Vec4};
use std::collections::BTreeMap;
use xxhash_rust::xxh3::Xxh3;

/// The hash of a value's canonical bytes.
fn hash(value: &impl Encode) -> u64 {
    let mut to = Encoder(Xxh3::new());
    value.encode(&mut to);
    to.0.digest()
}

/// Asserts that the values have different bytes.
fn all_differ<T: Encode>(values: impl IntoIterator<Item = (&'static str, T)>) {
    let mut names_by_hash = BTreeMap::new();
    for (name, value) in values {
        if let Some(other) = names_by_hash.insert(hash(&value), name) {
            panic!("{} encodes {name} and {other} alike", std::any::type_name::<T>());
        }
    }
}

/// Asserts that the bytes change with each field of a value. The pattern has no `..`, so a new field does not compile
/// until it is listed here. Fields after `except` must not change the bytes.
macro_rules! each_field_counts {
    (
        $base:expr, $type:ident { $($field:ident: $other:expr),* $(,)? }
        $(except { $($left_out:ident: $name:expr),* })?
    ) => {{
        let base: $type = $base;
        let $type { $($field: _,)* $($($left_out: _,)*)? } = &base;
        let mut values = vec![("nothing changed", base.clone())];
        $({
            let mut changed = base.clone();
            changed.$field = $other;
            values.push((stringify!($field), changed));
        })*
        all_differ(values);
        $($({
            let mut named = base.clone();
            named.$left_out = $name;
            assert_eq!(hash(&named), hash(&base), "{} must not count", stringify!($left_out));
        })*)?
    }};
}

const TEXTURE: TextureRef = TextureRef {
    texture: 3,
    set: 0,
    offset: Vec2::new(0.25, 0.5),
    rotation: 0.75,
    scale: Vec2::new(2.0, 4.0),
};

fn colour(factor: f32) -> Colour {
    Colour { factor: Vec3::new(factor, 0.5, 0.25), texture: None, vertex: false }
}

fn textured(factor: f32) -> Scalar {
    Scalar { factor, texture: Some((TEXTURE, Channel::G)) }
}

fn image() -> Texture {
    Texture {
        name: "image".into(),
        width: 2,
        height: 2,
        texels: [[1, 2, 3, 4], [5, 6, 7, 8], [9, 10, 11, 12], [13, 14, 15, 16]].into(),
        space: ColourSpace::Srgb,
        wrap_u: Wrap::Repeat,
        wrap_v: Wrap::Clamp,
        mipmap: Mipmap::default(),
    }
}

fn map() -> EnvironmentMap {
    EnvironmentMap {
        width: 2,
        height: 1,
        texels: [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]].into(),
        rotation_degrees: 30.0,
    }
}

#[test]
fn every_field_of_a_textured_input_counts() {
    each_field_counts!(
        TEXTURE,
        TextureRef { texture: 4, set: 1, offset: Vec2::ONE, rotation: 0.0, scale: Vec2::ONE }
    );
    each_field_counts!(colour(1.0), Colour { factor: Vec3::ZERO, texture: Some(TEXTURE), vertex: true });
    each_field_counts!(textured(1.0), Scalar { factor: 0.5, texture: None });
}

#[test]
fn every_field_of_a_material_counts() {
    let emission = Emission { radiance: colour(4.0), two_sided: false, is_light: true };
    each_field_counts!(emission, Emission { radiance: colour(5.0), two_sided: true, is_light: false });
    let bumps = NormalMap { texture: TEXTURE, scale: 1.0 };
    each_field_counts!(bumps, NormalMap { texture: TextureRef::plain(3), scale: -1.0 });
    each_field_counts!(
        Alpha::default(),
        Alpha { mode: AlphaMode::Blend, value: textured(1.0), vertex: true }
    );
    each_field_counts!(
        Medium::default(),
        Medium { absorption: Vec3::X, scattering: Vec3::ONE, anisotropy: 0.5 }
    );
    each_field_counts!(Mix { of: [1, 2], share: textured(0.5) }, Mix { of: [2, 1], share: textured(0.25) });
    each_field_counts!(Coat::CLEAR, Coat { weight: 0.5, ior: 1.25, roughness: 0.5, tint: Vec3::X });
    let anisotropy = Anisotropy { strength: textured(1.0), rotation: 0.0, direction: None };
    each_field_counts!(
        anisotropy,
        Anisotropy { strength: textured(0.5), rotation: 1.0, direction: Some(TEXTURE) }
    );
    let fibres = Sheen { colour: colour(1.0), roughness: textured(1.0) };
    each_field_counts!(fibres, Sheen { colour: colour(0.5), roughness: textured(0.5) });
    let film =
        Iridescence { strength: textured(1.0), ior: 1.5, thickness_nm: [1.0, 2.0], thickness_texture: None };
    each_field_counts!(
        film,
        Iridescence {
            strength: textured(0.5),
            ior: 1.25,
            thickness_nm: [2.0, 1.0],
            thickness_texture: Some((TEXTURE, Channel::A)),
        }
    );
    let leaf = DiffuseTransmission { share: textured(1.0), colour: colour(1.0) };
    each_field_counts!(leaf, DiffuseTransmission { share: textured(0.5), colour: colour(0.5) });
    each_field_counts!(
        Principled::default(),
        Principled {
            base_colour: colour(0.5),
            metallic: textured(0.5),
            roughness: textured(0.5),
            ior: 1.25,
            specular: textured(0.5),
            specular_colour: colour(0.5),
            transmission: textured(0.5),
            thin: false,
            clearcoat: textured(0.5),
            clearcoat_roughness: textured(0.5),
            coats: Coats::new(&[Coat::CLEAR]).expect("one"),
            coat_normal_map: Some(bumps),
            anisotropy: Some(anisotropy),
            sheen: Some(fibres),
            iridescence: Some(film),
            glossiness: Some(textured(0.5)),
            diffuse_transmission: Some(leaf),
            dispersion: 0.5,
        }
    );
}

#[test]
fn every_parameter_of_openpbr_counts() {
    let textured = Scalar { factor: 0.75, texture: Some((TEXTURE, Channel::G)) };
    let anisotropy = Anisotropy { strength: textured, rotation: 0.5, direction: None };
    let film =
        Iridescence { strength: textured, ior: 1.5, thickness_nm: [100.0, 400.0], thickness_texture: None };
    let subsurface = OpenPbrSubsurface { weight: Scalar::constant(0.5), color: Vec3::ONE, anisotropy: 0.0 };
    each_field_counts!(
        subsurface,
        OpenPbrSubsurface { weight: textured, color: Vec3::splat(0.5), anisotropy: 0.5 }
    );
    each_field_counts!(
        OpenPbr::default(),
        OpenPbr {
            base_weight: textured,
            base_color: colour(0.5),
            base_diffuse_roughness: textured,
            base_metalness: textured,
            specular_weight: textured,
            specular_color: colour(0.5),
            specular_roughness: textured,
            specular_anisotropy: Some(anisotropy),
            specular_ior: 1.25,
            transmission_weight: textured,
            transmission_color: colour(0.5),
            dispersion: 0.5,
            subsurface: Some(subsurface),
            coat: Some(OpenPbrCoat::default()),
            fuzz: Some(OpenPbrFuzz::default()),
            thin_film: Some(film),
            thin_walled: true,
        }
    );
    let coat = OpenPbrCoat::default();
    each_field_counts!(
        coat,
        OpenPbrCoat {
            weight: textured,
            color: colour(0.5),
            roughness: textured,
            anisotropy: textured,
            ior: 1.25,
            darkening: 0.5,
        }
    );
    let fuzz = OpenPbrFuzz::default();
    each_field_counts!(fuzz, OpenPbrFuzz { weight: textured, color: colour(0.5), roughness: textured });
}

#[test]
fn every_part_of_a_material_counts() {
    let emission = Emission { radiance: colour(4.0), two_sided: false, is_light: true };
    let bumps = NormalMap { texture: TEXTURE, scale: 1.0 };
    each_field_counts!(
        Material::fallback(),
        Material {
            surface: Surface::Mix(1),
            emission: Some(emission),
            normal_map: Some(bumps),
            alpha: Alpha { mode: AlphaMode::Blend, ..Alpha::default() },
            medium: Some(Medium::default()),
        } except { name: "another".into() }
    );
}

#[test]
fn every_variant_and_its_fields_count() {
    let dielectric = |ior, transmittance| Surface::Dielectric { ior, transmittance };
    all_differ([
        ("matte", Surface::Matte { reflectance: colour(1.0) }),
        ("darker matte", Surface::Matte { reflectance: colour(0.5) }),
        ("mirror", Surface::Mirror { reflectance: colour(1.0) }),
        ("darker mirror", Surface::Mirror { reflectance: colour(0.5) }),
        ("dielectric", dielectric(1.5, Vec3::ONE)),
        ("denser dielectric", dielectric(1.75, Vec3::ONE)),
        ("tinted dielectric", dielectric(1.5, Vec3::X)),
        ("principled", Surface::Principled(Principled::default())),
        ("procedural", Surface::Procedural(1)),
        ("another procedural", Surface::Procedural(2)),
        ("scattering", Surface::Scattering(1)),
        ("another scattering", Surface::Scattering(2)),
        ("mix", Surface::Mix(1)),
        ("another mix", Surface::Mix(2)),
        ("OpenPBR", Surface::OpenPbr(OpenPbr::default())),
    ]);
    all_differ([
        ("opaque", AlphaMode::Opaque),
        ("mask", AlphaMode::Mask { cutoff: 0.5 }),
        ("another mask", AlphaMode::Mask { cutoff: 0.25 }),
        ("blend", AlphaMode::Blend),
    ]);
    use Channel::{A, B, G, Luminance, R};
    all_differ([("r", R), ("g", G), ("b", B), ("a", A), ("luminance", Luminance)]);
    all_differ([("srgb", ColourSpace::Srgb), ("linear", ColourSpace::Linear)]);
    all_differ([("repeat", Wrap::Repeat), ("mirror", Wrap::Mirror), ("clamp", Wrap::Clamp)]);
    all_differ([
        ("light", Averaging::Light),
        ("covered", Averaging::Covered),
        ("normals", Averaging::Normals),
    ]);
    let spot = |position, direction, cos_inner, cos_outer| LightShape::Spot {
        position,
        direction,
        cos_inner,
        cos_outer,
    };
    all_differ([
        ("point", LightShape::Point { position: Vec3::ZERO }),
        ("another point", LightShape::Point { position: Vec3::X }),
        ("directional", LightShape::Directional { direction: Vec3::ZERO }),
        ("another directional", LightShape::Directional { direction: Vec3::X }),
        ("spot", spot(Vec3::X, Vec3::Y, 0.75, 0.5)),
        ("moved spot", spot(Vec3::Z, Vec3::Y, 0.75, 0.5)),
        ("turned spot", spot(Vec3::X, Vec3::Z, 0.75, 0.5)),
        ("sharper spot", spot(Vec3::X, Vec3::Y, 0.625, 0.5)),
        ("wider spot", spot(Vec3::X, Vec3::Y, 0.75, 0.25)),
    ]);
    all_differ([
        ("even sky", Environment::Constant(Vec3::ONE)),
        ("red sky", Environment::Constant(Vec3::X)),
        ("sky map", Environment::Map(map())),
    ]);
    all_differ([
        ("no coat", Coats::NONE),
        ("one coat", Coats::new(&[Coat::CLEAR]).expect("one")),
        ("two coats", Coats::new(&[Coat::CLEAR; 2]).expect("two")),
    ]);
}

#[test]
fn every_field_of_textures_lights_and_meshes_counts() {
    let with_mipmap = |mean| {
        let mut texture = image();
        texture.add_mipmap(mean);
        texture.mipmap
    };
    let mut other = image().texels.to_vec();
    other[3][3] = 0;
    each_field_counts!(
        image(),
        Texture {
            width: 1,
            height: 1,
            texels: other.into(),
            space: ColourSpace::Linear,
            wrap_u: Wrap::Clamp,
            wrap_v: Wrap::Mirror,
            mipmap: with_mipmap(Averaging::Light),
        } except { name: "another".into() }
    );
    all_differ(
        [Averaging::Light, Averaging::Covered, Averaging::Normals].map(|mean| ("mipmap", with_mipmap(mean))),
    );
    each_field_counts!(
        map(),
        EnvironmentMap { width: 1, height: 2, texels: [[0.0; 3]; 2].into(), rotation_degrees: 0.0 }
    );
    let lamp =
        Light { name: "lamp".into(), intensity: Vec3::ONE, shape: LightShape::Point { position: Vec3::X } };
    each_field_counts!(
        lamp,
        Light { intensity: Vec3::X, shape: LightShape::Point { position: Vec3::Y } }
        except { name: "another".into() }
    );
    let wetness = VertexAttribute { name: "wetness".into(), width: 1, values: vec![1.0] };
    each_field_counts!(
        TriangleMesh::default(),
        TriangleMesh {
            positions: vec![Vec3::ZERO; 12],
            normals: vec![Vec3::ZERO; 12],
            uvs: vec![Vec2::ZERO; 12],
            more_uvs: vec![Vec::new(); 12],
            colours: vec![Vec4::ZERO; 12],
            tangents: vec![Vec4::ZERO; 12],
            triangles: vec![[0; 3]; 12],
            materials: vec![0; 12],
        }
        except { attributes: vec![wetness.clone()] }
    );
    each_field_counts!(wetness, VertexAttribute { name: "flow".into(), width: 2, values: vec![1.0, 1.0] });
}

/// A surface of user code.
#[derive(Debug)]
struct Code {
    #[allow(dead_code, reason = "read by Debug")]
    parameter: f32,
}

impl Procedural for Code {
    fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        Finish::matte(points)
    }
}

/// A triangle under a point light.
fn scene() -> Scene {
    Scene {
        mesh: TriangleMesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            triangles: vec![[0, 1, 2]],
            materials: vec![0],
            ..TriangleMesh::default()
        }
        .into(),
        materials: vec![Material::matte("grey", Vec3::splat(0.5))],
        textures: vec![image()],
        procedurals: vec![ProceduralSurface::new(Code { parameter: 1.0 })],
        lights: vec![Light {
            name: "lamp".into(),
            intensity: Vec3::ONE,
            shape: LightShape::Point { position: Vec3::Z },
        }],
        environment: Environment::Map(map()),
        ..Scene::default()
    }
}

#[test]
fn the_fingerprint_of_a_scene_is_pinned() {
    let pinned = (3, "4798a14e9df5bd4d");
    assert_eq!(
        (FINGERPRINT_VERSION, scene().fingerprint().as_str()),
        pinned,
        "the encoding has changed: raise FINGERPRINT_VERSION, then pin what it gives"
    );
}

/// Changes one thing of a scene.
type Change = fn(&mut Scene);

/// Gives all triangles to an object of this name.
fn own(scene: &mut Scene, name: &str) {
    let object = scene.objects.add(Object::new(name));
    scene.objects.assign(0, object);
}

#[test]
fn objects_count_where_user_code_may_look_at_them_but_their_names_do_not() {
    let [mut one, mut other] = [scene(), scene()];
    own(&mut one, "one");
    own(&mut other, "other");
    assert_eq!(one.fingerprint(), other.fingerprint());
    let mut plain = scene();
    plain.procedurals.clear();
    one.procedurals.clear();
    assert_eq!(one.fingerprint(), plain.fingerprint());
}

#[test]
fn the_fingerprint_depends_on_each_part_of_a_scene() {
    let changes: [(&str, Change); 10] = [
        ("nothing changed", |_| ()),
        ("mesh", |scene| scene.mesh.triangles[0].swap(0, 1)),
        ("materials", |scene| scene.materials.push(Material::fallback())),
        ("textures", |scene| scene.textures.push(image())),
        ("procedurals", |scene| scene.procedurals[0] = ProceduralSurface::new(Code { parameter: 2.0 })),
        ("mixes", |scene| scene.mixes.push(Mix { of: [0, 0], share: Scalar::constant(0.5) })),
        ("lights", |scene| scene.lights.clear()),
        ("environment", |scene| scene.environment = Environment::default()),
        ("one procedural less", |scene| scene.procedurals.clear()),
        ("objects", |scene| own(scene, "all")),
    ];
    let scenes = changes.map(|(name, change)| {
        let mut scene = scene();
        change(&mut scene);
        (name, scene)
    });
    all_differ(scenes);
}
