use super::*;
use crate::scene::{AlphaMode, Channel, Colour, NormalMap, OpenPbr, Principled, Scalar, Surface, TextureRef};
use glam::DVec3;

fn square() -> TriangleMesh {
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
    TriangleMesh::new(positions, vec![[0, 1, 2], [0, 2, 3]])
}

fn build(assembly: &Assembly) -> Result<Scene, AssemblyError> {
    assembly.build(MemoryBudget::UNLIMITED)
}

fn shifts(count: u32) -> Vec<DMat4> {
    (0..count).map(|i| DMat4::from_translation(DVec3::new(2.0 * f64::from(i), 0.0, 0.5))).collect()
}

#[test]
fn parts_are_written_out_in_their_order_with_what_others_have() {
    let mut assembly = Assembly::default();
    let red = assembly.add_material(Material::matte("red", Vec3::X)).expect("a name");
    let normals = vec![Vec3::Z; 4];
    let uvs = vec![Vec2::ONE; 4];
    let more_uvs = vec![Vec::new(), vec![Vec2::X; 4]];
    let rich = TriangleMesh { normals, uvs, more_uvs, colours: vec![Vec4::splat(0.5); 4], ..square() };
    assembly.add(Part { material: Some(red), ..Part::new("rich", rich) }).expect("sound");
    assembly.add(Part { transforms: shifts(3), ..Part::new("poor", square()) }).expect("sound");
    let scene = build(&assembly).expect("a scene");
    assert_eq!((scene.mesh.positions.len(), &*scene.mesh.materials), (16, &[0, 0, 1, 1, 1, 1, 1, 1][..]));
    assert_eq!(scene.mesh.positions[13], Vec3::new(5.0, 0.0, 0.5));
    assert_eq!((scene.mesh.normals[3], scene.mesh.normals[4]), (Vec3::Z, Vec3::ZERO));
    assert_eq!((scene.mesh.uvs[3], scene.mesh.uvs[4]), (Vec2::ONE, Vec2::ZERO));
    assert_eq!((scene.mesh.uv_set(1).len(), scene.mesh.uv_set(2)[3]), (16, Vec2::X));
    assert_eq!(scene.mesh.triangles[7], [12, 14, 15]);
    let owners = [0, 2, 7].map(|primitive| scene.objects.of(primitive).expect("an object"));
    assert_eq!(owners.map(|owner| scene.objects.path(owner)), ["rich", "poor/0", "poor/2"]);
    assert_eq!(owners.map(|owner| scene.objects.get(owner).expect("one").instance), [None, Some(0), Some(2)]);
    assert_eq!((scene.shapes.len(), scene.shapes[0].instances.len()), (1, 3));
    // Colours multiply red, and their alpha counts; those that are missing are white.
    let Surface::Matte { reflectance } = scene.materials[0].surface else { panic!("matte") };
    assert_eq!(reflectance, Colour { vertex: true, ..Colour::constant(Vec3::X) });
    assert_eq!((scene.materials[0].alpha.mode, scene.materials[0].alpha.vertex), (AlphaMode::Blend, true));
    assert_eq!(scene.materials[1], Material::fallback());
}

#[test]
fn mirrors_turn_triangles_and_their_shapes_round() {
    let mirror = DMat4::from_scale(DVec3::new(-1.0, 1.0, 2.0));
    let transforms = [shifts(2), vec![mirror, mirror * shifts(3)[2]]].concat();
    let mut assembly = Assembly::default();
    let (normals, tangents) = (vec![Vec3::new(0.0, 3.0, 4.0); 4], vec![Vec4::new(1.0, 0.0, 0.0, 1.0); 4]);
    let mesh = TriangleMesh { normals, tangents, ..square() };
    assembly.add(Part { transforms, ..Part::new("sheets", mesh) }).expect("sound");
    let scene = build(&assembly).expect("a scene, whose instances are where the mesh is");
    assert_eq!((scene.mesh.triangles[2], scene.mesh.triangles[4]), ([4, 5, 6], [8, 10, 9]));
    assert_eq!(scene.shapes.iter().map(|shape| shape.instances.len()).collect::<Vec<_>>(), [2, 2]);
    let (normal, tangent) = (scene.mesh.normals[8], scene.mesh.tangents[8]);
    assert!((normal - Vec3::new(0.0, 3.0, 2.0).normalize()).length() < 1e-6, "{normal}");
    assert_eq!(tangent, Vec4::new(-1.0, 0.0, 0.0, -1.0));
    let local =
        scene.objects.local_at::<crate::lanes::SingleLane>(6_u32.into(), scene.mesh.positions[13].into());
    assert!((Vec3::from(local) - Vec3::X).length() < 1e-6);
}

#[test]
fn one_part_is_the_mesh_itself() {
    let mesh: Shared<TriangleMesh> = square().into();
    let mut assembly = Assembly::default();
    assembly.add(Part::new("sheet", mesh.clone())).expect("sound");
    let scene = build(&assembly).expect("a scene");
    assert!(Shared::is_same(&scene.mesh, &mesh) && scene.shapes.is_empty());
    // Written out, it is the same.
    let mut other = Assembly::default();
    other.add_material(Material::matte("unused", Vec3::X)).expect("a name");
    other.add(Part::new("sheet", mesh.clone())).expect("sound");
    let other = build(&other).expect("a scene");
    assert_eq!((&other.mesh.positions, &other.mesh.materials), (&mesh.positions, &vec![1, 1]));
}

#[test]
fn objects_without_a_material_are_of_their_colours_or_grey() {
    let mut assembly = Assembly::default();
    let coloured = |colour| TriangleMesh { colours: vec![colour; 4], ..square() };
    assembly.add(Part::new("grey", square())).expect("sound");
    assert_eq!(build(&assembly).expect("a scene").materials, [Material::fallback()]);
    assembly.add(Part::new("blue", coloured(Vec4::new(0.0, 0.0, 1.0, 1.0)))).expect("sound");
    let scene = build(&assembly).expect("a scene");
    assert_eq!(scene.materials, [Material::vertex_coloured()]);
    assert_eq!(scene.mesh.colours[0], Vec4::new(0.8, 0.8, 0.8, 1.0));
}

#[test]
fn mistakes_are_named() {
    let told = |assembly: &mut Assembly, part: Part| assembly.add(part).expect_err("refused").to_string();
    let mut assembly = Assembly::default();
    assembly.add(Part::new("a", square())).expect("sound");
    let a = &mut assembly;
    assert_eq!(
        told(a, Part::new("a", square())),
        r#"object "a": another object, or an instance, has this name; choose another"#
    );
    assert!(told(a, Part::new("", square())).contains("needs a name"));
    let mut broken = square();
    broken.positions[2].y = f32::NAN;
    assert!(told(a, Part::new("b", broken)).starts_with(r#"object "b": vertex 2 is at (1, NaN, 0)"#));
    let mut broken = square();
    broken.triangles[1][2] = 9;
    assert!(told(a, Part::new("b", broken)).contains("triangle 1 names vertex 9"));
    assert!(told(a, Part::new("b", TriangleMesh::default())).contains("has no triangles"));
    let pair = vec![DMat4::IDENTITY; 2];
    a.add(Part::new("c/0", square())).expect("a name of its own");
    assert!(told(a, Part { transforms: pair.clone(), ..Part::new("c", square()) }).contains("this name"));
    a.add(Part { transforms: pair, ..Part::new("d", square()) }).expect("two instances");
    assert!(told(a, Part::new("d/1", square())).contains("this name"));
    let flat = vec![DMat4::IDENTITY, DMat4::from_scale(DVec3::new(1.0, 0.0, 1.0))];
    assert!(
        told(a, Part { transforms: flat, ..Part::new("b", square()) })
            .contains("instance 1: the transform is singular")
    );
    assert!(told(a, Part { transforms: Vec::new(), ..Part::new("b", square()) }).contains("no transforms"));
    assert!(told(a, Part { material: Some(3), ..Part::new("b", square()) }).contains("names material 3"));
    let many = TriangleMesh::new(square().positions, vec![[0, 1, 2]; 1 << 20]);
    let transforms = vec![DMat4::IDENTITY; 1 << 8];
    assert!(told(a, Part { transforms, ..Part::new("b", many) }).contains("at most 268435455"));
    let image = TextureImage::of_bytes((1, 1), [[128_u8, 128, 255, 255]]).expect("a pixel");
    let texture = a.add_texture(image.texture("n", ColourSpace::Linear, [Wrap::Repeat; 2]));
    let place = TextureRef { set: 1, ..TextureRef::plain(texture) };
    let normal_map = Some(NormalMap { texture: place, scale: 1.0 });
    let bumpy = a.add_material(Material { normal_map, ..Material::matte("bumpy", Vec3::X) }).expect("a name");
    let plain = TriangleMesh { uvs: vec![Vec2::ZERO; 4], ..square() };
    let problem = told(a, Part { material: Some(bumpy), ..Part::new("b", plain.clone()) });
    assert!(
        problem.contains(r#"the normal texture of its material "bumpy" reads texture coordinates 1"#),
        "{problem}"
    );
    for name in ["bumpy", "default", ""] {
        assert!(a.add_material(Material::matte(name, Vec3::X)).is_err(), "{name}");
    }
    let rough = Scalar { texture: Some((place, Channel::G)), ..Scalar::constant(1.0) };
    let surface = Surface::OpenPbr(OpenPbr { specular_roughness: rough, ..OpenPbr::default() });
    let own = a.add_material(Material { surface, ..Material::matte("open", Vec3::X) }).expect("a name");
    let problem = told(a, Part { material: Some(own), ..Part::new("b", plain.clone()) });
    assert!(problem.contains("the specular-roughness texture of its material"), "{problem}");
    let more_uvs = vec![plain.uvs.clone()];
    a.add(Part { material: Some(bumpy), ..Part::new("b", TriangleMesh { more_uvs, ..plain }) })
        .expect("two sets");
    assert_eq!(build(a).expect("a scene").objects.len(), 5, "what was refused is not there");
    let far =
        vec![DMat4::from_translation(DVec3::splat(1e11)), DMat4::from_translation(DVec3::splat(9.0e10))];
    let mut huge = square();
    huge.positions[3].y = 2e10;
    a.add(Part { transforms: far, ..Part::new("far", huge) }).expect("sound by itself");
    let problem = build(a).expect_err("out of range").to_string();
    assert!(problem.starts_with(r#"object "far": instance 0, in the world: vertex 3"#), "{problem}");
    let memory = a.build(MemoryBudget::of_bytes(100)).expect_err("too little");
    assert!(matches!(memory, AssemblyError::Memory(_)), "{memory}");
}

#[test]
fn colours_of_vertices_multiply_every_base_colour() {
    let openpbr = Surface::OpenPbr(OpenPbr::default());
    let glossy = Surface::Principled(Principled::default());
    for (surface, name) in [(openpbr, "OpenPBR"), (glossy, "principled")] {
        let mut a = Assembly::default();
        let material = a.add_material(Material { surface, ..Material::matte("m", Vec3::X) });
        let mesh = TriangleMesh { colours: vec![Vec4::splat(0.5).with_w(1.0); 4], ..square() };
        a.add(Part { material: material.ok(), ..Part::new("a", mesh) }).expect("sound");
        let vertex = match &build(&a).expect("a scene").materials[0].surface {
            Surface::OpenPbr(surface) => surface.base_color.vertex,
            Surface::Principled(surface) => surface.base_colour.vertex,
            _ => false,
        };
        assert!(vertex, "{name}");
    }
}
