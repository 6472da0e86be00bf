// Polished marble: folded veins in pale stone.

// Folds in a unit of length.
override folds: f32 = 1.5;
// How much the folds are bent.
override bend: f32 = 2.5;

fn vein(p: vec3f, sharpness: f32) -> f32 {
    let wave = p.x + p.y * 0.6 + bend * turbulence(p, 6u);
    return pow(1.0 - abs(sin(wave * 3.0)), sharpness);
}

fn pattern(at: Point) -> Finish {
    let p = at.position * folds;
    let cloud = turbulence(p * 0.7 + vec3f(9.0, 3.0, 5.0), 4u);
    let thick = vein(p, 6.0);
    let fine = vein(p.zxy * 2.3 + vec3f(17.0, 5.0, 11.0), 14.0) * 0.5;
    let stone = mix(vec3f(0.82, 0.80, 0.76), vec3f(0.62, 0.62, 0.64), clamp(cloud + 0.3, 0.0, 1.0));
    var finish = matte(at);
    finish.colour = mix(stone, vec3f(0.16, 0.17, 0.20), clamp(thick * 0.85 + fine, 0.0, 1.0));
    finish.roughness = 0.45;
    finish.clearcoat = 0.9;
    return finish;
}
