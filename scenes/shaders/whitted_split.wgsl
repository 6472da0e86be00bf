// Whitted's algorithm (1980) as a hit shader and a loop shader, split by hand as in Ray Accelerator (section 3.3). The
// same picture as whitted.wgsl, to the bit.

// Smoother reflections are followed as mirrors, and bodies are clear.
const mirror_below: f32 = 0.25;

struct Payload {
    // The weight of radiance along the ray in its pixel.
    throughput: vec3f,
    // Position in the tree of rays: 1 for the camera ray, 2n and 2n + 1 for the reflection and the refraction of ray n.
    branch: u32,
}

// A refracted ray, which waits until the path of the reflected one has ended.
struct Entry {
    ray: Ray,
    throughput: vec3f,
    branch: u32,
}

fn start(p: ptr<function, Payload>) {
    (*p).throughput = vec3f(1.0);
    (*p).branch = 1u;
}

// Shadow rays to the lights.
fn light(at: Hit, weight: vec3f, branch: u32) {
    for (var i = 0u; i < 4u; i++) {
        if (i < at.lights) {
            let u = random_at(2u * branch + min(i, 1u));
            let light = light_sample(i, u, random2_at(2u * branch));
            if (is_above(light.wi)) {
                let value = bsdf_evaluate(light.wi).value;
                shadow(light.ray, weight * value * light.radiance / light.pdf);
            }
        }
    }
}

fn hit(at: Hit, p: Payload) {
    splat(p.throughput * at.emitted);
    let weight = p.throughput * at.passed;
    light(at, weight, p.branch);
    if (is_last()) {
        return;
    }
    let ways = bsdf_ways();
    let reflection = weight * ways.reflection;
    let refraction = weight * ways.refraction;
    let refracts = any(refraction != vec3f(0.0));
    let branch = 2u * p.branch;
    let reflects = any(reflection != vec3f(0.0));
    if (reflects && refracts) {
        push(Entry(ways.refracted, refraction, branch + 1u));
    }
    if (reflects) {
        spawn(ways.reflected, Payload(reflection, branch));
    } else if (refracts) {
        spawn(ways.refracted, Payload(refraction, branch + 1u));
    }
}

fn resume(e: Entry, came: vec3f, p: Payload) {
    spawn(e.ray, Payload(e.throughput, e.branch));
}

fn miss(direction: vec3f, p: Payload) {
    splat(p.throughput * sky(direction));
}
