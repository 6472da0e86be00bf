//! Kernels are valid and exact by their form, for every example and for control flow of all kinds.

use super::{FloatControls, Kernel, spirv};
use crate::program::PatternShader;

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

#[test]
fn kernels_have_no_operation_on_numbers_but_sums_differences_and_products() {
    let all = FloatControls { rounding: true, subnormals: true, special: true };
    for (name, shader) in examples() {
        for flushes in [false, true] {
            let kernel =
                Kernel::new(&shader.program(), flushes).unwrap_or_else(|error| panic!("{name}: {error}"));
            for controls in [FloatControls::default(), all] {
                let words = spirv(&kernel.source, controls);
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
