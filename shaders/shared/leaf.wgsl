// The triangles of a leaf, which lie in pairs that share an edge (RA section 4): four corners and five edge functions
// instead of six and six. `open_triangles` rejects most of them; `take` stands here once, for both triangles of a pair.

fn through_leaf(ray: PreparedRay, reference: u32, member: TreeInstance, found: ptr<function, Found>) -> bool {
    let first = reference & PAIR_INDEX;
    let pairs = ((reference >> PAIRS_SHIFT) & 7u) + 1u;
    for (var index = first; index < first + pairs; index++) {
        let pair = pair_at(index);
        if COUNTS {
            visit_pair(index);
        }
        // One bit for each triangle that remains.
        var open = open_triangles(ray, in_world(pair, member));
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
            if identity == MISS {
                continue;
            }
            let p = select(pair.a.xyz, pair.c.xyz, is_second);
            let q = pair.b.xyz;
            let r = select(pair.c.xyz, fourth(pair), is_second);
            // In the canonical order.
            let turn = identity >> TURN_SHIFT;
            let v0 = select(select(p, q, turn == 1u), r, turn == 2u);
            let v1 = select(select(q, r, turn == 1u), p, turn == 2u);
            let v2 = select(select(r, p, turn == 1u), q, turn == 2u);
            let primitive = (identity & PRIMITIVE) + select(0u, member.first, MEMBERS);
            let triangle = Triangle(v0, v1, v2, primitive, (reference & MASKED) != 0u);
            if take(ray, triangle, member, found) {
                return true;
            }
        }
    }
    return false;
}

// A triangle as it lies in its tree, its corners in the canonical order, and its primitive in the scene.
struct Triangle {
    v0: vec3<f32>,
    v1: vec3<f32>,
    v2: vec3<f32>,
    primitive: u32,
    is_masked: bool,
}

// The corner d.
fn fourth(pair: Pair) -> vec3<f32> {
    return vec3<f32>(pair.a.w, pair.b.w, pair.c.w);
}

fn in_world(pair: Pair, member: TreeInstance) -> Pair {
    if !MEMBERS {
        return pair;
    }
    let d = moved(member, fourth(pair));
    return Pair(
        vec4<f32>(moved(member, pair.a.xyz), d.x),
        vec4<f32>(moved(member, pair.b.xyz), d.y),
        vec4<f32>(moved(member, pair.c.xyz), d.z),
    );
}
