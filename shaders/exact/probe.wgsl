// Probes of a module's arithmetic: the fused multiply-add by itself, and the canonical test of pairs of a ray and a
// triangle. The host compares the results with its own before the module is used.

@group(2) @binding(0) var<storage, read> cases: array<u32>;
@group(2) @binding(1) var<storage, read_write> results: array<vec4<u32>>;
// The number of cases, and 0.
@group(2) @binding(2) var<uniform> probe: vec4<u32>;

@compute @workgroup_size(WORKGROUP_SIZE)
fn probe_fma(@builtin(global_invocation_id) id: vec3<u32>) {
    let slot = id.x;
    if slot >= probe.x {
        return;
    }
    let result = op_fma(cases[3u * slot], cases[3u * slot + 1u], cases[3u * slot + 2u]);
    results[slot] = vec4<u32>(result, is_undecided(), 0u, 0u);
}

fn case_at(word: u32) -> vec3<u32> {
    return vec3<u32>(cases[word], cases[word + 1u], cases[word + 2u]);
}

@compute @workgroup_size(WORKGROUP_SIZE)
fn probe_pairs(@builtin(global_invocation_id) id: vec3<u32>) {
    let slot = id.x;
    if slot >= probe.x {
        return;
    }
    let first = CASE_WORDS * slot;
    let origin = bitcast<vec3<f32>>(case_at(first));
    let direction = bitcast<vec3<f32>>(case_at(first + 4u));
    let interval = bitcast<vec2<f32>>(vec2<u32>(cases[first + 3u], cases[first + 7u]));
    let scene_reach = cases[first + 17u];
    unknown_zero = probe.y;
    var prepared: PreparedRay;
    let fitness = prepare(Ray(origin, interval.x, direction, interval.y), scene_reach, &prepared);
    var hit = NO_HIT;
    if fitness == CERTAIN {
        hit = canonical_hit(prepared, case_at(first + 8u), case_at(first + 11u), case_at(first + 14u));
    }
    // Scenes beyond the largest coordinate are refused when they are loaded.
    let is_open = (fitness == UNCERTAIN) | (is_undecided() != 0u) | (scene_reach > MAX_COORDINATE);
    results[slot] = vec4<u32>(hit.t, hit.u, hit.v, hit.is_hit | select(0u, 2u, is_open));
}
