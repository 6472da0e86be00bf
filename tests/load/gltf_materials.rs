//! glTF materials and textures.

use crate::document::Document;
use crate::folder::{Folder, assert_holds, warns};
use glam::{Vec2, Vec3};
use raystream::scene::load::LoadOptions;
use raystream::scene::{
    AlphaMode, Channel, ColourSpace, Material, Principled, Scene, Surface, TextureRef, Wrap,
};
use serde_json::{Value, json};

fn scene(material: Value) -> Scene {
    let mut document = Document::triangle();
    document.material(material);
    document.scene()
}

fn material(json: Value) -> Material {
    let scene = scene(json);
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    scene.materials[0].clone()
}

fn principled(json: Value) -> Principled {
    match material(json).surface {
        Surface::Principled(principled) => principled,
        other => panic!("{other:?}"),
    }
}

#[test]
fn factors_and_their_defaults() {
    let plain = principled(json!({}));
    assert_eq!(
        (plain.base_colour.factor, plain.metallic.factor, plain.roughness.factor),
        (Vec3::ONE, 1.0, 1.0)
    );
    assert_eq!((plain.ior, plain.specular.factor, plain.transmission.factor), (1.5, 1.0, 0.0));
    assert!(plain.thin && plain.anisotropy.is_none() && plain.sheen.is_none() && plain.iridescence.is_none());
    let set = material(json!({ "name": "wall", "pbrMetallicRoughness": {
        "baseColorFactor": [0.1, 0.2, 0.3, 0.4], "metallicFactor": 0.5, "roughnessFactor": 0.25 } }));
    let Surface::Principled(p) = set.surface else { panic!("{set:?}") };
    assert_eq!(
        (p.base_colour.factor, p.metallic.factor, p.roughness.factor),
        (Vec3::new(0.1, 0.2, 0.3), 0.5, 0.25)
    );
    assert_eq!((set.name.as_str(), set.alpha.mode), ("wall", AlphaMode::Opaque));
    let held = scene(json!({ "pbrMetallicRoughness": {
            "baseColorFactor": [2.0, 0.0, -1.0, 1.0], "metallicFactor": 7.0 } }));
    let Surface::Principled(p) = held.materials[0].surface else { panic!("{held:?}") };
    assert_eq!((p.base_colour.factor, p.metallic.factor), (Vec3::X, 1.0));
    assert!(warns(&held, &["baseColorFactor", "2"]) && warns(&held, &["metallicFactor", "7"]));
}

#[test]
fn extensions_of_the_surface() {
    let extension = |name: &str, value: Value| principled(json!({ "extensions": { name: value } }));
    assert_eq!(extension("KHR_materials_ior", json!({ "ior": 1.33 })).ior, 1.33);
    let everywhere = extension("KHR_materials_ior", json!({ "ior": 0.0 }));
    assert_eq!(everywhere.specular_colour.factor * 0.04, Vec3::ONE, "reflects all at every angle");
    let specular = extension(
        "KHR_materials_specular",
        json!({ "specularFactor": 0.5, "specularColorFactor": [1.0, 2.0, 3.0] }),
    );
    assert_eq!((specular.specular.factor, specular.specular_colour.factor), (0.5, Vec3::new(1.0, 2.0, 3.0)));
    let coat = extension(
        "KHR_materials_clearcoat",
        json!({ "clearcoatFactor": 0.75, "clearcoatRoughnessFactor": 0.25 }),
    );
    assert_eq!((coat.clearcoat.factor, coat.clearcoat_roughness.factor), (0.75, 0.25));
    assert_eq!((coat.coat_normal_map, coat.coats.len()), (None, 0));
    let glass = |volume: Value| {
        let transmission = json!({ "transmissionFactor": 0.9 });
        principled(json!({ "extensions": {
            "KHR_materials_transmission": transmission, "KHR_materials_volume": volume } }))
    };
    let wall = glass(json!({ "thicknessFactor": 0.0 }));
    assert_eq!((wall.transmission.factor, wall.thin), (0.9, true));
    assert!(!glass(json!({ "thicknessFactor": 0.1 })).thin);
    let odd = scene(json!({ "extensions": { "KHR_materials_ior": { "ior": 0.5 } } }));
    assert!(warns(&odd, &["ior is 0.5"]));
}

#[test]
fn volumes_absorb() {
    let filled = |volume: Value| material(json!({ "extensions": { "KHR_materials_volume": volume } })).medium;
    let colour = [1.0, 0.5, 0.25];
    let ink = json!({ "thicknessFactor": 1.0, "attenuationDistance": 2.0, "attenuationColor": colour });
    let absorption = filled(ink.clone()).expect("a medium").absorption;
    let expected = Vec3::new(0.0, 0.5 * 0.5_f32.ln(), 0.5 * 0.25_f32.ln());
    assert!((absorption + expected).abs().max_element() < 1e-6, "{absorption}");
    let with = |key: &str, value: Value| {
        let mut other = ink.clone();
        other[key] = value;
        other
    };
    assert_eq!(filled(with("thicknessFactor", json!(0.0))), None, "a thin wall holds nothing");
    assert_eq!(filled(with("attenuationColor", json!([1.0, 1.0, 1.0]))), None);
    assert_eq!(
        filled(json!({ "thicknessFactor": 1.0, "attenuationColor": colour })),
        None,
        "endless distance"
    );
    let odd = |key: &str, value: Value| {
        scene(json!({ "extensions": { "KHR_materials_volume": with(key, value) } }))
    };
    assert!(warns(&odd("attenuationDistance", json!(-1.0)), &["attenuationDistance is -1"]));
    assert!(warns(&odd("attenuationColor", json!([2.0, 1.0, 0.5])), &["attenuationColor", "2"]));
}

#[test]
fn grooves_fibres_and_films() {
    let grooves = json!({ "anisotropyStrength": 0.6, "anisotropyRotation": 1.57 });
    let grooves = principled(json!({ "extensions": { "KHR_materials_anisotropy": grooves } }));
    let grooves = grooves.anisotropy.expect("grooves");
    assert_eq!((grooves.strength.factor, grooves.rotation, grooves.direction), (0.6, 1.57, None));
    let fibres = json!({ "sheenColorFactor": [0.9, 0.8, 0.7], "sheenRoughnessFactor": 0.3 });
    let fibres =
        principled(json!({ "extensions": { "KHR_materials_sheen": fibres } })).sheen.expect("fibres");
    assert_eq!((fibres.colour.factor, fibres.roughness.factor), (Vec3::new(0.9, 0.8, 0.7), 0.3));
    let film = |film: Value| {
        principled(json!({ "extensions": { "KHR_materials_iridescence": film } }))
            .iridescence
            .expect("a film")
    };
    let plain = film(json!({ "iridescenceFactor": 0.5 }));
    assert_eq!((plain.strength.factor, plain.ior, plain.thickness_nm), (0.5, 1.3, [100.0, 400.0]));
    let thick = film(json!({ "iridescenceFactor": 1.0, "iridescenceIor": 1.8,
        "iridescenceThicknessMinimum": 200.0, "iridescenceThicknessMaximum": 800.0 }));
    assert_eq!((thick.ior, thick.thickness_nm, thick.thickness_texture), (1.8, [200.0, 800.0], None));
    let none = principled(json!({ "extensions": {
        "KHR_materials_anisotropy": { "anisotropyRotation": 1.0 },
        "KHR_materials_sheen": { "sheenRoughnessFactor": 1.0 },
        "KHR_materials_iridescence": { "iridescenceThicknessMaximum": 800.0 } } }));
    assert!(none.anisotropy.is_none() && none.sheen.is_none() && none.iridescence.is_none(), "{none:?}");
    let odd = scene(json!({ "extensions": {
        "KHR_materials_anisotropy": { "anisotropyStrength": 3.0 },
        "KHR_materials_sheen": { "sheenColorFactor": [2.0, 0.0, 0.0] },
        "KHR_materials_iridescence": { "iridescenceFactor": 1.0, "iridescenceIor": 0.5,
            "iridescenceThicknessMaximum": -1.0 } } }));
    for parts in [
        ["anisotropyStrength", "3"],
        ["sheenColorFactor", "2"],
        ["iridescenceIor", "0.5"],
        ["thickness", "-1"],
    ] {
        assert!(warns(&odd, &parts), "{parts:?}: {:?}", odd.warnings);
    }
    // What lies on a surface without reflection of its own is there all the same.
    let felt = principled(json!({ "pbrMetallicRoughness": { "metallicFactor": 0.0 }, "extensions": {
        "KHR_materials_specular": { "specularFactor": 0.0 },
        "KHR_materials_sheen": { "sheenColorFactor": [0.5, 0.5, 0.5] } } }));
    assert!(felt.sheen.is_some());
}

#[test]
fn textures_of_extensions_must_exist() {
    for (extension, key) in [
        ("KHR_materials_anisotropy", "anisotropyTexture"),
        ("KHR_materials_sheen", "sheenColorTexture"),
        ("KHR_materials_iridescence", "iridescenceThicknessTexture"),
    ] {
        let mut document = Document::triangle();
        document.material(json!({ "name": "m", "extensions": { extension: { key: { "index": 7 } } } }));
        assert_holds(&document.message(), &["\"m\"", extension, "texture 7"]);
    }
}

#[test]
fn without_specular_reflection_or_light_of_its_own_a_surface_is_matte() {
    let dull = json!({ "KHR_materials_specular": { "specularFactor": 0.0 } });
    let pbr = json!({ "metallicFactor": 0.0, "baseColorFactor": [0.5, 0.5, 0.5, 1.0] });
    let is_matte = |json: Value| matches!(material(json).surface, Surface::Matte { .. });
    assert!(is_matte(json!({ "pbrMetallicRoughness": pbr, "extensions": dull })));
    assert!(!is_matte(json!({ "pbrMetallicRoughness": pbr })));
    assert!(!is_matte(json!({ "extensions": dull })), "metal");
    let mut coated = dull.clone();
    coated["KHR_materials_clearcoat"] = json!({ "clearcoatFactor": 1.0 });
    assert!(!is_matte(json!({ "pbrMetallicRoughness": pbr, "extensions": coated })));
    let unlit = scene(json!({ "extensions": { "KHR_materials_unlit": {} } }));
    assert!(matches!(unlit.materials[0].surface, Surface::Matte { .. }) && unlit.warnings.is_empty());
}

#[test]
fn emission_is_factor_times_strength_and_one_sided_unless_doubled() {
    let light = material(json!({ "emissiveFactor": [1.0, 0.5, 0.25], "doubleSided": true,
        "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 16.0 } } }));
    let light = light.emission.expect("light");
    assert_eq!((light.radiance.factor, light.two_sided), (Vec3::new(16.0, 8.0, 4.0), true));
    let light = material(json!({ "emissiveFactor": [1.0, 1.0, 1.0] })).emission.expect("light");
    assert_eq!((light.radiance.factor, light.two_sided), (Vec3::ONE, false));
    assert_eq!(material(json!({ "emissiveFactor": [0.0, 0.0, 0.0] })).emission, None);
}

#[test]
fn alpha_modes() {
    let alpha = |mode: &str| {
        let mut document = Document::triangle();
        let texture = document.texture(1, &[[1, 2, 3, 4]]);
        document.material(json!({ "alphaMode": mode, "alphaCutoff": 0.25, "pbrMetallicRoughness": {
            "baseColorFactor": [1.0, 1.0, 1.0, 0.75], "baseColorTexture": { "index": texture } } }));
        document.scene().materials[0].alpha
    };
    assert_eq!(alpha("OPAQUE").mode, AlphaMode::Opaque);
    let mask = alpha("MASK");
    assert_eq!((mask.mode, mask.value.factor), (AlphaMode::Mask { cutoff: 0.25 }, 0.75));
    assert_eq!(mask.value.texture.expect("a texture").1, Channel::A);
    assert_eq!(alpha("BLEND").mode, AlphaMode::Blend);
    let faint = |mode: &str, alpha: f32| {
        let colour = [1.0, 1.0, 1.0, alpha];
        let mode = json!({ "alphaMode": mode, "pbrMetallicRoughness": { "baseColorFactor": colour } });
        material(mode).alpha.mode
    };
    assert_eq!(faint("MASK", 0.25), AlphaMode::Mask { cutoff: 0.5 });
    assert_eq!(faint("BLEND", 0.75), AlphaMode::Blend);
    assert_eq!([faint("MASK", 0.5), faint("BLEND", 1.0)], [AlphaMode::Opaque; 2], "there everywhere");
}

#[test]
fn every_texture_has_its_channel_and_colour_space() {
    let mut document = Document::triangle();
    let texture = document.texture(2, &[[10, 20, 30, 255], [1, 2, 3, 4]]);
    let info = json!({ "index": texture });
    document.material(json!({
        "emissiveFactor": [1.0, 1.0, 1.0], "emissiveTexture": info, "occlusionTexture": info,
        "normalTexture": { "index": texture, "scale": 0.5 },
        "pbrMetallicRoughness": { "baseColorTexture": info, "metallicRoughnessTexture": info },
        "extensions": {
            "KHR_materials_transmission": { "transmissionFactor": 1.0, "transmissionTexture": info },
            "KHR_materials_clearcoat": { "clearcoatFactor": 1.0, "clearcoatTexture": info,
                "clearcoatRoughnessFactor": 1.0, "clearcoatRoughnessTexture": info,
                "clearcoatNormalTexture": { "index": texture, "scale": 0.25 } },
            "KHR_materials_specular": { "specularTexture": info, "specularColorTexture": info },
            "KHR_materials_anisotropy": { "anisotropyStrength": 1.0, "anisotropyTexture": info },
            "KHR_materials_sheen": { "sheenColorFactor": [1.0, 1.0, 1.0], "sheenColorTexture": info,
                "sheenRoughnessFactor": 1.0, "sheenRoughnessTexture": info },
            "KHR_materials_iridescence": { "iridescenceFactor": 1.0, "iridescenceTexture": info,
                "iridescenceThicknessTexture": info }
        }
    }));
    let scene = document.scene();
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    let Surface::Principled(p) = scene.materials[0].surface else { panic!("principled") };
    let space =
        |texture: Option<TextureRef>| scene.textures[texture.expect("a texture").texture as usize].space;
    let channels = [p.metallic, p.roughness, p.transmission, p.clearcoat, p.clearcoat_roughness]
        .map(|scalar| (scalar.texture.expect("a texture").1, space(scalar.texture.map(|t| t.0))));
    let linear = |channel| (channel, ColourSpace::Linear);
    assert_eq!(channels, [Channel::B, Channel::G, Channel::R, Channel::R, Channel::G].map(linear));
    let (grooves, fibres, film) =
        (p.anisotropy.expect("grooves"), p.sheen.expect("fibres"), p.iridescence.expect("a film"));
    let layers = [
        p.specular.texture,
        grooves.strength.texture,
        fibres.roughness.texture,
        film.strength.texture,
        film.thickness_texture,
    ]
    .map(|texture| (texture.expect("a texture").1, space(texture.map(|t| t.0))));
    assert_eq!(layers, [Channel::A, Channel::B, Channel::A, Channel::R, Channel::G].map(linear));
    assert_eq!(space(grooves.direction), ColourSpace::Linear);
    let emission = scene.materials[0].emission.expect("light");
    let colours =
        [p.base_colour.texture, emission.radiance.texture, p.specular_colour.texture, fibres.colour.texture];
    assert_eq!(colours.map(space), [ColourSpace::Srgb; 4]);
    let normal = scene.materials[0].normal_map.expect("a normal map");
    assert_eq!((space(Some(normal.texture)), normal.scale), (ColourSpace::Linear, 0.5));
    let coat = p.coat_normal_map.expect("another");
    assert_eq!((coat.texture, coat.scale), (normal.texture, 0.25));
    assert_eq!(scene.textures.len(), 2, "one image in two colour spaces");
    for texture in &scene.textures {
        assert_eq!(texture.texels[..2], [[10, 20, 30, 255], [1, 2, 3, 4]], "and its smaller copy");
    }
}

#[test]
fn samplers_wrap_and_transforms_are_kept() {
    let mut document = Document::triangle();
    let texture = document.texture(1, &[[1, 2, 3, 255]]);
    document.add("samplers", json!({ "wrapS": 33071, "wrapT": 33648 }));
    document.json["textures"][texture]["sampler"] = json!(0);
    let other = document.add("textures", json!({ "source": 0 }));
    let transform =
        json!({ "KHR_texture_transform": { "offset": [0.5, 0.25], "rotation": 1.5, "scale": [2.0, 3.0] } });
    document.material(json!({
        "emissiveFactor": [1.0, 1.0, 1.0], "emissiveTexture": { "index": other },
        "normalTexture": { "index": texture, "extensions": transform },
        "pbrMetallicRoughness": { "baseColorTexture": { "index": texture, "extensions": transform } }
    }));
    let scene = document.scene();
    let Surface::Principled(p) = scene.materials[0].surface else { panic!("principled") };
    for used in
        [p.base_colour.texture.expect("a texture"), scene.materials[0].normal_map.expect("a map").texture]
    {
        let texture = &scene.textures[used.texture as usize];
        assert_eq!((texture.wrap_u, texture.wrap_v), (Wrap::Clamp, Wrap::Mirror));
        assert_eq!(
            (used.offset, used.rotation, used.scale),
            (Vec2::new(0.5, 0.25), 1.5, Vec2::new(2.0, 3.0))
        );
    }
    let plain = scene.materials[0].emission.expect("light").radiance.texture.expect("a texture");
    assert_eq!(plain, TextureRef::plain(plain.texture));
    assert_eq!(scene.textures[plain.texture as usize].wrap_u, Wrap::Repeat);
}

#[test]
fn every_texture_has_its_own_set_of_coordinates() {
    let mut document = Document::triangle();
    let sets = [0.1, 0.2, 0.3].map(|value| document.floats("VEC2", &[value; 6]));
    let attributes = &mut document.json["meshes"][0]["primitives"][0]["attributes"];
    for (set, accessor) in sets.into_iter().enumerate() {
        attributes[format!("TEXCOORD_{set}")] = json!(accessor);
    }
    let texture = document.texture(1, &[[1, 2, 3, 255]]);
    document.material(json!({ "name": "wall", "pbrMetallicRoughness": {
        "baseColorTexture": { "index": texture, "texCoord": 1 } } }));
    let scene = document.scene();
    assert_eq!((scene.mesh.uvs[0], scene.warnings.len()), (Vec2::splat(0.2), 0));
    assert!(scene.mesh.more_uvs.is_empty(), "sets that no texture uses take no memory");
    // The transform's set counts, if it has one.
    let moved = json!({ "KHR_texture_transform": { "texCoord": 2 } });
    let wall = &mut document.json["materials"][0];
    wall["normalTexture"] = json!({ "index": texture });
    wall["emissiveTexture"] = json!({ "index": texture, "texCoord": 1, "extensions": moved });
    wall["emissiveFactor"] = json!([1.0, 1.0, 1.0]);
    let scene = document.scene();
    assert!(scene.warnings.is_empty() && scene.validate().is_ok());
    let material = &scene.materials[0];
    let Surface::Principled(surface) = &material.surface else { panic!("{:?}", material.surface) };
    let emitted = material.emission.expect("light").radiance.texture;
    for (texture, value) in [
        (surface.base_colour.texture, 0.2),
        (material.normal_map.map(|map| map.texture), 0.1),
        (emitted, 0.3),
    ] {
        let uvs = scene.mesh.uv_set(texture.expect("a texture").set);
        assert_eq!(uvs, [Vec2::splat(value); 3]);
    }
    document.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] = json!(5);
    let scene = document.scene();
    assert_eq!(scene.mesh.uvs[0], Vec2::splat(0.1));
    assert!(warns(&scene, &["no TEXCOORD_5"]));
}

#[test]
fn meshes_without_a_second_set_have_zeros_beside_those_with_one() {
    let mut document = Document::triangle();
    let texture = document.texture(1, &[[1, 2, 3, 255]]);
    document.material(json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": texture } },
        "normalTexture": { "index": texture, "texCoord": 1 } }));
    let second = document.floats("VEC2", &[0.2; 6]);
    // Without the first set, and after a mesh that has neither.
    document.mesh(json!({ "attributes": { "POSITION": 0, "TEXCOORD_1": second }, "material": 0 }));
    document.node(json!({ "mesh": 1 }));
    document.node(json!({ "mesh": 0 }));
    let scene = document.scene();
    let (zero, there) = ([Vec2::ZERO; 3], [Vec2::splat(0.2); 3]);
    assert_eq!(scene.mesh.uv_set(1), [zero, there, zero].concat());
    assert_eq!(scene.mesh.uvs, [zero; 3].concat());
    assert!(scene.validate().is_ok());
}

#[test]
fn specular_reflection_and_glossiness_replace_metal_and_roughness() {
    let gold = principled(json!({ "pbrMetallicRoughness": { "baseColorFactor": [0.0, 1.0, 0.0, 1.0] },
        "extensions": { "KHR_materials_pbrSpecularGlossiness": { "diffuseFactor": [0.1, 0.2, 0.3, 1.0],
            "specularFactor": [1.0, 0.766, 0.336], "glossinessFactor": 0.75 } } }));
    assert_eq!((gold.base_colour.factor, gold.metallic.factor), (Vec3::new(0.1, 0.2, 0.3), 0.0));
    assert_eq!((gold.ior, gold.specular.factor), (1.5, 1.0));
    let reflected = gold.specular_colour.factor * 0.04;
    assert!((reflected - Vec3::new(1.0, 0.766, 0.336)).abs().max_element() < 1e-6, "{reflected}");
    assert_eq!(gold.glossiness.expect("a glossiness").factor, 0.75);
    let plain = principled(json!({ "extensions": { "KHR_materials_pbrSpecularGlossiness": {} } }));
    assert_eq!((plain.base_colour.factor, plain.specular_colour.factor * 0.04), (Vec3::ONE, Vec3::ONE));
    assert_eq!(plain.glossiness.expect("the default").factor, 1.0);
    let both =
        scene(json!({ "extensions": { "KHR_materials_pbrSpecularGlossiness": { "glossinessFactor": 2.0 },
        "KHR_materials_transmission": { "transmissionFactor": 1.0 } } }));
    assert!(
        warns(&both, &["glossinessFactor is 2"])
            && warns(&both, &["KHR_materials_transmission has no effect"])
    );
}

#[test]
fn textures_of_specular_reflection_and_glossiness_have_colour_in_srgb_and_linear_alpha() {
    let mut document = Document::triangle();
    let diffuse = document.texture(1, &[[1, 2, 3, 77]]);
    let specular = document.texture(1, &[[200, 100, 50, 128]]);
    document.material(json!({ "alphaMode": "BLEND", "extensions": { "KHR_materials_pbrSpecularGlossiness": {
        "diffuseTexture": { "index": diffuse }, "diffuseFactor": [1.0, 1.0, 1.0, 0.5],
        "specularGlossinessTexture": { "index": specular } } } }));
    let scene = document.scene();
    let Surface::Principled(surface) = &scene.materials[0].surface else { panic!("{scene:?}") };
    let used = surface.specular_colour.texture.expect("a texture");
    assert_eq!(scene.textures[used.texture as usize].texels[0], [200, 100, 50, 128]);
    assert_eq!(scene.textures[used.texture as usize].space, ColourSpace::Srgb);
    let glossiness = surface.glossiness.expect("a glossiness");
    assert_eq!(glossiness.texture, Some((used, Channel::A)));
    let alpha = scene.materials[0].alpha;
    assert_eq!((alpha.mode, alpha.value.factor), (AlphaMode::Blend, 0.5));
    assert_eq!(alpha.value.texture.map(|(texture, _)| texture), surface.base_colour.texture);
}

#[test]
fn diffuse_transmission_and_its_textures() {
    let mut document = Document::triangle();
    let texture = document.texture(1, &[[1, 2, 3, 77]]);
    document.material(json!({ "extensions": { "KHR_materials_diffuse_transmission": {
        "diffuseTransmissionFactor": 0.25, "diffuseTransmissionTexture": { "index": texture },
        "diffuseTransmissionColorFactor": [1.0, 0.5, 0.25], "diffuseTransmissionColorTexture": { "index": texture } },
        "KHR_materials_specular": { "specularFactor": 0.0 } },
        "pbrMetallicRoughness": { "metallicFactor": 0.0 } }));
    let scene = document.scene();
    let Surface::Principled(surface) = &scene.materials[0].surface else { panic!("{scene:?}") };
    let leaf = surface.diffuse_transmission.expect("it transmits");
    let space = |texture: TextureRef| scene.textures[texture.texture as usize].space;
    let (share, channel) = leaf.share.texture.expect("a texture");
    assert_eq!((leaf.share.factor, space(share), channel), (0.25, ColourSpace::Linear, Channel::A));
    assert_eq!(leaf.colour.factor, Vec3::new(1.0, 0.5, 0.25));
    assert_eq!(leaf.colour.texture.map(space), Some(ColourSpace::Srgb));
    let none = principled(json!({ "extensions": { "KHR_materials_diffuse_transmission": {} } }));
    assert_eq!(none.diffuse_transmission, None);
}

#[test]
fn dispersion_needs_a_body_that_transmits() {
    let material = |thickness: f32| {
        json!({ "extensions": { "KHR_materials_dispersion": { "dispersion": 0.36 },
            "KHR_materials_transmission": { "transmissionFactor": 1.0 },
            "KHR_materials_volume": { "thicknessFactor": thickness } } })
    };
    let body = principled(material(1.0));
    assert!(body.dispersion == 0.36 && body.is_dispersive());
    assert!(warns(&scene(material(0.0)), &["KHR_materials_dispersion has no effect"]));
    let below = scene(json!({ "extensions": { "KHR_materials_dispersion": { "dispersion": -1.0 } } }));
    assert!(warns(&below, &["dispersion is -1"]));
}

#[test]
fn images_may_be_files_or_data_uris() {
    let folder = Folder::new();
    folder.image("blue sky.png", 1, &[[0, 0, 255, 255]]);
    let mut document = Document::triangle();
    document.add("images", json!({ "uri": "blue%20sky.png" }));
    document.add("textures", json!({ "source": 0 }));
    document.material(json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }));
    folder.write("a.glb", document.glb());
    assert_eq!(folder.scene("a.glb").textures[0].texels[0], [0, 0, 255, 255]);
    // A 1 x 1 BMP, which the decoder tells by its first bytes.
    let bmp = "data:image/bmp;base64,Qk06AAAAAAAAADYAAAAoAAAAAQAAAAEAAAAB\
               ABgAAAAAAAQAAAAAAAAAAAAAAAAAAAAAAAAAAID/AA==";
    document.json["images"][0]["uri"] = json!(bmp);
    assert_eq!(document.scene().textures[0].texels[0], [255, 128, 0, 255]);
}

#[test]
fn all_materials_are_kept_and_the_fallback_comes_last() {
    let mut document = Document::triangle();
    document.add("materials", json!({ "name": "unused" }));
    document.material(json!({}));
    let primitive = document.json["meshes"][0]["primitives"][0].clone();
    let bare = json!({ "attributes": primitive["attributes"] });
    document.json["meshes"][0]["primitives"] = json!([bare, primitive]);
    let scene = document.scene();
    let names: Vec<&str> = scene.materials.iter().map(|m| m.name.as_str()).collect();
    assert_eq!((names, &scene.mesh.materials[..]), (vec!["unused", "material 1", "default"], &[2, 1][..]));
}

#[test]
fn extras_ask_for_surfaces_of_user_code() {
    let asks = scene(json!({ "name": "door", "extras": { "other": [1], "raystream": {
        "surface": "wood", "options": { "rings": 12, "tint": [1, 0.5] } } } }));
    let [request] = &asks.surface_requests[..] else { panic!("one request") };
    assert_eq!((request.material, &*request.surface), (0, "wood"));
    let options: Vec<_> = request.options.iter().map(|(key, value)| (&**key, &**value)).collect();
    assert_eq!(options, [("rings", "12"), ("tint", "1,0.5")]);
    for others in [json!("text"), json!({ "name": 3 }), json!(null)] {
        let plain = scene(json!({ "extras": others }));
        assert!(plain.surface_requests.is_empty() && plain.warnings.is_empty(), "{:?}", plain.warnings);
    }
    let wrong = scene(json!({ "name": "door", "extras": { "raystream": { "surfce": "wood" } } }));
    assert!(wrong.surface_requests.is_empty());
    assert!(warns(&wrong, &["door", "extras.raystream", "surfce"]), "{:?}", wrong.warnings);
}

#[test]
fn shaders_have_all_sets_of_texture_coordinates() {
    let mut document = Document::triangle();
    let texture = document.texture(1, &[[1, 2, 3, 255]]);
    for set in 0..6 {
        let uvs = document.floats("VEC2", &[set as f32 + 1.0; 6]);
        document.json["meshes"][0]["primitives"][0]["attributes"][format!("TEXCOORD_{set}")] = json!(uvs);
    }
    let textured =
        json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": texture, "texCoord": 2 } } });
    document.material(textured.clone());
    let sets = |scene: &Scene| {
        assert!(scene.validate().is_ok() && scene.warnings.is_empty(), "{:?}", scene.warnings);
        let all = [0, 1, 2, 3, 4].map(|set| scene.mesh.uv_set(set).first().map(|uv| uv.x));
        all.into_iter().flatten().collect::<Vec<f32>>()
    };
    assert_eq!(sets(&document.scene()), [3.0], "what the texture uses");
    let all = LoadOptions::default().with_all_uv_sets(true);
    assert_eq!(sets(&document.scene_with(&all)), [3.0, 1.0, 2.0, 4.0], "the texture's first");
    document.json["materials"][0]["extras"] = json!({ "raystream": { "surface": "wood" } });
    assert_eq!(sets(&document.scene()), [3.0, 1.0, 2.0, 4.0]);
    // Sets that no texture uses cannot make a file an error.
    let few = document.floats("VEC2", &[0.0; 4]);
    document.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] = json!(few);
    assert_eq!(sets(&document.scene()), [3.0, 1.0, 4.0]);
    let plain = &mut document.json["meshes"][0]["primitives"][0];
    plain.as_object_mut().expect("a primitive").remove("material");
    assert_eq!(sets(&document.scene()), [1.0]);
    assert_eq!(sets(&document.scene_with(&all)), [1.0, 3.0, 4.0]);
}

#[test]
fn attributes_of_the_files_own_have_their_names_and_numbers() {
    let mut document = Document::triangle();
    let wetness = document.floats("SCALAR", &[0.25, f32::NAN, 0.75]);
    let flow = document.floats("VEC3", &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]);
    let attributes = |document: &mut Document, name: &str, accessor| {
        document.json["meshes"][0]["primitives"][0]["attributes"][name] = json!(accessor);
    };
    attributes(&mut document, "_WETNESS", wetness);
    attributes(&mut document, "_Flow", flow);
    let scene = document.scene();
    assert!(scene.validate().is_ok() && scene.warnings.is_empty(), "{:?}", scene.warnings);
    let found = |scene: &Scene, name: &str| {
        scene.mesh.attribute(name).map(|attribute| (attribute.width, attribute.values.clone()))
    };
    assert_eq!(found(&scene, "wetness"), Some((1, vec![0.25, 0.0, 0.75])), "what is not finite is 0");
    assert_eq!(found(&scene, "flow"), Some((3, (1..10).map(|x| x as f32).collect())));
    assert_eq!(found(&scene, "_WETNESS"), None);
    let plain = Document::triangle().scene();
    assert_eq!(plain.fingerprint(), scene.fingerprint(), "no surface reads them");

    // A second mesh has neither, and another width of one.
    let mut both = document.json["meshes"][0].clone();
    let other = document.floats("VEC2", &[1.0; 6]);
    let primitive = &mut both["primitives"][0]["attributes"];
    primitive.as_object_mut().expect("attributes").remove("_WETNESS");
    primitive["_Flow"] = json!(other);
    document.json["meshes"].as_array_mut().expect("meshes").push(both);
    document.json["nodes"].as_array_mut().expect("nodes").push(json!({ "mesh": 1 }));
    let scene = document.scene();
    assert!(warns(&scene, &["_Flow", "3 numbers", "2 in another"]), "{:?}", scene.warnings);
    assert_eq!(found(&scene, "wetness"), Some((1, vec![0.25, 0.0, 0.75, 0.0, 0.0, 0.0])));
    assert_eq!(found(&scene, "flow").map(|(_, values)| values[9..] == [0.0; 9]), Some(true));

    let few = document.floats("SCALAR", &[1.0; 2]);
    attributes(&mut document, "_WETNESS", few);
    let error = document.message();
    assert!(error.contains("2 elements of _WETNESS for 3 of POSITION"), "{error}");
}
