// The operations of programs, on words. Of floating-point arithmetic only sums, differences and products are the
// device's own; all else is integers, so that it cannot be rounded, flushed or reordered.

const SIGN: u32 = 0x80000000u;
const MAGNITUDE: u32 = 0x7fffffffu;
const INFINITE: u32 = 0x7f800000u;
const NOT_A_NUMBER: u32 = 0x7fc00000u;
const ONE: u32 = 0x3f800000u;

// 2 to the power -100: smaller numbers may lead to subnormal ones.
const NEAR_ZERO: u32 = 0x0d800000u;

// The most turns that all loops of a program take together.
const MOST_TURNS: u32 = 16384u;

// Whether the host has to compute the point.
var<private> undecided: bool;

// Turns that loops have taken.
var<private> turns: u32;

fn truth(x: bool) -> u32 {
    return select(0u, 0xffffffffu, x);
}

fn is_nan(a: u32) -> bool {
    return (a & MAGNITUDE) > INFINITE;
}

fn is_near_zero(a: u32) -> bool {
    let magnitude = a & MAGNITUDE;
    return magnitude != 0u && magnitude < NEAR_ZERO;
}

// Notes operands and results that a device may treat otherwise than the host.
fn noted(a: u32, b: u32, result: u32) -> u32 {
    if (max(max(a & MAGNITUDE, b & MAGNITUDE), result & MAGNITUDE) >= INFINITE) {
        undecided = true;
    }
    if (FLUSHES && (is_near_zero(a) || is_near_zero(b) || is_near_zero(result))) {
        undecided = true;
    }
    return result;
}

fn op_add(a: u32, b: u32) -> u32 {
    return noted(a, b, bitcast<u32>(bitcast<f32>(a) + bitcast<f32>(b)));
}

fn op_sub(a: u32, b: u32) -> u32 {
    return noted(a, b, bitcast<u32>(bitcast<f32>(a) - bitcast<f32>(b)));
}

fn op_mul(a: u32, b: u32) -> u32 {
    let result = bitcast<u32>(bitcast<f32>(a) * bitcast<f32>(b));
    if (FLUSHES && (result & MAGNITUDE) == 0u && (a & MAGNITUDE) != 0u && (b & MAGNITUDE) != 0u) {
        undecided = true;
    }
    return noted(a, b, result);
}

// A number above zero as a significand of 24 bits and the exponent of its last bit plus 150.
fn significand(magnitude: u32) -> vec2u {
    if (magnitude < 0x800000u) {
        let shift = countLeadingZeros(magnitude) - 8u;
        return vec2u(magnitude << shift, 1u - shift);
    }
    return vec2u((magnitude & 0x7fffffu) | 0x800000u, magnitude >> 23u);
}

// Divides significands eight bits at a time: each remainder is below the divisor, hence below 2 to the power 24.
fn op_div(a: u32, b: u32) -> u32 {
    let sign = (a ^ b) & SIGN;
    let x = a & MAGNITUDE;
    let y = b & MAGNITUDE;
    if (x > INFINITE || y > INFINITE || (x == INFINITE && y == INFINITE) || (x == 0u && y == 0u)) {
        undecided = true;
        return NOT_A_NUMBER;
    }
    if (x == INFINITE || y == 0u) {
        return sign | INFINITE;
    }
    if (x == 0u || y == INFINITE) {
        return sign;
    }
    let above = significand(x);
    let below = significand(y);
    var exponent = i32(above.y) - i32(below.y) + 127;
    var rest = above.x;
    if (rest < below.x) {
        rest = rest << 1u;
        exponent -= 1;
    }
    rest -= below.x;
    // 25 bits: the significand of the quotient and one more.
    var quotient = 1u;
    for (var digit = 0u; digit < 3u; digit++) {
        rest = rest << 8u;
        let part = rest / below.x;
        rest -= part * below.x;
        quotient = (quotient << 8u) | part;
    }
    // Subnormal quotients lose more bits; beyond 26 all of them.
    let lost = u32(clamp(2 - exponent, 1, 27));
    let kept = quotient >> lost;
    let cut = quotient & ((1u << lost) - 1u);
    let half = 1u << (lost - 1u);
    let up = cut > half || (cut == half && (rest != 0u || (kept & 1u) == 1u));
    let word = (u32(max(exponent, 1) - 1) << 23u) + kept + select(0u, 1u, up);
    return sign | min(word, INFINITE);
}

// The root's bits one by one; the remainder stays below 2 to the power 28.
fn op_sqrt(a: u32) -> u32 {
    let x = a & MAGNITUDE;
    if (x == 0u || a == INFINITE) {
        return a;
    }
    if (x > INFINITE || a != x) {
        undecided = true;
        return NOT_A_NUMBER;
    }
    let parts = significand(x);
    let exponent = i32(parts.y) - 150;
    let odd = u32(exponent & 1);
    let radicand = parts.x << (2u - odd);
    let even = exponent - 2 + i32(odd);
    var rest = 0u;
    var root = 0u;
    for (var bit = 0u; bit < 25u; bit++) {
        let pair = select(0u, (radicand >> (24u - 2u * min(bit, 12u))) & 3u, bit < 13u);
        rest = (rest << 2u) | pair;
        let trial = (root << 2u) | 1u;
        let fits = rest >= trial;
        rest = select(rest, rest - trial, fits);
        root = (root << 1u) | select(0u, 1u, fits);
    }
    let kept = root >> 1u;
    let up = (root & 1u) == 1u && (rest != 0u || (kept & 1u) == 1u);
    return (u32(138 + (even >> 1u)) << 23u) + kept + select(0u, 1u, up);
}

fn op_trunc(a: u32) -> u32 {
    let x = a & MAGNITUDE;
    if (x > INFINITE) {
        undecided = true;
    }
    if (x < ONE) {
        return a & SIGN;
    }
    if (x >= 0x4b000000u) {
        return a;
    }
    return a & ~((1u << (150u - (x >> 23u))) - 1u);
}

fn op_floor(a: u32) -> u32 {
    let whole = op_trunc(a);
    if ((a & SIGN) != 0u && whole != a) {
        return op_sub(whole, ONE);
    }
    return whole;
}

fn op_ceil(a: u32) -> u32 {
    return op_floor(a ^ SIGN) ^ SIGN;
}

fn op_round(a: u32) -> u32 {
    let x = a & MAGNITUDE;
    if (x > INFINITE) {
        undecided = true;
    }
    if (x < ONE) {
        return (a & SIGN) | select(0u, ONE, x > 0x3f000000u);
    }
    if (x >= 0x4b000000u) {
        return a;
    }
    let lost = 150u - (x >> 23u);
    let half = 1u << (lost - 1u);
    return (a & SIGN) | ((x + (half - 1u) + ((x >> lost) & 1u)) & ~((1u << lost) - 1u));
}

// Integers in the order of the numbers; both zeros are 0.
fn rank(a: u32) -> i32 {
    let magnitude = i32(a & MAGNITUDE);
    return select(magnitude, -magnitude, (a & SIGN) != 0u);
}

fn is_less(a: u32, b: u32) -> bool {
    return rank(a) < rank(b) && !is_nan(a) && !is_nan(b);
}

fn op_less(a: u32, b: u32) -> u32 {
    return truth(is_less(a, b));
}

fn op_less_equal(a: u32, b: u32) -> u32 {
    return truth(rank(a) <= rank(b) && !is_nan(a) && !is_nan(b));
}

fn op_equal(a: u32, b: u32) -> u32 {
    return truth(rank(a) == rank(b) && !is_nan(a) && !is_nan(b));
}

fn op_min(a: u32, b: u32) -> u32 {
    return select(b, a, is_less(a, b));
}

fn op_max(a: u32, b: u32) -> u32 {
    return select(b, a, is_less(b, a));
}

fn op_div_uint(a: u32, b: u32) -> u32 {
    return a / b;
}

fn op_rem_uint(a: u32, b: u32) -> u32 {
    return a % b;
}

fn op_div_sint(a: u32, b: u32) -> u32 {
    return bitcast<u32>(bitcast<i32>(a) / bitcast<i32>(b));
}

fn op_rem_sint(a: u32, b: u32) -> u32 {
    return bitcast<u32>(bitcast<i32>(a) % bitcast<i32>(b));
}

fn op_uint_to_number(a: u32) -> u32 {
    if (a == 0u) {
        return 0u;
    }
    let zeros = countLeadingZeros(a);
    let high = a << zeros;
    let kept = high >> 8u;
    let cut = high & 0xffu;
    let up = cut > 0x80u || (cut == 0x80u && (kept & 1u) == 1u);
    return ((157u - zeros) << 23u) + kept + select(0u, 1u, up);
}

fn op_sint_to_number(a: u32) -> u32 {
    if ((a & SIGN) == 0u) {
        return op_uint_to_number(a);
    }
    return SIGN | op_uint_to_number(0u - a);
}

// The whole part of a magnitude below 2 to the power 32.
fn whole_part(x: u32) -> u32 {
    let exponent = x >> 23u;
    if (exponent < 127u) {
        return 0u;
    }
    let bits = (x & 0x7fffffu) | 0x800000u;
    if (exponent < 150u) {
        return bits >> (150u - exponent);
    }
    return bits << (exponent - 150u);
}

fn op_number_to_uint(a: u32) -> u32 {
    if (is_nan(a) || (a & SIGN) != 0u) {
        return 0u;
    }
    if (a >= 0x4f800000u) {
        return 0xffffffffu;
    }
    return whole_part(a);
}

fn op_number_to_sint(a: u32) -> u32 {
    let x = a & MAGNITUDE;
    if (x > INFINITE) {
        return 0u;
    }
    if (x >= 0x4f000000u) {
        return select(0x7fffffffu, 0x80000000u, a != x);
    }
    let whole = whole_part(x);
    return select(whole, 0u - whole, a != x);
}
