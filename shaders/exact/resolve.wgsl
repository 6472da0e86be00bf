// Hits of candidates. `trace_closest` and `trace_any` answer with the places of triangles that rounding could not judge
// (`place_of`); these kernels run the canonical test there and write the host's own bits. What stays undecided is
// listed for the host: rays with masked candidates, rays with more candidates than an answer has room for, and rays
// whose arithmetic came near subnormal numbers.

@group(1) @binding(3) var<storage, read_write> undecided_rays: array<atomic<u32>>;

// Lists a ray for the host. The first word counts the rays, whether or not there is room for them.
fn leave_to_host(slot: u32, is_masked: bool) {
    let at = atomicAdd(&undecided_rays[0], 1u) + 1u;
    if (at < arrayLength(&undecided_rays)) {
        atomicStore(&undecided_rays[at], slot | select(0u, MASKED_RAY, is_masked));
    }
}

// Three corners in the canonical order, and the primitive that they are of.
struct Corners {
    v0: vec3<u32>,
    v1: vec3<u32>,
    v2: vec3<u32>,
    primitive: u32,
}

fn corners_at(place: u32) -> Corners {
    let index = (place & (PLACE_MASKED - 1u)) >> 1u;
    let is_second = (place & 1u) != 0u;
    let pair = pair_at(index);
    let identities = identity_at(index);
    let identity = select(identities.x, identities.y, is_second);
    let d = vec3<u32>(bitcast<u32>(pair.d_x), bitcast<u32>(pair.d_y), bitcast<u32>(pair.d_z));
    let p = select(bitcast<vec3<u32>>(pair.a), bitcast<vec3<u32>>(pair.c), vec3<bool>(is_second));
    let q = bitcast<vec3<u32>>(pair.b);
    let r = select(bitcast<vec3<u32>>(pair.c), d, vec3<bool>(is_second));
    let turned = vec3<bool>((identity >> TURN_SHIFT) == 1u);
    let twice = vec3<bool>((identity >> TURN_SHIFT) == 2u);
    return Corners(
        select(select(p, q, turned), r, twice),
        select(select(q, r, turned), p, twice),
        select(select(r, p, turned), q, twice),
        identity & PRIMITIVE,
    );
}

fn ray_at(slot: u32) -> ExactRay {
    let ray = rays[slot];
    scene_reach = bitcast<u32>(params.scene_max_abs);
    unknown_zero = params.zero;
    return ExactRay(
        bitcast<vec3<u32>>(ray.origin),
        bitcast<u32>(ray.t_min),
        bitcast<vec3<u32>>(ray.direction),
        bitcast<u32>(ray.t_max),
    );
}
