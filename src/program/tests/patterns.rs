//! Patterns as surfaces.

use crate::lanes::{Int, Lanes, Mask, Num, SingleLane, Vector};
use crate::program::kernel::first_scalar;
use crate::program::{BsdfShader, PatternShader};
use crate::scene::{
    BlockColumns, BlockSurface, FINISH_FIELDS, Finish, Points, Procedural, Scattering, Scene, VertexAttribute,
};
use crate::stream::Stopped;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// A point.
pub(super) fn point_at(scene: &Scene, [x, y, z]: [f32; 3]) -> Points<'_, SingleLane> {
    let l = SingleLane;
    let n = |x: f32| Num::splat(l, x);
    let up = Vector::new(n(0.0), n(0.0), n(1.0));
    Points {
        position: Vector::new(n(x), n(y), n(z)),
        normal: up,
        geometric_normal: up,
        wo: up,
        uv: [n(0.25), n(0.75)],
        barycentric: [n(0.1), n(0.2)],
        width: n(0.01),
        area: n(1.0),
        primitive: Int::splat(l, 3),
        front: Mask::splat(l, true),
        bumps: n(0.0),
        scene,
        own: None,
    }
}

/// A finish at one point.
pub(super) fn finish_at(shader: &PatternShader, position: [f32; 3]) -> Finish<SingleLane> {
    shader.finish(&point_at(&Scene::default(), position))
}

fn colour_at(text: &str, position: [f32; 3]) -> [f32; 3] {
    let body = format!("fn pattern(at: Point) -> Finish {{ var f = matte(at); {text} return f; }}");
    let shader = PatternShader::load("test.wgsl", &body, []).unwrap_or_else(|error| panic!("{error}"));
    let colour = finish_at(&shader, position).colour;
    [colour.x.get(), colour.y.get(), colour.z.get()]
}

#[test]
fn control_flow_acts_point_by_point() {
    let text = "
        var x = at.position.x;
        var turns = 0u;
        loop {
            if (x > 100.0) { break; }
            x = x * 2.0 + 1.0;
            turns += 1u;
            if (turns == 3u) { continue; }
            if (turns > 50u) { x = -1.0; break; }
        }
        switch (turns % 3u) {
            case 0u: { f.colour.x = 1.0; }
            case 1u, 5u: { f.colour.x = 2.0; if (x > 150.0) { break; } f.colour.y = 3.0; }
            default: { f.colour.x = 4.0; }
        }
        f.colour.z = x;";
    let expected = |mut x: f32| {
        let mut turns = 0u32;
        loop {
            if x > 100.0 {
                break;
            }
            x = x * 2.0 + 1.0;
            turns += 1;
            if turns == 3 {
                continue;
            }
            if turns > 50 {
                x = -1.0;
                break;
            }
        }
        let mut colour = [1.0, 1.0, x];
        match turns % 3 {
            0 => colour[0] = 1.0,
            1 => {
                colour[0] = 2.0;
                if x <= 150.0 {
                    colour[1] = 3.0;
                }
            }
            _ => colour[0] = 4.0,
        }
        colour
    };
    for x in [0.0, 1.0, 7.5, 99.0, 100.5, -1.0, -0.9, 3.3, 12.0, 47.0] {
        assert_eq!(colour_at(text, [x, 0.0, 0.0]), expected(x), "{x}");
    }
}

#[test]
fn loops_that_end_at_all_points_end_in_vectors_and_blocks_with_room_for_more() {
    let text = "fn pattern(at: Point) -> Finish {
        var f = matte(at);
        f.metallic = at.position.x;
        while (f.metallic < 1.0) { f.metallic *= 2.0; }
        return f;
    }";
    let shader = PatternShader::load("test.wgsl", text, []).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(finish_at(&shader, [0.3, 0.0, 0.0]).metallic.get(), 1.2);
    let shader = shader.with_block(Some(64));
    let (mut points, mut finishes) = (BlockColumns::default(), BlockColumns::default());
    points.for_points(shader.wanted(), 64);
    finishes.for_finishes(64);
    points.column_mut(0)[..5].copy_from_slice(&[0.3, 0.4, 0.5, 0.6, 0.7]);
    shader.compute(8, 5, &points, &mut finishes);
    let computed = |scalar: &usize| finishes.column(*scalar)[..5] == [1.2, 1.6, 1.0, 1.2, 1.4];
    let scalars: usize = FINISH_FIELDS.iter().map(|field| field.kind.numbers()).sum();
    assert_eq!((0..scalars).filter(computed).count(), 1);
}

#[test]
fn natives_have_the_bits_of_their_wgsl() {
    // Points of the unit square, its middle too, and points around it.
    let warps = "fn pattern(at: Point) -> Finish {
        var f = matte(at);
        let p = at.position;
        f.colour = cosine_hemisphere(floor(fract(p.xy) * 9.0) * 0.125);
        let point = disk(p.yz);
        f.roughness = point.x;
        f.metallic = point.y;
        f.clearcoat = cosine_hemisphere(p.zx).z + disk(fract(p.xy)).x;
        return f;
    }";
    let functions = "fn pattern(at: Point) -> Finish {
        var f = matte(at);
        let p = at.position;
        f.colour = vec3f(noise(p * 3.0), sin(p.x * 10.0), cos(p.y * 100.0));
        f.roughness = atan2(p.y, p.z);
        f.metallic = exp2(p.x) + log2(abs(p.y) + 1e-3);
        f.clearcoat = turbulence(p, 4u) + pow(abs(p.z), p.x) + exp(p.y) + log(abs(p.z) + 0.5) + tan(p.x);
        return f;
    }";
    for (text, times_fewer) in [(functions, 4), (warps, 2)] {
        natives_have_the_bits_of_the_wgsl_of(text, times_fewer);
    }
}

fn natives_have_the_bits_of_the_wgsl_of(body: &str, times_fewer: usize) {
    let [native, written] = [true, false].map(|natives| {
        PatternShader::load_with("test.wgsl", body, [], natives).unwrap_or_else(|error| panic!("{error}"))
    });
    assert!(native.operations() * times_fewer < written.operations());
    for i in 0..5000u32 {
        let part = |k: u32| (crate::geom::mix(3 * i + k) as f32 / u32::MAX as f32 - 0.5) * 10.0;
        let position = [part(0), part(1), part(2)];
        let [a, b] = [&native, &written].map(|shader| {
            let f = finish_at(shader, position);
            [f.colour.x, f.colour.y, f.colour.z, f.roughness, f.metallic, f.clearcoat]
                .map(|x| x.get().to_bits())
        });
        assert_eq!(a, b, "{position:?}: {:?} {:?}", a.map(f32::from_bits), b.map(f32::from_bits));
    }
}

#[test]
fn errors_show_the_place_and_the_remedy() {
    let cases = [
        ("fn pattern(at: Point) -> Finish { return mate(at); }", "test.wgsl:1:42", "mate"),
        (
            "fn patern(at: Point) -> Finish { return matte(at); }",
            "--> test.wgsl",
            "fn pattern(at: Point) -> Finish",
        ),
        ("fn pattern(at: Point) -> f32 { return 1.0; }", "test.wgsl:1:1", "fn pattern(at: Point) -> Finish"),
        ("fn pattern(at: Point) -> Finish {\n  return at.uv;\n}", "test.wgsl:2:", ""),
        (
            "fn pattern(at: Point) -> Finish { var f = matte(at); f.roughness = dpdx(at.uv.x); return f; }",
            "test.wgsl:1:68",
            "at.width",
        ),
        (
            "fn pattern(at: Point) -> Finish { var f = matte(at); f.emission = vec3f(1.0); return f; }",
            "",
            "max_emission",
        ),
    ];
    for (text, place, words) in cases {
        let error = PatternShader::load("test.wgsl", text, []).expect_err(text).to_string();
        assert!(error.contains(place) && error.contains(words), "{text}\n{error}");
    }
}

#[test]
fn constants_need_no_type() {
    let glass = "fn pattern(at: Point) -> Finish { var f = matte(at); f.transmission = 1.0; return f; }";
    let effects = |constant: &str| {
        let shader = PatternShader::load("test.wgsl", &format!("{constant}\n{glass}"), []);
        format!("{:?}", shader.expect(constant).effects())
    };
    let body = effects("const ior: f32 = 1.5;");
    assert_eq!(effects("const ior = 1.5;"), body);
    assert_eq!(effects("/* a /* body */ */ const prior = 2.0; const ior=1.5; // of glass"), body);
    let thin = effects("");
    assert_ne!(thin, body);
    assert_eq!(effects("// const ior = 1.5;\n/* const ior = 1.5;\n */ const prior = 2.0;"), thin);
    for wrong in ["const ior = 0.5;", "const ior = 3.0 / 2.0;"] {
        let error = PatternShader::load("test.wgsl", &format!("{wrong}\n{glass}"), []).expect_err(wrong);
        assert!(error.to_string().contains("test.wgsl:1:7"), "{error}");
    }
    let lamp = "const max_emission = 8.0;\n\
                fn pattern(at: Point) -> Finish { var f = matte(at); f.emission = vec3f(2.0); return f; }";
    PatternShader::load("lamp.wgsl", lamp, []).expect("the bound is there");
}

/// A pattern whose colour is an expression.
fn pattern_of(expression: &str) -> String {
    format!("fn pattern(at: Point) -> Finish {{ var f = matte(at); f.roughness = {expression}; return f; }}")
}

#[test]
fn hostile_shaders_are_refused_soon() {
    let x = "at.position.x";
    let calls =
        (0..40).map(|i| format!("fn g{i}(x: f32) -> f32 {{ return g{}(x) + g{}(x); }}\n", i + 1, i + 1));
    let tower =
        calls.collect::<String>() + "fn g40(x: f32) -> f32 { return 1.0; }\n" + &pattern_of("g0(1.0)");
    let mut loops = String::from("1.0; ");
    for i in 0..30 {
        loops += &format!("for (var i{i} = 0u; i{i} < 1000000u; i{i}++) {{ ");
    }
    loops += "f.metallic += 0.5; ";
    loops += &"}".repeat(30);
    for (text, words) in [
        (pattern_of(&format!("{}{x}{}", "(".repeat(5000), ")".repeat(5000))), "deep"),
        (pattern_of(&vec![x; 20_000].join(" + ")), "operators"),
        (pattern_of(&format!("{}{x}", "-".repeat(100_000))), "operators"),
        (format!("{}{}", pattern_of(x), " ".repeat(2 << 20)), "bytes"),
        (tower, "statements"),
        ("fn f(x: f32) -> f32 { return f(x); }".to_owned() + &pattern_of("f(1.0)"), ""),
        ("\0\u{feff}é{{{{".to_owned(), ""),
    ] {
        let error = PatternShader::load("hostile.wgsl", &text, []).expect_err(words).to_string();
        assert!(error.contains(words), "{words}: {}", &error[..error.len().min(2000)]);
    }
    PatternShader::load("loops.wgsl", &pattern_of(&loops), [])
        .expect("long loops are no error before they run");
}

#[test]
fn integers_and_indices_have_results_everywhere() {
    let text = "
        let zero = i32(at.position.x);
        var a = array<f32, 3>(1.0, 2.0, 4.0);
        let far = a[u32(zero) + 7u] + a[zero - 5];
        f.colour = vec3f(far, f32(7 / zero) + f32(7 % zero), f32(7u << (u32(zero) + 33u)));";
    assert_eq!(colour_at(text, [0.25, 0.0, 0.0]), [8.0, 7.0, 14.0]);
}

#[test]
fn endless_loops_are_told() {
    let text = "fn pattern(at: Point) -> Finish { var f = matte(at); var x = at.position.x;\n\
                loop { x = x * 0.5; if (x > 9.0) { break; } } f.roughness = x; return f; }";
    let shader = PatternShader::load("endless.wgsl", text, []).expect("valid");
    let ran = catch_unwind(AssertUnwindSafe(|| finish_at(&shader, [1.0; 3])));
    let Err(thrown) = ran else { panic!("the loop does not end") };
    let Stopped(reason) = *thrown.downcast().expect("no panic");
    assert!(reason.starts_with("this loop takes too many turns\n --> endless.wgsl:2:1\n"), "{reason}");
}

/// Values of an expression of `p` at random points.
fn values(expression: &str) -> Vec<[f32; 3]> {
    let text = format!(
        "fn pattern(at: Point) -> Finish {{ var f = matte(at); let p = at.position; f.colour = {expression}; \
         return f; }}"
    );
    let shader = PatternShader::load("test.wgsl", &text, []).unwrap_or_else(|error| panic!("{error}"));
    let part = |k: u32| (crate::geom::mix(k) as f32 / u32::MAX as f32 - 0.5) * 40.0;
    let at = |i: u32| finish_at(&shader, [part(3 * i), part(3 * i + 1), part(3 * i + 2)]).colour;
    (0..2000).map(at).map(|c| [c.x.get(), c.y.get(), c.z.get()]).collect()
}

#[test]
fn noises_keep_what_they_promise() {
    let spread = |numbers: Vec<f32>| {
        let mean = numbers.iter().sum::<f32>() / numbers.len() as f32;
        let squares = numbers.iter().map(|x| (x - mean) * (x - mean)).sum::<f32>();
        (mean, (squares / numbers.len() as f32).sqrt())
    };
    let channel =
        |all: &[[f32; 3]], channel: usize| all.iter().map(|colour| colour[channel]).collect::<Vec<_>>();
    let plain = values("vec3f(noise2(p.xy), gradient_noise(p), gradient_noise2(p.xy))");
    assert!(plain.iter().all(|[a, b, c]| (0.0..=1.0).contains(a) && b.abs() <= 1.5 && c.abs() <= 1.5));
    let [(a, sa), (b, sb), (c, sc)] = [0, 1, 2].map(|i| spread(channel(&plain, i)));
    assert!((a - 0.5).abs() < 0.03 && b.abs() < 0.03 && c.abs() < 0.03, "{a} {b} {c}");
    assert!(sa > 0.1 && sb > 0.1 && sc > 0.1, "{sa} {sb} {sc}");
    let corners =
        values("vec3f(gradient_noise(floor(p)), gradient_noise2(floor(p.xy)), noise2(p.xy) - noise2(p.xy))");
    assert!(corners.iter().all(|corner| *corner == [0.0; 3]));
    // No jumps: along a short step values differ little, across faces of the lattice too.
    let steps = values(
        "vec3f(gradient_noise(round(p) + 1e-3) - gradient_noise(round(p) - 1e-3), noise2(round(p.xy) + 1e-3) - \
         noise2(round(p.xy) - 1e-3), periodic_noise(round(p) + 1e-3, vec3f(5.0)) - periodic_noise(round(p) - 1e-3, \
         vec3f(5.0)))",
    );
    assert!(steps.iter().flatten().all(|step| step.abs() < 0.01));
    let repeats = values(
        "vec3f(periodic_noise(floor(p * 8.0) / 8.0, vec3f(4.0, 3.0, 7.0)), \
         periodic_noise(floor(p * 8.0) / 8.0 + vec3f(4.0, -9.0, 14.0), vec3f(4.0, 3.0, 7.0)), \
         periodic_noise(floor(p * 8.0) / 8.0 + vec3f(1.0, 0.0, 0.0), vec3f(4.0, 3.0, 7.0)))",
    );
    assert!(repeats.iter().all(|[a, b, _]| a == b) && repeats.iter().any(|[a, _, c]| (a - c).abs() > 0.1));
    for text in ["worley(p)", "worley2(p.xy)"] {
        let cells = values(&format!("vec3f({text}.distance, {text}.second, {text}.random)"));
        assert!(
            cells.iter().all(|[near, second, id]| near <= second && *second < 2.0 && (0.0..1.0).contains(id))
        );
        let (mean, _) = spread(channel(&cells, 0));
        assert!((0.3..0.7).contains(&mean), "{text}: {mean}");
    }
    let own = values(
        "vec3f(worley(worley(p).centre).distance, worley(worley(p).centre).random - worley(p).random, 0.0)",
    );
    assert!(
        own.iter().all(|[distance, other, _]| *distance < 1e-4 && *other == 0.0),
        "a centre is in its cell"
    );
    let bent = values("bump(vec3f(0.0, 0.0, 1.0), vec3f(0.5, 0.0, 9.0))");
    assert!(
        bent.iter().all(|[x, y, z]| (x / z + 0.5).abs() < 1e-6 && *y == 0.0),
        "a slope along the normal is none"
    );
    let random = values("vec3f(object_random(at, 0u), object_random(at, 1u), object_random(at, 0u))");
    assert!(
        random.iter().all(|[a, b, c]| a == c && a != b && *a == random[0][0]),
        "the same all over an object"
    );
}

#[test]
fn displacement_is_refused_in_words() {
    let pattern = "fn pattern(at: Point) -> Finish { return matte(at); }";
    let told = format!("fn displace(at: Point) -> f32 {{ return noise(at.position); }}\n{pattern}");
    let error = PatternShader::load("test.wgsl", &told, []).expect_err("ignored").to_string();
    assert!(error.contains("cannot be displaced") && error.contains("test.wgsl:1:"), "{error}");
    let called = "fn displace(p: vec3f) -> vec3f { return p + noise(p); }
        fn pattern(at: Point) -> Finish { var f = matte(at); f.colour = displace(at.position); return f; }";
    PatternShader::load("test.wgsl", called, []).expect("a function of the file's own");
}

#[test]
fn the_second_set_of_texture_coordinates_is_told() {
    let text =
        "fn pattern(at: Point) -> Finish { var f = matte(at); f.colour = vec3f(at.uv1, at.uv.x); return f; }";
    let shader = PatternShader::load("test.wgsl", text, []).unwrap_or_else(|error| panic!("{error}"));
    let mut scene = Scene::default();
    let colour = |scene: &Scene| {
        let colour = shader.finish(&point_at(scene, [0.0; 3])).colour;
        [colour.x.get(), colour.y.get(), colour.z.get()]
    };
    assert_eq!(colour(&scene), [0.25, 0.75, 0.25], "without a second set");
    scene.mesh.triangles = vec![[0, 1, 2]; 4];
    scene.mesh.more_uvs = vec![vec![glam::Vec2::ZERO, glam::Vec2::new(5.0, 0.0), glam::Vec2::new(0.0, 10.0)]];
    assert_eq!(colour(&scene), [0.5, 2.0, 0.25]);
}

#[test]
fn further_sets_of_texture_coordinates_are_told() {
    let text = "fn pattern(at: Point) -> Finish {
            var f = matte(at);
            let all = vec4f(at.uv2.x, at.uv3.x, uv_set(at, 1u).x, uv_set(at, 3u).y);
            f.colour = vec3f(all.x, all.y, all.z + uv_set(at, 0u).y);
            f.roughness = all.w + uv_set(at, 2u).y + uv_set(at, 9u).x;
            return f;
        }";
    let shader = PatternShader::load("test.wgsl", text, []).unwrap_or_else(|error| panic!("{error}"));
    let mut scene = Scene::default();
    let finish = |scene: &Scene| {
        let finish = shader.finish(&point_at(scene, [0.0; 3]));
        [finish.colour.x, finish.colour.y, finish.colour.z, finish.roughness].map(|number| number.get())
    };
    assert_eq!(finish(&scene), [0.25, 0.25, 1.0, 1.75], "those of the first without them");
    scene.mesh.triangles = vec![[0, 1, 2]; 4];
    let set = |x, y| vec![glam::Vec2::ZERO, glam::Vec2::new(x, 0.0), glam::Vec2::new(0.0, y)];
    scene.mesh.more_uvs = vec![set(5.0, 10.0), set(8.0, 1.0), set(12.0, 3.0)];
    let [u, v] = [0.1, 0.2];
    let all = [8.0 * u, 12.0 * u, 5.0 * u + 0.75, 3.0 * v + v + 0.25];
    let close = finish(&scene).iter().zip(all).all(|(&found, expected)| (found - expected).abs() < 1e-6);
    assert!(close, "{:?}, not {all:?}", finish(&scene));
}

const WEATHERED: &str = "struct Attributes { wetness: f32, flow: vec3f }
    var<private> attributes: Attributes;
    fn pattern(at: Point) -> Finish {
        var f = matte(at);
        f.colour = attributes.flow;
        f.roughness = attributes.wetness;
        return f;
    }";

/// A scene of one triangle with these attributes.
fn attributed(attributes: &[(&str, u32, &[f32])]) -> Scene {
    let mut scene = Scene::default();
    scene.mesh.triangles = vec![[0, 1, 2]; 4];
    let attribute = |&(name, width, values): &(&str, u32, &[f32])| VertexAttribute {
        name: name.into(),
        width,
        values: values.to_vec(),
    };
    scene.mesh.attributes = attributes.iter().map(attribute).collect();
    scene
}

#[test]
fn vertex_attributes_are_found_by_their_names() {
    let shader = PatternShader::load("test.wgsl", WEATHERED, []).unwrap_or_else(|error| panic!("{error}"));
    let names: Vec<(&str, u32)> = shader.attributes().iter().map(|one| (&*one.name, one.width)).collect();
    assert_eq!(names, [("wetness", 1), ("flow", 3)]);
    let finish = |scene: &Scene| {
        let Finish { colour, roughness, .. } = shader.finish(&point_at(scene, [0.0; 3]));
        [colour.x, colour.y, colour.z, roughness].map(|number| number.get())
    };
    assert_eq!(finish(&Scene::default()), [0.0; 4], "a mesh without them");
    let flow = ("flow", 3, &[0.0, 1.0, 2.0, 10.0, 1.0, 2.0, 0.0, 21.0, 2.0][..]);
    let scene = attributed(&[("other", 1, &[9.0; 3]), flow, ("wetness", 1, &[1.0, 2.0, 3.0])]);
    // The weights of the corners are 0.7, 0.1 and 0.2.
    let close =
        finish(&scene).iter().zip([1.0, 5.0, 2.0, 1.5]).all(|(found, sought)| (found - sought).abs() < 1e-5);
    assert!(close, "{:?}", finish(&scene));
}

#[test]
fn blocks_and_vectors_see_the_same_vertex_attributes() {
    let text = WEATHERED.replace("attributes.wetness;", "attributes.wetness * noise(base(at).colour);");
    let shader = PatternShader::load("test.wgsl", &text, []).unwrap_or_else(|error| panic!("{error}"));
    let shader = shader.with_block(Some(16));
    let scene = attributed(&[("flow", 3, &[0.5; 9]), ("wetness", 1, &[1.0, 2.0, 3.0])]);
    let point = point_at(&scene, [0.3; 3]);
    let alone = shader.finish(&point);
    let (mut points, mut finishes) = (BlockColumns::default(), BlockColumns::default());
    points.for_points(shader.wanted(), 16);
    finishes.for_finishes(16);
    point.write_to(shader.wanted(), &mut points.sink(0, SingleLane::LANES));
    shader.compute(8, 1, &points, &mut finishes);
    let roughness = first_scalar(FINISH_FIELDS, "roughness");
    assert_eq!(finishes.column(roughness)[0].to_bits(), alone.roughness.get().to_bits());
    assert_eq!(finishes.column(0)[0], 0.5);
}

#[test]
fn attributes_that_are_not_read_are_not_asked_for() {
    let text = WEATHERED.replace("f.colour = attributes.flow;", "");
    let shader = PatternShader::load("test.wgsl", &text, []).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(shader.attributes().len(), 1);
    let other = WEATHERED.replace("Attributes", "Things");
    let shader = PatternShader::load("test.wgsl", &other, []).unwrap_or_else(|error| panic!("{error}"));
    assert!(shader.attributes().is_empty(), "a variable of the file's own");
    let whole = WEATHERED.replace("wetness: f32", "wetness: u32").replace("attributes.wetness", "0.5");
    let error = PatternShader::load("test.wgsl", &whole, []).expect_err("integers").to_string();
    assert!(error.contains("`wetness`") && error.contains("test.wgsl:2:"), "{error}");
}

#[test]
fn bsdfs_read_vertex_attributes() {
    let text = "struct Attributes { wetness: f32, flow: vec3f }
        var<private> attributes: Attributes;
        struct State { wet: f32 }
        fn prepare(at: Point) -> State { return State(attributes.wetness); }
        fn evaluate(s: State, wo: vec3f, wi: vec3f) -> Lobe {
            return Lobe(vec3f(s.wet, attributes.wetness, wi.z), wo.z);
        }
        fn sample(s: State, wo: vec3f, u: f32, u2: vec2f) -> Scattered {
            return Scattered(vec3f(u2, u), vec3f(s.wet), attributes.flow.y);
        }";
    let shader = BsdfShader::load("test.wgsl", text, []).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(shader.attributes().len(), 2);
    let scene = attributed(&[
        ("wetness", 1, &[0.25; 3]),
        ("flow", 3, &[0.0, 8.0, 0.0, 0.0, 8.0, 0.0, 0.0, 8.0, 0.0]),
    ]);
    let point = point_at(&scene, [0.0; 3]);
    let l = point.lanes();
    let number = |x| Num::splat(l, x);
    let (wo, wi) = (
        Vector::new(number(0.0), number(0.0), number(1.0)),
        Vector::new(number(0.6), number(0.0), number(0.8)),
    );
    let (value, pdf) = shader.evaluate(&point, wo, wi);
    let found = [value.x, value.y, value.z, pdf].map(|number| number.get());
    assert!(found.iter().zip([0.25, 0.25, 0.8, 1.0]).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}");
    let sampled = shader.sample(&point, wo, number(0.5), [number(0.125), number(0.75)]);
    let found = [sampled.wi.x, sampled.wi.z, sampled.weight.x, sampled.pdf].map(|number| number.get());
    assert!(found.iter().zip([0.125, 0.5, 0.25, 8.0]).all(|(a, b)| (a - b).abs() < 1e-5), "{found:?}");
}
