// Computes sums, differences, products and quotients, for the host to check how the device rounds. The error bounds of
// the kernels assume that the first three are rounded to nearest and that quotients are within 2.5 ulp.

@group(0) @binding(0) var<storage, read> pairs: array<vec2<f32>>;
@group(0) @binding(1) var<storage, read_write> results: array<vec4<f32>>;

@compute @workgroup_size(PROBES)
fn probe_rounding(@builtin(local_invocation_index) i: u32) {
    let p = pairs[i];
    results[i] = vec4<f32>(p.x + p.y, p.x - p.y, p.x * p.y, p.x / p.y);
}
