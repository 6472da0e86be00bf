// Noises and random numbers, with the lattice of `noise`.

// Smooth noise of 0 to 1 in the plane.
fn noise2(p: vec2f) -> f32 {
    let low = floor(p);
    let x = place(low.x);
    let y = place(low.y);
    let u = ease(p.x - low.x);
    return mix(
        mix(lattice(x, y, 0u), lattice(x + 1u, y, 0u), u),
        mix(lattice(x, y + 1u, 0u), lattice(x + 1u, y + 1u, 0u), u),
        ease(p.y - low.y),
    );
}

// A whole number modulo a period, as a coordinate of the lattice.
fn repeated(whole: f32, period: f32) -> u32 {
    return u32(clamp(whole - floor(whole / period) * period, 0.0, 131072.0));
}

// Smooth noise of 0 to 1 that repeats after a whole number of units along each axis, at most 131072.
fn periodic_noise(p: vec3f, period: vec3f) -> f32 {
    let size = clamp(floor(period), vec3f(1.0), vec3f(131072.0));
    let low = floor(p);
    let x = repeated(low.x, size.x);
    let y = repeated(low.y, size.y);
    let z = repeated(low.z, size.z);
    let x1 = repeated(low.x + 1.0, size.x);
    let y1 = repeated(low.y + 1.0, size.y);
    let z1 = repeated(low.z + 1.0, size.z);
    let u = ease(p.x - low.x);
    let v = ease(p.y - low.y);
    let w = ease(p.z - low.z);
    let near = mix(mix(lattice(x, y, z), lattice(x1, y, z), u), mix(lattice(x, y1, z), lattice(x1, y1, z), u), v);
    let far = mix(mix(lattice(x, y, z1), lattice(x1, y, z1), u), mix(lattice(x, y1, z1), lattice(x1, y1, z1), u), v);
    return mix(near, far, w);
}

// The height above a corner of the lattice of a plane with a random slope, at an offset from the corner.
fn slope(x: u32, y: u32, z: u32, offset: vec3f) -> f32 {
    let dx = lattice(x, y, z) - 0.5;
    let dy = lattice(y + 7919u, z, x) - 0.5;
    let dz = lattice(z, x + 7919u, y) - 0.5;
    return (dx * offset.x + dy * offset.y + dz * offset.z) * 2.0;
}

// Gradient noise: from about -1 to 1, and 0 at the corners of the lattice, with features of unit size.
fn gradient_noise(p: vec3f) -> f32 {
    let low = floor(p);
    let f = p - low;
    let x = place(low.x);
    let y = place(low.y);
    let z = place(low.z);
    let u = ease(f.x);
    let v = ease(f.y);
    let w = ease(f.z);
    let near = mix(
        mix(slope(x, y, z, f), slope(x + 1u, y, z, f - vec3f(1.0, 0.0, 0.0)), u),
        mix(slope(x, y + 1u, z, f - vec3f(0.0, 1.0, 0.0)), slope(x + 1u, y + 1u, z, f - vec3f(1.0, 1.0, 0.0)), u),
        v,
    );
    let g = f - vec3f(0.0, 0.0, 1.0);
    let far = mix(
        mix(slope(x, y, z + 1u, g), slope(x + 1u, y, z + 1u, g - vec3f(1.0, 0.0, 0.0)), u),
        mix(
            slope(x, y + 1u, z + 1u, g - vec3f(0.0, 1.0, 0.0)),
            slope(x + 1u, y + 1u, z + 1u, g - vec3f(1.0, 1.0, 0.0)),
            u,
        ),
        v,
    );
    return mix(near, far, w);
}

// Gradient noise in the plane.
fn gradient_noise2(p: vec2f) -> f32 {
    let low = floor(p);
    let f = p - low;
    let x = place(low.x);
    let y = place(low.y);
    let u = ease(f.x);
    return mix(
        mix(slope(x, y, 0u, vec3f(f, 0.0)), slope(x + 1u, y, 0u, vec3f(f.x - 1.0, f.y, 0.0)), u),
        mix(slope(x, y + 1u, 0u, vec3f(f.x, f.y - 1.0, 0.0)), slope(x + 1u, y + 1u, 0u, vec3f(f - 1.0, 0.0)), u),
        ease(f.y),
    );
}

// The cell of scattered points, one in each unit cube, that a place belongs to.
struct Cell {
    // Distance to the cell's point.
    distance: f32,
    // Distance to the nearest point of another cell.
    second: f32,
    // A random number of 0 to 1 of the cell.
    random: f32,
    // The cell's point.
    centre: vec3f,
}

// Worley's noise: the nearest and the second nearest of scattered points.
fn worley(p: vec3f) -> Cell {
    let low = floor(p);
    var cell = Cell(8.0, 8.0, 0.0, vec3f(0.0));
    for (var i = 0u; i < 27u; i++) {
        let corner = low + vec3f(f32(i % 3u), f32((i / 3u) % 3u), f32(i / 9u)) - vec3f(1.0);
        let x = place(corner.x);
        let y = place(corner.y);
        let z = place(corner.z);
        let random = lattice(x, y, z);
        let centre = corner + vec3f(random, lattice(y + 7919u, z, x), lattice(z, x + 7919u, y));
        let way = centre - p;
        let distance = dot(way, way);
        let nearer = distance < cell.distance;
        cell.second = select(min(cell.second, distance), cell.distance, nearer);
        cell.distance = select(cell.distance, distance, nearer);
        cell.random = select(cell.random, random, nearer);
        cell.centre = select(cell.centre, centre, nearer);
    }
    cell.distance = sqrt(cell.distance);
    cell.second = sqrt(cell.second);
    return cell;
}

// Worley's noise in the plane.
fn worley2(p: vec2f) -> Cell {
    let low = floor(p);
    var cell = Cell(8.0, 8.0, 0.0, vec3f(0.0));
    for (var i = 0u; i < 9u; i++) {
        let corner = low + vec2f(f32(i % 3u), f32(i / 3u)) - vec2f(1.0);
        let x = place(corner.x);
        let y = place(corner.y);
        let random = lattice(x, y, 0u);
        let centre = corner + vec2f(random, lattice(y + 7919u, 0u, x));
        let way = centre - p;
        let distance = dot(way, way);
        let nearer = distance < cell.distance;
        cell.second = select(min(cell.second, distance), cell.distance, nearer);
        cell.distance = select(cell.distance, distance, nearer);
        cell.random = select(cell.random, random, nearer);
        cell.centre = select(cell.centre, vec3f(centre, 0.0), nearer);
    }
    cell.distance = sqrt(cell.distance);
    cell.second = sqrt(cell.second);
    return cell;
}

// A random number of 0 to 1 for each object and n. Each instance is an object of its own.
fn object_random(at: Point, n: u32) -> f32 {
    return lattice(at.object, n, 2u);
}

// A unit normal bent as by a height whose slope along each axis of the world is given.
fn bump(normal: vec3f, slopes: vec3f) -> vec3f {
    return normalize(normal - slopes + normal * dot(normal, slopes));
}
