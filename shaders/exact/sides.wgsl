// Edge functions of pairs of triangles, exact: five instead of six. Their signs reject most triangles, and need no
// margin.

fn open_triangles(ray: PreparedRay, pair: Pair) -> u32 {
    let origin = bitcast<vec3<u32>>(ray.origin);
    let direction = bitcast<vec3<u32>>(ray.direction);
    let a = sub3(bitcast<vec3<u32>>(pair.a.xyz), origin);
    let b = sub3(bitcast<vec3<u32>>(pair.b.xyz), origin);
    let c = sub3(bitcast<vec3<u32>>(pair.c.xyz), origin);
    let d = sub3(bitcast<vec3<u32>>(fourth(pair)), origin);
    let shared_side = side_of(direction, c, b);
    let is_abc = have_one_sign(side_of(direction, a, c), side_of(direction, b, a), shared_side);
    let is_cbd = have_one_sign(side_of(direction, c, d), shared_side ^ SIGN, side_of(direction, d, b));
    return select(0u, 1u, is_abc) | select(0u, 2u, is_cbd);
}
