//> palette by cosines: palette(x, vec3f(.5), vec3f(.5), vec3f(1.), vec3f(0., .33, .67)).y
fn palette(t: f32, a: vec3f, b: vec3f, c: vec3f, d: vec3f) -> vec3f {
    return a + b * cos(6.28318 * (c * t + d));
}
//> hash of a number: hash11(x)
fn hash11(p: f32) -> f32 {
    var q = fract(p * .1031);
    q *= q + 33.33;
    q *= q + q;
    return fract(q);
}
//> hash by a sine: rand(vec2f(x, y))
fn rand(n: vec2f) -> f32 {
    return fract(sin(dot(n, vec2f(12.9898, 4.1414))) * 43758.5453);
}
//> hash of vectors: hash33(vec3f(x, y, z)).z
fn hash33(p3: vec3f) -> vec3f {
    var p = fract(p3 * vec3f(.1031, .1030, .0973));
    p += dot(p, p.yxz + 33.33);
    return fract((p.xxy + p.yxx) * p.zyx);
}
//> integer hash: f32(pcg(bitcast<u32>(x)) >> 8u) / 16777216.0
fn pcg(n: u32) -> u32 {
    var h = n * 747796405u + 2891336453u;
    h = ((h >> ((h >> 28u) + 4u)) ^ h) * 277803737u;
    return (h >> 22u) ^ h;
}
//> three integers hashed: vec3f(pcg3d(vec3u(1u, 2u, u32(x * 10.0)))).x / 4294967296.0
fn pcg3d(p: vec3u) -> vec3u {
    var v = p * 1664525u + 1013904223u;
    v.x += v.y * v.z; v.y += v.z * v.x; v.z += v.x * v.y;
    v ^= v >> vec3u(16u);
    v.x += v.y * v.z; v.y += v.z * v.x; v.z += v.x * v.y;
    return v;
}
//> value noise with the prelude's name: noise(vec2f(x, y) * 5.)
fn rand2(n: vec2f) -> f32 { return fract(sin(dot(n, vec2f(12.9898, 4.1414))) * 43758.5453); }
fn noise(p: vec2f) -> f32 {
    let i = floor(p);
    let f = fract(p);
    let u = f * f * (3.0 - 2.0 * f);
    return mix(mix(rand2(i), rand2(i + vec2f(1., 0.)), u.x),
        mix(rand2(i + vec2f(0., 1.)), rand2(i + vec2f(1.)), u.x), u.y);
}
//> gradient noise: gnoise(vec2f(x, y) * 4.)
fn grad(p: vec2f) -> vec2f {
    let a = 6.2831853 * fract(sin(dot(p, vec2f(127.1, 311.7))) * 43758.5453);
    return vec2f(cos(a), sin(a));
}
fn gnoise(p: vec2f) -> f32 {
    let i = floor(p);
    let f = fract(p);
    let u = f * f * f * (f * (f * 6. - 15.) + 10.);
    let a = dot(grad(i), f);
    let b = dot(grad(i + vec2f(1., 0.)), f - vec2f(1., 0.));
    let c = dot(grad(i + vec2f(0., 1.)), f - vec2f(0., 1.));
    let d = dot(grad(i + vec2f(1., 1.)), f - vec2f(1., 1.));
    return mix(mix(a, b, u.x), mix(c, d, u.x), u.y);
}
//> simplex noise: simplex2(vec2f(x, y) * 3.)
fn permute3(x: vec3f) -> vec3f { return (((x * 34.) + 1.) * x) % vec3f(289.); }
fn simplex2(v: vec2f) -> f32 {
    let C = vec4(0.211324865405187, 0.366025403784439, -0.577350269189626, 0.024390243902439);
    var i: vec2f = floor(v + dot(v, C.yy));
    let x0 = v - i + dot(i, C.xx);
    var i1: vec2f = select(vec2f(0., 1.), vec2f(1., 0.), (x0.x > x0.y));
    var x12: vec4f = x0.xyxy + C.xxzz - vec4f(i1, 0., 0.);
    i = i % vec2f(289.);
    let p = permute3(permute3(i.y + vec3f(0., i1.y, 1.)) + i.x + vec3f(0., i1.x, 1.));
    var m: vec3f = max(0.5 - vec3f(dot(x0, x0), dot(x12.xy, x12.xy), dot(x12.zw, x12.zw)), vec3f(0.));
    m *= m;
    m *= m;
    let xs = 2. * fract(p * C.www) - 1.;
    let h = abs(xs) - 0.5;
    let ox = floor(xs + 0.5);
    let a0 = xs - ox;
    m *= 1.79284291400159 - 0.85373472095314 * (a0 * a0 + h * h);
    let g = vec3f(a0.x * x0.x + h.x * x0.y, a0.yz * x12.xz + h.yz * x12.yw);
    return 130. * dot(m, g);
}
//> cellular noise: worley(vec2f(x, y) * 4.)
fn cell(p: vec2f) -> vec2f {
    return fract(sin(vec2f(dot(p, vec2f(127.1, 311.7)), dot(p, vec2f(269.5, 183.3)))) * 43758.5453);
}
fn worley(p: vec2f) -> f32 {
    let n = floor(p);
    let f = fract(p);
    var d = 8.0;
    for (var j = -1; j <= 1; j++) {
        for (var i = -1; i <= 1; i++) {
            let g = vec2f(f32(i), f32(j));
            let r = g + cell(n + g) - f;
            d = min(d, dot(r, r));
        }
    }
    return sqrt(d);
}
//> fractal sum: fbm(vec2f(x, y) * 2.)
fn vnoise(p: vec2f) -> f32 { return 0.5 + 0.5 * sin(p.x) * cos(p.y); }
fn fbm(q: vec2f) -> f32 {
    var p = q;
    var value = 0.0;
    var amplitude = .5;
    const OCTAVES = 6;
    let rot = mat2x2f(cos(0.5), sin(0.5), -sin(0.5), cos(0.50));
    for (var i = 0; i < OCTAVES; i++) {
        value += amplitude * vnoise(p);
        p = rot * p * 2.0 + vec2f(100.0);
        amplitude *= .5;
    }
    return value;
}
//> warped domain: warp(vec2f(x, y))
fn f1(p: vec2f) -> f32 { return sin(p.x * 3.0 + cos(p.y * 2.0)); }
fn warp(p: vec2f) -> f32 {
    let q = vec2f(f1(p), f1(p + vec2f(5.2, 1.3)));
    let r = vec2f(f1(p + 4.0 * q + vec2f(1.7, 9.2)), f1(p + 4.0 * q + vec2f(8.3, 2.8)));
    return f1(p + 4.0 * r);
}
//> spherical uv: spherical(normalize(vec3f(x, y, z) + 0.1)).x
const PI = 3.14159265358979;
fn spherical(d: vec3f) -> vec2f {
    return vec2f(atan2(d.z, d.x) / (2.0 * PI) + 0.5, acos(clamp(d.y, -1.0, 1.0)) / PI);
}
//> distance to a sphere: sdSphere(vec3f(x, y, z), 0.5)
fn sdSphere(p: vec3f, r: f32) -> f32 { return length(p) - r; }
//> distance to a box: sdBox(vec3f(x, y, z), vec3f(.2, .3, .4))
fn sdBox(p: vec3f, b: vec3f) -> f32 {
    let q = abs(p) - b;
    return length(max(q, vec3f(0.))) + min(max(q.x, max(q.y, q.z)), 0.);
}
//> distance to a torus: sdTorus(vec3f(x, y, z), vec2f(.5, .1))
fn sdTorus(p: vec3f, R: vec2f) -> f32 {
    let q = vec2f(length(p.xz) - R.x, p.y);
    return length(q) - R.y;
}
//> distance to a capsule: sdCapsule(vec3f(x, y, z), vec3f(0.), vec3f(1.), .1)
fn sdCapsule(p: vec3f, a: vec3f, b: vec3f, r: f32) -> f32 {
    let pa = p - a;
    let ba = b - a;
    let h = clamp(dot(pa, ba) / dot(ba, ba), 0., 1.);
    return length(pa - ba * h) - r;
}
//> distance to a hexagon: sdHexagon(vec2f(x, y), .4)
fn sdHexagon(q: vec2f, r: f32) -> f32 {
    const k = vec3f(-0.866025404, 0.5, 0.577350269);
    var p = abs(q);
    p -= 2.0 * min(dot(k.xy, p), 0.0) * k.xy;
    p -= vec2f(clamp(p.x, -k.z * r, k.z * r), r);
    return length(p) * sign(p.y);
}
//> distance to a star: sdStar5(vec2f(x, y), .5, .4)
fn sdStar5(q: vec2f, r: f32, rf: f32) -> f32 {
    let k1 = vec2f(0.809016994375, -0.587785252292);
    let k2 = vec2f(-k1.x, k1.y);
    var p = vec2f(abs(q.x), q.y);
    p -= 2.0 * max(dot(k1, p), 0.0) * k1;
    p -= 2.0 * max(dot(k2, p), 0.0) * k2;
    p.x = abs(p.x);
    p.y -= r;
    let ba = rf * vec2f(-k1.y, k1.x) - vec2f(0., 1.);
    let h = clamp(dot(p, ba) / dot(ba, ba), 0.0, r);
    return length(p - ba * h) * sign(p.y * ba.x - p.x * ba.y);
}
//> smooth union: opSmoothUnion(x, y, .2)
fn opSmoothUnion(d1: f32, d2: f32, k: f32) -> f32 {
    let h = clamp(0.5 + 0.5 * (d2 - d1) / k, 0., 1.);
    return mix(d2, d1, h) - k * h * (1. - h);
}
//> repetition: opRep(vec3f(x, y, z), vec3f(.3)).y
fn modulo(p: vec3f, c: vec3f) -> vec3f { return p - c * floor(p / c); }
fn opRep(p: vec3f, c: vec3f) -> vec3f { return modulo(p + 0.5 * c, c) - 0.5 * c; }
//> twist: opTwist(vec3f(x, y, z), 2.).x
fn opTwist(p: vec3f, k: f32) -> vec3f {
    let s = sin(k * p.y);
    let c = cos(k * p.y);
    let m = mat2x2<f32>(vec2<f32>(c, s), vec2<f32>(-s, c));
    return vec3<f32>(m * p.xz, p.y);
}
//> sphere march: march(vec3f(x, y, -3.), vec3f(0., 0., 1.))
fn scene(p: vec3f) -> f32 { return min(length(p) - 1.0, p.y + 1.0); }
fn march(ro: vec3f, rd: vec3f) -> f32 {
    var t = 0.0;
    for (var i = 0; i < 40; i++) {
        let d = scene(ro + rd * t);
        if d < 0.001 || t > 20.0 { break; }
        t += d;
    }
    return t;
}
//> normal by differences: calcNormal(vec3f(x, y, z)).x
fn field(p: vec3f) -> f32 { return length(p) - 1.0 + 0.1 * sin(5.0 * p.x); }
fn calcNormal(p: vec3f) -> vec3f {
    const h = 0.001;
    const k = vec2f(1., -1.);
    return normalize(k.xyy * field(p + k.xyy * h) + k.yyx * field(p + k.yyx * h)
        + k.yxy * field(p + k.yxy * h) + k.xxx * field(p + k.xxx * h));
}
//> hue to colour: hsv2rgb(vec3f(x, y, z)).x
fn hsv2rgb(c: vec3f) -> vec3f {
    let K = vec4f(1.0, 2.0 / 3.0, 1.0 / 3.0, 3.0);
    let p = abs(fract(c.xxx + K.xyz) * 6.0 - K.www);
    return c.z * mix(K.xxx, clamp(p - K.xxx, vec3f(0.0), vec3f(1.0)), c.y);
}
//> colour to hue: rgb2hsv(vec3f(x, y, z)).y
fn rgb2hsv(c: vec3f) -> vec3f {
    let K = vec4f(0.0, -1.0 / 3.0, 2.0 / 3.0, -1.0);
    let p = mix(vec4f(c.bg, K.wz), vec4f(c.gb, K.xy), step(c.b, c.g));
    let q = mix(vec4f(p.xyw, c.r), vec4f(c.r, p.yzx), step(p.x, c.r));
    let d = q.x - min(q.w, q.y);
    let e = 1.0e-10;
    return vec3f(abs(q.z + (q.w - q.y) / (6.0 * d + e)), d / (q.x + e), q.x);
}
//> sRGB encoding: toSrgb(vec3f(x, y, z)).x
fn toSrgb(linear: vec3f) -> vec3f {
    let cutoff = linear <= vec3f(0.0031308);
    let higher = 1.055 * pow(linear, vec3f(1.0 / 2.4)) - 0.055;
    return select(higher, linear * 12.92, cutoff);
}
//> filmic curve: aces(vec3f(x, y, z)).z
fn aces(x: vec3f) -> vec3f {
    const a = 2.51; const b = 0.03; const c = 2.43; const d = 0.59; const e = 0.14;
    return saturate((x * (a * x + b)) / (x * (c * x + d) + e));
}
//> luminance: luminance(vec3f(x, y, z))
fn luminance(c: vec3f) -> f32 { return dot(c, vec3f(0.2126, 0.7152, 0.0722)); }
//> rotation about an axis: rotate(vec3f(x, y, z), normalize(vec3f(1.)), 1.).x
fn rotate(v: vec3f, axis: vec3f, angle: f32) -> vec3f {
    let c = cos(angle);
    return v * c + cross(axis, v) * sin(angle) + axis * dot(axis, v) * (1.0 - c);
}
//> rotation matrix: (rotation3dY(x) * vec3f(1., y, z)).x
fn rotation3dY(angle: f32) -> mat3x3f {
    let s = sin(angle);
    let c = cos(angle);
    return mat3x3f(c, 0., -s, 0., 1., 0., s, 0., c);
}
//> quaternion rotation: qrot(vec4f(0., sin(x), 0., cos(x)), vec3f(1., y, z)).z
fn qrot(q: vec4f, v: vec3f) -> vec3f {
    return v + 2. * cross(q.xyz, cross(q.xyz, v) + q.w * v);
}
//> Fresnel by Schlick: fresnel(x, 0.04)
fn fresnel(cosTheta: f32, f0: f32) -> f32 { return f0 + (1. - f0) * pow(clamp(1. - cosTheta, 0., 1.), 5.); }
//> microfacets: ggx(x, 0.3)
fn ggx(nh: f32, roughness: f32) -> f32 {
    let a = roughness * roughness;
    let d = nh * nh * (a * a - 1.0) + 1.0;
    return a * a / (PI * d * d);
}
const PI: f32 = acos(-1.0);
//> checkerboard: checker(vec2f(x, y) * 8.)
fn checker(p: vec2f) -> f32 { return f32((i32(floor(p.x)) + i32(floor(p.y))) & 1); }
//> bricks: brick(vec2f(x, y) * 6.)
fn brick(q: vec2f) -> f32 {
    var p = q;
    p.x += step(1., p.y % 2.) * 0.5;
    let b = smoothstep(vec2f(0.05), vec2f(0.1), fract(p)) * smoothstep(vec2f(0.05), vec2f(0.1), 1. - fract(p));
    return b.x * b.y;
}
//> stripes with soft edges: stripes(x * 10.)
fn stripes(t: f32) -> f32 { return smoothstep(.4, .6, abs(fract(t) - .5) * 2.); }
//> rings of wood: rings(vec3f(x, y, z))
fn rings(p: vec3f) -> f32 {
    let r = length(p.xz) * 10.0 + sin(p.y * 4.0);
    return pow(fract(r), 2.0) * exp(-fract(r));
}
//> truchet tiles: truchet(vec2f(x, y) * 4.)
fn truchet(p: vec2f) -> f32 {
    let id = floor(p);
    var f = fract(p) - 0.5;
    if (fract(sin(dot(id, vec2f(12.9, 78.2))) * 43758.5) > 0.5) { f.x = -f.x; }
    let s = select(-0.5, 0.5, f.x > -f.y);
    return abs(length(f - vec2f(s)) - 0.5);
}
//> polar coordinates: polar(vec2f(x, y) - 0.5).y
fn polar(p: vec2f) -> vec2f { return vec2f(length(p), atan2(p.y, p.x)); }
//> logarithmic spiral: spiral(vec2f(x, y) - 0.4)
fn spiral(p: vec2f) -> f32 { return fract(log(length(p) + 0.001) * 2. + atan2(p.y, p.x) / 6.283); }
//> Mandelbrot set: mandel(vec2f(x * 2. - 1.5, y * 2. - 1.))
fn mandel(c: vec2f) -> f32 {
    var z = vec2f(0.);
    var n = 0u;
    loop {
        if n >= 64u { break; }
        z = vec2f(z.x * z.x - z.y * z.y, 2. * z.x * z.y) + c;
        if dot(z, z) > 4. { break; }
        continuing { n += 1u; }
    }
    return f32(n) / 64.;
}
//> complex numbers: cpow(vec2f(x, y), 3.).x
fn cpow(z: vec2f, n: f32) -> vec2f {
    let r = pow(length(z), n);
    let a = atan2(z.y, z.x) * n;
    return r * vec2f(cos(a), sin(a));
}
//> remapping: remap(x, 0., 1., -1., 3.)
fn remap(v: f32, a: f32, b: f32, c: f32, d: f32) -> f32 { return c + (v - a) * (d - c) / (b - a); }
//> gain and bias: gain(x, 3.)
fn gain(x: f32, k: f32) -> f32 {
    let a = 0.5 * pow(2.0 * select(1.0 - x, x, x < 0.5), k);
    return select(1.0 - a, a, x < 0.5);
}
//> smooth minimum: smin(x, y, 8.)
fn smin(a: f32, b: f32, k: f32) -> f32 { return -log2(exp2(-k * a) + exp2(-k * b)) / k; }
//> easing: elastic(x)
fn elastic(t: f32) -> f32 { return sin(13.0 * t * 1.5707963) * pow(2.0, 10.0 * (t - 1.0)); }
//> bump of a height: bump(vec2f(x, y))
fn height(p: vec2f) -> f32 { return sin(p.x * 10.) * sin(p.y * 10.); }
fn bump(p: vec2f) -> f32 {
    let e = vec2f(0.01, 0.);
    let n = normalize(vec3f(height(p - e.xy) - height(p + e.xy), height(p - e.yx) - height(p + e.yx), 0.02));
    return n.z;
}
//> triplanar weights: triplanar(normalize(vec3f(x, y, z) + 0.01)).x
fn triplanar(n: vec3f) -> vec3f {
    let w = pow(abs(n), vec3f(4.));
    return w / (w.x + w.y + w.z);
}
//> Halton sequence: halton(u32(x * 100.), 3u)
fn halton(index: u32, base: u32) -> f32 {
    var result = 0.;
    var f = 1.;
    var i = index;
    while (i > 0u) {
        f /= f32(base);
        result += f * f32(i % base);
        i /= base;
    }
    return result;
}
//> Hammersley points: hammersley(7u, 64u).y + x * 0.
fn hammersley(i: u32, n: u32) -> vec2f {
    return vec2f(f32(i) / f32(n), f32(reverseBits(i)) * 2.3283064365386963e-10);
}
//> Bayer matrix: bayer(vec2u(u32(x * 8.), u32(y * 8.)))
const BAYER = array<f32, 16>(0., 8., 2., 10., 12., 4., 14., 6., 3., 11., 1., 9., 15., 7., 13., 5.);
fn bayer(p: vec2u) -> f32 { return BAYER[(p.y & 3u) * 4u + (p.x & 3u)] / 16.; }
//> black body: blackbody(1000. + 9000. * x).x
fn blackbody(t: f32) -> vec3f {
    var c = vec3f(255.);
    c.x = 56100000. * pow(t, (-3. / 2.)) + 148.;
    c.y = 100.04 * log(t) - 623.6;
    if (t > 6500.) { c.y = 35200000. * pow(t, (-3. / 2.)) + 184.; }
    c.z = 194.18 * log(t) - 1448.6;
    c = clamp(c, vec3f(0.), vec3f(255.)) / 255.;
    if (t < 1000.) { c *= t / 1000.; }
    return c;
}
//> sky gradient: skyColour(normalize(vec3f(x, y, z) + 0.1)).z
fn skyColour(d: vec3f) -> vec3f {
    let t = 0.5 * (d.y + 1.0);
    let sun = pow(max(dot(d, normalize(vec3f(1., 1., 0.5))), 0.), 256.);
    return mix(vec3f(1.), vec3f(.5, .7, 1.), t) + sun;
}
//> waves: waves(vec2f(x, y))
struct Wave { direction: vec2f, steepness: f32, wavelength: f32, }
const WAVES = array<Wave, 2>(Wave(vec2f(1., 0.), .3, .5), Wave(vec2f(.6, .8), .2, .3));
fn waves(p: vec2f) -> f32 {
    var h = 0.;
    for (var i = 0u; i < 2u; i += 1u) {
        let w = WAVES[i];
        let k = 2. * 3.14159 / w.wavelength;
        h += w.steepness / k * sin(k * dot(w.direction, p));
    }
    return h;
}
//> hyperbolic functions: ridge(x * 4. - 2.)
fn ridge(x: f32) -> f32 { return tanh(x) * (1. / cosh(x)) + sinh(x) * .1; }
//> a filter's kernel: gauss(x, .3)
fn gauss(x: f32, sigma: f32) -> f32 { return exp(-x * x / (2. * sigma * sigma)) / (sigma * sqrt(2. * PI)); }
const PI = radians(180.0);
//> octahedral normals: octDecode(octEncode(normalize(vec3f(x, y, z) + 0.1))).y
fn octWrap(v: vec2f) -> vec2f { return (1.0 - abs(v.yx)) * select(vec2f(-1.0), vec2f(1.0), v >= vec2f(0.0)); }
fn octEncode(m: vec3f) -> vec2f {
    var n = m / (abs(m.x) + abs(m.y) + abs(m.z));
    if (n.z < 0.0) { n = vec3f(octWrap(n.xy), n.z); }
    return n.xy * 0.5 + 0.5;
}
fn octDecode(e: vec2f) -> vec3f {
    let f = e * 2.0 - 1.0;
    var n = vec3f(f, 1.0 - abs(f.x) - abs(f.y));
    let t = saturate(-n.z);
    n.x += select(t, -t, n.x >= 0.0);
    n.y += select(t, -t, n.y >= 0.0);
    return normalize(n);
}
//> packed colours: unpack4x8unorm(pack4x8unorm(vec4f(x, y, z, 1.))).y
alias Colour = vec4f;
//> pointers: swapped(x, y)
fn swap(a: ptr<function, f32>, b: ptr<function, f32>) { let t = *a; *a = *b; *b = t; }
fn swapped(x: f32, y: f32) -> f32 { var a = x; var b = y; swap(&a, &b); return a - b; }
//> a basis: basis(normalize(vec3f(x, y, z) + 0.1))[0].y
fn basis(n: vec3f) -> mat3x3f {
    let s = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (s + n.z);
    let b = n.x * n.y * a;
    return mat3x3f(vec3f(1.0 + s * n.x * n.x * a, s * b, -s * n.x), vec3f(b, s + n.y * n.y * a, -n.y), n);
}
