// Built-in functions of WGSL whose precision the language leaves to the device, and those that are made of several
// operations. `sin(x)` is computed as `sin_of(x)`, of a vector component by component, with the same bits everywhere.

// 1, unknown while a file is parsed: the parser leaves alone what is multiplied by it.
override unfolded: f32 = 1.0;

fn small_sin(x: f32) -> f32 {
    let x2 = x * x;
    let series = ((x2 * (1.0f / 362880.0f) - 1.0f / 5040.0f) * x2 + 1.0f / 120.0f) * x2 - 1.0f / 6.0f;
    return x + x * x2 * series;
}

fn small_cos(x: f32) -> f32 {
    let x2 = x * x;
    let series = (((x2 * (-1.0f / 3628800.0f) + 1.0f / 40320.0f) * x2 - 1.0f / 720.0f) * x2 + 1.0f / 24.0f) * x2 - 0.5;
    return 1.0 + x2 * series;
}

// The rest of an angle in radians beside whole quarter turns, and the number of quarters modulo 4.
fn quarters(angle: f32) -> vec2f {
    let whole = floor(angle * 0.63661975 + 0.5);
    let rest = angle - whole * 1.5703125 - whole * 4.837513e-4 - whole * 7.54979e-8;
    return vec2f(clamp(rest, -0.8, 0.8), clamp(whole - floor(whole * 0.25) * 4.0, 0.0, 3.0));
}

// Sine of an angle in radians.
fn sin_of(angle: f32) -> f32 {
    let parts = quarters(angle);
    let quadrant = u32(parts.y);
    let sine = select(small_sin(parts.x), small_cos(parts.x), (quadrant & 1u) == 1u);
    return select(sine, -sine, (quadrant & 2u) == 2u);
}

// Cosine of an angle in radians.
fn cos_of(angle: f32) -> f32 {
    let parts = quarters(angle);
    let quadrant = u32(parts.y);
    let cosine = select(small_cos(parts.x), small_sin(parts.x), (quadrant & 1u) == 1u);
    return select(cosine, -cosine, ((quadrant + 1u) & 2u) == 2u);
}

fn tan_of(angle: f32) -> f32 {
    return sin_of(angle) / cos_of(angle);
}

// Angle of the point (x, y) in radians, -pi to pi; 0 at the origin.
fn atan2_of(y: f32, x: f32) -> f32 {
    let ax = abs(x);
    let ay = abs(y);
    let low = min(ax, ay);
    let high = max(ax, ay);
    let upper = low * (1.0f + 1.4142135f) > high;
    let top = select(low, low - high, upper);
    let bottom = select(high, low + high, upper);
    let t = select(bottom, top / bottom, bottom > 0.0);
    let t2 = t * t;
    let series = ((t2 * 0.08059808 - 0.13879707) * t2 + 0.19977914) * t2 - 0.33332955;
    let angle = t + t * t2 * series;
    let octant = select(angle, angle + 0.7853982, upper);
    let turns = octant * (0.5 * 0.31830987);
    let quadrant = select(turns, 0.25 - turns, ay > ax);
    let half = select(quadrant, 0.5 - quadrant, x < 0.0);
    let signed = bitcast<f32>((bitcast<u32>(half) & 0x7fffffffu) | (bitcast<u32>(y) & 0x80000000u));
    return signed * TAU;
}

fn atan_of(x: f32) -> f32 {
    return atan2_of(x, 1.0);
}

// 2 to the power x; 0 below -126, and above 126 the value at 126.
fn exp2_of(x: f32) -> f32 {
    let held = clamp(x, -126.0, 126.0);
    let whole = floor(held + 0.5);
    let f = (held - whole) * 0.6931472;
    let tail = ((f * (1.0f / 5040.0f) + 1.0f / 720.0f) * f + 1.0f / 120.0f) * f + 1.0f / 24.0f;
    let series = (((tail * f + 1.0f / 6.0f) * f + 0.5) * f + 1.0) * f + 1.0;
    let power = bitcast<f32>(u32(whole + 127.0) << 23u);
    return select(0.0, series * power, x >= -126.0);
}

fn exp_of(x: f32) -> f32 {
    return exp2_of(x * 1.442695);
}

// The logarithm to base 2 of a positive number.
fn log2_of(x: f32) -> f32 {
    let bits = bitcast<u32>(x);
    let exponent = f32(bits >> 23u) - 127.0;
    let mantissa = bitcast<f32>((bits & 0x7fffffu) + 0x3f800000u);
    let upper = mantissa > 1.4142135;
    let m = select(mantissa, mantissa * 0.5, upper);
    let power = select(exponent, exponent + 1.0, upper);
    let s = (m - 1.0) / (m + 1.0);
    let s2 = s * s;
    let series = (((s2 * (1.0f / 9.0f) + 1.0f / 7.0f) * s2 + 0.2) * s2 + 1.0f / 3.0f) * s2 + 1.0;
    return power + s * series * (2.0 * 1.442695);
}

fn log_of(x: f32) -> f32 {
    return log2_of(x) * 0.6931472;
}

// base to a power; a base of at most 1.17549435e-38 gives 0.
fn pow_of(base: f32, power: f32) -> f32 {
    let some = base > 1.17549435e-38;
    return select(0.0, exp2_of(power * log2_of(select(1.0, base, some))), some);
}

// Angle whose sine is x, held between -1 and 1.
fn asin_of(x: f32) -> f32 {
    return atan2_of(x, sqrt(max((1.0 - x) * (1.0 + x), 0.0)));
}

// Angle whose cosine is x, held between -1 and 1.
fn acos_of(x: f32) -> f32 {
    return atan2_of(sqrt(max((1.0 - x) * (1.0 + x), 0.0)), x);
}

fn sinh_of(x: f32) -> f32 {
    let x2 = x * x;
    let tail = ((x2 * (1.0f / 362880.0f) + 1.0f / 5040.0f) * x2 + 1.0f / 120.0f) * x2 + 1.0f / 6.0f;
    let small = x + x * x2 * tail;
    let large = (exp_of(x) - exp_of(-x)) * 0.5;
    return select(large, small, x2 < 1.0);
}

fn cosh_of(x: f32) -> f32 {
    return (exp_of(x) + exp_of(-x)) * 0.5;
}

fn tanh_of(x: f32) -> f32 {
    let held = clamp(x, -10.0, 10.0);
    return sinh_of(held) / cosh_of(held);
}

fn asinh_of(x: f32) -> f32 {
    let x2 = x * x;
    let ax = abs(x);
    let tail = ((x2 * (35.0f / 1152.0f) - 5.0f / 112.0f) * x2 + 3.0f / 40.0f) * x2 - 1.0f / 6.0f;
    let small = ax + ax * x2 * tail;
    let middle = log_of(ax + sqrt(x2 + 1.0));
    let large = log_of(ax) + 0.6931472;
    let size = select(select(middle, large, ax > 1e9), small, x2 < 0.04);
    return select(size, -size, x < 0.0);
}

// The positive number whose hyperbolic cosine is x; 0 below 1.
fn acosh_of(x: f32) -> f32 {
    let middle = asinh_of(sqrt(max((x - 1.0) * (x + 1.0), 0.0)));
    return select(middle, log_of(x) + 0.6931472, x > 1e9);
}

// The number whose hyperbolic tangent is x, which lies between -1 and 1.
fn atanh_of(x: f32) -> f32 {
    let x2 = x * x;
    let tail = (((x2 * (1.0f / 11.0f) + 1.0f / 9.0f) * x2 + 1.0f / 7.0f) * x2 + 0.2) * x2 + 1.0f / 3.0f;
    let small = x + x * x2 * tail;
    let large = 0.5 * log_of((1.0 + x) / (1.0 - x));
    return select(large, small, x2 < 0.04);
}

// 2 to a power between -126 and 127.
fn power_of_two(power: i32) -> f32 {
    return bitcast<f32>(u32(clamp(power, -126, 127) + 127) << 23u);
}

// x * 2^power
fn ldexp_of(x: f32, power: i32) -> f32 {
    let held = clamp(power, -300, 300);
    let third = held / 3;
    let part = power_of_two(third);
    return x * part * part * power_of_two(held - third - third);
}

// The exponent e of a number m * 2^e with 0.5 <= |m| < 1; 0 for zeros, infinities and NaN.
fn exponent_of(x: f32) -> i32 {
    let is_small = abs(x) < 1.17549435e-38;
    let exponent = i32((bitcast<u32>(select(x, x * 16777216.0, is_small)) >> 23u) & 0xffu);
    let is_number = x != 0.0 && (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
    return select(0, exponent - select(126, 150, is_small), is_number);
}

// The part m of a number m * 2^e with 0.5 <= |m| < 1; x for zeros, infinities and NaN.
fn mantissa_of(x: f32) -> f32 {
    let bits = bitcast<u32>(select(x, x * 16777216.0, abs(x) < 1.17549435e-38));
    let is_number = x != 0.0 && (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
    return select(x, bitcast<f32>((bits & 0x807fffffu) | 0x3f000000u), is_number);
}

fn low_bits(count: u32) -> u32 {
    return select((1u << (count & 31u)) - 1u, 0xffffffffu, count > 31u);
}

fn extract_unsigned_of(bits: u32, offset: u32, count: u32) -> u32 {
    let start = min(offset, 32u);
    let width = min(count, 32u - start);
    return select((bits >> (start & 31u)) & low_bits(width), 0u, width == 0u);
}

fn extract_signed_of(bits: u32, offset: u32, count: u32) -> u32 {
    let start = min(offset, 32u);
    let width = min(count, 32u - start);
    let unused = (32u - width) & 31u;
    let high = bitcast<i32>(extract_unsigned_of(bits, offset, count) << unused);
    return select(bitcast<u32>(high >> unused), 0u, width == 0u);
}

fn insert_of(bits: u32, added: u32, offset: u32, count: u32) -> u32 {
    let start = min(offset, 32u);
    let width = min(count, 32u - start);
    let mask = select(low_bits(width) << (start & 31u), 0u, width == 0u);
    return (bits & ~mask) | ((added << (start & 31u)) & mask);
}

// The place of the highest bit that is 1, from 0; -1 if there is none.
fn first_leading_unsigned_of(bits: u32) -> u32 {
    return 31u - countLeadingZeros(bits);
}

// The place of the highest bit that differs from the sign, from 0; -1 if there is none.
fn first_leading_signed_of(bits: u32) -> u32 {
    return 31u - countLeadingZeros(bits ^ bitcast<u32>(bitcast<i32>(bits) >> 31u));
}

// The place of the lowest bit that is 1, from 0; -1 if there is none.
fn first_trailing_of(bits: u32) -> u32 {
    return select(countTrailingZeros(bits), 0xffffffffu, bits == 0u);
}

fn signed_byte(bits: u32, place: u32) -> i32 {
    return bitcast<i32>(bits << (24u - 8u * place)) >> 24u;
}

fn pack4x8snorm_of(v: vec4f) -> u32 {
    let whole = bitcast<vec4u>(vec4i(floor(clamp(v, vec4f(-1.0), vec4f(1.0)) * 127.0 + 0.5))) & vec4u(0xffu);
    return whole.x | (whole.y << 8u) | (whole.z << 16u) | (whole.w << 24u);
}

fn pack4x8unorm_of(v: vec4f) -> u32 {
    let whole = vec4u(floor(clamp(v, vec4f(0.0), vec4f(1.0)) * 255.0 + 0.5));
    return whole.x | (whole.y << 8u) | (whole.z << 16u) | (whole.w << 24u);
}

fn pack2x16snorm_of(v: vec2f) -> u32 {
    let whole = bitcast<vec2u>(vec2i(floor(clamp(v, vec2f(-1.0), vec2f(1.0)) * 32767.0 + 0.5))) & vec2u(0xffffu);
    return whole.x | (whole.y << 16u);
}

fn pack2x16unorm_of(v: vec2f) -> u32 {
    let whole = vec2u(floor(clamp(v, vec2f(0.0), vec2f(1.0)) * 65535.0 + 0.5));
    return whole.x | (whole.y << 16u);
}

// The bits of the nearest 16-bit number, ties to even.
fn half_of(x: f32) -> u32 {
    let size = bitcast<u32>(x) & 0x7fffffffu;
    let normal = (size + 0xfffu + ((size >> 13u) & 1u) - 0x38000000u) >> 13u;
    let small = u32(round(abs(x) * 16777216.0));
    let finite = select(normal, small, size < 0x38800000u);
    let held = select(finite, 0x7c00u, size >= 0x477ff000u);
    let bits = select(held, 0x7e00u, size > 0x7f800000u);
    return bits | ((bitcast<u32>(x) >> 16u) & 0x8000u);
}

// The number of 16 bits.
fn from_half(bits: u32) -> f32 {
    let exponent = (bits >> 10u) & 31u;
    let mantissa = bits & 0x3ffu;
    let normal = bitcast<f32>(((exponent + 112u) << 23u) | (mantissa << 13u));
    let small = f32(mantissa) * (1.0f / 16777216.0f);
    let finite = select(normal, small, exponent == 0u);
    let size = select(finite, bitcast<f32>(0x7f800000u | (mantissa << 13u)), exponent == 31u);
    return bitcast<f32>(bitcast<u32>(size) | ((bits & 0x8000u) << 16u));
}

fn pack2x16float_of(v: vec2f) -> u32 {
    return half_of(v.x) | (half_of(v.y) << 16u);
}

fn quantize_to_half_of(x: f32) -> f32 {
    return from_half(half_of(x));
}

fn pack4x_integer_of(v: vec4u) -> u32 {
    let low = v & vec4u(0xffu);
    return low.x | (low.y << 8u) | (low.z << 16u) | (low.w << 24u);
}

fn pack4x_signed_clamp_of(v: vec4i) -> u32 {
    return pack4x_integer_of(bitcast<vec4u>(clamp(v, vec4i(-128), vec4i(127))));
}

fn pack4x_unsigned_clamp_of(v: vec4u) -> u32 {
    return pack4x_integer_of(min(v, vec4u(255u)));
}

fn unpack4x_signed_of(bits: u32) -> vec4i {
    return vec4i(signed_byte(bits, 0u), signed_byte(bits, 1u), signed_byte(bits, 2u), signed_byte(bits, 3u));
}

fn unpack4x_unsigned_of(bits: u32) -> vec4u {
    return vec4u(bits, bits >> 8u, bits >> 16u, bits >> 24u) & vec4u(0xffu);
}

fn unpack4x8snorm_of(bits: u32) -> vec4f {
    return max(vec4f(unpack4x_signed_of(bits)) / 127.0, vec4f(-1.0));
}

fn unpack4x8unorm_of(bits: u32) -> vec4f {
    return vec4f(unpack4x_unsigned_of(bits)) / 255.0;
}

fn unpack2x16snorm_of(bits: u32) -> vec2f {
    let signed = vec2i(bitcast<i32>(bits << 16u) >> 16u, bitcast<i32>(bits) >> 16u);
    return max(vec2f(signed) / 32767.0, vec2f(-1.0));
}

fn unpack2x16unorm_of(bits: u32) -> vec2f {
    return vec2f(vec2u(bits & 0xffffu, bits >> 16u)) / 65535.0;
}

fn unpack2x16float_of(bits: u32) -> vec2f {
    return vec2f(from_half(bits & 0xffffu), from_half(bits >> 16u));
}

fn dot4_signed_of(a: u32, b: u32) -> i32 {
    let products = unpack4x_signed_of(a) * unpack4x_signed_of(b);
    return products.x + products.y + products.z + products.w;
}

fn dot4_unsigned_of(a: u32, b: u32) -> u32 {
    let products = unpack4x_unsigned_of(a) * unpack4x_unsigned_of(b);
    return products.x + products.y + products.z + products.w;
}
