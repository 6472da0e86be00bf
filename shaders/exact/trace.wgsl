// What the kernels of exact hits share: triangles that `open_triangles` leaves are tested canonically at once, so a hit
// is the host's to the bit and traversal goes on with its distance. Left to the host are rays whose arithmetic came
// near subnormal numbers on a device that may flush them, and rays that meet a triangle before anything else about
// which the filter decides and no table does.

@group(1) @binding(3) var<storage, read_write> undecided_rays: array<atomic<u32>>;

// Decisions about a hit of a masked leaf.
const COUNTED: u32 = 0u;
const IGNORED: u32 = 1u;
const OF_FILTER: u32 = 2u;

// Words. `t` is the distance of the nearest hit, at first the end of the ray's interval; `masked` that of the nearest
// hit about which the filter decides.
struct Found {
    t: u32,
    u: u32,
    v: u32,
    primitive: u32,
    masked: u32,
    // The first hit is enough.
    is_any: bool,
}

fn limit_of(found: ptr<function, Found>) -> i32 {
    return bitcast<i32>((*found).t);
}

// Corners in the world are words of their own, so that near-zero products are noted for this triangle alone.
fn take(ray: PreparedRay, triangle: Triangle, member: TreeInstance, found: ptr<function, Found>) -> bool {
    var v0 = bitcast<vec3<u32>>(triangle.v0);
    var v1 = bitcast<vec3<u32>>(triangle.v1);
    var v2 = bitcast<vec3<u32>>(triangle.v2);
    if MEMBERS {
        v0 = moved_words(member, v0);
        v1 = moved_words(member, v1);
        v2 = moved_words(member, v2);
    }
    let hit = canonical_hit(ray, v0, v1, v2);
    if hit.is_hit == 0u {
        return false;
    }
    // No t is below zero, so words compare as the numbers do.
    if (hit.t > (*found).t) | ((hit.t == (*found).t) & (triangle.primitive >= (*found).primitive)) {
        return false;
    }
    if triangle.is_masked {
        let decision = alpha_decision(triangle.primitive, hit.u, hit.v);
        if decision != COUNTED {
            (*found).masked = select((*found).masked, min((*found).masked, hit.t), decision == OF_FILTER);
            return false;
        }
    }
    (*found).t = hit.t;
    (*found).u = hit.u;
    (*found).v = hit.v;
    (*found).primitive = triangle.primitive;
    return (*found).is_any;
}

fn moved_word(member: TreeInstance, p: vec3<u32>, axis: u32) -> u32 {
    let x = op_mul(bitcast<u32>(member.x[axis]), p.x);
    let y = op_mul(bitcast<u32>(member.y[axis]), p.y);
    let z = op_mul(bitcast<u32>(member.z[axis]), p.z);
    return op_add(op_add(op_add(x, y), z), bitcast<u32>(member.shift[axis]));
}

fn moved_words(member: TreeInstance, p: vec3<u32>) -> vec3<u32> {
    return vec3<u32>(moved_word(member, p, 0u), moved_word(member, p, 1u), moved_word(member, p, 2u));
}

// No driver may contract or reorder this module's arithmetic.
fn rounded(v: vec3<f32>) -> vec3<f32> {
    return v;
}

// Traces a ray. Returns whether its answer is left to the host, which is told.
fn trace(slot: u32, is_any: bool, found: ptr<function, Found>) -> bool {
    *found = Found(0u, 0u, 0u, MISS, MISS, is_any);
    unknown_zero = params.zero;
    var ray: PreparedRay;
    let fitness = prepare(rays[slot], bitcast<u32>(params.scene_max_abs), &ray);
    if fitness == REFUSED {
        return false;
    }
    var is_masked = false;
    if fitness == CERTAIN {
        (*found).t = bitcast<u32>(ray.t_max);
        traverse(ray, found);
        let is_settled = is_any & ((*found).primitive != MISS);
        is_masked = !is_settled & ((*found).masked <= (*found).t);
        if !is_masked & (is_undecided() == 0u) {
            return false;
        }
    }
    // The first word counts the rays, whether or not there is room for them.
    let at = atomicAdd(&undecided_rays[0], 1u) + 1u;
    if at < arrayLength(&undecided_rays) {
        atomicStore(&undecided_rays[at], slot | select(0u, MASKED_RAY, is_masked));
    }
    return true;
}
