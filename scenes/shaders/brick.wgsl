// A wall of bricks with rough mortar in the plane of x and y. Bricks differ in colour; the mortar lies deeper.

// Length and height of a brick, and the width of the joints, in world units.
override brick_length: f32 = 0.5;
override brick_height: f32 = 0.15;
override joint: f32 = 0.02;

// How far a point lies inside a brick: 0 at the joint's middle.
fn inside(place: vec2f) -> f32 {
    let from_joint = min(place, vec2f(brick_length, brick_height) - place) - 0.5 * joint;
    return min(from_joint.x, from_joint.y);
}

fn pattern(at: Point) -> Finish {
    let row = floor(at.position.y / brick_height);
    let shift = select(0.0, 0.5 * brick_length, row - 2.0 * floor(row * 0.5) == 1.0);
    let x = at.position.x + shift;
    let column = floor(x / brick_length);
    let place = vec2f(x - column * brick_length, at.position.y - row * brick_height);
    let rough = turbulence(at.position * 30.0, 4u);
    let depth = inside(place) + rough * 0.012;
    // Sharper than a pixel would flicker.
    let share = smoothstep(0.0, max(0.008, at.width), depth);
    let shade = noise(vec3f(column * 7.3, row * 3.1, floor(at.position.z) * 5.7));
    let clay = mix(vec3f(0.36, 0.11, 0.06), vec3f(0.58, 0.24, 0.13), shade) * (1.0 + rough * 0.5);
    let mortar = vec3f(0.55, 0.52, 0.47) * (1.0 + rough * 0.4);
    // Edges of bricks are round: the normal leans outwards next to a joint.
    let middle = place - 0.5 * vec2f(brick_length, brick_height);
    let edge = 1.0 - smoothstep(0.0, 0.02, inside(place));
    let across = abs(middle.x) / brick_length > abs(middle.y) / brick_height;
    let lean = select(vec3f(0.0, sign(middle.y), 0.0), vec3f(sign(middle.x), 0.0, 0.0), across);
    var finish = matte(at);
    finish.colour = clamp(mix(mortar, clay, share), vec3f(0.0), vec3f(1.0));
    finish.roughness = mix(1.0, 0.8, share);
    finish.normal = at.normal + lean * edge * 0.6 + (rough * 0.25) * at.geometric_normal;
    return finish;
}
