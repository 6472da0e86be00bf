//! MTL materials.

use crate::folder::{Folder, assert_holds, warns};
use glam::{Vec2, Vec3};
use raystream::lanes::Num;
use raystream::scene::{AlphaMode, Channel, ColourSpace, Material, Principled, Scalar, Scene, Surface, Wrap};

const OBJ: &str = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n";

/// The scene of one material `m` with these lines.
fn in_folder(folder: &Folder, lines: &str) -> Scene {
    folder.write("a.obj", OBJ);
    folder.write("a.mtl", format!("newmtl m\n{lines}\n"));
    folder.scene("a.obj")
}

fn scene(lines: &str) -> Scene {
    in_folder(&Folder::new(), lines)
}

fn material(lines: &str) -> Material {
    let scene = scene(lines);
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    scene.materials[0].clone()
}

fn principled(lines: &str) -> Principled {
    match material(lines).surface {
        Surface::Principled(principled) => principled,
        other => panic!("{other:?}"),
    }
}

fn matte(lines: &str) -> Vec3 {
    match material(lines).surface {
        Surface::Matte { reflectance } => reflectance.factor,
        other => panic!("{other:?}"),
    }
}

#[test]
fn without_gloss_materials_are_matte() {
    let kd = Vec3::new(0.1, 0.2, 0.3);
    for rest in
        ["", "illum 1", "illum 0", "illum 2", "illum 2\nKs 0 0 0\nNs 50", "illum 1\nKs 0 0 0", "Ka 1 1 1"]
    {
        assert_eq!(matte(&format!("Kd 0.1 0.2 0.3\n{rest}")), kd, "{rest}");
    }
    assert_eq!(matte("Kd 0.5"), Vec3::splat(0.5), "one number for all three");
    assert_eq!(matte(""), Vec3::splat(0.8));
}

#[test]
fn mirrors_are_of_ks() {
    for lines in [
        "illum 3\nKs 0.9 0.8 0.7",
        "illum 5\nKs 0.9 0.8 0.7\nKd 0 0 0",
        "illum 3\nPm 1\nPr 0\nNs 100000\nKs 0.9 0.8 0.7\nKd 0 0 0",
    ] {
        let Surface::Mirror { reflectance } = material(lines).surface else { panic!("{lines}") };
        assert_eq!(reflectance.factor, Vec3::new(0.9, 0.8, 0.7));
    }
    assert!(warns(&scene("illum 3\nKd 0.5 0.5 0.5\nKs 1 1 1"), &["\"m\"", "Kd is ignored"]));
}

#[test]
fn rough_mirrors_are_metal() {
    let metal = principled("illum 3\nPm 1\nPr 0.25\nKd 0 0 0\nKs 0.9 0.8 0.7");
    assert_eq!(
        (metal.base_colour.factor, metal.metallic.factor, metal.roughness.factor),
        (Vec3::new(0.9, 0.8, 0.7), 1.0, 0.25)
    );
    let gold = principled("illum 3\nPm 1\nPr 0.25\nKd 1 0.7 0.3\nKs 0.5 0.5 0.5");
    assert_eq!(gold.base_colour.factor, Vec3::new(1.0, 0.7, 0.3), "the PBR extension's base colour is Kd");
}

#[test]
fn glass_is_a_dielectric_that_pr_makes_rough() {
    for illum in [4, 6, 7] {
        let glass = material(&format!("illum {illum}\nKd 0 0 0\nKs 1 1 1\nNi 1.33\nTf 0.5 0.6 1\nd 0.2"));
        assert_eq!(glass.surface, Surface::Dielectric { ior: 1.33, transmittance: Vec3::new(0.5, 0.6, 1.0) });
        assert_eq!(glass.alpha.mode, AlphaMode::Opaque, "a body that refracts is all there");
    }
    assert_eq!(material("illum 7").surface, Surface::Dielectric { ior: 1.5, transmittance: Vec3::ONE });
    let frosted = principled("illum 7\nNi 1.3\nTf 0.5 1 1\nPr 0.4");
    assert_eq!(frosted, Principled::glass(1.3, Vec3::new(0.5, 1.0, 1.0), Scalar::constant(0.4)));
    assert!(warns(&scene("illum 7\nNi 0"), &["Ni is 0"]));
}

#[test]
fn a_coat_has_the_index_ni_and_the_roughness_pr_or_ns() {
    let coat = principled("illum 2\nKd 0.6 0.5 0.4\nKs 0.04 0.04 0.04\nNs 100000\nPr 0.316228\nNi 1.4");
    assert_eq!(coat.base_colour.factor, Vec3::new(0.6, 0.5, 0.4));
    assert_eq!((coat.ior, coat.roughness.factor, coat.metallic.factor), (1.4, 0.316228, 0.0));
    assert_eq!(
        (coat.specular.factor, coat.specular_colour.factor),
        (1.0, Vec3::ONE),
        "the index says it all"
    );
    // The Phong equal of roughness 0.316228 (alpha 0.1) is 198.
    let phong = principled("illum 2\nKd 0.6 0.5 0.4\nKs 0.04 0.04 0.04\nNs 198\nNi 1.5");
    assert!((phong.roughness.factor - 0.316_228).abs() < 1e-5);
    assert_eq!(matte("illum 2\nKs 0 0 0\nNi 1.5\nKd 0 0 1"), Vec3::Z, "a black Ks is no coat");
    assert_eq!(principled("illum 2\nKs 0 0 0\nNi 1.5\nPm 0.5").specular.factor, 0.0);
}

#[test]
fn classic_gloss_reflects_ks() {
    let gloss = principled("illum 2\nKd 0.2 0.2 0.2\nKs 0.08 0.04 0.02\nNs 198");
    assert!((gloss.specular_colour.factor * 0.04 - Vec3::new(0.08, 0.04, 0.02)).abs().max_element() < 1e-6);
    assert!((gloss.roughness.factor - 0.316_228).abs() < 1e-5);
    assert_eq!(principled("illum 2\nKs 1 1 1").roughness.factor, 1.0, "Ns 0 is not glossy");
}

#[test]
fn the_pbr_extension_is_honoured() {
    let all = principled("Kd 1 1 1\nPr 0.3\nPm 0.7\nPc 0.5\nPcr 0.1\nNi 1.6");
    assert_eq!((all.roughness.factor, all.metallic.factor, all.ior), (0.3, 0.7, 1.6));
    assert_eq!((all.clearcoat.factor, all.clearcoat_roughness.factor), (0.5, 0.1));
    assert!(all.sheen.is_none() && all.anisotropy.is_none());
    let felt = principled("Pr 0.6\nPs 0.5").sheen.expect("fibres");
    assert_eq!((felt.colour.factor, felt.roughness.factor), (Vec3::splat(0.5), 0.6));
    for lines in ["Pr 0.3\nPm 1\naniso 0.5\nanisor 0.25", "illum 3\nPr 0.3\nPm 1\naniso 0.5\nanisor 0.25"] {
        let grooves = principled(lines).anisotropy.expect("grooves");
        let quarter = std::f32::consts::FRAC_PI_2;
        assert_eq!((grooves.strength.factor, grooves.rotation), (0.5, quarter), "{lines}");
    }
    assert!(warns(&scene("illum 1\nPm 1"), &["Pm"]));
    assert!(warns(&scene("Pr 0.5\naniso 2"), &["aniso", "2"]));
}

#[test]
fn emitters_shine_on_both_sides() {
    let light = material("Kd 0 0 0\nKe 17 12 4\nillum 1").emission.expect("light");
    assert_eq!((light.radiance.factor, light.two_sided), (Vec3::new(17.0, 12.0, 4.0), true));
    assert_eq!(material("Ke 0 0 0").emission, None);
    let folder = Folder::new();
    folder.image("glow.png", 1, &[[255; 4]]);
    let light = in_folder(&folder, "map_Ke glow.png").materials[0].emission.expect("a map alone shines");
    assert_eq!((light.radiance.factor, light.radiance.texture.is_some()), (Vec3::ONE, true));
    assert!(warns(&in_folder(&folder, "Ke 0 0 0\nmap_Ke glow.png"), &["map_Ke has no effect"]));
    assert!(warns(&scene("Ke -1 0 0"), &["Ke is negative"]));
    let bright = image::Rgb32FImage::from_pixel(1, 1, image::Rgb([0.5, 0.25, 1.0]));
    image::DynamicImage::ImageRgb32F(bright).save(folder.path("glow.exr")).expect("an image");
    let glow = in_folder(&folder, "map_Ke glow.exr").textures[0].clone();
    assert_eq!((glow.space, glow.texels[0]), (ColourSpace::Linear, [128, 64, 255, 255]), "floats are linear");
}

#[test]
fn opacity_is_blended_and_masks_are_cut() {
    assert_eq!(material("d 1").alpha.mode, AlphaMode::Opaque);
    for lines in ["d 0.25", "Tr 0.75", "d -halo 0.25", "Tr 0\nd 0.25"] {
        let alpha = scene(lines).materials[0].alpha;
        assert_eq!((alpha.mode, alpha.value.factor), (AlphaMode::Blend, 0.25), "{lines}");
    }
    assert!(warns(&scene("d 0"), &["invisible"]));
    let folder = Folder::new();
    folder.image("grey.png", 1, &[[255, 255, 255, 255], [0, 0, 0, 255]]);
    folder.image("cut.png", 1, &[[9, 9, 9, 255], [9, 9, 9, 0]]);
    folder.image("solid.png", 1, &[[9, 9, 9, 255]]);
    let alpha = |lines| in_folder(&folder, lines).materials[0].alpha;
    let mask = AlphaMode::Mask { cutoff: 0.5 };
    let cases = [
        ("map_d grey.png", mask, Some(Channel::Luminance)),
        ("map_d cut.png", mask, Some(Channel::A)),
        ("map_d -imfchan r cut.png", mask, Some(Channel::R)),
        ("map_Kd cut.png", mask, Some(Channel::A)),
        ("map_Kd solid.png", AlphaMode::Opaque, None),
        ("map_Kd cut.png\nd 0.5", AlphaMode::Blend, Some(Channel::A)),
    ];
    for (lines, mode, channel) in cases {
        let alpha = alpha(lines);
        assert_eq!((alpha.mode, alpha.value.texture.map(|t| t.1)), (mode, channel), "{lines}");
    }
}

#[test]
fn textures_keep_their_options() {
    let folder = Folder::new();
    let red = [255, 0, 0, 255];
    let blue = [0, 0, 255, 255];
    folder.image("two rows.png", 1, &[red, blue]);
    let scene = in_folder(
        &folder,
        "Kd 0.5 0.5 0.5\nmap_Kd -clamp on -s 2 4 1 -o 0.25 0.5 -blendu on -mm 0 1 -texres 64 two rows.png",
    );
    let Surface::Matte { reflectance } = scene.materials[0].surface else { panic!("matte") };
    let texture = reflectance.texture.expect("a texture");
    assert_eq!(reflectance.factor, Vec3::splat(0.5), "multiplied by the map");
    assert_eq!((scene.textures[0].wrap_u, scene.textures[0].space), (Wrap::Clamp, ColourSpace::Srgb));
    assert_eq!((scene.textures[0].height, scene.textures[0].texels[0]), (2, red), "first row first");
    // (0.5, 0.125) in the file, v up, is (1.25, 1) in the image: its top edge; v = 0.875 in the mesh.
    let transformed: Vec2 = texture.transform([0.5, 1.0 - 0.125].map(Num::from)).map(Num::get).into();
    assert!((transformed - Vec2::new(1.25, 0.0)).length() < 1e-6, "{transformed}");
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    let scene = in_folder(&folder, "map_Kd -mm 0.5 2 -t 1 1 1 two rows.png\nmap_Ks two rows.png");
    assert!(warns(&scene, &["-mm"]) && warns(&scene, &["turbulence"]) && warns(&scene, &["\"map_Ks\""]));
    let scene = in_folder(&folder, "map_Kd -s 2 two rows.png");
    let Surface::Matte { reflectance } = scene.materials[0].surface else { panic!("matte") };
    assert_eq!(reflectance.texture.expect("a texture").scale, Vec2::new(2.0, 1.0));
}

#[test]
fn an_image_is_decoded_once_for_each_use() {
    let folder = Folder::new();
    folder.image("a.png", 1, &[[1, 2, 3, 255]]);
    folder.write("a.obj", OBJ);
    let mtl = "newmtl m\nmap_Kd a.png\nPr 1\nmap_Pr a.png\nmap_Pm a.png\nnewmtl n\nmap_Kd ./a.png\n";
    folder.write("a.mtl", mtl);
    let scene = folder.scene("a.obj");
    let spaces: Vec<ColourSpace> = scene.textures.iter().map(|t| t.space).collect();
    assert_eq!(spaces, [ColourSpace::Srgb, ColourSpace::Linear]);
    for texture in &scene.textures {
        assert_eq!(texture.texels[0], [1, 2, 3, 255]);
    }
}

#[test]
fn normal_maps_count_and_height_maps_do_not() {
    let folder = Folder::new();
    folder.image("normal.png", 2, &[[128, 128, 255, 255], [200, 128, 230, 255]]);
    folder.image("height.png", 2, &[[128, 128, 128, 255], [200, 200, 200, 255]]);
    for lines in ["norm -bm 0.5 normal.png", "map_Bump -bm 0.5 normal.png"] {
        let scene = in_folder(&folder, lines);
        let map = scene.materials[0].normal_map.expect("a normal map");
        assert_eq!((map.scale, scene.textures[0].space), (0.5, ColourSpace::Linear));
    }
    let scene = in_folder(&folder, "bump height.png");
    assert!(scene.materials[0].normal_map.is_none() && warns(&scene, &["map_Bump", "heights"]));
}

#[test]
fn bad_textures_name_texture_material_and_file() {
    let folder = Folder::new();
    folder.write("a.obj", OBJ);
    let message = |lines: &str| {
        folder.write("a.mtl", format!("newmtl m\n{lines}\n"));
        folder.message("a.obj")
    };
    assert_holds(&message("map_Kd lost.png"), &["a.mtl", "\"m\"", "lost.png", "cannot read"]);
    folder.write("noise.png", "this is no image");
    assert_holds(&message("map_d noise.png"), &["a.mtl", "\"m\"", "noise.png", "decoded"]);
    folder.write("noise", "this is no image");
    assert_holds(&message("map_Ke noise"), &["noise", "known kind"]);
    let whole = folder.image("whole.png", 8, &[[7, 80, 200, 255]; 64]);
    let bytes = std::fs::read(whole).expect("just written");
    folder.write("half.png", &bytes[..bytes.len() / 2]);
    assert_holds(&message("map_Kd half.png"), &["half.png", "decoded"]);
    assert_holds(&message("map_Kd"), &["line 2", "file name is missing"]);
    assert_holds(&message("map_Kd -wrong 1 a.png"), &["line 2", "-wrong"]);
    assert_holds(&message("map_Kd -imfchan q a.png"), &["line 2", "-imfchan q"]);
}

#[test]
fn absurd_images_are_refused_with_both_numbers() {
    // A TGA header: uncompressed, 65535 x 65535, 32 bits, no data.
    let mut header = [0_u8; 18];
    header[2] = 2;
    header[12..16].fill(255);
    header[16] = 32;
    let folder = Folder::new();
    folder.write("huge.tga", header);
    folder.write("a.obj", OBJ);
    folder.write("a.mtl", "newmtl m\nmap_Kd huge.tga\n");
    assert_holds(&folder.message("a.obj"), &["huge.tga", "65535 x 65535", "17179344900", "2147483648"]);
}

#[test]
fn bad_numbers_name_the_line_and_odd_ones_are_held() {
    let folder = Folder::new();
    folder.write("a.obj", OBJ);
    for (lines, parts) in [
        ("Kd 0.1 x 0.2", &["a.mtl", "line 2", "Kd", "\"x\""][..]),
        ("Kd 0.1 0.2", &["line 2", "3"]),
        ("Kd", &["line 2", "missing"]),
        ("Ns inf", &["line 2", "not finite"]),
        ("Kd 0 0 0\nNi nan", &["line 3", "not finite"]),
    ] {
        folder.write("a.mtl", format!("newmtl m\n{lines}\n"));
        assert_holds(&folder.message("a.obj"), parts);
    }
    folder.write("a.mtl", "Kd 1 1 1\n");
    assert_holds(&folder.message("a.obj"), &["line 1", "before the first newmtl"]);
    let scene = scene("Kd 1.5 -1 0.5\nd 7\nillum 77\nKs spectral a.rfl\nTf xyz 1 1 1");
    let Surface::Matte { reflectance } = scene.materials[0].surface else { panic!("matte") };
    assert_eq!(reflectance.factor, Vec3::new(1.0, 0.0, 0.5));
    assert!(warns(&scene, &["Kd", "1.5"]) && warns(&scene, &["illum 77"]) && warns(&scene, &["spectral"]));
}
