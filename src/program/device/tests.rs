//! Kernels are valid and exact by their form, for every example and for control flow of all kinds.

use super::{Kernel, Program};
use crate::device::{Checks, FloatControls, Fma, spirv};
use crate::program::{BsdfShader, PatternShader};

/// Branches, loops, returns from within and arrays.
pub(crate) const FLOW: &str = "
    fn early(x: f32) -> f32 {
        for (var i = 0u; i < u32(abs(x)); i++) {
            if (f32(i) * 0.3 > x) { return f32(i); }
            if (i == 7u) { continue; }
            if (i > 40u) { break; }
        }
        return x * 0.5;
    }
    fn pattern(at: Point) -> Finish {
        var f = matte(at);
        var table = array<f32, 5>(0.1, 0.2, at.uv.x, 0.7, at.position.y);
        var x = at.position.x;
        loop {
            if (x > 100.0 || x < -1e6) { break; }
            x = x * 1.5 + 1.0;
            if (at.front) { x += 0.5; continue; }
            if (x < -50.0) { x = 200.0; }
        }
        switch (at.primitive % 4u) {
            case 0u: { f.colour.x = early(at.position.z); }
            case 1u, 3u: { f.colour.x = sqrt(abs(x)) / 11.0; if (x > 120.0) { break; } f.colour.y = round(x); }
            default: { f.colour.z = table[at.primitive >> 3u] % 0.13; }
        }
        table[at.primitive % 7u] = floor(x) - ceil(at.position.y) + trunc(at.position.z);
        f.roughness = table[2] + f32(i32(at.position.y * 1000.0)) + f32(u32(x) / (at.primitive % 3u));
        f.metallic = f32(i32(at.primitive) % i32(at.position.x)) * f32(countLeadingZeros(at.primitive));
        return f;
    }";

/// The examples under `scenes/shaders`.
pub(crate) fn examples() -> Vec<(&'static str, PatternShader)> {
    let load =
        |name, text| (name, PatternShader::load(name, text, []).unwrap_or_else(|error| panic!("{error}")));
    vec![
        load("wood.wgsl", include_str!("../../../scenes/shaders/wood.wgsl")),
        load("marble.wgsl", include_str!("../../../scenes/shaders/marble.wgsl")),
        load("brick.wgsl", include_str!("../../../scenes/shaders/brick.wgsl")),
        load("flow.wgsl", FLOW),
    ]
}

/// The BSDFs under `scenes/shaders`, and one with a loop and a way through.
pub(crate) fn bsdfs() -> Vec<(&'static str, BsdfShader)> {
    let load =
        |name, text| (name, BsdfShader::load(name, text, []).unwrap_or_else(|error| panic!("{error}")));
    vec![
        load("velvet.wgsl", include_str!("../../../scenes/shaders/velvet.wgsl")),
        load("dust.wgsl", include_str!("../../../scenes/shaders/dust.wgsl")),
        load("paper.wgsl", PAPER),
    ]
}

/// What devices compute of the examples.
pub(crate) fn programs() -> Vec<(&'static str, Program)> {
    let patterns = examples().into_iter().map(|(name, shader)| (name, shader.program()));
    let program = |shader: BsdfShader| shader.program().unwrap_or_else(|error| panic!("{error}"));
    patterns.chain(bsdfs().into_iter().map(|(name, shader)| (name, program(shader)))).collect()
}

/// Paper of uneven layers that let some light through.
const PAPER: &str = "
    const transmits = true;
    struct State { share: f32 }
    fn prepare(at: Point) -> State {
        var share = 1.0;
        for (var i = 0u; i < u32(abs(at.position.x) * 3.0) % 9u; i++) {
            share *= 0.7 + 0.3 * noise(at.position * f32(i + 1u));
        }
        return State(share);
    }
    fn evaluate(s: State, wo: vec3f, wi: vec3f) -> Lobe {
        let pdf = abs(wi.z) * 0.15915494;
        let through = select(1.0 - s.share, s.share, wi.z < 0.0);
        return Lobe(vec3f(0.9, 0.85, 0.7) * through * pdf * 2.0, pdf);
    }
    fn sample(s: State, wo: vec3f, u: f32, u2: vec2f) -> Scattered {
        var wi = cosine_hemisphere(u2);
        if (u < 0.5) { wi.z = -wi.z; }
        return scattered(wi, evaluate(s, wo, wi));
    }";

#[test]
fn kernels_have_no_operation_on_numbers_but_sums_differences_and_products() {
    let all = FloatControls { rounding: true, subnormals: true, special: true };
    for (name, program) in programs() {
        for flushes in [false, true] {
            let kernel = Kernel::new(&program, flushes).unwrap_or_else(|error| panic!("{name}: {error}"));
            for controls in [FloatControls::default(), all] {
                let words = spirv(&kernel.source, None, controls, Fma::Refused, Checks::Kept);
                let words = words.unwrap_or_else(|error| panic!("{name}: {error}\n{}", kernel.source));
                assert!(words.len() > 1000);
            }
            assert!(!kernel.inputs.is_empty() && !kernel.outputs.is_empty() && kernel.probes.len() > 10);
        }
    }
}

#[test]
fn long_programs_are_refused_with_their_length() {
    // Each turn is lowered by itself.
    let lines: String = (0..40).map(|i| format!("x = x * 1.1 + f32(i) * {i}.5;\n")).collect();
    let text = format!(
        "fn pattern(at: Point) -> Finish {{
            var f = matte(at);
            var x = at.position.x;
            for (var i = 0u; i < 90u; i++) {{ {lines} }}
            for (var i = 0u; i < 90u; i++) {{ {lines} }}
            for (var i = 0u; i < 90u; i++) {{ {lines} }}
            for (var i = 0u; i < 90u; i++) {{ {lines} }}
            for (var i = 0u; i < 90u; i++) {{ {lines} }}
            for (var i = 0u; i < 90u; i++) {{ {lines} }}
            f.roughness = x;
            return f;
        }}"
    );
    let shader = PatternShader::load("long.wgsl", &text, []).unwrap_or_else(|error| panic!("{error}"));
    let Err(refusal) = Kernel::new(&shader.program(), false) else { panic!("too long") };
    assert!(refusal.contains("too many for a device"), "{refusal}");
}
