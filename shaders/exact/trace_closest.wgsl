// Nearest hits: t, u, v and the primitive. If COUNTS, the answer is what the ray has visited.

@group(1) @binding(2) var<storage, read_write> hits: array<vec4<u32>>;

@compute @workgroup_size(WORKGROUP_SIZE)
fn trace_closest(@builtin(global_invocation_id) id: vec3<u32>) {
    let slot = id.x;
    if slot >= params.count {
        return;
    }
    var found: Found;
    let is_open = trace(slot, false, &found);
    let is_miss = found.primitive == MISS;
    let hit = select(vec4<u32>(found.t, found.u, found.v, found.primitive), vec4<u32>(INFINITE, 0u, 0u, MISS), is_miss);
    let answer = select(hit, vec4<u32>(0u, 0u, 0u, UNDECIDED), is_open);
    hits[slot] = select(answer, visited(), COUNTS);
}
