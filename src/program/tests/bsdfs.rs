//! BSDFs as surfaces.

use super::patterns::point_at;
use crate::lanes::{Num, SingleLane, Vector};
use crate::program::BsdfShader;
use crate::scene::{Scattered, Scattering, ScatteringSurface, Scene};

/// Noise of a measured albedo, the greatest of many views; what is more than noise is a fault.
const NOISE: f64 = 0.02;

const COUNTING: &str = "
    var<private> count: f32 = 1.0;
    struct State { left: f32, position: vec3f }
    fn prepare(at: Point) -> State {
        count += at.position.x;
        if (at.position.y > 0.0) { return State(count, at.position); }
        return State(-count, at.position);
    }
    fn evaluate(s: State, wo: vec3f, wi: vec3f) -> Lobe {
        count *= 2.0;
        return Lobe(vec3f(s.left, count, s.position.z), wo.z + 10.0 * wi.z);
    }
    fn sample(s: State, wo: vec3f, u: f32, u2: vec2f) -> Scattered {
        count += u;
        return Scattered(vec3f(u2, wo.x), vec3f(s.left, count, s.position.y), s.position.z);
    }";

#[test]
fn functions_get_their_arguments_and_begin_with_the_initial_values_of_variables() {
    let shader = BsdfShader::load("counting.wgsl", COUNTING, []).unwrap_or_else(|error| panic!("{error}"));
    let (scene, l) = (Scene::default(), SingleLane);
    let n = |x: f32| Num::splat(l, x);
    let numbers = |v: Vector<SingleLane>| [v.x, v.y, v.z].map(Num::get);
    let (wo, wi) = (Vector::new(n(0.25), n(0.5), n(0.75)), Vector::new(n(2.0), n(3.0), n(4.0)));
    for (position, left) in [([4.0, 6.0, 7.0], 5.0), ([8.0, -6.0, 7.0], -9.0)] {
        let at = point_at(&scene, position);
        let (value, pdf) = shader.evaluate(&at, wo, wi);
        assert_eq!((numbers(value), pdf.get()), ([left, 2.0, 7.0], 40.75));
        let Scattered { wi, weight, pdf } = shader.sample(&at, wo, n(0.125), [n(0.375), n(0.625)]);
        assert_eq!(numbers(wi), [0.375, 0.625, 0.25]);
        assert_eq!((numbers(weight), pdf.get()), ([left, 1.125, position[1]], 7.0));
    }
}

#[test]
fn shipped_bsdfs_break_no_promise() {
    for (name, text) in [
        ("velvet.wgsl", include_str!("../../../scenes/shaders/velvet.wgsl")),
        ("dust.wgsl", include_str!("../../../scenes/shaders/dust.wgsl")),
        ("pearl.wgsl", include_str!("../../../scenes/shaders/pearl.wgsl")),
        ("dusty.wgsl", include_str!("../../../scenes/shaders/dusty.wgsl")),
    ] {
        let shader = BsdfShader::load(name, text, []).unwrap_or_else(|error| panic!("{error}"));
        let report = ScatteringSurface::new(shader).measure();
        assert_eq!(report.faults, [], "{name}");
        assert!(report.albedo[0] > 0.0 && report.albedo[1] < 1.0 + NOISE, "{name}: {:?}", report.albedo);
    }
}

/// What a device computes at once has the bits of what hits ask, function by function.
#[cfg(feature = "gpu")]
#[test]
fn answers_of_both_functions_together_have_the_bits_of_each() {
    use crate::program::device::{Given, Kernel, Program, sample_points, tests::bsdfs};
    use crate::scene::BlockColumns;

    /// Scalars of what is asked: `wo`, `wi`, and three random numbers.
    const ASKED: usize = 9;
    /// Scalars of the answers: value and density, then direction, weight and density.
    const ANSWERS: usize = 11;

    fn check(name: &str, shader: &BsdfShader, program: &Program) {
        const POINTS: usize = 700;
        const POINT: usize = BlockColumns::POINT;
        let kernel = Kernel::new(program, false).unwrap_or_else(|error| panic!("{name}: {error}"));
        // Every scalar, whether it is read or not.
        let all: Vec<u32> = (0..(POINT + ASKED) as u32).collect();
        let words = sample_points(program, &all, POINTS, 5);
        let inputs: Vec<u32> =
            kernel.inputs.iter().flat_map(|&i| words[i as usize * POINTS..][..POINTS].to_vec()).collect();
        let answers = program.evaluate(&kernel, POINTS, &inputs).expect("loops end");
        let (scene, l) = (Scene::default(), SingleLane);
        let mut different = 0;
        for point in 0..POINTS {
            let n = |scalar: usize| Num::splat(l, f32::from_bits(words[scalar * POINTS + point]));
            let v = |scalar: usize| Vector::new(n(scalar), n(scalar + 1), n(scalar + 2));
            let at = point_at(&scene, [0, 1, 2].map(|i| n(i).get()));
            let (value, pdf) = shader.evaluate(&at, v(POINT), v(POINT + 3));
            let sample = shader.sample(&at, v(POINT), n(POINT + 6), [n(POINT + 7), n(POINT + 8)]);
            let Scattered { wi, weight, pdf: density } = sample;
            let expected =
                [value.x, value.y, value.z, pdf, wi.x, wi.y, wi.z, weight.x, weight.y, weight.z, density];
            let expected: [u32; ANSWERS] = expected.map(|x| x.get().to_bits());
            for (column, &scalar) in answers.chunks(POINTS).zip(&kernel.outputs) {
                different += usize::from(column[point] != expected[scalar as usize]);
            }
            for &(scalar, given) in &kernel.given {
                let word = match given {
                    Given::Word(word) => word,
                    Given::Input(input) => words[input as usize * POINTS + point],
                };
                different += usize::from(word != expected[scalar as usize]);
            }
        }
        assert_eq!((different, kernel.outputs.len() + kernel.given.len()), (0, ANSWERS), "{name}");
    }

    let counting = BsdfShader::load("counting.wgsl", COUNTING, []).unwrap_or_else(|error| panic!("{error}"));
    for (name, shader) in bsdfs().into_iter().chain([("counting.wgsl", counting)]) {
        let program = shader.program().unwrap_or_else(|error| panic!("{error}"));
        check(name, &shader, &program);
        // What depends on the point is computed once.
        let ([evaluate, sample], both) = (shader.operations(), program.code.instructions.len());
        assert!(name == "dust.wgsl" || both < evaluate + sample, "{name}: nothing is shared");
    }
}

/// A BSDF of a white diffuse surface, or of another, under a coat.
fn coated(evaluate: &str, coat: &str) -> BsdfShader {
    let text = format!(
        "struct State {{ at: Point }}
        fn prepare(at: Point) -> State {{ return State(at); }}
        fn evaluate(s: State, wo: vec3f, wi: vec3f) -> Lobe {{ {evaluate} }}
        fn sample(s: State, wo: vec3f, u: f32, u2: vec2f) -> Scattered {{
            let wi = cosine_hemisphere(u2);
            return scattered(wi, evaluate(s, wo, wi));
        }}
        fn clear_coat(at: Point) -> ClearCoat {{ return {coat}; }}"
    );
    BsdfShader::load("coated.wgsl", &text, []).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn coats_over_bsdfs_make_no_light_and_keep_reciprocity() {
    const WHITE: &str = "let pdf = cosine_hemisphere_pdf(wi.z); return Lobe(vec3f(pdf), pdf);";
    const DUST: &str = "let cosine = clamp(wi.z, 0.0, 1.0);
        return Lobe(vec3f(0.0795 * cosine / (wo.z + cosine)), cosine_hemisphere_pdf(wi.z));";
    for evaluate in [WHITE, DUST] {
        for coat in [
            "ClearCoat(1.0, 0.0, vec3f(1.0))",
            "ClearCoat(0.5, 0.3, vec3f(1.0))",
            "ClearCoat(2.0, 0.9, vec3f(0.9, 0.5, 3.0))",
            "ClearCoat(at.uv.x, at.uv.y, vec3f(at.uv, 1.0))",
        ] {
            let report = ScatteringSurface::new(coated(evaluate, coat)).measure();
            assert_eq!(report.faults, [], "{coat} over {evaluate}");
            assert!(report.albedo[1] < 1.0 + NOISE, "{coat} over {evaluate}: {:?}", report.albedo);
        }
    }
    let albedo = |coat| ScatteringSurface::new(coated(WHITE, coat)).measure().albedo;
    let [least, _] = albedo("ClearCoat(1.0, 0.0, vec3f(1.0))");
    assert!(least > 0.9, "{least}: a coat over white takes little");
    let [least, most] = albedo("ClearCoat(0.0, 0.0, vec3f(0.0))");
    assert!(least > 1.0 - NOISE && most < 1.0 + NOISE, "no coat: {least} to {most}");
    let [least, most] = albedo("ClearCoat(1.0, 0.2, vec3f(0.0))");
    assert!(least < 0.1 && most < 0.9, "a black coat only reflects: {least} to {most}");
}

/// A BSDF that is the native one of a finish.
fn native(finish: &str, ending: &str) -> Result<BsdfShader, String> {
    let text = format!(
        "struct State {{ finish: Finish }}
        fn prepare(at: Point) -> State {{ var f = matte(at); {finish} return State(f); }}
        fn evaluate(s: State, wo: vec3f, wi: vec3f) -> Lobe {{ return finish_evaluate(s.finish, wo, wi); }}
        fn sample(s: State, wo: vec3f, u: f32, u2: vec2f) -> Scattered {{
            return finish_sample(s.finish, wo, u, u2);
        }}
        {ending}"
    );
    BsdfShader::load("native.wgsl", &text, []).map_err(|error| error.to_string())
}

#[test]
fn native_bsdfs_are_called_and_break_no_promise() {
    for (finish, transmits) in [
        ("", false),
        ("f.roughness = 0.4; f.clearcoat = 1.0;", false),
        ("f.metallic = 0.7; f.roughness = at.uv.x;", false),
        ("f.sheen = vec3f(0.8, 0.4, 0.2); f.film = at.uv.y;", false),
        ("f.transmission = 0.8; f.roughness = 0.3;", true),
        ("f.diffuse_transmission = 0.5;", true),
        // What a BSDF has not is left out.
        ("f.opacity = 0.0; f.emission = vec3f(9.0); f.normal = vec3f(0.0); f.anisotropy = 1.0;", false),
    ] {
        let shader = native(finish, "").unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(Scattering::transmits(&shader), transmits, "{finish}");
        let report = ScatteringSurface::new(shader).measure();
        assert_eq!(report.faults, [], "{finish}");
        assert!(report.albedo[0] > 0.3 && report.albedo[1] < 1.0 + NOISE, "{finish}: {:?}", report.albedo);
    }
    let error = native("f.transmission = 1.0;", "const ior = 0.5;").expect_err("too low");
    assert!(error.contains("`ior` is 0.5") && error.contains("native.wgsl:7"), "{error}");
    // A constant of this name means nothing else.
    native("", "const ior = 0.5;").unwrap_or_else(|error| panic!("{error}"));
}

#[test]
fn native_bsdfs_are_given_any_direction() {
    let shader = native("f.roughness = 0.2;", "").unwrap_or_else(|error| panic!("{error}"));
    let (scene, l) = (Scene::default(), SingleLane);
    let at = point_at(&scene, [0.0; 3]);
    let vector = |numbers: [f32; 3]| {
        let [x, y, z] = numbers.map(|x| Num::splat(l, x));
        Vector::new(x, y, z)
    };
    for wo in [[0.0, 0.0, 1.0], [0.0; 3], [f32::NAN; 3], [0.0, 0.0, -1.0], [1e30, f32::INFINITY, 1.0]] {
        for wi in [[0.6, 0.0, 0.8], [f32::NAN, 0.0, 1.0], [f32::INFINITY; 3], [-1e30, 2.0, 1e30]] {
            let (value, pdf) = shader.evaluate(&at, vector(wo), vector(wi));
            assert!(value.x.get().is_finite() && pdf.get().is_finite(), "{wo:?}, {wi:?}");
        }
        let numbers = [f32::NAN, -1.0, 2.0].map(|x| Num::splat(l, x));
        let Scattered { weight, pdf, .. } =
            shader.sample(&at, vector(wo), numbers[0], [numbers[1], numbers[2]]);
        assert!(weight.x.get().is_finite() && pdf.get().is_finite(), "{wo:?}");
    }
}
