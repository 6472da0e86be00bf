// The canonical test of one triangle (`geom::CanonicalRay::triangle`), judged with an error bound.
//
// The operations are the canonical ones in the canonical order, but a driver may round an fma twice
// and contract products into sums, so a result is known only up to a margin. Write eps for 2^-24.
//
// Given the same a, b, c, host and device have the same edges and sums to the bit (one correctly
// rounded operation each). Of a cross product's component x = pq - rs, with P = |pq| + |rs|, either
// has an error of at most 2 eps P, fused or not; of the dot product with d, at most 3 eps |x| |d| a
// component. So each is within 5 eps sum(P |d|) of the exact value, and the two within 10 eps
// sum(P |d|) of each other, to first order. MARGIN = 16 eps covers that with the higher orders and
// the roundings of the margin itself. Results below the smallest normal number may be flushed to
// zero: TINY = 2^6 times that number, times the factors that may follow, covers it.

// What is known of the canonical answer: refused, accepted, or either; and, unless refused, that an
// accepted t lies in low..=high.
struct Verdict {
    kind: u32,
    low: f32,
    high: f32,
}

const NOT_HIT = Verdict(REFUSED, 0.0, 0.0);

// `v`, rounded to f32: keeps a compiler from looking through a subtraction ((c - o) - (a - o) is not
// c - a here).
fn rounded(v: vec3<f32>) -> vec3<f32> {
    return bitcast<vec3<f32>>(bitcast<vec3<u32>>(v) ^ vec3<u32>(params.zero));
}

fn cross_fma(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return fma(a.yzx, b.zxy, -(a.zxy * b.yzx));
}

fn dot_fma(a: vec3<f32>, b: vec3<f32>) -> f32 {
    return fma(a.x, b.x, fma(a.y, b.y, a.z * b.z));
}

// The sum of P, weighted: how large dot(cross(a, b), d) is without cancellation.
fn magnitude(a: vec3<f32>, b: vec3<f32>, d: vec3<f32>) -> f32 {
    let p = abs(a);
    let q = abs(b);
    return dot(p.yzx * q.zxy + p.zxy * q.yzx, abs(d));
}

// The edge function of an edge seen from the ray's origin. From its other end it is the same with another sign: every
// intermediate is negated, exactly.
fn side_of(ray: PreparedRay, from_corner: vec3<f32>, to_corner: vec3<f32>) -> f32 {
    return dot_fma(cross_fma(to_corner - from_corner, to_corner + from_corner), ray.direction);
}

// Whether the edge functions leave it open that a triangle is hit, coarsely: most triangles are far outside. With a, b
// and c seen from the ray's origin, no P exceeds 2 * edge * sum <= 4 * edge * reach. Turning the corners changes
// nothing.
fn may_be_hit(ray: PreparedRay, sides: vec3<f32>, a: vec3<f32>, b: vec3<f32>, c: vec3<f32>) -> bool {
    let reach = largest(max(max(abs(a), abs(b)), abs(c)));
    let longest = largest(max(max(abs(c - a), abs(a - b)), abs(b - c)));
    let coarse = fma(longest * reach, ray.margin, ray.tiny * (reach + 1.0));
    return smallest(sides) >= -coarse || largest(sides) <= coarse;
}

// The judgement of a triangle whose corners are in the canonical order.
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
    // The canonical choice, to the bit: nothing in it is rounded.
    let e = select(e2, e0, largest(abs(e0)) <= largest(abs(e2)));
    let normal = cross_fma(e1, e);
    let facing = dot_fma(normal, d);
    let facing_margin = fma(MARGIN, magnitude(e1, e, d), tiny);
    if abs(facing) > 2.0 * facing_margin {
        let t = dot_fma(normal, a) / facing;
        let margin = fma(MARGIN, magnitude(e1, e, a), 3.0 * TINY * (reach + 1.0) * (reach + 1.0));
        // The first term is what numerator and denominator do to the quotient, the second its own
        // rounding (division: 2.5 ulp) and that of the two sums below.
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
    // A masked triangle is there only where its alpha says so, which the host decides.
    certain = certain && low >= ray.t_min && high <= ray.t_max && !is_masked;
    return Verdict(select(UNCERTAIN, CERTAIN, certain), low, high);
}
