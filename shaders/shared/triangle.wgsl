// The canonical test of one triangle (`geom::CanonicalRay::triangle`), judged with an error bound.
//
// The operations are the canonical ones in the canonical order, but a driver may round an fma twice and contract
// products into sums, so a result is known only up to a margin. Write eps for 2^-24.
//
// Given the same a, b, c, host and device have the same edges and sums to the bit (one correctly rounded operation
// each). For a component x = pq - rs of a cross product, let P = |pq| + |rs|. Either side's x has an error of at most
// 2 eps P, fused or not, and its dot product with d of at most 3 eps |x| |d| for each component. So each side is within
// 5 eps sum(P |d|) of the exact value, and the two are within 10 eps sum(P |d|) of each other, to first order.
// MARGIN = 16 eps covers that, the higher orders, and the roundings of the margin itself. Results below the smallest
// normal number may be flushed to zero: TINY = 2^6 times that number, times the factors that may follow, covers that.

// What is known of the canonical answer: REFUSED, accepted (CERTAIN), or either (UNCERTAIN). Unless it is REFUSED, an
// accepted t lies in low..=high.
struct Verdict {
    kind: u32,
    low: f32,
    high: f32,
}

const NOT_HIT = Verdict(REFUSED, 0.0, 0.0);

// `v`, rounded to f32. Keeps a compiler from simplifying sums: (c - o) - (a - o) is not c - a here.
fn rounded(v: vec3<f32>) -> vec3<f32> {
    return bitcast<vec3<f32>>(bitcast<vec3<u32>>(v) ^ vec3<u32>(params.zero));
}

fn cross_fma(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return fma(a.yzx, b.zxy, -(a.zxy * b.yzx));
}

fn dot_fma(a: vec3<f32>, b: vec3<f32>) -> f32 {
    return fma(a.x, b.x, fma(a.y, b.y, a.z * b.z));
}

// sum(P |d|): the size of dot(cross(a, b), d) without cancellation.
fn magnitude(a: vec3<f32>, b: vec3<f32>, d: vec3<f32>) -> f32 {
    let p = abs(a);
    let q = abs(b);
    return dot(p.yzx * q.zxy + p.zxy * q.yzx, abs(d));
}

// The edge function of an edge, with corners relative to the ray's origin. With the two corners exchanged it has the
// same value and the opposite sign, since every intermediate is negated exactly.
fn side_of(ray: PreparedRay, from_corner: vec3<f32>, to_corner: vec3<f32>) -> f32 {
    return dot_fma(cross_fma(to_corner - from_corner, to_corner + from_corner), ray.direction);
}

// A coarse test: whether the edge functions allow that a triangle is hit. Most triangles are far outside. With a, b and
// c relative to the ray's origin, no P exceeds 2 * edge * sum <= 4 * edge * reach. Rotating the corners changes
// nothing.
fn may_be_hit(ray: PreparedRay, sides: vec3<f32>, a: vec3<f32>, b: vec3<f32>, c: vec3<f32>) -> bool {
    let reach = largest(max(max(abs(a), abs(b)), abs(c)));
    let longest = largest(max(max(abs(c - a), abs(a - b)), abs(b - c)));
    let coarse = fma(longest * reach, ray.margin, ray.tiny * (reach + 1.0));
    return smallest(sides) >= -coarse || largest(sides) <= coarse;
}

// Judges a triangle whose corners are in the canonical order.
fn judge(ray: PreparedRay, v0: vec3<f32>, v1: vec3<f32>, v2: vec3<f32>, is_masked: bool) -> Verdict {
    let d = ray.direction;
    let a = rounded(v0 - ray.origin);
    let b = rounded(v1 - ray.origin);
    let c = rounded(v2 - ray.origin);
    let e0 = c - a;
    let e1 = a - b;
    let e2 = b - c;
    let s0 = c + a;
    let s1 = a + b;
    let s2 = b + c;
    let edges = vec3<f32>(
        dot_fma(cross_fma(e0, s0), d),
        dot_fma(cross_fma(e1, s1), d),
        dot_fma(cross_fma(e2, s2), d),
    );
    let reach = largest(max(max(abs(a), abs(b)), abs(c)));
    let tiny = ray.tiny * (reach + 1.0);
    let margins = MARGIN * vec3<f32>(magnitude(e0, s0, d), magnitude(e1, s1, d), magnitude(e2, s2, d))
        + vec3<f32>(tiny);
    let least = edges - margins;
    let most = edges + margins;
    if smallest(most) < 0.0 && largest(least) > 0.0 {
        return NOT_HIT;
    }
    var certain = smallest(least) >= tiny || largest(most) <= -tiny;

    // The canonical t is clamped to the triangle's own box.
    let lower = min(min(v0, v1), v2);
    let upper = max(max(v0, v1), v2);
    let wide = outer(ray, lower, upper);
    if wide.enter > wide.leave {
        return NOT_HIT;
    }
    let narrow = inner(ray, lower, upper);
    certain = certain && narrow.enter <= narrow.leave;

    var low = wide.enter;
    var high = wide.leave;
    // Chooses as the canonical test does, to the bit: nothing is rounded here.
    let e = select(e2, e0, largest(abs(e0)) <= largest(abs(e2)));
    let normal = cross_fma(e1, e);
    let facing = dot_fma(normal, d);
    let facing_margin = fma(MARGIN, magnitude(e1, e, d), tiny);
    if abs(facing) > 2.0 * facing_margin {
        let t = dot_fma(normal, a) / facing;
        let margin = fma(MARGIN, magnitude(e1, e, a), 3.0 * TINY * (reach + 1.0) * (reach + 1.0));
        // The first term bounds the errors of numerator and denominator, the second the rounding of the quotient
        // (2.5 ulp) and of the two sums below.
        let error = 1.01 * fma(abs(t), facing_margin, margin) / (abs(facing) - facing_margin)
            + fma(abs(t), T_ROUNDING, TINY);
        low = min(max(t - error, wide.enter), narrow.leave);
        high = min(max(t + error, narrow.enter), wide.leave);
    } else {
        certain = false;
    }
    if high < ray.t_min || low > ray.t_max {
        return NOT_HIT;
    }
    // The alpha of a masked triangle decides whether it is hit, on the host.
    certain = certain && low >= ray.t_min && high <= ray.t_max && !is_masked;
    return Verdict(select(UNCERTAIN, CERTAIN, certain), low, high);
}
