// Nearest hits. Replaces each answer of `trace_closest` by a hit's words: t, u, v and the primitive.

@group(1) @binding(2) var<storage, read_write> answers: array<vec4<u32>>;

@compute @workgroup_size(WORKGROUP_SIZE)
fn resolve_closest(@builtin(global_invocation_id) id: vec3<u32>) {
    let slot = id.x;
    if (slot >= params.count) {
        return;
    }
    let found = answers[slot];
    let miss = vec4<u32>(INFINITE, 0u, 0u, MISS);
    // A member's candidates are two places and their members; others are three and the distance of what was left out.
    let candidates = select(found.xyz, vec3<u32>(found.xy, MISS), vec3<bool>(MEMBERS));
    let rest = select(found.w, LARGEST_FLOAT, MEMBERS);
    if (candidates.x == MISS && rest == LARGEST_FLOAT) {
        answers[slot] = miss;
        return;
    }
    // What was left out may be as near as the ray's beginning; negative words would not compare as numbers do.
    var is_open = candidates.x == UNDECIDED || (rest & SIGN) != 0u;
    var is_masked = false;
    var best = miss;
    if (!is_open) {
        let ray = ray_at(slot);
        for (var number = 0u; number < 3u; number++) {
            let place = candidates[number];
            if (place == MISS) {
                break;
            }
            if ((place & PLACE_MASKED) != 0u) {
                is_masked = true;
                break;
            }
            let corners = in_world(corners_at(place), select(found.z, found.w, number == 1u));
            let hit = canonical_hit(ray, corners.v0, corners.v1, corners.v2);
            // No t is below zero, so words compare as the numbers do.
            let is_first = hit.t < best.x || (hit.t == best.x && corners.primitive < best.w);
            if (hit.is_hit == 1u && is_first) {
                best = vec4<u32>(hit.t, hit.u, hit.v, corners.primitive);
            }
        }
        is_open = is_undecided() != 0u || !(rest == LARGEST_FLOAT || best.x < rest);
    }
    if (is_open || is_masked) {
        best = vec4<u32>(0u, 0u, 0u, UNDECIDED);
        leave_to_host(slot, is_masked);
    }
    answers[slot] = best;
}
