// Any hit. The answer is OCCLUDED, MISS, or a primitive that occludes the ray unless rounding or alpha decides against
// it, with the flag MORE when there are other such primitives. UNDECIDED when the kernel cannot tell.

@group(1) @binding(2) var<storage, read_write> answers: array<u32>;

struct Found {
    limit: f32,
    answer: u32,
}

fn limit_of(found: ptr<function, Found>) -> i32 {
    return bitcast<i32>((*found).limit);
}

// The first certain hit ends the traversal.
fn take(ray: PreparedRay, triangle: Triangle, member: TreeInstance, found: ptr<function, Found>) -> bool {
    let verdict = verdict_of(ray, triangle, member);
    if verdict.kind == REFUSED {
        return false;
    }
    let answer = (*found).answer;
    let is_certain = verdict.kind == CERTAIN;
    let candidate = select(answer | MORE, triangle.primitive, answer == MISS);
    (*found).answer = select(candidate, OCCLUDED, is_certain);
    return is_certain;
}

@compute @workgroup_size(WORKGROUP_SIZE)
fn trace_any(@builtin(global_invocation_id) id: vec3<u32>) {
    let slot = id.x;
    if slot >= params.count {
        return;
    }
    var ray: PreparedRay;
    let fitness = prepare(rays[slot], bitcast<u32>(params.scene_max_abs), &ray);
    if fitness != CERTAIN {
        answers[slot] = select(UNDECIDED, MISS, fitness == REFUSED);
        return;
    }
    var found = Found(ray.t_max, MISS);
    traverse(ray, &found);
    answers[slot] = found.answer;
}
