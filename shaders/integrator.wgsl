// What an integrator can use besides the functions above. The renderer computes the functions whose bodies are empty.

// A ray ends at origin + direction * end.
struct Ray {
    origin: vec3f,
    direction: vec3f,
    end: f32,
}

// A ray to sample a BSDF with, its direction, the factor for the radiance along it, and its density: infinite where the
// direction is one of few. The factor is 0 where there is no such ray.
struct ScatteredRay {
    ray: Ray,
    wi: vec3f,
    weight: vec3f,
    pdf: f32,
}

// The mirrored and the refracted ray, and the factors for the radiance along them; a factor of 0 means that there is
// none.
struct Ways {
    reflected: Ray,
    reflection: vec3f,
    refracted: Ray,
    refraction: vec3f,
}

// A shadow ray to a light, its unit direction, the radiance that arrives if nothing is between, and its density. The
// radiance is 0 where none arrives.
struct LightSample {
    ray: Ray,
    wi: vec3f,
    radiance: vec3f,
    pdf: f32,
}

// Adds radiance to the pixel.
fn splat(radiance: vec3f) {}

// Adds radiance to the pixel if nothing is hit between the ends of a ray.
fn shadow(ray: Ray, radiance: vec3f) {}

// Traces a ray, which comes back in hit or miss; not after the last bounce. Of several the first goes on at once, and
// the others wait on the loop stack until its path ends.
fn spawn(ray: Ray, payload: Payload) {}

// Traces a ray and goes on when its path has ended, with what hit or miss has returned for it; 0 after the last bounce.
fn trace(ray: Ray, payload: Payload) -> vec3f {
    return vec3f();
}

// 1 if nothing is hit between the ends of a ray, 0 otherwise. The function goes on when the ray has been traced, after
// the last bounce, too. Multiply by it where `hit` returns radiance: what `shadow` adds is not weighted by its callers.
fn visible(ray: Ray) -> f32 {
    return 1.0;
}

// Rays before this one on its path; 0 for a camera ray.
fn depth() -> u32 {
    return 0u;
}

// Whether rays from here are no longer traced.
fn is_last() -> bool {
    return false;
}

// A random number from 0 to 1 that depends on pixel, sample and dimension. Use each dimension below 2^30 once.
fn random_at(dimension: u32) -> f32 {
    return 0.0;
}

fn random2_at(dimension: u32) -> vec2f {
    return vec2f();
}

// A random number that depends on pixel, sample, depth and n, which is below 64.
fn random(n: u32) -> f32 {
    return random_at(depth() * 64u + n);
}

fn random2(n: u32) -> vec2f {
    return random2_at(depth() * 64u + n);
}

// Radiance of the environment along a unit direction.
fn sky(direction: vec3f) -> vec3f {
    return vec3f();
}

// A direction of the shading basis, whose z axis is the shading normal, in the world.
fn to_world(direction: vec3f) -> vec3f {
    return vec3f();
}

// Whether a direction points away from the surface: above the triangle or, where vertex normals suggest that the
// surface is bent outwards, above the shading normal's plane. Light from there reaches it.
fn is_above(direction: vec3f) -> bool {
    return false;
}

// The ray that leaves the surface in a direction, without an end.
fn leave(direction: vec3f) -> Ray {
    return Ray();
}

// A sample of a light: 0 is one of the surfaces and the environment, chosen with u, at a place chosen with u2; the
// others below Hit.lights are point, spot and directional lights, one for each, or one chosen with u if there are more
// than three.
fn light_sample(light: u32, u: f32, u2: vec2f) -> LightSample {
    return LightSample();
}

// The BSDF of the surface, without its mirrored and refracted rays, towards the ray's origin from a unit direction.
fn bsdf_evaluate(wi: vec3f) -> Lobe {
    return Lobe();
}

// A ray in proportion to the BSDF: u chooses a lobe, u2 the direction.
fn bsdf_sample(u: f32, u2: vec2f) -> ScatteredRay {
    return ScatteredRay();
}

// The rays that the surface mirrors and refracts without spread.
fn bsdf_ways() -> Ways {
    return Ways();
}
