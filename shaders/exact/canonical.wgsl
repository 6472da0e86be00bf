// The canonical ray/triangle test (`geom::CanonicalRay`) on words: the host's operations in the host's order. Sums,
// differences and products are the device's, `op_fma` is one of three (`trace/gpu/exact`), all else is integers. No
// intermediate of a prepared ray and of a triangle within MAX_COORDINATE overflows.

// Always 0, which compilers do not know.
var<private> unknown_zero: u32;

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

// A zero of either sign as +0.
fn unsigned_zero(a: u32) -> u32 {
    return select(a, 0u, a == SIGN);
}

// Where the ray is inside the box, as in `CanonicalRay::slab`: the distances of entering and leaving.
fn slab_of(ray: PreparedRay, lower: vec3<u32>, upper: vec3<u32>) -> vec2<u32> {
    let origin = bitcast<vec3<u32>>(ray.origin);
    let inverse = bitcast<vec3<u32>>(ray.inverse);
    let slack = bitcast<u32>(ray.slack);
    var enter = SIGN | INFINITE;
    var leave = INFINITE;
    for (var axis = 0u; axis < 3u; axis++) {
        let shift = op_sub(unknown_zero, op_mul(origin[axis], inverse[axis]));
        let pad = op_mul(slack, inverse[axis] & MAGNITUDE);
        let first = select(upper[axis], lower[axis], ray.forward[axis]);
        let last = select(lower[axis], upper[axis], ray.forward[axis]);
        enter = op_max(enter, op_fma(first, inverse[axis], op_sub(shift, pad)));
        leave = op_min(leave, op_fma(last, inverse[axis], op_add(shift, pad)));
    }
    return vec2<u32>(enter, leave);
}

// The edge function of an edge, with corners relative to the ray's origin. With the two corners exchanged it has the
// same value and the opposite sign, since every intermediate is negated exactly.
fn side_of(direction: vec3<u32>, from_corner: vec3<u32>, to_corner: vec3<u32>) -> u32 {
    return dot3(cross3(sub3(to_corner, from_corner), add3(to_corner, from_corner)), direction);
}

// Whether no two of three numbers have opposite signs. Zeros have none.
fn have_one_sign(a: u32, b: u32, c: u32) -> bool {
    let is_negative = max(max(a, b), c) > SIGN;
    let is_positive = max(max(bitcast<i32>(a), bitcast<i32>(b)), bitcast<i32>(c)) > 0;
    return !(is_negative & is_positive);
}

// The hit of a triangle whose corners are in the canonical order.
fn canonical_hit(ray: PreparedRay, v0: vec3<u32>, v1: vec3<u32>, v2: vec3<u32>) -> ExactHit {
    let origin = bitcast<vec3<u32>>(ray.origin);
    let d = bitcast<vec3<u32>>(ray.direction);
    var a = sub3(v0, origin);
    var b = sub3(v1, origin);
    var c = sub3(v2, origin);
    // Of a and c, b and a, c and b. The edge function stands here once, since it is long where its multiply-add is
    // emulated. After three turns each corner is in its place again.
    var sides = vec3<u32>(0u);
    for (var edge = 0u; edge < 3u; edge++) {
        sides = vec3<u32>(sides.yz, side_of(d, a, c));
        let first = a;
        a = b;
        b = c;
        c = first;
    }
    let u = sides.x;
    let v = sides.y;
    let w = sides.z;
    if !have_one_sign(u, v, w) {
        return NO_HIT;
    }
    let e0 = sub3(c, a);
    let e2 = sub3(b, c);
    let shorter = select(e2, e0, vec3<bool>(greatest3(e0) <= greatest3(e2)));
    let normal = cross3(sub3(a, b), shorter);
    let facing = dot3(normal, d);
    if (facing & MAGNITUDE) == 0u {
        return NO_HIT;
    }
    let plane = op_div(dot3(normal, a), facing);
    let within = slab_of(ray, min3(min3(v0, v1), v2), max3(max3(v0, v1), v2));
    let t = unsigned_zero(op_min(op_max(plane, within.x), within.y));
    // Distances and the ray's interval have words in the order of numbers.
    let is_after = ((t & SIGN) == 0u) & (t >= bitcast<u32>(ray.t_min));
    if (rank(within.x) > rank(within.y)) | !is_after | (t > bitcast<u32>(ray.t_max)) {
        return NO_HIT;
    }
    let scale = op_div(ONE, op_add(op_add(u, v), w));
    if (scale & MAGNITUDE) >= INFINITE {
        return NO_HIT;
    }
    let weight_u = unsigned_zero(op_min(op_mul(u, scale), ONE));
    let weight_v = unsigned_zero(op_min(op_mul(v, scale), ONE));
    return ExactHit(t, weight_u, weight_v, 1u);
}
