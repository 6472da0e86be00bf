// What the device makes of sums, differences, products and quotients: the error bounds of the
// kernels assume that the first three are rounded to nearest and the last is within 2.5 ulp.

@group(0) @binding(0) var<storage, read> pairs: array<vec2<f32>>;
@group(0) @binding(1) var<storage, read_write> results: array<vec4<f32>>;

@compute @workgroup_size(PROBES)
fn probe_rounding(@builtin(local_invocation_index) i: u32) {
    let p = pairs[i];
    results[i] = vec4<f32>(p.x + p.y, p.x - p.y, p.x * p.y, p.x / p.y);
}
