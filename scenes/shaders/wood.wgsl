// Wood of a tree that grew along y: rings, fibres, pores and rays, after RA's Figure 6. The same surface in Rust is
// examples/wood.rs.

// Rings in a unit of length.
override rings: f32 = 3.0;

fn pattern(at: Point) -> Finish {
    let p = at.position * rings;
    // The trunk bends, its rings are dented.
    let slow = vec3f(p.x * 0.11, p.y * 0.03, p.z * 0.11);
    let x = p.x + turbulence(slow, 5u) * 5.0;
    let z = p.z + turbulence(vec3f(slow.z + 37.0, slow.y, slow.x - 11.0), 5u) * 5.0;
    let radius = sqrt(x * x + z * z) + turbulence(p * 0.9, 4u) * 0.35;
    // Within a year wood darkens slowly, and is pale again all at once.
    let year = radius - floor(radius);
    let darkening = year * year * (1.0 - ease(clamp((year - 0.86) * 7.0, 0.0, 1.0)));
    let width = noise(vec3f(floor(radius) * 3.7, 0.0, 0.0));
    let late = darkening * (width * 0.7 + 0.5);
    // Fibres and pores run along the trunk; rays from the pith outwards shimmer.
    let fibres = turbulence(vec3f(x * 3.0, p.y * 0.12, z * 3.0), 6u);
    let hole = noise(vec3f(x * 8.0, p.y * 0.3, z * 8.0));
    let pores = ease(clamp((hole - 0.66) * 5.0, 0.0, 1.0)) * (1.0 - late * 0.5);
    let turn = atan2(z, x) / TAU;
    let shimmer = noise(vec3f(turn * 60.0 + 400.0, p.y * 0.3, radius * 0.2));
    let rays = ease(clamp((shimmer - 0.7) * 4.0, 0.0, 1.0));

    let early = vec3f(0.62, 0.36, 0.17);
    let dark = vec3f(0.27, 0.11, 0.04);
    let light = 1.0 + fibres * 0.4 - pores * 0.35 + rays * 0.12;
    var finish = matte(at);
    finish.colour = mix(early, dark, clamp(late, 0.0, 1.0)) * light;
    finish.roughness = 0.42 + pores * 0.35 - late * 0.1;
    finish.clearcoat = 0.35 - pores * 0.3;
    return finish;
}
