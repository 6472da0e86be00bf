//! MTL materials that name OpenPBR's parameters.

use crate::folder::{Folder, assert_holds, warns};
use glam::Vec3;
use raystream::scene::recipe::Recipe;
use raystream::scene::{AlphaMode, Channel, Material, OpenPbr, Scene, Surface};

const OBJ: &str = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n";

fn in_folder(folder: &Folder, lines: &str) -> Scene {
    folder.write("a.obj", OBJ);
    folder.write("a.mtl", format!("newmtl m\n{lines}\n"));
    folder.scene("a.obj")
}

/// The only material of a file without warnings.
fn material(lines: &str) -> Material {
    let scene = in_folder(&Folder::new(), lines);
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    scene.materials[0].clone()
}

fn openpbr(material: &Material) -> OpenPbr {
    let Surface::OpenPbr(surface) = material.surface else { panic!("{material:?}") };
    surface
}

/// The material of the recipe with the same parameters, its light on both sides as in MTL files.
fn of_recipe(fields: &str) -> Material {
    let text = format!(
        r#"{{ "materials": {{ "m": {{ "openpbr": {{ {fields} }} }} }},
              "shapes": [
                {{ "shape": "quad", "corner": [0, 0, 0], "u": [1, 0, 0], "v": [0, 1, 0], "material": "m" }}] }}"#
    );
    let scene = Recipe::parse(&text).and_then(|recipe| recipe.build()).expect("a scene");
    let mut material = scene.materials[0].clone();
    material.emission.iter_mut().for_each(|emission| emission.two_sided = true);
    material
}

/// Every parameter with a value that is not its default.
const ALL: [(&str, &str); 38] = [
    ("base_weight", "0.9"),
    ("base_color", "0.5 0.25 0.125"),
    ("base_diffuse_roughness", "0.3"),
    ("base_metalness", "0.2"),
    ("specular_weight", "0.7"),
    ("specular_color", "1 0.5 0.25"),
    ("specular_roughness", "0.4"),
    ("specular_roughness_anisotropy", "0.5"),
    ("specular_ior", "1.7"),
    ("transmission_weight", "0.5"),
    ("transmission_color", "0.5 0.9 0.8"),
    ("transmission_depth", "2"),
    ("transmission_scatter", "0.1 0.2 0.3"),
    ("transmission_scatter_anisotropy", "0.6"),
    ("transmission_dispersion_scale", "0.5"),
    ("transmission_dispersion_abbe_number", "40"),
    ("subsurface_weight", "0.6"),
    ("subsurface_color", "0.9 0.6 0.3"),
    ("subsurface_radius", "0.25"),
    ("subsurface_radius_scale", "1 0.75 0.5"),
    ("subsurface_scatter_anisotropy", "-0.25"),
    ("coat_weight", "0.75"),
    ("coat_color", "0.9 0.8 0.7"),
    ("coat_roughness", "0.1"),
    ("coat_roughness_anisotropy", "0.2"),
    ("coat_ior", "1.4"),
    ("coat_darkening", "0.5"),
    ("fuzz_weight", "0.25"),
    ("fuzz_color", "0.3 0.4 0.5"),
    ("fuzz_roughness", "0.7"),
    ("emission_luminance", "3"),
    ("emission_color", "1 0.5 2"),
    ("thin_film_weight", "0.5"),
    ("thin_film_thickness", "0.4"),
    ("thin_film_ior", "1.3"),
    ("geometry_opacity", "0.75"),
    ("geometry_thin_walled", "0"),
    ("color_space", "acescg"),
];

/// A value in the words of a recipe.
fn json(value: &str) -> String {
    match value {
        "acescg" => r#""acescg""#.into(),
        "0" => "false".into(),
        number if !number.contains(' ') => number.into(),
        colour => format!("[{}]", colour.replace(' ', ", ")),
    }
}

#[test]
fn all_parameters_have_the_names_of_the_specification() {
    let lines: Vec<String> = ALL.iter().map(|(name, value)| format!("openpbr_{name} {value}")).collect();
    let fields: Vec<String> =
        ALL.iter().map(|(name, value)| format!("\"{}\": {}", name.replace('_', "-"), json(value))).collect();
    let whole = material(&lines.join("\n"));
    assert_eq!(whole, of_recipe(&fields.join(", ")));
    assert!(whole.medium.is_some_and(|medium| medium.scatters()), "the medium is read");
    for ((name, value), line) in ALL.iter().zip(&lines) {
        // One that acts alone differs from the defaults; any is read as a recipe's.
        let field = format!("\"{}\": {}", name.replace('_', "-"), json(value));
        assert_eq!(material(line), of_recipe(&field), "{name}");
    }
    let thin = openpbr(&material("openpbr_geometry_thin_walled 1"));
    assert!(thin.thin_walled && openpbr(&material("openpbr_geometry_thin_walled true")).thin_walled);
}

#[test]
fn a_material_without_them_is_as_before() {
    for lines in ["Kd 0.2 0.3 0.4", "Pr 0.3\nPm 1", "illum 7"] {
        assert!(!matches!(material(lines).surface, Surface::OpenPbr(_)), "{lines}");
    }
    let folder = Folder::new();
    folder.write("a.obj", OBJ);
    folder.write("a.mtl", "newmtl m\nKd 0.5\nnewmtl n\nopenpbr_fuzz_weight 1\n");
    assert!(matches!(folder.scene("a.obj").materials[0].surface, Surface::Matte { .. }), "one of two");
}

#[test]
fn classic_numbers_are_for_other_readers_and_maps_multiply() {
    let classic = "Kd 0.1 0.2 0.3\nKs 1 1 1\nNs 90\nNi 1.9\nPr 0.9\nPm 1\nPc 1\nPs 1\naniso 1\nillum 7\n\
        d 0.5\nKe 1 1 1";
    let named = "openpbr_base_color 0.8 0.7 0.6\nopenpbr_geometry_opacity 0.25\nopenpbr_emission_luminance 2";
    assert_eq!(material(&format!("{classic}\n{named}")), material(named));
    assert_eq!(material(&format!("{named}\n{classic}")), material(named), "in any order");
    let folder = Folder::new();
    folder.image("map.png", 1, &[[200, 200, 200, 255]]);
    folder.image("normal.png", 2, &[[128, 128, 255, 255], [200, 128, 230, 255]]);
    let maps = "map_Kd map.png\nmap_Pr map.png\nmap_Pm map.png\nmap_Ke map.png\nmap_d map.png\nnorm -bm 0.5 normal.png";
    let scene =
        in_folder(&folder, &format!("{named}\n{maps}\nanisor 0.25\nopenpbr_specular_roughness_anisotropy 1"));
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    let (material, surface) = (&scene.materials[0], openpbr(&scene.materials[0]));
    assert_eq!(surface.base_color.factor, Vec3::new(0.8, 0.7, 0.6));
    assert!(surface.base_color.texture.is_some());
    let channel = |texture: Option<(_, Channel)>| texture.map(|(_, channel)| channel);
    assert_eq!(channel(surface.specular_roughness.texture), Some(Channel::Luminance));
    assert_eq!(channel(surface.base_metalness.texture), Some(Channel::Luminance));
    let grooves = surface.specular_anisotropy.expect("grooves");
    assert_eq!(grooves.rotation, std::f32::consts::FRAC_PI_2, "anisor turns the tangent");
    let light = material.emission.expect("light").radiance;
    assert_eq!((light.factor, light.texture.is_some()), (Vec3::splat(2.0), true));
    assert_eq!((material.alpha.mode, material.alpha.value.factor), (AlphaMode::Blend, 0.25));
    assert_eq!(channel(material.alpha.value.texture), Some(Channel::Luminance));
    assert_eq!(material.normal_map.expect("normals").scale, 0.5);
}

#[test]
fn classic_statements_without_a_counterpart_warn() {
    let scene = |lines: &str| in_folder(&Folder::new(), &format!("openpbr_fuzz_weight 1\n{lines}"));
    for (lines, parts) in [
        ("Kd 0.1 0.2 0.3", ["Kd is not read", "openpbr_base_color"]),
        ("Ke 4 4 4", ["Ke is not read", "openpbr_emission_luminance"]),
        ("Tr 0.5", ["d or Tr is not read", "openpbr_geometry_opacity"]),
        ("map_Ke a.png", ["map_Ke has no effect", "openpbr_emission_luminance"]),
        ("openpbr_geometry_opacity 0", ["invisible", "openpbr_geometry_opacity"]),
    ] {
        let scene = scene(lines);
        assert!(scene.warnings.len() == 1 && warns(&scene, &parts), "{:?}", scene.warnings);
    }
    let usual = scene("Ke 0 0 0\nd 1\nNi 1.45\nillum 2\nNs 250");
    assert!(usual.warnings.is_empty(), "{:?}", usual.warnings);
}

#[test]
fn errors_name_file_line_and_range() {
    let folder = Folder::new();
    folder.write("a.obj", OBJ);
    for (line, parts) in [
        ("openpbr_coat_weight 2", &["openpbr_coat_weight", "is 2", "0 to 1"][..]),
        ("openpbr_specular_ior nan", &["NaN", "0.1 to 10"]),
        ("openpbr_base_color 0.5 1.5 0", &["largest channel", "1.5"]),
        ("openpbr_base_color -0.5 0.5 0", &["least channel", "-0.5"]),
        ("openpbr_base_color 0.5", &["three numbers", "\"0.5\""]),
        ("openpbr_base_color 0.5 0.5 0.5 1", &["three numbers"]),
        ("openpbr_coat_weight 1 1 1", &["one number", "\"1 1 1\""]),
        ("openpbr_coat_weight", &["one number"]),
        ("openpbr_coat_weight much", &["\"much\" is not a number"]),
        ("openpbr_geometry_thin_walled 0.5", &["1 or 0", "0.5"]),
        ("openpbr_color_space cmyk", &["cmyk", "acescg"]),
        ("openpbr_coat_colour 1 1 1", &["no parameter of OpenPBR", "coat_color"]),
        ("openpbr_coat-weight 1", &["no parameter of OpenPBR"]),
        ("openpbr_ 1", &["no parameter of OpenPBR"]),
    ] {
        folder.write("a.mtl", format!("newmtl m\nKd 1 1 1\n{line}\n"));
        let message = folder.message("a.obj");
        assert_holds(&message, &["a.mtl", "line 3"]);
        assert_holds(&message, parts);
    }
}
