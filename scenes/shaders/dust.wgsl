// A thick layer of dust (Lommel and Seeliger's law): each grain scatters light evenly and once. Seen from the sun's
// side a ball of it is as bright at its rim as in its middle, like the moon.

// Share of the light that a grain scatters, 0 to 1.
override albedo: f32 = 0.9;

struct Params {
    // Colour of the grains.
    colour: vec3f,
}
var<private> params: Params = Params(vec3f(1.0, 0.95, 0.88));

struct State {
    colour: vec3f,
    // albedo / 4 pi
    scale: f32,
}

fn prepare(at: Point) -> State {
    return State(params.colour, albedo * 0.07957747);
}

fn evaluate(s: State, wo: vec3f, wi: vec3f) -> Lobe {
    let cosine = clamp(wi.z, 0.0, 1.0);
    let value = cosine * s.scale / (wo.z + cosine);
    return Lobe(s.colour * value, cosine_hemisphere_pdf(wi.z));
}

fn sample(s: State, wo: vec3f, u: f32, u2: vec2f) -> Scattered {
    let wi = cosine_hemisphere(u2);
    return scattered(wi, evaluate(s, wo, wi));
}
