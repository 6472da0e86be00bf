// What host and device share. The structs are written in Rust first (`trace/gpu/layout.rs`); a test
// compares names, offsets and strides. The constants in capitals are injected by
// `trace/gpu/kernel.rs`.

struct Ray {
    origin: vec3<f32>,
    t_min: f32,
    direction: vec3<f32>,
    t_max: f32,
}

// Both children's boxes and references: inner nodes by index, leaves by LEAF | first triangle.
struct Node {
    left_min: vec3<f32>,
    left: u32,
    left_max: vec3<f32>,
    spare_0: u32,
    right_min: vec3<f32>,
    right: u32,
    right_max: vec3<f32>,
    spare_1: u32,
}

// Triangles lie in leaf order; the last of a leaf has the LAST flag.
struct Triangle {
    v0: vec3<f32>,
    primitive: u32,
    v1: vec3<f32>,
    flags: u32,
    v2: vec3<f32>,
    // No edge is longer than this along any axis.
    extent: f32,
}

// A tree placed in the world: the columns of the matrix that moves it there, its root, as a child reference, and what
// is added to its primitives.
struct Member {
    x: vec3<f32>,
    root: u32,
    y: vec3<f32>,
    first: u32,
    z: vec3<f32>,
    spare_0: u32,
    shift: vec3<f32>,
    spare_1: u32,
}

// What may be the nearest hit of a ray: the canonical one is among up to three primitives in order
// of distance (MISS where there are fewer), unless what was left out may be as near: that is not
// nearer than `rest` (LARGEST_FLOAT when nothing was left out).
struct Candidates {
    first: u32,
    second: u32,
    third: u32,
    rest: f32,
}

struct Params {
    // Number of rays.
    count: u32,
    // Largest absolute coordinate of the scene.
    scene_max_abs: f32,
    // Always 0, which no compiler knows; see `rounded`.
    zero: u32,
    spare: u32,
}

// Group 0 binds nodes and triangles, in pages, and members: `trace/gpu/pages.rs` declares them and the functions
// `node_at` and `triangle_at`. If MEMBERS, leaves above the members' trees are members, by index.
@group(1) @binding(0) var<storage, read> rays: array<Ray>;
@group(1) @binding(1) var<uniform> params: Params;
// Binding 2 of group 1 takes the answers of each kernel.
