// The shading of Interactive Rendering with Coherent Ray Tracing (Wald and others 2001): reflections, and shadows from
// three point lights.

const mirror_below: f32 = 0.35;

// Strength of the lights.
override power: f32 = 14.0;
// The share that is lit without any light.
override ambient: f32 = 0.08;

const lamps = array<vec3f, 3>(vec3f(-3.0, 4.5, 3.0), vec3f(3.5, 4.0, 2.0), vec3f(0.5, 5.0, -3.0));
const colours = array<vec3f, 3>(vec3f(1.0, 0.85, 0.6), vec3f(0.55, 0.7, 1.0), vec3f(0.8, 0.9, 0.8));

struct Payload {
    weight: vec3f,
}

fn start(p: ptr<function, Payload>) {
    (*p).weight = vec3f(1.0);
}

fn hit(at: Hit, p: Payload) -> vec3f {
    let weight = p.weight * at.passed;
    for (var i = 0u; i < 3u; i++) {
        let way = lamps[i] - at.position;
        let distance = length(way);
        let ray = leave(way / distance);
        // Diffuse light, and a highlight as Phong has it.
        let facing = max(dot(at.normal, ray.direction), 0.0);
        let mirrored = max(dot(reflect(-at.wo, at.normal), ray.direction), 0.0);
        let reflected = at.colour * facing + vec3f(0.3 * pow(mirrored, 40.0) * step(1e-6, facing));
        let arrives = colours[i] * (power / (distance * distance));
        shadow(Ray(ray.origin, ray.direction, 0.999 * distance), weight * reflected * arrives * 0.3183099);
    }
    let ways = bsdf_ways();
    let here = at.emitted + ambient * at.colour;
    let share = clamp(ways.reflection, vec3f(0.0), vec3f(0.8));
    let through = ways.refraction;
    var seen = vec3f(0.0);
    if (any(share > vec3f(0.01))) {
        seen += share * trace(ways.reflected, Payload(weight * share));
    }
    if (any(through > vec3f(0.01))) {
        seen += through * trace(ways.refracted, Payload(weight * through));
    }
    return at.passed * (here + seen);
}

fn miss(direction: vec3f, p: Payload) -> vec3f {
    return sky(direction);
}
