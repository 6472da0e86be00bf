// The alpha test on words, with the host's operations in the host's order (`bvh::AlphaTable` says which).
//
// `alpha_words` (`trace/gpu/alpha.rs`): the first words of its parts; a row for each primitive; the masked triangles,
// their materials, the values of bytes, and texels, four in a word.

const TWO: u32 = 0x40000000u;
const HALF: u32 = 0x3f000000u;
const THIRD: u32 = 0x3eaaaaabu;
// 2 to the power -24.
const UNIT_OF_CHANCE: u32 = 0x33800000u;

// A masked triangle: texture coordinates and alphas of its corners.
struct AlphaTriangle {
    u: vec3<u32>,
    v: vec3<u32>,
    alpha: vec3<u32>,
    material: u32,
}

struct AlphaMaterial {
    // HAS_CUTOFF, HAS_VERTICES, HAS_TEXTURE, HAS_THREE, IS_TURNED; addressing in bits 8 and 9, and 10 and 11.
    kind: u32,
    cutoff: u32,
    factor: u32,
    width: u32,
    height: u32,
    scale_u: u32,
    scale_v: u32,
    sine: u32,
    cosine: u32,
    offset_u: u32,
    offset_v: u32,
    // The first texel, counted from the first of all images.
    texel: u32,
    // The first of 256 values, counted from that of the first byte.
    value: u32,
}

fn alpha_triangle(index: u32) -> AlphaTriangle {
    let at = alpha_words[0] + index * ALPHA_TRIANGLE_WORDS;
    return AlphaTriangle(
        vec3<u32>(alpha_words[at], alpha_words[at + 1u], alpha_words[at + 2u]),
        vec3<u32>(alpha_words[at + 3u], alpha_words[at + 4u], alpha_words[at + 5u]),
        vec3<u32>(alpha_words[at + 6u], alpha_words[at + 7u], alpha_words[at + 8u]),
        alpha_words[at + 9u],
    );
}

fn alpha_material(index: u32) -> AlphaMaterial {
    let at = alpha_words[1] + index * ALPHA_MATERIAL_WORDS;
    return AlphaMaterial(
        alpha_words[at], alpha_words[at + 1u], alpha_words[at + 2u], alpha_words[at + 3u], alpha_words[at + 4u],
        alpha_words[at + 5u], alpha_words[at + 6u], alpha_words[at + 7u], alpha_words[at + 8u], alpha_words[at + 9u],
        alpha_words[at + 10u], alpha_words[at + 11u], alpha_words[at + 12u],
    );
}

// A texel's value.
fn alpha_texel(material: AlphaMaterial, index: u32) -> u32 {
    let texel = material.texel + index;
    let byte = (alpha_words[alpha_words[3] + (texel >> 2u)] >> (8u * (texel & 3u))) & 0xffu;
    return alpha_words[alpha_words[2] + material.value + byte];
}

// A corner's values by their weights.
fn weighed(values: vec3<u32>, weights: vec3<u32>) -> u32 {
    let sum = op_add(op_mul(values.x, weights.x), op_mul(values.y, weights.y));
    return op_add(sum, op_mul(values.z, weights.z));
}

fn mixed_words(a: u32, b: u32, share: u32) -> u32 {
    return op_add(a, op_mul(op_sub(b, a), share));
}

// The two texels around a coordinate, and the weight of the second.
struct Taps {
    first: u32,
    second: u32,
    share: u32,
}

fn taps(c: u32, size: u32, addressing: u32) -> Taps {
    var share: u32;
    if addressing == ALPHA_REPEAT {
        share = op_sub(c, op_floor(c));
    } else if addressing == ALPHA_MIRROR {
        let m = op_sub(c, op_mul(TWO, op_floor(op_mul(c, HALF))));
        share = select(m, op_sub(TWO, m), is_less(ONE, m));
    } else {
        share = op_min(op_max(c, 0u), ONE);
    }
    let count = op_uint_to_number(size);
    let place = op_sub(op_mul(share, count), HALF);
    let low = op_floor(place);
    // A whole number, and by integers' work at most the size, whatever the device has made of the sum.
    let next = min(op_number_to_uint(op_add(low, ONE)), size);
    // Beyond either edge a mirrored image repeats the edge texel.
    let repeats = addressing == ALPHA_REPEAT;
    let first = select(next - 1u, select(0u, size - 1u, repeats), next == 0u);
    let second = select(next, select(size - 1u, 0u, repeats), next == size);
    return Taps(first, second, op_sub(place, low));
}

// The bilinear mean of four texels of a plane.
fn filtered(material: AlphaMaterial, plane: u32, across: Taps, down: Taps) -> u32 {
    let first = plane * material.width * material.height;
    let above = first + down.first * material.width;
    let below = first + down.second * material.width;
    let upper = mixed_words(
        alpha_texel(material, above + across.first),
        alpha_texel(material, above + across.second),
        across.share,
    );
    let lower = mixed_words(
        alpha_texel(material, below + across.first),
        alpha_texel(material, below + across.second),
        across.share,
    );
    return mixed_words(upper, lower, down.share);
}

fn looked_up(material: AlphaMaterial, uv: vec2<u32>) -> u32 {
    var x = op_mul(uv.x, material.scale_u);
    var y = op_mul(uv.y, material.scale_v);
    if (material.kind & ALPHA_IS_TURNED) != 0u {
        let turned = op_add(op_mul(material.cosine, x), op_mul(material.sine, y));
        y = op_sub(op_mul(material.cosine, y), op_mul(material.sine, x));
        x = turned;
    }
    let across = taps(op_add(x, material.offset_u), material.width, (material.kind >> 8u) & 3u);
    let down = taps(op_add(y, material.offset_v), material.height, (material.kind >> 10u) & 3u);
    var texel = 0u;
    // One place where four texels are read, for one plane or for three.
    let planes = select(1u, 3u, (material.kind & ALPHA_HAS_THREE) != 0u);
    for (var plane = 0u; plane < planes; plane++) {
        let value = filtered(material, plane, across, down);
        texel = select(op_add(texel, value), value, plane == 0u);
    }
    return select(texel, op_mul(texel, THIRD), planes == 3u);
}

// `geom::mix`.
fn mixed_bits(bits: u32) -> u32 {
    let a = (bits ^ (bits >> 16u)) * 0x7feb352du;
    let b = (a ^ (a >> 15u)) * 0x846ca68bu;
    return b ^ (b >> 16u);
}

// Decides about a hit on a triangle of a masked leaf.
fn alpha_decision(primitive: u32, u: u32, v: u32) -> u32 {
    let row = alpha_words[ALPHA_ROWS + primitive];
    if row == ALPHA_OPAQUE {
        return COUNTED;
    }
    if row == ALPHA_OF_FILTER {
        return OF_FILTER;
    }
    let triangle = alpha_triangle(row);
    let material = alpha_material(triangle.material);
    let weights = vec3<u32>(op_sub(op_sub(ONE, u), v), u, v);
    var alpha = material.factor;
    if (material.kind & ALPHA_HAS_TEXTURE) != 0u {
        let uv = vec2<u32>(weighed(triangle.u, weights), weighed(triangle.v, weights));
        alpha = op_mul(alpha, looked_up(material, uv));
    }
    if (material.kind & ALPHA_HAS_VERTICES) != 0u {
        alpha = op_mul(alpha, weighed(triangle.alpha, weights));
    }
    if (material.kind & ALPHA_HAS_CUTOFF) != 0u {
        return select(IGNORED, COUNTED, rank(alpha) >= rank(material.cutoff));
    }
    let chance = mixed_bits(primitive ^ mixed_bits(u ^ mixed_bits(v))) >> 8u;
    return select(IGNORED, COUNTED, is_less(op_mul(op_uint_to_number(chance), UNIT_OF_CHANCE), alpha));
}
