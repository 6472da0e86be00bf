// Dust on any material: it lies where a surface faces up, and scatters light by a law of its own (dust.wgsl). Between
// the grains the BSDF of the material itself shows.

// Share of a face that looks up which dust covers at most, 0 to 1.
override amount: f32 = 0.9;

struct Params {
    // Share of light that a grain scatters.
    colour: vec3f,
}
var<private> params: Params = Params(vec3f(0.9, 0.82, 0.7));

struct State {
    below: Finish,
    // The share of light that a grain scatters / 4 pi.
    grain: vec3f,
    covered: f32,
}

fn prepare(at: Point) -> State {
    let up = smoothstep(0.2, 0.9, at.normal.y);
    let patches = smoothstep(0.25, 0.6, turbulence(at.position * 4.0, 4u));
    return State(base(at), params.colour * 0.07957747, clamp(amount * up * patches, 0.0, 1.0));
}

fn evaluate(s: State, wo: vec3f, wi: vec3f) -> Lobe {
    let below = finish_evaluate(s.below, wo, wi);
    let cosine = clamp(wi.z, 0.0, 1.0);
    let dust = s.grain * (cosine / (wo.z + cosine));
    let pdf = mix(below.pdf, cosine_hemisphere_pdf(wi.z), s.covered);
    return Lobe(mix(below.value, dust, s.covered), pdf);
}

fn sample(s: State, wo: vec3f, u: f32, u2: vec2f) -> Scattered {
    var wi = cosine_hemisphere(u2);
    if (u >= s.covered) {
        wi = finish_sample(s.below, wo, (u - s.covered) / (1.0 - s.covered), u2).wi;
    }
    return scattered(wi, evaluate(s, wo, wi));
}
