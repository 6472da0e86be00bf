//! Each invalid scene is refused with its own message, and jobs of other scenes are refused.

use super::*;
use raystream::lanes::Lanes;
use raystream::scene::{
    AttributeRequest, Effects, Finish, MeshError, Points, Procedural, ProceduralSurface, SceneError,
    ScenePart,
};
use raystream::schedule::{LimitsError, Tracers};

/// The message with which a damaged scene is refused.
fn refused(damage: impl FnOnce(&mut Scene)) -> String {
    let mut scene = everything();
    damage(&mut scene);
    PreparedScene::new(scene, &Units::cpu()).expect_err("the scene is invalid").to_string()
}

#[test]
fn short_and_long_arrays_are_refused() {
    for (message, part) in [
        (refused(|s| s.mesh.normals.truncate(39)), "normals: 39 entries for 40 vertices"),
        (refused(|s| s.mesh.uvs.truncate(39)), "texture coordinates: 39 entries"),
        (refused(|s| s.mesh.tangents.push(Vec4::ZERO)), "tangents: 41 entries"),
        (refused(|s| s.mesh.colours.truncate(3)), "colours: 3 entries"),
        (refused(|s| s.mesh.more_uvs[0].truncate(7)), "a further set of texture coordinates: 7 entries"),
        (
            refused(|s| s.mesh.attributes[0].values.truncate(39)),
            "the attribute \"wetness\": 39 numbers; the vertices have 40",
        ),
        (refused(|s| s.mesh.attributes[0].width = 5), "has 5 numbers a vertex"),
        (
            refused(|s| {
                let again = s.mesh.attributes[0].clone();
                s.mesh.attributes.push(again);
            }),
            "two attributes are called \"wetness\"",
        ),
        (refused(|s| s.mesh.materials.truncate(19)), "materials per triangle: 19 entries"),
        (refused(|s| s.mesh.triangles.clear()), "materials per triangle"),
        (refused(|s| s.mesh = TriangleMesh::default().into()), "no triangles"),
    ] {
        assert!(message.contains(part), "{message}");
    }
    let message = refused(|s| {
        let Environment::Map(map) = &mut s.environment else { unreachable!("a map") };
        map.texels = map.texels[1..].into();
    });
    assert!(message.contains("the environment: 7 texels for 4x2 pixels"), "{message}");
    let message = refused(|s| s.textures[1].texels = s.textures[1].texels[..15].into());
    assert!(message.contains("texture 1 (\"texture 1\"): 15 texels for 4x4 pixels"), "{message}");
    let message = refused(|s| s.textures[1].height = 5);
    assert!(
        message.contains("texture 1 (\"texture 1\"): its mipmap levels belong to another image"),
        "{message}"
    );
    let message = refused(|s| s.textures[0].width = 0);
    assert!(message.contains("texels for 0x4 pixels"), "{message}");
    let message = refused(|s| (s.textures[0].width, s.textures[0].height) = (1 << 16, 1 << 16));
    assert!(message.contains("texels for 65536x65536 pixels"), "the product overflows 32 bits: {message}");
}

#[test]
fn indices_out_of_range_are_refused() {
    for (message, part) in [
        (refused(|s| s.mesh.triangles[3][1] = 40), "triangle 3 names vertex 40, but there are 40 vertices"),
        (refused(|s| s.mesh.triangles[3][2] = u32::MAX), "triangle 3 names vertex 4294967295"),
        (refused(|s| s.mesh.materials[7] = 8), "triangle 7 names material 8, but there are 8"),
        (refused(|s| s.materials.truncate(7)), "triangle 14 names material 7, but there are 7 materials"),
        (
            refused(|s| s.materials[1].surface = Surface::Procedural(7)),
            "material 1 (\"matte\"): its surface names procedural surface 7, but the scene has 0",
        ),
        (refused(|s| s.materials[1].surface = Surface::Scattering(7)), "names scattering surface 7"),
        (refused(|s| s.materials[1].surface = Surface::Mix(2)), "names mix 2, but the scene has 2"),
        (refused(|s| s.mixes[1].of[0] = 8), "mix 1: a part names material 8"),
        (
            refused(|s| s.textures.truncate(1)),
            "material 0 (\"layered\"): its roughness names texture 1, but the scene has 1",
        ),
        (
            refused(|s| s.shapes[0].triangles[0][0] = 4),
            "shape 0: a position is not finite, or a triangle names",
        ),
        (refused(|s| s.shapes[0].instances[1].first = 19), "instance 1 of shape 0: its triangles lie beyond"),
        (
            refused(|s| s.shapes[0].instances[1].first = u32::MAX),
            "instance 1 of shape 0: its triangles lie beyond",
        ),
    ] {
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn numbers_that_are_not_finite_or_out_of_range_are_refused() {
    let principled = |s: &mut Scene, change: fn(&mut Principled)| {
        let Surface::Principled(surface) = &mut s.materials[0].surface else { unreachable!("layered") };
        change(surface);
    };
    let nan = f32::NAN;
    for (message, part) in [
        (refused(|s| s.mesh.positions[2].y = nan), "vertex 2 is at (-1, NaN,"),
        (refused(|s| s.mesh.normals[3].z = nan), "normals: the entry of vertex 3 is not finite"),
        (refused(|s| s.mesh.uvs[4].x = f32::INFINITY), "texture coordinates: the entry of vertex 4"),
        (refused(|s| s.mesh.tangents[5].w = nan), "tangents: the entry of vertex 5"),
        (refused(|s| s.mesh.colours[6].w = nan), "colours: the entry of vertex 6"),
        (
            refused(|s| s.mesh.more_uvs[0][7].y = nan),
            "a further set of texture coordinates: the entry of vertex 7",
        ),
        (
            refused(|s| s.mesh.attributes[0].values[8] = nan),
            "the attribute \"wetness\": a number of vertex 8 is not finite",
        ),
        (
            refused(|s| s.materials[1] = Material::matte("wall", Vec3::new(0.5, nan, 0.5))),
            "material 1 (\"wall\"): its reflectance is NaN; it must be from 0 to 1",
        ),
        (refused(|s| principled(s, |p| p.metallic.factor = 7.0)), "metallic is 7; it must be from 0 to 1"),
        (
            refused(|s| principled(s, |p| p.ior = 0.5)),
            "index of refraction is 0.5; it must be finite and at least 1",
        ),
        (
            refused(|s| s.materials[0].normal_map.as_mut().expect("a map").scale = nan),
            "scale of a normal map is NaN",
        ),
        (refused(|s| s.materials[7].alpha.value.factor = -1.0), "material 7 (\"leaf\"): its alpha is -1"),
        (refused(|s| s.lights[0].intensity.x = -1.0), "light 0 (\"bulb\"): its intensity is -1"),
        (
            refused(|s| s.lights[2].shape = LightShape::Directional { direction: Vec3::ZERO }),
            "light 2 (\"sun\"): the squared length of its direction is 0; it must be 1",
        ),
        (
            refused(|s| s.environment = Environment::Constant(Vec3::splat(nan))),
            "the environment: its radiance is NaN",
        ),
        (
            refused(|s| {
                let Environment::Map(map) = &mut s.environment else { unreachable!("a map") };
                map.texels = [[0.0, -1.0, 0.0]; 8].into();
            }),
            "the environment: a texel is -1; it must be finite and at least 0",
        ),
        (
            refused(|s| s.shapes[0].instances[0].placement.rows[1][1] = nan),
            "an element of its placement is NaN",
        ),
        (refused(|s| s.camera.as_mut().expect("a camera").eye.x = nan), "the camera's eye"),
        (refused(|s| s.mixes[0].share.factor = 2.0), "mix 0: its share is 2"),
    ] {
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn mixes_and_instances_that_contradict_themselves_are_refused() {
    for (message, part) in [
        (refused(|s| s.mixes[0].of[1] = 6), "mix 0: it contains itself"),
        (
            refused(|s| s.mixes[0].of[1] = 4),
            "material 5 (\"mix\"): its emission differs from that of material 4 (\"lamp\"), which is a part of its mix",
        ),
        (refused(|s| s.mixes[0].of[1] = 7), "its alpha differs"),
        (refused(|s| s.mixes[0].of[1] = 3), "its medium differs"),
        (refused(|s| s.shapes[0].instances.clear()), "shape 0: it has no instances"),
        (
            refused(|s| s.shapes[0].instances[1].placement.rows[0][3] = 9.0),
            "instance 1 of shape 0: the mesh's triangles are not where its placement moves the shape's",
        ),
        (
            refused(|s| {
                let first = s.shapes[0].instances[0];
                s.shapes[0].instances[1] = first;
            }),
            "its triangles also belong to another instance",
        ),
        (
            refused(|s| {
                let last = s.mesh.materials.len() - 1;
                s.mesh.materials[last] = 7;
            }),
            "instance 1 of shape 0: its materials are opaque where",
        ),
    ] {
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn errors_can_be_matched() {
    let mut scene = everything();
    scene.mesh.triangles[0] = [u32::MAX; 3];
    let vertex = MeshError::Vertex { triangle: 0, vertex: u32::MAX, count: 40 };
    assert_eq!(scene.validate(), Err(SceneError::Mesh(vertex)));
    let mut scene = everything();
    scene.mixes[1].share.factor = f32::INFINITY;
    let expected = "from 0 to 1";
    let error =
        SceneError::Value { part: ScenePart::Mix(1), field: "its share", value: f32::INFINITY, expected };
    assert_eq!(scene.validate(), Err(error));
}

#[test]
fn jobs_of_other_scenes_are_refused() {
    let service = service();
    let prepare = || PreparedScene::new(everything(), &Units::cpu()).expect("a valid scene");
    let (one, other) = (prepare(), prepare());
    let path = one.path(&camera(), settings()).expect("valid settings");
    let refused = other.submit(&service, path.clone(), JobOptions::default());
    assert_eq!(refused.map(drop), Err(LimitsError::OtherScene));
    let refused = service.submit(path.clone(), other.tracers.clone(), JobOptions::default());
    assert_eq!(refused.map(drop), Err(LimitsError::OtherScene));
    // Each appearance has tracers of its own, because its alpha may differ.
    let other = one.with_scene(Scene::clone(&one.scene)).expect("a valid scene");
    assert_eq!(
        other.submit(&service, path.clone(), JobOptions::default()).map(drop),
        Err(LimitsError::OtherScene)
    );
    one.submit(&service, path.clone(), JobOptions::default()).expect("its own").wait().expect("a picture");
    let seen = path.seen_by(&camera().with_fov(20.0)).expect("a valid camera");
    one.submit(&service, Arc::new(seen), JobOptions::default()).expect("its own").wait().expect("a picture");
    let anonymous = Tracers::cpu(other.tracers.host.clone());
    service.submit(path, anonymous, JobOptions::default()).expect("any scene").cancel();
}

/// A surface that declares a bound of its emission.
#[derive(Debug)]
struct Glow(f32);

impl Procedural for Glow {
    fn effects(&self) -> Effects {
        let mut effects = Effects::default();
        effects.emission_bound = self.0;
        effects
    }

    #[inline(always)]
    fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        Finish::matte(points)
    }
}

#[test]
fn effects_of_procedural_surfaces_are_checked() {
    let glow = |bound: f32| {
        move |s: &mut Scene| {
            s.procedurals.push(ProceduralSurface::new(Glow(bound)));
            s.materials[7].surface = Surface::Procedural(0);
        }
    };
    for bound in [f32::NAN, f32::INFINITY, -1.0] {
        let message = refused(glow(bound));
        let part = format!("material 7 (\"leaf\"): the bound of its computed emission is {bound}");
        assert!(message.contains(&part), "{message}");
    }
    let mut scene = everything();
    glow(2.0)(&mut scene);
    assert_eq!(scene.validate(), Ok(()));
}

/// A surface that reads attributes.
#[derive(Debug)]
struct Weathered(Vec<AttributeRequest>);

impl Procedural for Weathered {
    fn attributes(&self) -> &[AttributeRequest] {
        &self.0
    }

    fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        Finish { roughness: points.attribute("wetness")[0], ..Finish::matte(points) }
    }
}

#[test]
fn attributes_that_a_surface_reads_and_the_mesh_lacks_are_named() {
    let with = |name: &'static str, width| {
        move |s: &mut Scene| {
            let request = AttributeRequest { name: name.into(), width };
            s.procedurals.push(ProceduralSurface::new(Weathered(vec![request])));
            s.materials[7].surface = Surface::Procedural(0);
        }
    };
    let mut sound = everything();
    with("wetness", 1)(&mut sound);
    assert!(sound.validate().is_ok());
    let mut dry = sound.clone();
    dry.mesh.attributes[0].values.fill(0.0);
    assert_ne!(dry.fingerprint(), sound.fingerprint(), "pictures depend on what is read");
    let lacks = refused(with("flow", 2));
    assert!(
        lacks.contains("reads the vertex attribute \"flow\", which the mesh does not have; it has wetness"),
        "{lacks}"
    );
    let other = refused(with("wetness", 2));
    assert!(other.contains("\"wetness\", of 2 numbers a vertex, but the mesh has 1 of each"), "{other}");
}
