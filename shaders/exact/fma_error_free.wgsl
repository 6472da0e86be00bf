// A fused multiply-add of sums and products: what they round away is computed as well, and the last sum is rounded once
// because the one before it is rounded to odd (Boldo and Melquiond 2008, "Emulation of a FMA and correctly rounded
// sums"). Numbers outside the guards may lose bits below the least normal number, and are left to the host.

// 2 to the power -78.
const LEAST_PRODUCT: u32 = 0x18800000u;
// 2 to the power 115: larger numbers may overflow when they are split.
const GREATEST: u32 = 0x79000000u;
// 2 to the power 12, plus 1: splits 24 bits in two halves (Dekker 1971).
const SPLITTER: u32 = 0x45800800u;

// A sum, and what it has rounded away (Knuth).
fn two_sum(a: f32, b: f32) -> vec2<f32> {
    let sum = a + b;
    let part = sum - a;
    return vec2<f32>(sum, (a - (sum - part)) + (b - part));
}

// The upper half of a number's bits.
fn upper_half(a: f32) -> f32 {
    let scaled = a * bitcast<f32>(SPLITTER);
    return scaled - (scaled - a);
}

fn op_fma(a: u32, b: u32, c: u32) -> u32 {
    let size_a = a & MAGNITUDE;
    let size_b = b & MAGNITUDE;
    let size_c = c & MAGNITUDE;
    let x = bitcast<f32>(a);
    let y = bitcast<f32>(b);
    let product = x * y;
    let size = bitcast<u32>(product) & MAGNITUDE;
    let is_low = (min(size_a, size_b) < NEAR_ZERO) | (size < LEAST_PRODUCT) | is_near_zero(c);
    let is_high = max(max(size_a, size_b), max(size, size_c)) >= GREATEST;
    let has_product = min(size_a, size_b) != 0u;
    undecided = undecided | (has_product & (is_low | is_high));
    let high_x = upper_half(x);
    let high_y = upper_half(y);
    let low_x = x - high_x;
    let low_y = y - high_y;
    let cut = ((high_x * high_y - product) + high_x * low_y + low_x * high_y) + low_x * low_y;
    let inner = two_sum(bitcast<f32>(c), cut);
    let outer = two_sum(product, inner.x);
    let rest = two_sum(inner.y, outer.y);
    // Rounded to odd: one step towards what was cut, if the last bit is even.
    let even = bitcast<u32>(rest.x);
    let beyond = bitcast<u32>(rest.y);
    let next = select(even - 1u, even + 1u, ((beyond ^ even) & SIGN) == 0u);
    let odd = select(even, next, ((beyond & MAGNITUDE) != 0u) & ((even & 1u) == 0u));
    let sum = bitcast<u32>(outer.x + bitcast<f32>(odd));
    // A product of zero adds nothing but its sign to a zero.
    return select(select(c, (a ^ b) & c & SIGN, size_c == 0u), sum, has_product);
}
