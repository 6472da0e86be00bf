// Pearlescent paint under a clear coat: flakes reflect one colour straight back and another one to the side. The BSDF
// knows nothing of the coat, which the engine lays over it.

// Perceptual roughness of the coat.
override gloss: f32 = 0.0;

struct Params {
    // Colour seen from where the light is, and colour seen against it.
    face: vec3f,
    flop: vec3f,
}
var<private> params: Params = Params(vec3f(0.85, 0.3, 0.55), vec3f(0.1, 0.25, 0.75));

struct State {
    face: vec3f,
    flop: vec3f,
}

fn prepare(at: Point) -> State {
    // Flakes are not equally dense everywhere.
    let sparkle = 0.85 + 0.15 * noise(at.object_position * 120.0);
    return State(params.face * sparkle, params.flop * sparkle);
}

fn evaluate(s: State, wo: vec3f, wi: vec3f) -> Lobe {
    if (wi.z <= 0.0) {
        return Lobe(vec3f(0.0), 0.0);
    }
    // The angle between light and flake is that between viewer and flake, so both may trade places.
    let tilt = 1.0 - dot(wo, normalize(wo + wi));
    let pdf = cosine_hemisphere_pdf(wi.z);
    return Lobe(mix(s.face, s.flop, smoothstep(0.0, 0.35, tilt)) * pdf, pdf);
}

fn sample(s: State, wo: vec3f, u: f32, u2: vec2f) -> Scattered {
    let wi = cosine_hemisphere(u2);
    return scattered(wi, evaluate(s, wo, wi));
}

fn clear_coat(at: Point) -> ClearCoat {
    return ClearCoat(1.0, gloss, vec3f(1.0));
}
