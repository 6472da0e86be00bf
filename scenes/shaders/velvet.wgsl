// Velvet (Ashikhmin, Premoze and Shirley 2000): fibres that stand upright shine where they are seen from the side. The
// density of facets is theirs, without the shadowing term, as Neubelt and Pettineo (2013) simplify it.

// Width of the bright rim: small is narrow.
override spread: f32 = 0.3;
// Share of the light that the cloth below the fibres scatters.
override base: f32 = 0.25;

struct Params {
    // Colour of the cloth and of its shine.
    colour: vec3f,
    shine: vec3f,
}
var<private> params: Params = Params(vec3f(0.35, 0.02, 0.06), vec3f(0.9, 0.45, 0.5));

struct State {
    colour: vec3f,
    shine: vec3f,
}

fn prepare(at: Point) -> State {
    // Fibres lean here and there, as if a hand had stroked the cloth.
    let stroked = 0.75 + 0.5 * turbulence(at.position * 5.0, 3u);
    return State(params.colour * base, params.shine * clamp(stroked, 0.3, 1.0));
}

// Density of facets whose normal has this cosine with the surface's.
fn facets(cosine: f32) -> f32 {
    let square = cosine * cosine;
    let sine2 = max(1.0 - square, 1e-4);
    let width = spread * spread;
    let peak = exp(-square / (sine2 * width));
    return 0.31830987 / (1.0 + 4.0 * width) * (1.0 + 4.0 * peak / (sine2 * sine2));
}

fn evaluate(s: State, wo: vec3f, wi: vec3f) -> Lobe {
    if (wi.z <= 0.0) {
        return Lobe(vec3f(0.0), 0.0);
    }
    let half = normalize(wo + wi);
    let fibres = facets(half.z) * wi.z / (4.0 * (wi.z + wo.z - wi.z * wo.z));
    let cloth = 0.31830987 * wi.z;
    // The fibres leave the cloth less light where they catch much.
    return Lobe(s.colour * cloth + s.shine * min(fibres, 1.0), 0.15915494);
}

// Directions are even over the hemisphere, because the shine is at grazing angles.
fn sample(s: State, wo: vec3f, u: f32, u2: vec2f) -> Scattered {
    let z = u2.x;
    let r = sqrt(max(1.0 - z * z, 0.0));
    let angle = TAU * u2.y;
    let wi = vec3f(r * cos(angle), r * sin(angle), z);
    return scattered(wi, evaluate(s, wo, wi));
}
