//! Pictures that shaders look up: the bytes of the material's own textures, at every level and in blocks.

use super::bases::{self, path};
use super::scenes::one_of_everything;
use crate::lanes::SimdLevel;
use crate::program::{PatternShader, SurfaceShader};
use crate::scene::{BoundTexture, CodedSurface, ProceduralSurface, Scene, Surface, Texture};
use std::sync::Arc;

/// Dirt by a mask over the material.
const DIRT: &str = "var dirt: texture_2d<f32>;
    var mask: texture_2d<f32>;
    fn soiled(clean: Finish, texel: vec4f, share: f32) -> Finish {
        var soil = clean;
        soil.colour = texel.rgb;
        soil.roughness = 0.9;
        return mix_finish(clean, soil, share * texel.a);
    }
    fn pattern(at: Point) -> Finish {
        let share = image(mask, at.position.xz * 0.7).g;
        var whole = base(at);
        if (share > 0.2) { whole = soiled(whole, image(dirt, at.uv * 3.0), share); }
        return whole;
    }";

/// A BSDF whose albedo is a picture.
const MATTE: &str = "var paint: texture_2d<f32>;
    struct State { albedo: vec3f }
    fn prepare(at: Point) -> State { return State(image(paint, at.uv).rgb); }
    fn evaluate(s: State, wo: vec3f, wi: vec3f) -> Lobe {
        let pdf = cosine_hemisphere_pdf(wi.z);
        return Lobe(s.albedo * pdf, pdf);
    }
    fn sample(s: State, wo: vec3f, u: f32, u2: vec2f) -> Scattered {
        let wi = cosine_hemisphere(u2);
        return scattered(wi, evaluate(s, wo, wi));
    }";

/// The scene's own texture, as a file would give it.
fn file(scene: &Scene) -> Texture {
    let mut texture = scene.textures[0].clone();
    texture.add_mipmap(crate::scene::Averaging::Covered);
    texture
}

fn pattern(scene: &Scene, text: &str, block: Option<usize>) -> CodedSurface {
    let mut find = |_: &str| Ok(BoundTexture::new(file(scene)));
    let values = [("dirt", "dirt.png"), ("mask", "mask.png"), ("own", "own.png")];
    let values: Vec<_> =
        values.into_iter().filter(|(name, _)| text.contains(&format!("var {name}"))).collect();
    let shader = PatternShader::load_with_pictures("test.wgsl", text, &values, &mut find);
    ProceduralSurface::new(shader.unwrap_or_else(|error| panic!("{error}")).with_block(block)).into()
}

fn covered(scene: &Scene, surface: CodedSurface) -> Arc<Scene> {
    bases::covered(scene, surface, |of| !matches!(of, Surface::Mix(_)))
}

#[test]
fn pictures_have_the_same_bytes_at_every_level_and_in_blocks() {
    let scene = one_of_everything();
    let expected = path(&covered(&scene, pattern(&scene, DIRT, None)), SimdLevel::narrowest());
    for simd in SimdLevel::available() {
        for block in [None, Some(16), Some(256)] {
            let found = path(&covered(&scene, pattern(&scene, DIRT, block)), simd);
            assert!(found == expected, "{simd}, {block:?}");
        }
    }
    let clean = DIRT.replace("share > 0.2", "share > 2.0");
    let clean = path(&covered(&scene, pattern(&scene, &clean, None)), SimdLevel::detect());
    assert!(expected != clean, "nothing is dirty");
    let bsdf = || {
        let mut find = |_: &str| Ok(BoundTexture::new(file(&scene)));
        let shader = SurfaceShader::load_with_pictures("test.wgsl", MATTE, &[("paint", "p.png")], &mut find);
        CodedSurface::from(shader.unwrap_or_else(|error| panic!("{error}")))
    };
    let expected = path(&covered(&scene, bsdf()), SimdLevel::narrowest());
    for simd in SimdLevel::available() {
        assert!(path(&covered(&scene, bsdf()), simd) == expected, "a BSDF, {simd}");
    }
}

/// A colour that is looked up in the material's own texture, with mipmaps, is the material's own colour to the bit.
#[test]
fn the_texture_of_a_material_is_what_the_material_shows() {
    let mut scene = one_of_everything();
    scene.add_mipmaps();
    let textured = scene.materials.iter().position(|of| {
        matches!(of.surface, Surface::Principled(of) if of.base_colour.texture.is_some() && of.sheen.is_none())
    });
    let number = textured.expect("one is textured");
    let Surface::Principled(of) = &mut scene.materials[number].surface else { panic!("principled") };
    of.base_colour.factor = glam::Vec3::ONE;
    let reference = scene.texture_of(number, "base-colour").expect("it has one");
    let given = |text: &str| {
        let mut find = |_: &str| Ok(BoundTexture::of_scene(&scene, reference));
        let values: &[(&str, &str)] = if text.contains("var own") { &[("own", "base-colour")] } else { &[] };
        let shader = PatternShader::load_with_pictures("test.wgsl", text, values, &mut find);
        let mut scene = scene.clone();
        let shader = shader.unwrap_or_else(|error| panic!("{error}"));
        scene.give_surface(&[number], ProceduralSurface::new(shader)).expect("a finish");
        path(&Arc::new(scene), SimdLevel::detect())
    };
    let expected = given("fn pattern(at: Point) -> Finish { return base(at); }");
    let own = "var own: texture_2d<f32>;
        fn pattern(at: Point) -> Finish {
            var f = base(at);
            f.colour = image(own, at.uv).rgb;
            return f;
        }";
    assert!(given(own) == expected);
    assert!(given(&own.replace("image(own, at.uv)", "image_over(own, at.uv, 0.0)")) != expected, "no mipmap");
    assert!(given(&own.replace("at.uv)", "at.uv * 2.0)")) != expected);
}
