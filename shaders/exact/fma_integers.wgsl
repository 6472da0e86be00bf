// A fused multiply-add of 32-bit integers alone: the product in 48 bits and the third operand are added in 62 bits,
// what is shifted out leaves a bit behind, and the sum is rounded once, to nearest, ties to even.

// Shifts 64 bits to the right. The lowest bit remembers whether a bit was lost.
fn shifted(bits: vec2<u32>, by: u32) -> vec2<u32> {
    let is_far = by >= 32u;
    let near = select(bits, vec2<u32>(0u, bits.x), vec2<bool>(is_far));
    let rest = by & 31u;
    // Shifts by 32 in two steps where the rest is 0.
    let lost = select(0u, bits.y, is_far) | ((near.y << 1u) << (31u - rest));
    let low = (near.y >> rest) | ((near.x << 1u) << (31u - rest));
    let some = vec2<u32>(near.x >> rest, low | select(0u, 1u, lost != 0u));
    return select(some, vec2<u32>(0u, select(0u, 1u, (bits.x | bits.y) != 0u)), vec2<bool>(by >= 64u));
}

// The product of two significands of 24 bits, 14 bits up: between 2 to the powers 60 and 62.
fn wide_product(a: u32, b: u32) -> vec2<u32> {
    let low = (a & 0xfffu) * (b & 0xfffu);
    let middle = (a >> 12u) * (b & 0xfffu) + (a & 0xfffu) * (b >> 12u);
    let high = (a >> 12u) * (b >> 12u);
    let first = (middle << 12u) + low;
    let second = first + (high << 24u);
    let carries = select(0u, 1u, first < low) + select(0u, 1u, second < first);
    let upper = (high >> 8u) + (middle >> 20u) + carries;
    return vec2<u32>((upper << 14u) | (second >> 18u), second << 14u);
}

// Rounds a sum of 64 bits, not 0, whose lowest bit counts 2 to the power `exponent`.
fn round_sum(sign: u32, sum: vec2<u32>, exponent: i32) -> u32 {
    let is_short = sum.x == 0u;
    let long = select(sum, vec2<u32>(sum.y, 0u), vec2<bool>(is_short));
    let zeros = countLeadingZeros(long.x) & 31u;
    let bits = vec2<u32>((long.x << zeros) | ((long.y >> 1u) >> (31u - zeros)), long.y << zeros);
    let biased = exponent - i32(zeros) + select(190, 158, is_short);
    // Subnormal numbers lose more bits.
    let lost = u32(clamp(9 - biased, 8, 32));
    let is_all = lost == 32u;
    let kept = select(bits.x >> (lost & 31u), 0u, is_all);
    let cut = select(bits.x & ((1u << (lost & 31u)) - 1u), bits.x, is_all);
    let half = 1u << (lost - 1u);
    let up = (cut > half) | ((cut == half) & ((bits.y != 0u) | ((kept & 1u) == 1u)));
    let word = sign | ((u32(max(biased, 1) - 1) << 23u) + kept + select(0u, 1u, up));
    return select(select(word, sign | INFINITE, biased >= 255), sign, biased < -23);
}

fn op_fma(a: u32, b: u32, c: u32) -> u32 {
    let size_a = a & MAGNITUDE;
    let size_b = b & MAGNITUDE;
    let size_c = c & MAGNITUDE;
    let is_finite = max(max(size_a, size_b), size_c) < INFINITE;
    undecided = undecided | !is_finite;
    let sign = (a ^ b) & SIGN;
    let x = significand(size_a);
    let y = significand(size_b);
    let z = significand(size_c);
    let is_addend_zero = size_c == 0u;
    let product_exponent = i32(x.y) + i32(y.y) - 314;
    let addend = vec2<u32>(select(z.x << 6u, 0u, is_addend_zero), 0u);
    let addend_exponent = select(i32(z.y) - 188, product_exponent, is_addend_zero);
    let exponent = max(product_exponent, addend_exponent);
    let p = shifted(wide_product(x.x, y.x), u32(exponent - product_exponent));
    let q = shifted(addend, u32(exponent - addend_exponent));
    let low = p.y + q.y;
    let sum = vec2<u32>(p.x + q.x + select(0u, 1u, low < p.y), low);
    let is_less = (p.x < q.x) | ((p.x == q.x) & (p.y < q.y));
    let greater = select(p, q, vec2<bool>(is_less));
    let smaller = select(q, p, vec2<bool>(is_less));
    let borrow = select(0u, 1u, greater.y < smaller.y);
    let difference = vec2<u32>(greater.x - smaller.x - borrow, greater.y - smaller.y);
    let is_sum = sign == (c & SIGN);
    let total = select(difference, sum, vec2<bool>(is_sum));
    let rounded_sum = round_sum(select(sign, c & SIGN, is_less), total, exponent);
    let is_cancelled = (total.x | total.y) == 0u;
    let of_product = select(rounded_sum, 0u, is_cancelled);
    // A product of zero adds nothing but its sign to a zero.
    let of_addend = select(c, sign & c, is_addend_zero);
    let result = select(of_product, of_addend, min(size_a, size_b) == 0u);
    return select(NOT_A_NUMBER, result, is_finite);
}
