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

// sum(P |d|): the size of dot(cross(a, b), d) without cancellation.
fn magnitude(a: vec3<f32>, b: vec3<f32>, d: vec3<f32>) -> f32 {
    let p = abs(a);
    let q = abs(b);
    return dot(p.yzx * q.zxy + p.zxy * q.yzx, abs(d));
}

fn largest(v: vec3<f32>) -> f32 {
    return max(max(v.x, v.y), v.z);
}

fn smallest(v: vec3<f32>) -> f32 {
    return min(min(v.x, v.y), v.z);
}

// Where a ray enters and leaves a box.
struct Interval {
    enter: f32,
    leave: f32,
}

// An interval that contains the canonical one of the box.
fn outer(ray: PreparedRay, lower: vec3<f32>, upper: vec3<f32>) -> Interval {
    let first = select(upper, lower, ray.forward);
    let last = select(lower, upper, ray.forward);
    return Interval(
        largest(near_fma3(first, ray.inverse, ray.near)),
        smallest(near_fma3(last, ray.inverse, ray.far)),
    );
}

// An interval within the canonical one of the box.
fn inner(ray: PreparedRay, lower: vec3<f32>, upper: vec3<f32>) -> Interval {
    let first = select(upper, lower, ray.forward);
    let last = select(lower, upper, ray.forward);
    let shift = -(ray.origin * ray.inverse);
    return Interval(
        largest(near_fma3(first, ray.inverse, shift)),
        smallest(near_fma3(last, ray.inverse, shift)),
    );
}

// Judges a triangle whose corners are in the world and in the canonical order.
fn judge(ray: PreparedRay, v0: vec3<f32>, v1: vec3<f32>, v2: vec3<f32>, is_masked: bool) -> Verdict {
    let d = ray.direction;
    let sum = abs(d.x) + abs(d.y) + abs(d.z);
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
        near_dot(near_cross(e0, s0), d),
        near_dot(near_cross(e1, s1), d),
        near_dot(near_cross(e2, s2), d),
    );
    let reach = largest(max(max(abs(a), abs(b)), abs(c)));
    let tiny = TINY * (sum + 1.0) * (reach + 1.0);
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
    let normal = near_cross(e1, e);
    let facing = near_dot(normal, d);
    let facing_margin = near_fma(MARGIN, magnitude(e1, e, d), tiny);
    if abs(facing) > 2.0 * facing_margin {
        let t = near_dot(normal, a) / facing;
        let margin = near_fma(MARGIN, magnitude(e1, e, a), 3.0 * TINY * (reach + 1.0) * (reach + 1.0));
        // The first term bounds the errors of numerator and denominator, the second the rounding of the quotient
        // (2.5 ulp) and of the two sums below.
        let error = 1.01 * near_fma(abs(t), facing_margin, margin) / (abs(facing) - facing_margin)
            + near_fma(abs(t), T_ROUNDING, TINY);
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

// Judges a triangle of a member.
fn verdict_of(ray: PreparedRay, triangle: Triangle, member: TreeInstance) -> Verdict {
    if !MEMBERS {
        return judge(ray, triangle.v0, triangle.v1, triangle.v2, triangle.is_masked);
    }
    let v0 = moved(member, triangle.v0);
    return judge(ray, v0, moved(member, triangle.v1), moved(member, triangle.v2), triangle.is_masked);
}
