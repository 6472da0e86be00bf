// Any hits: 1 if the ray is occluded, else 0.

@group(1) @binding(2) var<storage, read_write> occluded: array<u32>;

@compute @workgroup_size(WORKGROUP_SIZE)
fn trace_any(@builtin(global_invocation_id) id: vec3<u32>) {
    let slot = id.x;
    if slot >= params.count {
        return;
    }
    var found: Found;
    let is_open = trace(slot, true, &found);
    occluded[slot] = select(select(0u, 1u, found.primitive != MISS), UNDECIDED, is_open);
}
