// A ray prepared for traversal: `geom::CanonicalRay::new`. Decisions and the reciprocals are integers' work, so they
// are the host's on every device; the rest is within the pads.
//
// The canonical slab test crosses a plane p at fma(p, inverse, shift -+ pad), pad = SLACK * scale * |inverse|. A device
// may round the fma twice and contract sums. The two shifts differ by at most 22 * 2^-24 * scale * |inverse|, less than
// one pad (32 of the same units). So planes pushed out by two pads are outside the canonical ones (`near`, `far`), and
// planes that are not pushed out are inside them.

const REFUSED: u32 = 0u;
const UNCERTAIN: u32 = 1u;
const CERTAIN: u32 = 2u;

struct PreparedRay {
    origin: vec3<f32>,
    direction: vec3<f32>,
    // The host's reciprocals, to the bit.
    inverse: vec3<f32>,
    near: vec3<f32>,
    far: vec3<f32>,
    // For each axis: whether the ray enters through the lower plane.
    forward: vec3<bool>,
    // The sign bits of the direction, x in bit 0.
    octant: u32,
    // Neither is below +0.
    t_min: f32,
    t_max: f32,
    // A pad for a reciprocal of 1, the host's to the bit.
    slack: f32,
}

// The largest magnitude of three numbers, a word.
fn greatest3(words: vec3<u32>) -> u32 {
    let sizes = words & vec3<u32>(MAGNITUDE);
    return max(max(sizes.x, sizes.y), sizes.z);
}

// The same as a number.
fn largest_size(v: vec3<f32>) -> f32 {
    return bitcast<f32>(greatest3(bitcast<vec3<u32>>(v)));
}

// Whether a ray hits something by definition: see `CanonicalRay::new`. NaN and infinite coordinates are too large.
fn can_hit(reach: u32, length: u32, t_min: u32, t_max: u32) -> bool {
    let is_sound = (reach <= MAX_COORDINATE) & (length >= DIRECTION_MIN) & (length <= DIRECTION_MAX);
    let is_interval = !is_nan(t_min) & !is_nan(t_max) & (rank(t_min) <= rank(t_max)) & (rank(t_max) >= 0);
    return is_sound & is_interval;
}

// REFUSED if the ray hits nothing by definition; UNCERTAIN if numbers are so small that underflow could exceed the
// pads; else CERTAIN, and `prepared` is filled. `scene_max_abs` is a word.
fn prepare(ray: Ray, scene_max_abs: u32, prepared: ptr<function, PreparedRay>) -> u32 {
    let direction = bitcast<vec3<u32>>(ray.direction);
    let reach = greatest3(bitcast<vec3<u32>>(ray.origin));
    let length = greatest3(direction);
    let low = bitcast<u32>(ray.t_min);
    let high = bitcast<u32>(ray.t_max);
    if !can_hit(reach, length, low, high) {
        return REFUSED;
    }
    let least = bitcast<u32>(bitcast<f32>(length) * bitcast<f32>(MIN_COMPONENT));
    let sign = direction & vec3<u32>(SIGN);
    let slanted = max(direction & vec3<u32>(MAGNITUDE), vec3<u32>(least)) | sign;
    let reciprocals = vec3<u32>(op_div(ONE, slanted.x), op_div(ONE, slanted.y), op_div(ONE, slanted.z));
    let inverse = bitcast<vec3<f32>>(reciprocals);
    let sizes = bitcast<vec3<f32>>(reciprocals & vec3<u32>(MAGNITUDE));
    let slack = bitcast<f32>(max(scene_max_abs, reach)) * bitcast<f32>(SLACK);
    let pad = vec3<f32>(slack + slack) * sizes;
    let pads = bitcast<vec3<u32>>(pad);
    // If products of a placement are flushed to zero, moved planes are off by up to the smallest normal number.
    let is_drowned = MEMBERS & (bitcast<u32>(slack) < LEAST_PAD);
    if is_drowned | (min(min(pads.x, pads.y), pads.z) < LEAST_PAD) {
        return UNCERTAIN;
    }
    let shift = ray.origin * inverse;

    (*prepared).origin = ray.origin;
    (*prepared).direction = ray.direction;
    (*prepared).inverse = inverse;
    (*prepared).near = vec3<f32>(0.0) - shift - pad;
    (*prepared).far = pad - shift;
    (*prepared).forward = sign == vec3<u32>(0u);
    (*prepared).octant = (sign.x >> 31u) | (sign.y >> 30u) | (sign.z >> 29u);
    (*prepared).t_min = bitcast<f32>(select(low, 0u, (low & SIGN) != 0u));
    (*prepared).t_max = bitcast<f32>(select(min(high, bitcast<u32>(LARGEST_FLOAT)), 0u, high == SIGN));
    (*prepared).slack = slack;
    return CERTAIN;
}
