// Ambient occlusion: the share of directions above a surface in which nothing is hit within reach. Colours and lights
// are ignored.

// Length of the shadow rays in world units.
override reach: f32 = 1.0;

fn hit(at: Hit, p: Payload) {
    let direction = to_world(cosine_hemisphere(random2_at(0u)));
    if (is_above(direction)) {
        let ray = leave(direction);
        shadow(Ray(ray.origin, ray.direction, reach), vec3f(1.0));
    }
}

fn miss(direction: vec3f, p: Payload) {
    splat(vec3f(1.0));
}
