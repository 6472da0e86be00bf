//> plasma: plasma(vec2f(x, y), z).y
const PI: f32 = 3.14159265359;

fn palette(t: f32) -> vec3f {
    let a = vec3f(0.5, 0.5, 0.5);
    let b = vec3f(0.5, 0.5, 0.5);
    let c = vec3f(1.0, 1.0, 1.0);
    let d = vec3f(0.263, 0.416, 0.557);
    return a + b * cos(2.0 * PI * (c * t + d));
}

fn plasma(uv: vec2f, time: f32) -> vec3f {
    let p = uv * 8.0 - vec2f(4.0);
    var v = sin(p.x + time);
    v += sin(0.5 * (p.y + time));
    v += sin(0.5 * (p.x + p.y + time));
    let c = p + vec2f(sin(time / 3.0), cos(time / 2.0)) * 2.0;
    v += sin(sqrt(dot(c, c) + 1.0) + time);
    return palette(v * 0.25);
}
//> signed distance raymarch: render(vec2f(x, y) * 2.0 - 1.0).x
const MAX_STEPS: i32 = 64;
const MAX_DIST: f32 = 20.0;
const SURF_DIST: f32 = 0.001;

struct Ray {
    origin: vec3f,
    direction: vec3f,
}

fn sd_sphere(p: vec3f, r: f32) -> f32 {
    return length(p) - r;
}

fn sd_box(p: vec3f, b: vec3f) -> f32 {
    let q = abs(p) - b;
    return length(max(q, vec3f(0.0))) + min(max(q.x, max(q.y, q.z)), 0.0);
}

fn smin(a: f32, b: f32, k: f32) -> f32 {
    let h = clamp(0.5 + 0.5 * (b - a) / k, 0.0, 1.0);
    return mix(b, a, h) - k * h * (1.0 - h);
}

fn rot(a: f32) -> mat2x2f {
    let s = sin(a);
    let c = cos(a);
    return mat2x2f(c, -s, s, c);
}

fn map(p: vec3f) -> f32 {
    var q = p;
    let turned = rot(0.7) * q.xz;
    q = vec3f(turned.x, q.y, turned.y);
    let blob = smin(sd_sphere(p - vec3f(0.4, 0.2, 0.0), 0.6), sd_box(q, vec3f(0.5)), 0.3);
    return min(blob, p.y + 1.0);
}

fn normal_at(p: vec3f) -> vec3f {
    let e = vec2f(1.0, -1.0) * 0.5773 * 0.0005;
    return normalize(e.xyy * map(p + e.xyy) + e.yyx * map(p + e.yyx) + e.yxy * map(p + e.yxy) + e.xxx * map(p + e.xxx));
}

fn march(ray: Ray) -> f32 {
    var t = 0.0;
    for (var i = 0; i < MAX_STEPS; i++) {
        let d = map(ray.origin + ray.direction * t);
        t += d;
        if (d < SURF_DIST || t > MAX_DIST) { break; }
    }
    return t;
}

fn render(uv: vec2f) -> vec3f {
    let ray = Ray(vec3f(0.0, 0.5, 3.0), normalize(vec3f(uv, -1.5)));
    let t = march(ray);
    if (t > MAX_DIST) { return vec3f(0.5, 0.7, 0.9); }
    let n = normal_at(ray.origin + ray.direction * t);
    let diffuse = max(dot(n, normalize(vec3f(0.6, 0.8, 0.4))), 0.0);
    return pow(vec3f(0.8, 0.5, 0.3) * diffuse + 0.05, vec3f(1.0 / 2.2));
}
//> voronoi with borders: mosaic(vec2f(x, y) * 6.0)
struct Cell {
    nearest: f32,
    second: f32,
    id: vec2f,
}

fn seed_of(cell: vec2f) -> vec2f {
    let angle = fract(sin(dot(cell, vec2f(39.3467, 11.1352))) * 4375.8544) * 6.2831855;
    return 0.5 + 0.4 * vec2f(cos(angle), sin(angle));
}

fn voronoi(p: vec2f) -> Cell {
    let home = floor(p);
    var found = Cell(1e9, 1e9, vec2f(0.0));
    for (var k: u32 = 0u; k < 9u; k = k + 1u) {
        let cell = home + vec2f(f32(k % 3u) - 1.0, f32(k / 3u) - 1.0);
        let d = distance(p, cell + seed_of(cell));
        if (d < found.nearest) {
            found.second = found.nearest;
            found.nearest = d;
            found.id = cell;
        } else if (d < found.second) {
            found.second = d;
        }
    }
    return found;
}

fn mosaic(p: vec2f) -> f32 {
    let cell = voronoi(p);
    let border = smoothstep(0.02, 0.08, cell.second - cell.nearest);
    return border * (0.3 + 0.7 * fract(cell.id.x * 0.37 + cell.id.y * 0.73));
}
//> fbm with a domain warp: pattern_of(vec2f(x, y) * 3.0)
fn hash(p: vec2f) -> f32 {
    return fract(sin(dot(p, vec2f(12.9898, 78.233))) * 43758.5453123);
}

fn noise(p: vec2f) -> f32 {
    let i = floor(p);
    let f = fract(p);
    let a = hash(i);
    let b = hash(i + vec2f(1.0, 0.0));
    let c = hash(i + vec2f(0.0, 1.0));
    let d = hash(i + vec2f(1.0, 1.0));
    let u = f * f * (3.0 - 2.0 * f);
    return mix(a, b, u.x) + (c - a) * u.y * (1.0 - u.x) + (d - b) * u.x * u.y;
}

const OCTAVES: u32 = 5u;

fn fbm(p_in: vec2f) -> f32 {
    var p = p_in;
    var value = 0.0;
    var amplitude = 0.5;
    let shift = vec2f(100.0);
    let m = mat2x2<f32>(cos(0.5), sin(0.5), -sin(0.5), cos(0.5));
    for (var i = 0u; i < OCTAVES; i++) {
        value += amplitude * noise(p);
        p = m * p * 2.0 + shift;
        amplitude *= 0.5;
    }
    return value;
}

fn pattern_of(p: vec2f) -> f32 {
    let q = vec2f(fbm(p + vec2f(0.0, 0.0)), fbm(p + vec2f(5.2, 1.3)));
    let r = vec2f(fbm(p + 4.0 * q + vec2f(1.7, 9.2)), fbm(p + 4.0 * q + vec2f(8.3, 2.8)));
    return fbm(p + 4.0 * r);
}
//> triplanar checker: triplanar(vec3f(x, y, z) * 4.0, normalize(vec3f(x, 0.5, z)))
fn checker(uv: vec2f) -> f32 {
    let cell = vec2i(floor(uv));
    return f32((cell.x + cell.y) & 1);
}

fn triplanar(p: vec3f, n: vec3f) -> f32 {
    var weights = pow(abs(n), vec3f(4.0));
    weights /= weights.x + weights.y + weights.z;
    return checker(p.yz) * weights.x + checker(p.zx) * weights.y + checker(p.xy) * weights.z;
}
//> latitude and longitude: sphere_grid(normalize(vec3f(x - 0.5, y - 0.5, 0.4)))
const PI = 3.141592653589793;
const TAU = 2.0 * PI;

fn sphere_uv(n: vec3f) -> vec2f {
    return vec2f(atan2(n.z, n.x) / TAU + 0.5, acos(clamp(n.y, -1.0, 1.0)) / PI);
}

fn sphere_grid(n: vec3f) -> f32 {
    let uv = sphere_uv(n) * vec2f(24.0, 12.0);
    let line = abs(fract(uv - 0.5) - 0.5);
    return 1.0 - smoothstep(0.02, 0.06, min(line.x, line.y));
}
//> brick: brick_wall(vec2f(x, y))
struct Brick {
    colour: vec3f,
    height: f32,
};

const BRICK_SIZE = vec2f(0.25, 0.1);
const MORTAR = 0.04;

fn brick(uv_in: vec2f) -> Brick {
    var uv = uv_in / BRICK_SIZE;
    if (fract(uv.y * 0.5) > 0.5) {
        uv.x += 0.5;
    }
    let id = floor(uv);
    let local = fract(uv);
    let edge = smoothstep(vec2f(0.0), vec2f(MORTAR) / vec2f(1.0, BRICK_SIZE.y / BRICK_SIZE.x), local)
        * smoothstep(vec2f(0.0), vec2f(MORTAR), 1.0 - local);
    let mask = edge.x * edge.y;
    let tint = fract(sin(dot(id, vec2f(41.3, 289.1))) * 45758.5453);
    return Brick(mix(vec3f(0.75), vec3f(0.6, 0.2 + 0.1 * tint, 0.15), mask), mask);
}

fn brick_wall(uv: vec2f) -> f32 {
    let wall = brick(uv);
    return dot(wall.colour, vec3f(0.2126, 0.7152, 0.0722)) * (0.5 + 0.5 * wall.height);
}
//> truchet tiles: truchet(vec2f(x, y) * 8.0)
fn truchet(p: vec2f) -> f32 {
    let tile = floor(p);
    var q = fract(p);
    let flip = fract(sin(dot(tile, vec2f(27.16898, 38.90563))) * 5151.5473) > 0.5;
    q.x = select(q.x, 1.0 - q.x, flip);
    let d1 = abs(length(q) - 0.5);
    let d2 = abs(length(q - vec2f(1.0)) - 0.5);
    return smoothstep(0.12, 0.1, min(d1, d2));
}
//> hexagons: hex_distance(vec2f(x, y) * 5.0)
fn hex_dist(p_in: vec2f) -> f32 {
    let p = abs(p_in);
    return max(dot(p, normalize(vec2f(1.0, 1.7320508))), p.x);
}

fn glsl_mod(a: vec2f, b: vec2f) -> vec2f {
    return a - b * floor(a / b);
}

fn hex_coords(uv: vec2f) -> vec4f {
    let r = vec2f(1.0, 1.7320508);
    let h = r * 0.5;
    let a = glsl_mod(uv, r) - h;
    let b = glsl_mod(uv - h, r) - h;
    var gv = b;
    if (dot(a, a) < dot(b, b)) {
        gv = a;
    }
    return vec4f(atan2(gv.x, gv.y), 0.5 - hex_dist(gv), uv - gv);
}

fn hex_distance(p: vec2f) -> f32 {
    let hc = hex_coords(p);
    return smoothstep(0.05, 0.1, hc.y) * (0.5 + 0.5 * sin(hc.z * hc.w));
}
//> curl noise: curl(vec3f(x, y, z) * 3.0).y
fn corner_gradient(cell: vec3i) -> vec3f {
    var h = vec3u(cell + 4096) * vec3u(1597334673u, 3812015801u, 2798796415u);
    let seed = (h.x ^ h.y ^ h.z) * vec3u(1597334673u, 3812015801u, 2798796415u);
    h = seed >> vec3u(9u);
    return vec3f(h) / f32(1u << 22u) - 1.0;
}

fn field(p: vec3f) -> f32 {
    let cell = vec3i(floor(p));
    let f = fract(p);
    let weight = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    var sum = 0.0;
    for (var corner = 0; corner < 8; corner++) {
        let offset = vec3i(corner & 1, (corner >> 1u) & 1, (corner >> 2u) & 1);
        let towards = vec3f(offset);
        let share = mix(1.0 - weight, weight, towards);
        sum += share.x * share.y * share.z * dot(corner_gradient(cell + offset), f - towards);
    }
    return sum;
}

fn potential(p: vec3f) -> vec3f {
    return vec3f(field(p), field(p + vec3f(31.4, -17.7, 5.9)), field(p - vec3f(12.8, 41.3, -9.2)));
}

fn curl(p: vec3f) -> vec3f {
    const STEP = 1.0 / 128.0;
    let dx = (potential(p + vec3f(STEP, 0.0, 0.0)) - potential(p - vec3f(STEP, 0.0, 0.0))) / (2.0 * STEP);
    let dy = (potential(p + vec3f(0.0, STEP, 0.0)) - potential(p - vec3f(0.0, STEP, 0.0))) / (2.0 * STEP);
    let dz = (potential(p + vec3f(0.0, 0.0, STEP)) - potential(p - vec3f(0.0, 0.0, STEP))) / (2.0 * STEP);
    return vec3f(dy.z - dz.y, dz.x - dx.z, dx.y - dy.x);
}
//> escape time: mandelbrot(vec2f(x, y) * 2.5 - vec2f(1.7, 1.2))
fn complex_square(z: vec2f) -> vec2f {
    return vec2f(z.x * z.x - z.y * z.y, 2.0 * z.x * z.y);
}

fn mandelbrot(c: vec2f) -> f32 {
    let max_iterations = 96u;
    var z = vec2f();
    var i = 0u;
    loop {
        if (i >= max_iterations) { break; }
        z = complex_square(z) + c;
        if (dot(z, z) > 64.0) { break; }
        continuing {
            i++;
        }
    }
    if (i == max_iterations) {
        return 0.0;
    }
    return (f32(i) + 1.0 - log2(log2(dot(z, z)) * 0.5)) / f32(max_iterations);
}
//> wood rings: wood(vec3f(x, y, z)).x
override ring_count: f32 = 12.0;

fn lattice_hash(p: vec3u) -> f32 {
    var h = p.x * 374761393u + p.y * 668265263u + p.z * 2147483647u;
    h = (h ^ (h >> 13u)) * 1274126177u;
    return f32(h ^ (h >> 16u)) / 4294967295.0;
}

fn value_noise(p: vec3f) -> f32 {
    let cell = vec3u(vec3i(floor(p)) + 1024);
    let f = smoothstep(vec3f(0.0), vec3f(1.0), fract(p));
    var corners: array<f32, 8>;
    for (var i = 0u; i < 8u; i++) {
        corners[i] = lattice_hash(cell + vec3u(i & 1u, (i >> 1u) & 1u, i >> 2u));
    }
    let x = mix(vec4f(corners[0], corners[2], corners[4], corners[6]),
                vec4f(corners[1], corners[3], corners[5], corners[7]), f.x);
    let y = mix(x.xz, x.yw, f.y);
    return mix(y.x, y.y, f.z);
}

fn wood(p: vec3f) -> vec3f {
    let radius = length(p.xz - 0.5) + 0.08 * value_noise(p * vec3f(4.0, 1.0, 4.0));
    let ring = pow(abs(fract(radius * ring_count) - 0.5) * 2.0, 0.6);
    let fibre = value_noise(p * vec3f(90.0, 4.0, 90.0));
    return mix(vec3f(0.35, 0.18, 0.08), vec3f(0.7, 0.45, 0.25), ring) * (0.85 + 0.15 * fibre);
}
//> bayer dithering: dithered(vec2f(x, y) * 64.0, z)
const BAYER = array<array<f32, 4>, 4>(
    array(0.0, 8.0, 2.0, 10.0),
    array(12.0, 4.0, 14.0, 6.0),
    array(3.0, 11.0, 1.0, 9.0),
    array(15.0, 7.0, 13.0, 5.0),
);

fn dithered(pixel: vec2f, value: f32) -> f32 {
    let p = vec2u(pixel) % 4u;
    let threshold = (BAYER[p.y][p.x] + 0.5) / 16.0;
    return select(0.0, 1.0, value > threshold);
}
//> halton points: stipple(vec2f(x, y))
fn halton(index: u32, base: u32) -> f32 {
    var f = 1.0;
    var r = 0.0;
    var i = index;
    while (i > 0u) {
        f /= f32(base);
        r += f * f32(i % base);
        i /= base;
    }
    return r;
}

fn stipple(p: vec2f) -> f32 {
    var nearest = 1.0;
    for (var i = 1u; i <= 32u; i += 1u) {
        nearest = min(nearest, distance(p, vec2f(halton(i, 2u), halton(i, 3u))));
    }
    return nearest;
}
