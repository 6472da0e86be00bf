// The canonical ray/triangle test (`geom::CanonicalRay`) on words: the host's operations in the host's order. Sums,
// differences and products are the device's, `op_fma` is one of three (`trace/gpu/exact`), all else is integers.

// Largest absolute coordinate of the scene.
var<private> scene_reach: u32;
// Always 0, which compilers do not know.
var<private> unknown_zero: u32;

// A ray, word by word.
struct ExactRay {
    origin: vec3<u32>,
    t_min: u32,
    direction: vec3<u32>,
    t_max: u32,
}

// A hit, if `is_hit` is 1.
struct ExactHit {
    t: u32,
    u: u32,
    v: u32,
    is_hit: u32,
}

const NO_HIT = ExactHit(0u, 0u, 0u, 0u);

fn sub3(a: vec3<u32>, b: vec3<u32>) -> vec3<u32> {
    return vec3<u32>(op_sub(a.x, b.x), op_sub(a.y, b.y), op_sub(a.z, b.z));
}

fn add3(a: vec3<u32>, b: vec3<u32>) -> vec3<u32> {
    return vec3<u32>(op_add(a.x, b.x), op_add(a.y, b.y), op_add(a.z, b.z));
}

fn min3(a: vec3<u32>, b: vec3<u32>) -> vec3<u32> {
    return vec3<u32>(op_min(a.x, b.x), op_min(a.y, b.y), op_min(a.z, b.z));
}

fn max3(a: vec3<u32>, b: vec3<u32>) -> vec3<u32> {
    return vec3<u32>(op_max(a.x, b.x), op_max(a.y, b.y), op_max(a.z, b.z));
}

fn cross3(a: vec3<u32>, b: vec3<u32>) -> vec3<u32> {
    return vec3<u32>(
        op_fma(a.y, b.z, op_mul(a.z, b.y) ^ SIGN),
        op_fma(a.z, b.x, op_mul(a.x, b.z) ^ SIGN),
        op_fma(a.x, b.y, op_mul(a.y, b.x) ^ SIGN),
    );
}

fn dot3(a: vec3<u32>, b: vec3<u32>) -> u32 {
    return op_fma(a.x, b.x, op_fma(a.y, b.y, op_mul(a.z, b.z)));
}

// The largest magnitude of three numbers.
fn greatest3(a: vec3<u32>) -> u32 {
    let sizes = a & vec3<u32>(MAGNITUDE);
    return max(max(sizes.x, sizes.y), sizes.z);
}

// A zero of either sign as +0.
fn unsigned_zero(a: u32) -> u32 {
    return select(a, 0u, a == SIGN);
}

// Where the ray is inside the box, as in `CanonicalRay::slab`: the distances of entering and leaving.
fn slab_of(ray: ExactRay, largest: u32, reach: u32, lower: vec3<u32>, upper: vec3<u32>) -> vec2<u32> {
    let floor = op_mul(largest, MIN_COMPONENT);
    let slack = op_mul(max(scene_reach, reach), SLACK);
    var enter = SIGN | INFINITE;
    var leave = INFINITE;
    for (var axis = 0u; axis < 3u; axis++) {
        let sign = ray.direction[axis] & SIGN;
        let inverse = op_div(ONE, max(ray.direction[axis] & MAGNITUDE, floor) | sign);
        let shift = op_sub(unknown_zero, op_mul(ray.origin[axis], inverse));
        let pad = op_mul(slack, inverse & MAGNITUDE);
        let first = select(upper[axis], lower[axis], sign == 0u);
        let last = select(lower[axis], upper[axis], sign == 0u);
        enter = op_max(enter, op_fma(first, inverse, op_sub(shift, pad)));
        leave = op_min(leave, op_fma(last, inverse, op_add(shift, pad)));
    }
    return vec2<u32>(enter, leave);
}

// Whether a ray hits something by definition: see `CanonicalRay::new`.
fn can_hit(ray: ExactRay, largest: u32, reach: u32) -> bool {
    let is_sound = reach <= MAX_COORDINATE && largest >= DIRECTION_MIN && largest <= DIRECTION_MAX;
    return is_sound && !is_nan(ray.t_min) && !is_nan(ray.t_max) && rank(ray.t_min) <= rank(ray.t_max);
}

// The hit of a triangle whose corners are in the canonical order.
fn canonical_hit(ray: ExactRay, v0: vec3<u32>, v1: vec3<u32>, v2: vec3<u32>) -> ExactHit {
    let reach = greatest3(ray.origin);
    let largest = greatest3(ray.direction);
    if (!can_hit(ray, largest, reach)) {
        return NO_HIT;
    }
    let d = ray.direction;
    let a = sub3(v0, ray.origin);
    let b = sub3(v1, ray.origin);
    let c = sub3(v2, ray.origin);
    let e0 = sub3(c, a);
    let e1 = sub3(a, b);
    let e2 = sub3(b, c);
    let u = dot3(cross3(e0, add3(c, a)), d);
    let v = dot3(cross3(e1, add3(a, b)), d);
    let w = dot3(cross3(e2, add3(b, c)), d);
    let least = min(min(rank(u), rank(v)), rank(w));
    let most = max(max(rank(u), rank(v)), rank(w));
    if (least < 0 && most > 0) {
        return NO_HIT;
    }
    let shorter = select(e2, e0, vec3<bool>(greatest3(e0) <= greatest3(e2)));
    let normal = cross3(e1, shorter);
    let facing = dot3(normal, d);
    if ((facing & MAGNITUDE) == 0u) {
        return NO_HIT;
    }
    let plane = op_div(dot3(normal, a), facing);
    let within = slab_of(ray, largest, reach, min3(min3(v0, v1), v2), max3(max3(v0, v1), v2));
    let t = unsigned_zero(op_min(op_max(plane, within.x), within.y));
    let is_inside = rank(within.x) <= rank(within.y);
    if (!is_inside || rank(t) < max(rank(ray.t_min), 0) || rank(t) > rank(ray.t_max)) {
        return NO_HIT;
    }
    let scale = op_div(ONE, op_add(op_add(u, v), w));
    if ((scale & MAGNITUDE) >= INFINITE) {
        return NO_HIT;
    }
    let weight_u = unsigned_zero(op_min(op_mul(u, scale), ONE));
    let weight_v = unsigned_zero(op_min(op_mul(v, scale), ONE));
    return ExactHit(t, weight_u, weight_v, 1u);
}
