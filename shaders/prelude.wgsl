// Functions that every shader file can use. Transcendental functions replace WGSL's own: each is a fixed polynomial, so
// that all processors give the same bits. They take one number; for vectors there are functions with a 2 or 3 at the
// end of their names.

const TAU: f32 = 6.2831855;

fn small_sin(x: f32) -> f32 {
    let x2 = x * x;
    let series = ((x2 * (1.0f / 362880.0f) - 1.0f / 5040.0f) * x2 + 1.0f / 120.0f) * x2 - 1.0f / 6.0f;
    return x + x * x2 * series;
}

fn small_cos(x: f32) -> f32 {
    let x2 = x * x;
    let series = (((x2 * (-1.0f / 3628800.0f) + 1.0f / 40320.0f) * x2 - 1.0f / 720.0f) * x2 + 1.0f / 24.0f) * x2 - 0.5;
    return 1.0 + x2 * series;
}

// The rest of an angle in radians beside whole quarter turns, and the number of quarters modulo 4.
fn quarters(angle: f32) -> vec2f {
    let whole = floor(angle * 0.63661975 + 0.5);
    let rest = angle - whole * 1.5703125 - whole * 4.837513e-4 - whole * 7.54979e-8;
    return vec2f(clamp(rest, -0.8, 0.8), clamp(whole - floor(whole * 0.25) * 4.0, 0.0, 3.0));
}

// Sine of an angle in radians.
fn sin(angle: f32) -> f32 {
    let parts = quarters(angle);
    let quadrant = u32(parts.y);
    let sine = select(small_sin(parts.x), small_cos(parts.x), (quadrant & 1u) == 1u);
    return select(sine, -sine, (quadrant & 2u) == 2u);
}

// Cosine of an angle in radians.
fn cos(angle: f32) -> f32 {
    let parts = quarters(angle);
    let quadrant = u32(parts.y);
    let cosine = select(small_cos(parts.x), small_sin(parts.x), (quadrant & 1u) == 1u);
    return select(cosine, -cosine, ((quadrant + 1u) & 2u) == 2u);
}

fn tan(angle: f32) -> f32 {
    return sin(angle) / cos(angle);
}

// Angle of the point (x, y) in radians, -pi to pi; 0 at the origin.
fn atan2(y: f32, x: f32) -> f32 {
    let ax = abs(x);
    let ay = abs(y);
    let low = min(ax, ay);
    let high = max(ax, ay);
    let upper = low * (1.0f + 1.4142135f) > high;
    let top = select(low, low - high, upper);
    let bottom = select(high, low + high, upper);
    let t = select(bottom, top / bottom, bottom > 0.0);
    let t2 = t * t;
    let series = ((t2 * 0.08059808 - 0.13879707) * t2 + 0.19977914) * t2 - 0.33332955;
    let angle = t + t * t2 * series;
    let octant = select(angle, angle + 0.7853982, upper);
    let turns = octant * (0.5 * 0.31830987);
    let quadrant = select(turns, 0.25 - turns, ay > ax);
    let half = select(quadrant, 0.5 - quadrant, x < 0.0);
    let signed = bitcast<f32>((bitcast<u32>(half) & 0x7fffffffu) | (bitcast<u32>(y) & 0x80000000u));
    return signed * TAU;
}

fn atan(x: f32) -> f32 {
    return atan2(x, 1.0);
}

// 2 to the power x; 0 below -126, and above 126 the value at 126.
fn exp2(x: f32) -> f32 {
    let held = clamp(x, -126.0, 126.0);
    let whole = floor(held + 0.5);
    let f = (held - whole) * 0.6931472;
    let tail = ((f * (1.0f / 5040.0f) + 1.0f / 720.0f) * f + 1.0f / 120.0f) * f + 1.0f / 24.0f;
    let series = (((tail * f + 1.0f / 6.0f) * f + 0.5) * f + 1.0) * f + 1.0;
    let power = bitcast<f32>(u32(whole + 127.0) << 23u);
    return select(0.0, series * power, x >= -126.0);
}

fn exp(x: f32) -> f32 {
    return exp2(x * 1.442695);
}

// The logarithm to base 2 of a positive number.
fn log2(x: f32) -> f32 {
    let bits = bitcast<u32>(x);
    let exponent = f32(bits >> 23u) - 127.0;
    let mantissa = bitcast<f32>((bits & 0x7fffffu) + 0x3f800000u);
    let upper = mantissa > 1.4142135;
    let m = select(mantissa, mantissa * 0.5, upper);
    let power = select(exponent, exponent + 1.0, upper);
    let s = (m - 1.0) / (m + 1.0);
    let s2 = s * s;
    let series = (((s2 * (1.0f / 9.0f) + 1.0f / 7.0f) * s2 + 0.2) * s2 + 1.0f / 3.0f) * s2 + 1.0;
    return power + s * series * (2.0 * 1.442695);
}

fn log(x: f32) -> f32 {
    return log2(x) * 0.6931472;
}

// base to a power; a base of at most 1.17549435e-38 gives 0.
fn pow(base: f32, power: f32) -> f32 {
    let some = base > 1.17549435e-38;
    return select(0.0, exp2(power * log2(select(1.0, base, some))), some);
}

fn pow3(base: vec3f, power: f32) -> vec3f {
    return vec3f(pow(base.x, power), pow(base.y, power), pow(base.z, power));
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
