// A ray prepared for traversal: `geom::CanonicalRay::new`, with margins for the device's rounding.
//
// The canonical slab test crosses a plane p at fma(p, inverse, shift -+ pad), pad = SLACK * scale * |inverse|. Here the
// reciprocal may be off by 2.5 ulp, and the fma may round twice. The two shifts differ by at most 22 * 2^-24 * scale *
// |inverse|, less than one pad (32 of the same units). So planes pushed out by two pads are outside the canonical ones
// (`near`, `far`), and planes that are not pushed out are inside them (`shift`).

const REFUSED: u32 = 0u;
const UNCERTAIN: u32 = 1u;
const CERTAIN: u32 = 2u;

struct PreparedRay {
    origin: vec3<f32>,
    direction: vec3<f32>,
    inverse: vec3<f32>,
    shift: vec3<f32>,
    near: vec3<f32>,
    far: vec3<f32>,
    // For each axis: whether the ray enters through the lower plane.
    forward: vec3<bool>,
    // The sign bits of the direction, x in bit 0.
    octant: u32,
    t_min: f32,
    t_max: f32,
    // The coarse margin of edge functions, and what underflow adds to it, each for a unit of reach.
    margin: f32,
    tiny: f32,
}

// Where a ray enters and leaves a box.
struct Interval {
    enter: f32,
    leave: f32,
}

fn largest(v: vec3<f32>) -> f32 {
    return max(max(v.x, v.y), v.z);
}

fn smallest(v: vec3<f32>) -> f32 {
    return min(min(v.x, v.y), v.z);
}

// Tests the bits for NaN and infinity, because a compiler may assume that numbers are finite.
fn is_finite(bits: u32) -> bool {
    return (bits & EXPONENT) != EXPONENT;
}

fn are_finite(v: vec3<f32>) -> bool {
    let bits = bitcast<vec3<u32>>(v);
    return is_finite(bits.x) && is_finite(bits.y) && is_finite(bits.z);
}

// REFUSED if the ray hits nothing by definition; UNCERTAIN if numbers are so small that underflow could exceed the
// bounds; else CERTAIN, and `prepared` is filled.
fn prepare(ray: Ray, prepared: ptr<function, PreparedRay>) -> u32 {
    if !(are_finite(ray.origin) && are_finite(ray.direction)) {
        return REFUSED;
    }
    let reach = largest(abs(ray.origin));
    let length = largest(abs(ray.direction));
    if reach > MAX_COORDINATE || length < DIRECTION_MIN || length > DIRECTION_MAX {
        return REFUSED;
    }
    // t_min may be minus infinity, and t_max plus infinity.
    let low = bitcast<u32>(ray.t_min);
    let high = bitcast<u32>(ray.t_max);
    if !(is_finite(low) || low == MINUS_INFINITY) || !(is_finite(high) || high == PLUS_INFINITY) {
        return REFUSED;
    }
    let t_min = select(max(ray.t_min, 0.0), 0.0, low == MINUS_INFINITY);
    let t_max = select(ray.t_max, LARGEST_FLOAT, high == PLUS_INFINITY);
    if t_min > t_max {
        return REFUSED;
    }

    let sign = bitcast<vec3<u32>>(ray.direction) & vec3<u32>(SIGN);
    let size = max(abs(ray.direction), vec3<f32>(length * MIN_COMPONENT));
    let slanted = bitcast<vec3<f32>>(bitcast<vec3<u32>>(size) | sign);
    let inverse = 1.0 / slanted;
    let pad = (2.0 * SLACK * max(params.scene_max_abs, reach)) * abs(inverse);
    // If products of a placement are flushed to zero, moved planes are off by up to the smallest normal number.
    let drowned = MEMBERS && SLACK * max(params.scene_max_abs, reach) < LEAST_PAD;
    if drowned || smallest(pad) < LEAST_PAD {
        return UNCERTAIN;
    }
    let shift = -(ray.origin * inverse);
    let sum = abs(ray.direction.x) + abs(ray.direction.y) + abs(ray.direction.z);

    (*prepared).origin = ray.origin;
    (*prepared).direction = ray.direction;
    (*prepared).inverse = inverse;
    (*prepared).shift = shift;
    (*prepared).near = shift - pad;
    (*prepared).far = shift + pad;
    (*prepared).forward = sign == vec3<u32>(0u);
    (*prepared).octant = (sign.x >> 31u) | (sign.y >> 30u) | (sign.z >> 29u);
    (*prepared).t_min = t_min;
    (*prepared).t_max = t_max;
    (*prepared).margin = 4.0 * MARGIN * sum;
    (*prepared).tiny = TINY * (sum + 1.0);
    return CERTAIN;
}

// An interval that contains the canonical one of the box.
fn outer(ray: PreparedRay, lower: vec3<f32>, upper: vec3<f32>) -> Interval {
    let first = select(upper, lower, ray.forward);
    let last = select(lower, upper, ray.forward);
    return Interval(
        largest(fma(first, ray.inverse, ray.near)),
        smallest(fma(last, ray.inverse, ray.far)),
    );
}

// An interval within the canonical one of the box.
fn inner(ray: PreparedRay, lower: vec3<f32>, upper: vec3<f32>) -> Interval {
    let first = select(upper, lower, ray.forward);
    let last = select(lower, upper, ray.forward);
    return Interval(
        largest(fma(first, ray.inverse, ray.shift)),
        smallest(fma(last, ray.inverse, ray.shift)),
    );
}
