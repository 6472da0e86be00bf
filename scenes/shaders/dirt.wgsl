// Dirt in patches over a material that keeps its textures where it is clean.

// Patches in a unit of length.
override patches: f32 = 2.0;
// The share of the surface that is dirty, 0 to 1.
override cover: f32 = 0.5;

fn pattern(at: Point) -> Finish {
    let p = at.position * patches;
    var dirt = matte(at);
    dirt.colour = vec3f(0.16, 0.1, 0.05) * (0.7 + 0.6 * noise(p * 9.0));
    dirt.roughness = 0.95;
    let rough_edge = gradient_noise(p) + 0.4 * gradient_noise(p * 4.0) + 0.2 * gradient_noise(p * 11.0);
    let mask = smoothstep(-0.08, 0.08, rough_edge + 0.6 * (cover - 0.5));
    return mix_finish(base(at), dirt, mask);
}
