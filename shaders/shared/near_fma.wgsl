// a·b + c, rounded once or twice: for what has margins.

fn near_fma(a: f32, b: f32, c: f32) -> f32 {
    return fma(a, b, c);
}

fn near_fma3(a: vec3<f32>, b: vec3<f32>, c: vec3<f32>) -> vec3<f32> {
    return fma(a, b, c);
}

fn near_fma4(a: vec4<f32>, b: vec4<f32>, c: vec4<f32>) -> vec4<f32> {
    return fma(a, b, c);
}
