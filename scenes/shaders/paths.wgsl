// A path tracer as one recursive function: at each hit the light that reaches it, and what comes along a sample of the
// BSDF. It finds the picture of `--integrator path`, with more noise: it does not weight the two ways to a light.

struct Payload {
    // 1 if the ray shows lights: no other ray could have found them.
    sees_lights: u32,
}

fn start(p: ptr<function, Payload>) {
    (*p).sees_lights = 1u;
}

fn hit(at: Hit, p: Payload) -> vec3f {
    var light = f32(p.sees_lights) * at.emitted;
    if at.lights > 0u {
        // One light, chosen with equal probability.
        let chosen = min(u32(random(0u) * f32(at.lights)), at.lights - 1u);
        let s = light_sample(chosen, random(1u), random2(2u));
        if is_above(s.wi) {
            light += bsdf_evaluate(s.wi).value * s.radiance * (f32(at.lights) / s.pdf) * visible(s.ray);
        }
    }
    let next = bsdf_sample(random(4u), random2(5u));
    if any(next.weight > vec3f(0.0)) {
        // What mirrors and refracts has no density, and no light sample goes there.
        light += next.weight * trace(next.ray, Payload(select(0u, 1u, next.pdf > 1e30)));
    }
    return at.passed * light;
}

fn miss(direction: vec3f, p: Payload) -> vec3f {
    return f32(p.sees_lights) * sky(direction);
}
