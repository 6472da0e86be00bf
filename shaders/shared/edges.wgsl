// A coarse test of pairs of triangles: whether the edge functions, as far as the device knows them, allow that a
// triangle is hit. Most triangles are far outside. `candidates/triangle.wgsl` derives the margins.

fn negated(v: vec3<f32>) -> vec3<f32> {
    return bitcast<vec3<f32>>(bitcast<vec3<u32>>(v) ^ vec3<u32>(SIGN));
}

fn near_cross(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return near_fma3(a.yzx, b.zxy, negated(a.zxy * b.yzx));
}

fn near_dot(a: vec3<f32>, b: vec3<f32>) -> f32 {
    return near_fma(a.x, b.x, near_fma(a.y, b.y, a.z * b.z));
}

// The edge function of an edge, with corners relative to the ray's origin. With the two corners exchanged it has the
// same value and the opposite sign, since every intermediate is negated exactly.
fn near_side(ray: PreparedRay, from_corner: vec3<f32>, to_corner: vec3<f32>) -> f32 {
    return near_dot(near_cross(to_corner - from_corner, to_corner + from_corner), ray.direction);
}

// With a, b and c relative to the ray's origin, no P exceeds 2 * edge * sum <= 4 * edge * reach. Rotating the corners
// changes nothing.
fn may_be_hit(ray: PreparedRay, sides: vec3<f32>, a: vec3<f32>, b: vec3<f32>, c: vec3<f32>) -> bool {
    let reach = greatest(a, b, c);
    let longest = greatest(c - a, a - b, b - c);
    let sizes = bitcast<vec3<f32>>(bitcast<vec3<u32>>(ray.direction) & vec3<u32>(MAGNITUDE));
    let sum = sizes.x + sizes.y + sizes.z;
    let margin = near_fma(longest * reach, 4.0 * MARGIN * sum, TINY * (sum + 1.0) * (reach + 1.0));
    let coarse = bitcast<i32>(margin);
    let signs = bitcast<vec3<i32>>(sides);
    let magnitudes = signs & vec3<i32>(0x7fffffff);
    let ranks = select(magnitudes, -magnitudes, signs < vec3<i32>(0));
    return all(ranks >= vec3<i32>(-coarse)) | all(ranks <= vec3<i32>(coarse));
}

// The largest magnitude of nine numbers.
fn greatest(a: vec3<f32>, b: vec3<f32>, c: vec3<f32>) -> f32 {
    let ab = max(greatest3(bitcast<vec3<u32>>(a)), greatest3(bitcast<vec3<u32>>(b)));
    return bitcast<f32>(max(ab, greatest3(bitcast<vec3<u32>>(c))));
}

// The triangles of a pair that may be hit: bit 0 for the first.
fn open_triangles(ray: PreparedRay, pair: Pair) -> u32 {
    let a = rounded(pair.a.xyz - ray.origin);
    let b = rounded(pair.b.xyz - ray.origin);
    let c = rounded(pair.c.xyz - ray.origin);
    let d = rounded(fourth(pair) - ray.origin);
    let shared_side = near_side(ray, c, b);
    let opposite = bitcast<f32>(bitcast<u32>(shared_side) ^ SIGN);
    let abc = vec3<f32>(near_side(ray, a, c), near_side(ray, b, a), shared_side);
    let cbd = vec3<f32>(near_side(ray, c, d), opposite, near_side(ray, d, b));
    return select(0u, 1u, may_be_hit(ray, abc, a, b, c)) | select(0u, 2u, may_be_hit(ray, cbd, c, b, d));
}
