// Tests the triangles of a leaf, which lie in pairs that share an edge (RA section 4): four corners and five edge
// functions instead of six and six. A coarse test rejects most triangles; `judge` stands here once, for both triangles
// of a pair.

// The number of the member whose tree is being traversed.
var<private> current_member: u32;

fn through_leaf(ray: PreparedRay, reference: u32, member: TreeInstance, found: ptr<function, Found>) -> bool {
    let first = reference & PAIR_INDEX;
    let pairs = ((reference >> PAIRS_SHIFT) & 7u) + 1u;
    for (var index = first; index < first + pairs; index++) {
        let pair = pair_in_world(index, member);
        if COUNTS {
            visit_pair(index);
        }
        let corner_d = vec3<f32>(pair.d_x, pair.d_y, pair.d_z);
        let a = rounded(pair.a - ray.origin);
        let b = rounded(pair.b - ray.origin);
        let c = rounded(pair.c - ray.origin);
        let d = rounded(corner_d - ray.origin);
        let shared_side = side_of(ray, c, b);
        let abc = vec3<f32>(side_of(ray, a, c), side_of(ray, b, a), shared_side);
        let cbd = vec3<f32>(side_of(ray, c, d), -shared_side, side_of(ray, d, b));
        // One bit for each triangle that remains.
        var open = select(0u, 1u, may_be_hit(ray, abc, a, b, c)) | select(0u, 2u, may_be_hit(ray, cbd, c, b, d));
        loop {
            if open == 0u {
                break;
            }
            let is_second = open == 2u;
            open &= open - 1u;
            let identities = identity_at(index);
            if COUNTS {
                visit_identities();
            }
            let identity = select(identities.x, identities.y, is_second);
            let p = select(pair.a, pair.c, is_second);
            let q = pair.b;
            let r = select(pair.c, corner_d, is_second);
            // In the canonical order.
            let turn = identity >> TURN_SHIFT;
            let v0 = select(select(p, q, turn == 1u), r, turn == 2u);
            let v1 = select(select(q, r, turn == 1u), p, turn == 2u);
            let v2 = select(select(r, p, turn == 1u), q, turn == 2u);
            let verdict = judge(ray, v0, v1, v2, (reference & MASKED) != 0u);
            if verdict.kind == REFUSED || identity == MISS {
                continue;
            }
            var candidate = identity & PRIMITIVE;
            if MEMBERS {
                candidate += member.first;
            }
            if EXACT {
                candidate = place_of(index, is_second, (reference & MASKED) != 0u);
            }
            if take(found, verdict, candidate) {
                return true;
            }
        }
    }
    return false;
}

// A candidate for the kernels that make its hit: where they find the triangle.
fn place_of(index: u32, is_second: bool, is_masked: bool) -> u32 {
    return (index << 1u) | select(0u, 1u, is_second) | select(0u, PLACE_MASKED, is_masked);
}

fn pair_in_world(index: u32, member: TreeInstance) -> Pair {
    var pair = pair_at(index);
    if MEMBERS {
        let d = moved(member, vec3<f32>(pair.d_x, pair.d_y, pair.d_z));
        pair = Pair(moved(member, pair.a), d.x, moved(member, pair.b), d.y, moved(member, pair.c), d.z);
    }
    return pair;
}
