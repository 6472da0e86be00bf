//! Pictures of shaders: over how much they are averaged, and what is refused.

use super::patterns::point_at;
use crate::program::{PatternShader, SurfaceShader};
use crate::scene::{
    Averaging, BoundTexture, ColourSpace, Mipmap, Object, Procedural, Scene, Texture, TriangleMesh, Wrap,
};
use glam::{DMat4, DVec3, Vec2, Vec3};

/// Noise of a texel, which no mean shows.
fn speckles() -> BoundTexture {
    let side = 64;
    let texel = |i: u32| {
        let bits = i.wrapping_mul(0x9e37_79b9) ^ (i << 7);
        [(bits >> 8) as u8, (bits >> 16) as u8, (bits >> 24) as u8, 255]
    };
    let mut texture = Texture {
        name: "speckles".into(),
        width: side,
        height: side,
        texels: (0..side * side).map(texel).collect(),
        space: ColourSpace::Linear,
        wrap_u: Wrap::Repeat,
        wrap_v: Wrap::Repeat,
        mipmap: Mipmap::default(),
    };
    texture.add_mipmap(Averaging::Light);
    BoundTexture::new(texture)
}

/// A triangle of number 3 with four sets of texture coordinates, in an object of half the size.
fn scene() -> Scene {
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let mesh = TriangleMesh {
        positions: corners.map(Vec3::from).to_vec(),
        uvs: [[0.0, 0.0], [6.0, 0.0], [0.0, 6.0]].map(Vec2::from).to_vec(),
        more_uvs: [20.0, 9.0, 13.0]
            .map(|side| [[0.0, 0.0], [side, 0.0], [0.0, side]].map(Vec2::from).to_vec())
            .to_vec(),
        triangles: vec![[0, 1, 2]; 4],
        materials: vec![0; 4],
        ..TriangleMesh::default()
    };
    let mut scene = Scene::new(mesh, Vec::new());
    let object = scene.objects.add(Object::new("toy"));
    scene.objects.assign(0, object);
    scene.objects.place(object, &DMat4::from_scale(DVec3::splat(0.125)));
    scene
}

fn shader(text: &str) -> PatternShader {
    PatternShader::load_with_pictures("test.wgsl", text, &[("p", "p.png")], &mut |_| Ok(speckles()))
        .unwrap_or_else(|error| panic!("{error}\n{text}"))
}

#[test]
fn pictures_are_averaged_over_what_the_cone_covers_of_their_coordinates() {
    let scene = scene();
    let cases = [
        ("at.uv", "at.footprint"),
        ("at.uv * 4.0", "at.footprint * 4.0"),
        ("at.uv * tiles", "at.footprint * 3.0"),
        ("at.uv / vec2f(0.5, 8.0) - 0.5", "at.footprint * 0.5"),
        ("vec2f(7.0 * at.uv.y, -at.uv.x)", "at.footprint * sqrt(7.0)"),
        ("fract(at.uv * 4.0)", "at.footprint * 4.0"),
        ("abs(at.uv) % vec2f(0.3)", "at.footprint"),
        ("select(at.uv, at.uv * 2.0, at.front)", "at.footprint * 2.0"),
        ("at.uv + 0.1 * sin(at.position.xy)", "at.footprint"),
        ("0.5 * vec2f(at.uv.x + at.uv.y, at.uv.x - at.uv.y)", "at.footprint * (0.5 * sqrt(2.0))"),
        ("clamp(at.uv1, vec2f(0.1), vec2f(0.9))", "at.footprint1"),
        ("at.uv3 * 2.0", "at.footprint3 * 2.0"),
        ("uv_set(at, 2u) + 0.25", "at.footprint2"),
        ("at.position.zx * 5.0", "at.width * 5.0"),
        ("at.object_position.xy", "at.object_width"),
        ("warped(at.uv)", "at.footprint * 9.0"),
        // Not known.
        ("sin(at.uv)", "0.0"),
        ("at.uv * at.uv", "0.0"),
        ("vec2f(at.uv.x, at.position.x)", "0.0"),
        ("vec2f(0.3, 0.7)", "0.0"),
    ];
    for (uv, side) in cases {
        let text = format!(
            "override tiles = 3.0;
            var p: texture_2d<f32>;
            fn warped(uv: vec2f) -> vec2f {{
                var moved = uv;
                for (var i = 0; i < 2; i++) {{ moved *= 3.0; }}
                return moved;
            }}
            fn pattern(at: Point) -> Finish {{
                var f = matte(at);
                f.colour = image(p, {uv}).rgb - image_over(p, {uv}, {side}).rgb;
                f.sheen = image(p, {uv}).rgb - image_over(p, {uv}, 0.0).rgb;
                return f;
            }}"
        );
        let shader = shader(&text);
        let mut differs = false;
        for i in 0..20 {
            let mut at = point_at(&scene, [0.013 * i as f32, 0.3, 0.1 * i as f32]);
            at.uv = [0.371 * i as f32, 0.117 * i as f32].map(Into::into);
            at.barycentric = [0.01 * i as f32, 0.02 * i as f32].map(Into::into);
            at.width = 0.02.into();
            let finish = shader.finish(&at);
            let colour = [finish.colour.x, finish.colour.y, finish.colour.z].map(|x| x.get());
            assert!(colour.iter().all(|x| x.abs() < 1e-6), "{uv} is not over {side}: {colour:?}");
            differs |= [finish.sheen.x, finish.sheen.y, finish.sheen.z].iter().any(|x| x.get() != 0.0);
        }
        assert_eq!(differs, side != "0.0", "{uv}");
    }
}

#[test]
fn a_look_up_is_done_once() {
    let once = "var p: texture_2d<f32>;
        fn pattern(at: Point) -> Finish { var f = matte(at); f.colour = image(p, at.uv).rgb; return f; }";
    let twice =
        once.replace("return", "f.roughness = image(p, at.uv).a; f.metallic = image(p, at.uv).x; return");
    assert_eq!(shader(once).operations(), shader(&twice).operations());
}

#[test]
fn pictures_that_are_not_bound_are_told_with_their_place() {
    let text = "override size: f32 = 1.0;\nvar dirt: texture_2d<f32>;
        fn pattern(at: Point) -> Finish { var f = matte(at); f.colour = image(dirt, at.uv).rgb; return f; }";
    let told = |values: &[(&str, &str)]| {
        let mut find = |value: &str| match value {
            "dirt.png" => Ok(speckles()),
            _ => Err("there is no such thing".into()),
        };
        let loaded = SurfaceShader::load_with_pictures("test.wgsl", text, values, &mut find);
        loaded.map_or_else(|error| error.to_string(), |_| "no error".into())
    };
    assert_eq!(told(&[("dirt", "dirt.png")]), "no error");
    let place = "\n --> test.wgsl:2:1\n  |\n2 | var dirt: texture_2d<f32>;\n";
    let unbound = told(&[("size", "2")]);
    assert!(unbound.starts_with(&format!("the picture `dirt` is not bound{place}")), "{unbound}");
    assert!(
        unbound.contains("= help: bind a file, `dirt=FILE.png`, or a texture of the material"),
        "{unbound}"
    );
    let number = told(&[("dirt", "3")]);
    assert!(
        number.starts_with(&format!("the picture `dirt` is \"3\": there is no such thing{place}")),
        "{number}"
    );
    let swapped = told(&[("dirt", "dirt.png"), ("size", "dirt.png")]);
    assert!(swapped.starts_with("`size` is \"dirt.png\", which is no f32\n --> test.wgsl:1:1"), "{swapped}");
    let unknown = told(&[("dust", "dirt.png")]);
    assert!(unknown.contains("it has size, dirt"), "{unknown}");
    let plain = SurfaceShader::load("test.wgsl", text, []).map(|_| ()).expect_err("not bound");
    assert_eq!((plain.line, &*plain.message), (2, "the picture `dirt` is not bound"));
    assert_eq!(
        SurfaceShader::check("test.wgsl", text).expect("white").parameters()[1].kind,
        "texture_2d<f32>"
    );
}

#[test]
fn hashes_hold_the_pictures() {
    let text = "var p: texture_2d<f32>;
        fn pattern(at: Point) -> Finish { var f = matte(at); f.colour = image(p, at.uv).rgb; return f; }";
    let of = |picture: BoundTexture| {
        let mut find = |_: &str| Ok(picture.clone());
        let shader = PatternShader::load_with_pictures("test.wgsl", text, &[("p", "p.png")], &mut find);
        format!("{:?}", shader.expect("valid"))
    };
    assert_eq!(of(speckles()), of(speckles()));
    assert_ne!(of(speckles()), of(BoundTexture::white()));
}
