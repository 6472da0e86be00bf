// A fused multiply-add of 32-bit integers alone: the product in 48 bits and the third operand are added in 62 bits,
// what is shifted out leaves a bit behind, and the sum is rounded once, to nearest, ties to even.

// Shifts 64 bits to the right. The lowest bit remembers whether a bit was lost.
fn shifted(bits: vec2<u32>, by: u32) -> vec2<u32> {
    if (by == 0u) {
        return bits;
    }
    if (by >= 64u) {
        return vec2<u32>(0u, select(0u, 1u, (bits.x | bits.y) != 0u));
    }
    if (by >= 32u) {
        let rest = by - 32u;
        let lost = bits.y | select(0u, bits.x << (32u - rest), rest != 0u);
        return vec2<u32>(0u, (bits.x >> rest) | select(0u, 1u, lost != 0u));
    }
    let lost = bits.y << (32u - by);
    return vec2<u32>(bits.x >> by, (bits.y >> by) | (bits.x << (32u - by)) | select(0u, 1u, lost != 0u));
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
    var bits = sum;
    var scale = exponent;
    if (bits.x == 0u) {
        bits = vec2<u32>(bits.y, 0u);
        scale -= 32;
    }
    let zeros = countLeadingZeros(bits.x);
    if (zeros != 0u) {
        bits = vec2<u32>((bits.x << zeros) | (bits.y >> (32u - zeros)), bits.y << zeros);
    }
    let biased = scale - i32(zeros) + 190;
    if (biased >= 255) {
        return sign | INFINITE;
    }
    if (biased < -23) {
        return sign;
    }
    // Subnormal numbers lose more bits.
    let lost = u32(clamp(9 - biased, 8, 32));
    let is_all = lost == 32u;
    let kept = select(bits.x >> (lost & 31u), 0u, is_all);
    let cut = select(bits.x & ((1u << (lost & 31u)) - 1u), bits.x, is_all);
    let half = 1u << (lost - 1u);
    let up = cut > half || (cut == half && (bits.y != 0u || (kept & 1u) == 1u));
    return sign | ((u32(max(biased, 1) - 1) << 23u) + kept + select(0u, 1u, up));
}

fn op_fma(a: u32, b: u32, c: u32) -> u32 {
    let size_a = a & MAGNITUDE;
    let size_b = b & MAGNITUDE;
    let size_c = c & MAGNITUDE;
    if (max(max(size_a, size_b), size_c) >= INFINITE) {
        undecided = true;
        return NOT_A_NUMBER;
    }
    let sign = (a ^ b) & SIGN;
    if (size_a == 0u || size_b == 0u) {
        return select(c, sign & c, size_c == 0u);
    }
    let x = significand(size_a);
    let y = significand(size_b);
    let product_exponent = i32(x.y) + i32(y.y) - 314;
    var addend = vec2<u32>(0u);
    var addend_exponent = product_exponent;
    if (size_c != 0u) {
        let z = significand(size_c);
        addend.x = z.x << 6u;
        addend_exponent = i32(z.y) - 188;
    }
    let exponent = max(product_exponent, addend_exponent);
    let p = shifted(wide_product(x.x, y.x), u32(exponent - product_exponent));
    let q = shifted(addend, u32(exponent - addend_exponent));
    if (sign == (c & SIGN)) {
        let low = p.y + q.y;
        return round_sum(sign, vec2<u32>(p.x + q.x + select(0u, 1u, low < p.y), low), exponent);
    }
    let is_less = p.x < q.x || (p.x == q.x && p.y < q.y);
    let greater = select(p, q, is_less);
    let smaller = select(q, p, is_less);
    let borrow = select(0u, 1u, greater.y < smaller.y);
    let difference = vec2<u32>(greater.x - smaller.x - borrow, greater.y - smaller.y);
    if ((difference.x | difference.y) == 0u) {
        return 0u;
    }
    return round_sum(select(sign, c & SIGN, is_less), difference, exponent);
}
