// Any hits. Replaces each answer of `trace_any` by 1 if the ray is occluded, else 0.

@group(1) @binding(2) var<storage, read_write> occluded: array<u32>;

@compute @workgroup_size(WORKGROUP_SIZE)
fn resolve_any(@builtin(global_invocation_id) id: vec3<u32>) {
    let slot = id.x;
    if (slot >= params.count) {
        return;
    }
    let found = occluded[slot];
    if (found == OCCLUDED || found == MISS) {
        occluded[slot] = select(0u, 1u, found == OCCLUDED);
        return;
    }
    let is_masked = found != UNDECIDED && (found & PLACE_MASKED) != 0u;
    var is_open = found == UNDECIDED || is_masked;
    var is_hit = false;
    if (!is_open) {
        let corners = corners_at(found);
        is_hit = canonical_hit(ray_at(slot), corners.v0, corners.v1, corners.v2).is_hit == 1u;
        is_open = is_undecided() != 0u || (!is_hit && (found & MORE) != 0u);
    }
    if (is_open) {
        leave_to_host(slot, is_masked);
    }
    occluded[slot] = select(select(0u, 1u, is_hit), UNDECIDED, is_open);
}
