// Closest hits. The answer has the words of `Candidates`: the primitives among which the canonical nearest hit of the
// ray is, or their places if EXACT. Of members there are two places, then their members' numbers. If COUNTS, the answer
// is what the ray has visited.

@group(1) @binding(2) var<storage, read_write> answers: array<vec4<u32>>;

// `limit` is the least distance within which some triangle is certainly hit, so the canonical hit is not farther.
// Triangles that are not refused and may be as near are kept, in order of their least possible distances. A triangle
// that does not fit lowers `rest`.
struct Found {
    limit: f32,
    kept: vec3<u32>,
    // The members' numbers of the first two, if EXACT.
    owners: vec2<u32>,
    lows: vec3<f32>,
    rest: f32,
}

fn limit_of(found: ptr<function, Found>) -> f32 {
    return (*found).limit;
}

fn take(found: ptr<function, Found>, verdict: Verdict, candidate: u32) -> bool {
    if verdict.low > (*found).limit {
        return false;
    }
    if verdict.kind == CERTAIN {
        (*found).limit = min((*found).limit, verdict.high);
    }
    // Inserts the triangle in order, and drops the last one.
    let lows = (*found).lows;
    (*found).rest = min((*found).rest, max(lows.z, verdict.low));
    let low = vec3<f32>(verdict.low);
    let before = low < lows;
    let moved = vec3<bool>(false, before.xy);
    (*found).kept = select((*found).kept, select(vec3<u32>(candidate), (*found).kept.xxy, moved), before);
    if EXACT && MEMBERS {
        let owners = (*found).owners;
        (*found).owners = select(owners, select(vec2<u32>(current_member), owners.xx, moved.xy), before.xy);
    }
    (*found).lows = select(lows, select(low, lows.xxy, moved), before);
    return false;
}

@compute @workgroup_size(WORKGROUP_SIZE)
fn trace_closest(@builtin(global_invocation_id) id: vec3<u32>) {
    let slot = id.x;
    if slot >= params.count {
        return;
    }
    var ray: PreparedRay;
    let fitness = prepare(rays[slot], &ray);
    if fitness != CERTAIN {
        let is_miss = fitness == REFUSED;
        let first = select(MISS, UNDECIDED, EXACT && !is_miss);
        let rest = select(-1.0, LARGEST_FLOAT, is_miss);
        let answer = vec4<u32>(first, MISS, MISS, bitcast<u32>(rest));
        answers[slot] = select(answer, vec4<u32>(0u), vec4<bool>(COUNTS));
        return;
    }
    var found = Found(ray.t_max, vec3<u32>(MISS), vec2<u32>(0u), vec3<f32>(LARGEST_FLOAT), LARGEST_FLOAT);
    traverse(ray, &found);
    if COUNTS {
        answers[slot] = vec4<u32>(visits.nodes, visits.triangles, visits.bytes, visits.instances);
        return;
    }
    let near = select(vec3<u32>(MISS), found.kept, found.lows <= vec3<f32>(found.limit));
    let rest = select(LARGEST_FLOAT, found.rest, found.rest <= found.limit);
    if EXACT && MEMBERS {
        let is_full = near.z != MISS || rest != LARGEST_FLOAT;
        answers[slot] = vec4<u32>(select(near.x, UNDECIDED, is_full), near.y, found.owners);
        return;
    }
    answers[slot] = vec4<u32>(near, bitcast<u32>(rest));
}
