use super::*;

fn material(json: &str) -> Result<Material, String> {
    let recipe: MaterialRecipe = serde_json::from_str(json).expect("a material");
    let has_alpha = |name: &str| name == "leaf";
    let texture = |name: &str, _| {
        let reference = TextureRef::plain(name.len() as u32);
        Ok::<_, String>(MaterialTexture { reference, has_alpha: has_alpha(name) })
    };
    recipe.material("m", &recipe.textures(texture)?)
}

#[test]
fn textures_multiply_what_they_are_named_after() {
    let textured = r#"{ "texture": "a", "normal_texture": "bb", "normal_scale": 0.5, "roughness": 1,
            "metallic": 0.5, "roughness_texture": "ccc", "metallic_texture": "dddd", "emission": [1, 2, 3],
            "emission_texture": "eeeee" }"#;
    let material = material(textured).expect("valid");
    let Surface::Principled(surface) = material.surface else { panic!("principled") };
    assert_eq!(
        surface.base_colour,
        Colour { texture: Some(TextureRef::plain(1)), ..Colour::constant(Vec3::ONE) }
    );
    assert_eq!(surface.roughness.texture, Some((TextureRef::plain(3), Channel::G)));
    assert_eq!(surface.metallic.texture, Some((TextureRef::plain(4), Channel::B)));
    assert_eq!(material.normal_map, Some(NormalMap { texture: TextureRef::plain(2), scale: 0.5 }));
    assert_eq!(material.emission.expect("a lamp").radiance.texture, Some(TextureRef::plain(5)));
    assert_eq!(material.alpha, Alpha::default());
}

#[test]
fn openpbrs_surface_has_the_textures_too() {
    let textured = r#"{ "texture": "leaf", "normal_texture": "bb", "roughness_texture": "ccc", "alpha": 0.5,
            "metallic_texture": "ddddd", "emission_texture": "eeeeee", "openpbr": { "base-metalness": 0.5,
            "specular-roughness": 1, "emission-luminance": 2, "geometry-opacity": 0.5 } }"#;
    let material = material(textured).expect("valid");
    let Surface::OpenPbr(surface) = material.surface else { panic!("OpenPBR") };
    assert_eq!(surface.base_color.texture, Some(TextureRef::plain(4)));
    assert_eq!(surface.specular_roughness.texture, Some((TextureRef::plain(3), Channel::G)));
    assert_eq!(surface.base_metalness.texture, Some((TextureRef::plain(5), Channel::B)));
    assert_eq!(material.normal_map, Some(NormalMap { texture: TextureRef::plain(2), scale: 1.0 }));
    assert_eq!(material.emission.expect("a lamp").radiance.texture, Some(TextureRef::plain(6)));
    let leaf = Some((TextureRef::plain(4), Channel::A));
    assert_eq!((material.alpha.value.factor, material.alpha.value.texture), (0.25, leaf));
}

#[test]
fn alpha_is_of_the_number_and_of_the_texture() {
    let alpha = |json: &str| material(json).expect("valid").alpha;
    let leaf = Some((TextureRef::plain(4), Channel::A));
    assert_eq!(alpha(r#"{ "texture": "leaf" }"#).mode, AlphaMode::Blend);
    assert_eq!(alpha(r#"{ "texture": "leaf" }"#).value.texture, leaf);
    let cut = alpha(r#"{ "texture": "leaf", "alpha_cutoff": 0.5, "alpha": 0.75 }"#);
    assert_eq!((cut.mode, cut.value.factor), (AlphaMode::Mask { cutoff: 0.5 }, 0.75));
    let veil = alpha(r#"{ "alpha": 0.25 }"#);
    assert_eq!((veil.mode, veil.value), (AlphaMode::Blend, Scalar::constant(0.25)));
}

#[test]
fn layers_and_media_become_gltfs_extensions() {
    let layered = r#"{ "colour": [1, 1, 1], "roughness": 0.5, "anisotropy": 0.6, "anisotropy_degrees": 90,
            "sheen": { "colour": [0.1, 0.2, 0.3], "roughness": 0.4 }, "film": { "nanometres": 300, "ior": 1.4 } }"#;
    let Surface::Principled(surface) = material(layered).expect("valid").surface else {
        panic!("principled")
    };
    let anisotropy = surface.anisotropy.expect("anisotropic");
    assert_eq!((anisotropy.strength.factor, anisotropy.rotation), (0.6, std::f32::consts::FRAC_PI_2));
    let fibres = surface.sheen.expect("fibres");
    assert_eq!((fibres.colour.factor, fibres.roughness.factor), (Vec3::new(0.1, 0.2, 0.3), 0.4));
    let film = surface.iridescence.expect("a film");
    assert_eq!((film.thickness_nm, film.ior, film.strength.factor), ([300.0; 2], 1.4, 1.0));
    let glass =
        r#"{ "colour": [1, 1, 1], "ior": 1.5, "absorption": { "colour": [0.5, 1, 1], "distance": 2 } }"#;
    let frosted = material(r#"{ "colour": [1, 0.5, 1], "ior": 1.4, "roughness": 0.2 }"#).expect("valid");
    let tint = Vec3::new(1.0, 0.5, 1.0);
    let expected = Principled::glass(1.4, tint, Scalar::constant(0.2));
    assert_eq!(frosted.surface, Surface::Principled(expected));
    let medium = material(glass).expect("valid").medium.expect("a medium");
    assert!((medium.absorption - Vec3::X * (0.5 * 2.0_f32.ln())).abs().max_element() < 1e-6, "{medium:?}");
}

#[test]
fn glass_may_disperse_and_sheets_let_light_through() {
    let prism = r#"{ "colour": [1, 0.5, 1], "ior": 1.6, "dispersion": 0.8 }"#;
    let glass = Principled::glass(1.6, Vec3::new(1.0, 0.5, 1.0), Scalar::constant(0.0));
    let Surface::Principled(surface) = material(prism).expect("valid").surface else {
        panic!("clear glass without dispersion")
    };
    assert_eq!(surface, Principled { dispersion: 0.8, ..glass });
    assert!(surface.is_dispersive());
    let clear = material(r#"{ "colour": [1, 1, 1], "ior": 1.6, "dispersion": 0 }"#).expect("valid");
    assert!(matches!(clear.surface, Surface::Dielectric { .. }));
    for (fields, colour, specular) in [
        (r#""roughness": 0.5, "diffuse_transmission": { "share": 0.4, "colour": [0, 1, 0] }"#, Vec3::Y, 1.0),
        (r#""diffuse_transmission": { "share": 0.4 }"#, Vec3::ONE, 0.0),
    ] {
        let text = format!(r#"{{ "colour": [0.1, 0.2, 0.3], {fields} }}"#);
        let Surface::Principled(surface) = material(&text).expect("valid").surface else {
            panic!("opaque: {text}")
        };
        let lobe = surface.diffuse_transmission.expect("a lobe");
        assert_eq!(
            (lobe.share.factor, lobe.colour, surface.specular.factor),
            (0.4, Colour::constant(colour), specular)
        );
    }
}

#[test]
fn the_lowest_coat_may_become_the_clear_coat() {
    let surface = |fields: &str| {
        let text = format!(r#"{{ "colour": [0.5, 0.4, 0.3], {fields} }}"#);
        let Surface::Principled(surface) = material(&text).expect("valid").surface else {
            panic!("principled")
        };
        surface
    };
    let one = surface(r#""roughness": 0.3, "coats": [{ "weight": 0.6 }]"#);
    assert_eq!(one, surface(r#""roughness": 0.3, "clearcoat": 0.6"#));
    let two = surface(r#""coats": [{ "tint": [1, 0.5, 0.2], "ior": 1.7 }, { "roughness": 0.4 }]"#);
    let upper = Coat { ior: 1.7, tint: Vec3::new(1.0, 0.5, 0.2), ..Coat::CLEAR };
    assert_eq!((&*two.coats, two.clearcoat.factor), (&[upper][..], 1.0));
    assert_eq!((two.clearcoat_roughness.factor, two.specular.factor), (0.4, 0.0), "over matte");
    let both = surface(r#""roughness": 0.3, "clearcoat": 0.5, "coats": [{}, {}]"#);
    assert_eq!((both.coats.len(), both.clearcoat.factor), (2, 0.5));
}

#[test]
fn errors_name_numbers_out_of_range() {
    for (field, part) in [
        (r#""anisotropy": 2"#, "anisotropy is 2"),
        (r#""sheen": { "colour": [2, 0, 0], "roughness": 0 }"#, "largest channel of sheen is 2"),
        (r#""film": { "nanometres": -1, "ior": 1.4 }"#, "nanometres is -1"),
        (r#""absorption": { "colour": [1, 1, 1], "distance": 0 }"#, "distance of absorption is 0"),
        (r#""dispersion": -1"#, "dispersion is -1; it must be from 0 to 20"),
        (r#""alpha": 1.5"#, "alpha is 1.5"),
        (r#""metallic_texture": "t""#, "metallic, which is 0"),
        (r#""emission_texture": "t""#, "emission, which is not given"),
        (r#""ior": 1.5, "metallic": 0, "normal_scale": 1e9"#, "normal_scale"),
        (r#""diffuse_transmission": { "share": 1.5 }"#, "share of diffuse_transmission is 1.5"),
        (
            r#""diffuse_transmission": { "share": 1, "colour": [2, 0, 0] }"#,
            "largest channel of the colour of diffuse_transmission is 2",
        ),
        (r#""coats": [{ "weight": 2 }]"#, "weight of a coat is 2"),
        (r#""coats": [{ "tint": [0, 0, 3] }]"#, "tint of a coat is 3"),
        (r#""coats": [{}, {}, {}, {}, {}, {}, {}, {}, {}]"#, "number of coats is 9; it must be from 0 to 8"),
        (r#""coats": [{}], "mirror": true"#, "glass and mirrors cannot have coats"),
    ] {
        let text = format!(r#"{{ "colour": [1, 1, 1], "roughness": 0.5, {field} }}"#);
        let problem = material(&text).expect_err(field);
        assert!(problem.contains(part), "{problem}");
    }
}
