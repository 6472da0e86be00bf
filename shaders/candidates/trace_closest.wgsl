// Closest hits. The answer has the words of `Candidates`: the primitives among which the canonical nearest hit of the
// ray is. If COUNTS, the answer is what the ray has visited.

@group(1) @binding(2) var<storage, read_write> answers: array<vec4<u32>>;

// `limit` is the least distance within which some triangle is certainly hit, so the canonical hit is not farther.
// Triangles that are not refused and may be as near are kept, in order of their least possible distances. A triangle
// that does not fit lowers `rest`.
struct Found {
    limit: f32,
    kept: vec3<u32>,
    lows: vec3<f32>,
    rest: f32,
}

fn limit_of(found: ptr<function, Found>) -> i32 {
    // No distance is below zero, and a zero may have either sign.
    return bitcast<i32>((*found).limit) & 0x7fffffff;
}

fn take(ray: PreparedRay, triangle: Triangle, member: TreeInstance, found: ptr<function, Found>) -> bool {
    let verdict = verdict_of(ray, triangle, member);
    if verdict.kind == REFUSED || verdict.low > (*found).limit {
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
    let candidate = vec3<u32>(triangle.primitive);
    (*found).kept = select((*found).kept, select(candidate, (*found).kept.xxy, moved), before);
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
    let fitness = prepare(rays[slot], bitcast<u32>(params.scene_max_abs), &ray);
    if fitness != CERTAIN {
        let rest = select(-1.0, LARGEST_FLOAT, fitness == REFUSED);
        let answer = vec4<u32>(MISS, MISS, MISS, bitcast<u32>(rest));
        answers[slot] = select(answer, vec4<u32>(0u), vec4<bool>(COUNTS));
        return;
    }
    var found = Found(ray.t_max, vec3<u32>(MISS), vec3<f32>(LARGEST_FLOAT), LARGEST_FLOAT);
    traverse(ray, &found);
    if COUNTS {
        answers[slot] = visited();
        return;
    }
    let near = select(vec3<u32>(MISS), found.kept, found.lows <= vec3<f32>(found.limit));
    let rest = select(LARGEST_FLOAT, found.rest, found.rest <= found.limit);
    answers[slot] = vec4<u32>(near, bitcast<u32>(rest));
}
