// A drawing: flat colours in bands of light, dark outlines, hard shadows. Mirrors and glass show what they reflect.

// Bands of light.
override bands: u32 = 3u;
// Width of outlines: the cosine of the view below which a surface is an edge.
override outline: f32 = 0.25;

const mirror_below: f32 = 0.25;

// Direction towards the sun.
const sun = vec3f(0.48, 0.76, 0.44);

struct Payload {
    weight: f32,
}

fn start(p: ptr<function, Payload>) {
    (*p).weight = 1.0;
}

fn hit(at: Hit, p: Payload) -> vec3f {
    if (dot(at.wo, at.normal) < outline) {
        return vec3f(0.02);
    }
    if (any(at.emitted > vec3f(0.0))) {
        return vec3f(1.0, 0.95, 0.8);
    }
    let steps = f32(bands);
    let lit = ceil(max(dot(at.normal, normalize(sun)), 0.0) * steps) / steps;
    // Light beyond the ambient share arrives unless something is between.
    shadow(leave(normalize(sun)), p.weight * 0.75 * lit * at.colour);
    let ways = bsdf_ways();
    let flat_colour = 0.3 * at.colour;
    if (at.lights > 0u && all(ways.reflection < vec3f(0.3))) {
        return flat_colour;
    }
    let glass = any(ways.refraction > ways.reflection);
    var way = ways.reflected;
    if (glass) {
        way = ways.refracted;
    }
    let seen = trace(way, Payload(0.6 * p.weight));
    return mix(flat_colour, seen, 0.6);
}

fn miss(direction: vec3f, p: Payload) -> vec3f {
    let height = clamp(ceil((direction.y + 0.1) * 5.0) / 5.0, 0.0, 1.0);
    return mix(vec3f(0.92, 0.9, 0.78), vec3f(0.35, 0.6, 0.85), height);
}
