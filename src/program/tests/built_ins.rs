//! WGSL's own functions.

use super::patterns::finish_at;
use crate::program::PatternShader;

/// A pattern of an expression, with kernels in lanes and computed from its WGSL.
struct Computed {
    expression: String,
    shaders: [PatternShader; 2],
}

impl Computed {
    /// `x`, `y` and `z` are the position's components; the result is a number.
    fn new(definitions: &str, expression: &str) -> Self {
        // A number's bits are in three channels: what a finish holds is any number, but not any bits.
        let text = format!(
            "{definitions}\nfn pattern(at: Point) -> Finish {{ var f = matte(at); let x = at.position.x; \
             let y = at.position.y; let z = at.position.z; let b = bitcast<u32>({expression}); \
             f.colour = vec3f(f32(b & 0x7ffu), f32((b >> 11u) & 0x7ffu), f32(b >> 22u)); return f; }}"
        );
        let load = |natives| {
            PatternShader::load_with("test.wgsl", &text, [], natives)
                .unwrap_or_else(|error| panic!("{error}"))
        };
        Self { expression: expression.to_owned(), shaders: [true, false].map(load) }
    }

    fn at(&self, position: [f32; 3]) -> f32 {
        let [native, written] = self.shaders.each_ref().map(|shader| {
            let colour = finish_at(shader, position).colour;
            let [low, middle, high] = [colour.x, colour.y, colour.z].map(|part| part.get() as u32);
            low | (middle << 11) | (high << 22)
        });
        assert_eq!(native, written, "{} at {position:?}", self.expression);
        f32::from_bits(native)
    }
}

/// An expression's number at a position.
fn value(definitions: &str, expression: &str, position: [f32; 3]) -> f32 {
    Computed::new(definitions, expression).at(position)
}

type Reference = fn(f64) -> f64;

/// Functions of one number, where they are compared, and the greatest relative or absolute error.
const FUNCTIONS: [(&str, Reference, [f64; 2], f64); 20] = [
    ("sin", f64::sin, [-100.0, 100.0], 4e-6),
    ("cos", f64::cos, [-100.0, 100.0], 4e-6),
    ("tan", f64::tan, [-1.5, 1.5], 4e-6),
    ("asin", f64::asin, [-1.0, 1.0], 4e-6),
    ("acos", f64::acos, [-1.0, 1.0], 4e-6),
    ("atan", f64::atan, [-20.0, 20.0], 4e-6),
    ("sinh", f64::sinh, [-20.0, 20.0], 4e-6),
    ("cosh", f64::cosh, [-20.0, 20.0], 4e-6),
    ("tanh", f64::tanh, [-20.0, 20.0], 2e-6),
    ("asinh", f64::asinh, [-100.0, 100.0], 2e-6),
    ("acosh", f64::acosh, [1.0, 100.0], 4e-6),
    ("atanh", f64::atanh, [-0.99, 0.99], 4e-6),
    ("exp", f64::exp, [-20.0, 20.0], 4e-6),
    ("exp2", f64::exp2, [-20.0, 20.0], 4e-6),
    ("log", f64::ln, [0.01, 100.0], 4e-6),
    ("log2", f64::log2, [0.01, 100.0], 4e-6),
    ("sqrt", f64::sqrt, [0.0, 100.0], 1e-7),
    ("inverseSqrt", |x| 1.0 / x.sqrt(), [0.01, 100.0], 3e-7),
    ("degrees", f64::to_degrees, [-9.0, 9.0], 3e-7),
    ("radians", f64::to_radians, [-900.0, 900.0], 3e-7),
];

#[test]
fn functions_of_numbers_are_exact_enough() {
    for (name, reference, [low, high], most) in FUNCTIONS {
        let function = Computed::new("", &format!("{name}(x)"));
        for i in 0..=200 {
            let x = (low + (high - low) * f64::from(i) / 200.0) as f32;
            let (found, expected) = (function.at([x, 0.0, 0.0]), reference(f64::from(x)));
            let error = (f64::from(found) - expected).abs() / expected.abs().max(0.02);
            assert!(error <= most, "{name}({x}) = {found}, {expected} expected");
        }
    }
}

#[test]
fn functions_of_vectors_are_those_of_their_components() {
    let names = FUNCTIONS.iter().map(|(name, ..)| format!("{name}(V)"));
    let others =
        ["pow(V, V2)", "atan2(V, V2)", "ldexp(V, I)", "quantizeToF16(V)", "modf(V).fract", "frexp(V).fract"];
    for call in names.chain(others.map(str::to_owned)) {
        let with = |v: &str, v2: &str, i: &str| call.replace("V2", v2).replace('V', v).replace('I', i);
        let whole = with("vec3f(x, y, z)", "vec3f(y, z, x)", "vec3i(vec3f(x, y, z) * 9.0)");
        let parts = [["x", "y"], ["y", "z"], ["z", "x"]].map(|[a, b]| with(a, b, &format!("i32({a} * 9.0)")));
        for (component, part) in parts.iter().enumerate() {
            let (vector, single) =
                (Computed::new("", &format!("({whole})[{component}]")), Computed::new("", part));
            for position in [[0.3, 0.5, 0.9], [0.01, 0.99, 0.25]] {
                assert_eq!(vector.at(position).to_bits(), single.at(position).to_bits(), "{call}");
            }
        }
    }
}

/// Constant arguments, overrides and numbers that are known only at a point give the same bits.
#[test]
fn constants_have_the_bits_of_values() {
    let calls = FUNCTIONS.iter().map(|(name, ..)| format!("{name}(A)")).chain(
        [
            "pow(A, B)",
            "atan2(A, B)",
            "fma(A, B, C)",
            "mix(A, B, C)",
            "smoothstep(A, B, C)",
            "ldexp(A, 3)",
            "quantizeToF16(A)",
            "modf(A).fract",
            "frexp(A).fract",
            "length(vec2f(A, B))",
            "distance(vec2f(A, B), vec2f(C, A))",
            "normalize(vec3f(A, B, C)).y",
            "reflect(vec2f(A, B), vec2f(C, A)).x",
            "refract(vec2f(A, B), vec2f(C, A), B).x",
            "determinant(mat2x2f(A, B, C, A))",
        ]
        .map(str::to_owned),
    );
    let [a, b, c] = [0.1234567f32, 0.7654321, 0.4142135];
    for call in calls {
        let with =
            |names: [&str; 3]| call.replace('A', names[0]).replace('B', names[1]).replace('C', names[2]);
        let numbers = [a, b, c].map(|x| format!("{x:?}"));
        let literal = with([&numbers[0], &numbers[1], &numbers[2]]);
        let at_run_time = value("", &with(["x", "y", "z"]), [a, b, c]).to_bits();
        let found = |definitions: &str, expression: &str| value(definitions, expression, [a, b, c]).to_bits();
        assert_eq!(found("", &literal), at_run_time, "literal {call}");
        assert_eq!(found(&format!("const K = {literal};"), "K"), at_run_time, "const {call}");
        assert_eq!(
            found(&format!("const K: f32 = {literal}; const L = K;"), "L"),
            at_run_time,
            "const of const {call}"
        );
        assert_eq!(found(&format!("override K = {literal};"), "K"), at_run_time, "override {call}");
        assert_eq!(found(&format!("var<private> k = {literal};"), "k"), at_run_time, "variable {call}");
        let inside = format!("fn g() -> f32 {{ const k = {literal}; const l = k; return l; }}");
        assert_eq!(found(&inside, "g()"), at_run_time, "const of a function {call}");
    }
}

#[test]
fn parts_of_numbers_and_bits_are_those_of_the_standard() {
    let whole = |expression: &str, position: [f32; 3]| value("", &format!("f32({expression})"), position);
    for x in [0.0f32, 1.0, -1.5, 3.0e-3, 123456.0, 1.0e-40, -7.0e-42, f32::MAX, f32::MIN_POSITIVE] {
        let (fract, exp) = (value("", "frexp(x).fract", [x, 0.0, 0.0]), whole("frexp(x).exp", [x, 0.0, 0.0]));
        assert!(x == 0.0 || (0.5..1.0).contains(&fract.abs()), "{x}: {fract}");
        assert_eq!(f64::from(fract) * f64::from(exp).exp2(), f64::from(x), "{x}");
        assert_eq!(value("", "ldexp(frexp(x).fract, frexp(x).exp)", [x, 0.0, 0.0]), x);
        assert_eq!(value("", "modf(x).whole", [x, 0.0, 0.0]), x.trunc());
        assert_eq!(value("", "modf(x).fract", [x, 0.0, 0.0]), x - x.trunc());
    }
    let cases = [
        ("extractBits(0xabcdu, 4u, 8u)", 188.0),
        ("extractBits(0xabcdu, 40u, 8u)", 0.0),
        ("extractBits(-17i, 2u, 3u)", 3.0),
        ("extractBits(-1i, 0u, 32u)", -1.0),
        ("insertBits(0xffu, 0u, 2u, 3u)", 227.0),
        ("insertBits(1u, 7u, 8u, 0u)", 1.0),
        ("firstLeadingBit(40u)", 5.0),
        ("firstLeadingBit(-2i)", 0.0),
        ("firstLeadingBit(0i)", -1.0),
        ("firstTrailingBit(40i)", 3.0),
        ("firstTrailingBit(0i)", -1.0),
        ("determinant(mat3x3f(2.0, 0.0, 1.0, 1.0, 3.0, 0.0, 0.0, 1.0, 4.0))", 25.0),
        ("determinant(mat4x4f(2., 0., 0., 1., 0., 3., 0., 0., 0., 0., 4., 0., 1., 0., 0., 5.))", 108.0),
        ("dot4I8Packed(0xff02fe03u, 0x01020304u)", 9.0),
        ("dot4U8Packed(0x01020304u, 0x01010101u)", 10.0),
        ("pack4xU8Clamp(vec4u(300u, 1u, 2u, 0u)) & 0xffffu", 511.0),
        ("pack4xI8Clamp(vec4i(-300, 1, 2, 0)) & 0xffffu", 384.0),
        ("unpack4xI8(0x80ffu).y", -128.0),
    ];
    for (expression, expected) in cases {
        assert_eq!(whole(expression, [0.5, 0.25, 0.75]), expected, "{expression}");
    }
}

#[test]
fn packed_numbers_come_back() {
    for (pack, unpack, size, most) in [
        ("pack4x8snorm(vec4f(x, y, z, -x))", "unpack4x8snorm", 4, 0.5 / 127.0),
        ("pack4x8unorm(vec4f(x, y, z, 1.0))", "unpack4x8unorm", 3, 0.5 / 255.0),
        ("pack2x16snorm(vec2f(x, y))", "unpack2x16snorm", 2, 0.5 / 32767.0),
        ("pack2x16unorm(vec2f(x, y))", "unpack2x16unorm", 2, 0.5 / 65535.0),
        ("pack2x16float(vec2f(x, y))", "unpack2x16float", 2, 1.0 / 2048.0),
    ] {
        for component in 0..size {
            let computed = Computed::new("", &format!("{unpack}({pack})[{component}]"));
            for i in 0..50u8 {
                let x = f32::from(i) / 49.0;
                let position = [x, 1.0 - x * 0.5, 0.25 + x * 0.3];
                let expected = [position[0], position[1], position[2], -position[0]][component];
                let found = computed.at(position);
                assert!((found - expected).abs() <= most * 1.001, "{pack}[{component}]: {found} {expected}");
            }
        }
    }
}

/// All numbers of 16 bits, and those between.
#[test]
fn halves_are_the_nearest() {
    let half = |bits: u32| value("", &format!("unpack2x16float({bits}u).x"), [0.0; 3]);
    for (bits, expected) in
        [(0x3c00, 1.0), (0x0001, 5.9604645e-8), (0x7bff, 65504.0), (0xc000, -2.0), (0x0400, 6.1035156e-5)]
    {
        assert_eq!(half(bits), expected, "{bits:x}");
    }
    let quantized = |x: f32| value("", "quantizeToF16(x)", [x, 0.0, 0.0]);
    for (x, expected) in [
        (1.0 + 1.0 / 2048.0, 1.0),
        (1.0 + 3.0 / 2048.0, 1.0 + 2.0 / 1024.0),
        (65519.0, 65504.0),
        (65520.0, f32::INFINITY),
        (-3.0e-8, -5.9604645e-8),
        (2.9e-8, 0.0),
        (6.1e-5, 6.1035156e-5 - 5.9604645e-8 * 1.0),
    ] {
        let found = quantized(x);
        assert!(found == expected || (found - expected).abs() < 6e-8 && x < 1e-4, "{x}: {found} {expected}");
    }
}
