// Functions that every shader file can use. Names that a file defines itself come first.

const TAU: f32 = 6.2831855;

// A picture at uv: red, green, blue and alpha as linear numbers. It is averaged over what the ray's cone covers of
// `at.uv`, `at.uv1` to `at.uv3`, `at.position` or `at.object_position`, times known factors. Other coordinates read
// single texels.
fn image(picture: texture_2d<f32>, uv: vec2f) -> vec4f {
    return vec4f(uv, 0.0, 1.0);
}

// The same, averaged over a square of this side around uv.
fn image_over(picture: texture_2d<f32>, uv: vec2f, side: f32) -> vec4f {
    return vec4f(uv, side, 1.0);
}

// The texture coordinates of a set of the mesh, numbered from 0 to 3; those of the first where there is no such set.
fn uv_set(at: Point, number: u32) -> vec2f {
    if number == 0u { return at.uv; }
    if number == 1u { return at.uv1; }
    if number == 2u { return at.uv2; }
    if number == 3u { return at.uv3; }
    return at.uv;
}

// In a BSDF: the native BSDF of a finish, where the shading normal is +z. BSDF times |cosine|, and the density of
// `finish_sample`.
fn finish_evaluate(finish: Finish, wo: vec3f, wi: vec3f) -> Lobe {
    return Lobe(finish.colour * wi.z, wo.z);
}

// A direction, as the native BSDF of a finish scatters light.
fn finish_sample(finish: Finish, wo: vec3f, u: f32, u2: vec2f) -> Scattered {
    return Scattered(vec3f(u2, wo.z), finish.colour, u);
}

fn pow3(base: vec3f, power: f32) -> vec3f {
    return vec3f(pow_of(base.x, power), pow_of(base.y, power), pow_of(base.z, power));
}

// From a to b; what is the same in both stays as it is.
fn mixed(a: f32, b: f32, share: f32) -> f32 {
    return select(mix(a, b, share), a, bitcast<u32>(a) == bitcast<u32>(b));
}

fn mixed3(a: vec3f, b: vec3f, share: f32) -> vec3f {
    return vec3f(mixed(a.x, b.x, share), mixed(a.y, b.y, share), mixed(a.z, b.z, share));
}

fn tinted(colour: vec3f, tint: vec3f) -> vec3f {
    return select(colour * tint, colour, colour == vec3f(0.0));
}

// A finish under a clear varnish that covers a share of it. Of the varnish two things count: its colour, which is the
// share of white light that remains after it has passed the varnish down and up, and its roughness.
fn layer(varnish: Finish, below: Finish, weight: f32) -> Finish {
    let share = clamp(weight, 0.0, 1.0);
    let tint = mixed3(vec3f(1.0), varnish.colour, share);
    var coated = below;
    coated.colour = below.colour * tint;
    coated.specular_tint = below.specular_tint * tint;
    coated.sheen = tinted(below.sheen, tint);
    coated.diffuse_transmission_colour = below.diffuse_transmission_colour * tint;
    coated.emission = tinted(below.emission, sqrt(max(tint, vec3f(0.0))));
    coated.clearcoat = below.clearcoat + (1.0 - below.clearcoat) * share;
    let part = select(share / coated.clearcoat, 0.0, coated.clearcoat == 0.0);
    coated.clearcoat_roughness = mixed(below.clearcoat_roughness, varnish.roughness, part);
    return coated;
}

// The share of light that the boundary of a body of an index of refraction reflects at normal incidence.
fn reflectance_of(ior: f32) -> f32 {
    let ratio = (ior - 1.0) / (ior + 1.0);
    return ratio * ratio;
}

// From 0 to 1 with a slope of 0 at either end.
fn ease(x: f32) -> f32 {
    return x * x * x * (x * (x * 6.0 - 15.0) + 10.0);
}

fn place(whole: f32) -> u32 {
    return u32(clamp(whole + 65536.0, 0.0, 131072.0));
}

// A random number of 0 to 1 for each point of a lattice.
fn lattice(x: u32, y: u32, z: u32) -> f32 {
    var mixed = (x * 0x8da6b343u) ^ (y * 0xd8163841u) ^ (z * 0xcb1ab31fu);
    mixed = (mixed ^ (mixed >> 15u)) * 0x2c1b3c6du;
    mixed = (mixed ^ (mixed >> 12u)) * 0x297a2d39u;
    return f32((mixed ^ (mixed >> 15u)) >> 8u) * (1.0f / 16777216.0f);
}

// Smooth noise of 0 to 1 with features of unit size, between -65536 and 65536.
fn noise(p: vec3f) -> f32 {
    let low = floor(p);
    let x = place(low.x);
    let y = place(low.y);
    let z = place(low.z);
    let u = ease(p.x - low.x);
    let v = ease(p.y - low.y);
    let w = ease(p.z - low.z);
    let near = mix(
        mix(lattice(x, y, z), lattice(x + 1u, y, z), u),
        mix(lattice(x, y + 1u, z), lattice(x + 1u, y + 1u, z), u),
        v,
    );
    let far = mix(
        mix(lattice(x, y, z + 1u), lattice(x + 1u, y, z + 1u), u),
        mix(lattice(x, y + 1u, z + 1u), lattice(x + 1u, y + 1u, z + 1u), u),
        v,
    );
    return mix(near, far, w);
}

// Noise of many sizes, each half as large and half as strong as the one before, around 0.
fn turbulence(p: vec3f, octaves: u32) -> f32 {
    var sum = 0.0;
    var size = 1.0;
    var strength = 1.0;
    for (var octave = 0u; octave < octaves; octave++) {
        sum += (noise(p * size) - 0.5) * strength;
        size *= 2.03;
        strength *= 0.5;
    }
    return sum;
}

// A point on the unit disk for two random numbers (Shirley and Chiu's concentric map).
fn disk(u: vec2f) -> vec2f {
    let x = 2.0 * u.x - 1.0;
    let y = 2.0 * u.y - 1.0;
    let wide = abs(x) > abs(y);
    let r = select(y, x, wide);
    let other = select(x, y, wide);
    let share = select(other / r, r, r == 0.0);
    let angle = share * 0.7853982;
    let sine = small_sin(angle);
    let cosine = small_cos(angle);
    return vec2f(r * select(sine, cosine, wide), r * select(cosine, sine, wide));
}

// A unit direction around z for two random numbers, with a density proportional to its cosine.
fn cosine_hemisphere(u: vec2f) -> vec3f {
    let p = disk(u);
    return vec3f(p.x, p.y, sqrt(clamp(1.0 - p.x * p.x - p.y * p.y, 0.0, 1.0)));
}

// The density of cosine_hemisphere for a direction whose cosine is z.
fn cosine_hemisphere_pdf(z: f32) -> f32 {
    return clamp(z, 0.0, 1.0) * 0.31830987;
}

// A sample from a direction and what `evaluate` returned for it.
fn scattered(wi: vec3f, lobe: Lobe) -> Scattered {
    let there = lobe.pdf > 0.0;
    return Scattered(wi, select(vec3f(0.0), lobe.value / lobe.pdf, there), select(0.0, lobe.pdf, there));
}
