// What host and device share. The structs are written in Rust first (`trace/gpu/layout.rs`); a test
// compares names, offsets and strides. The constants in capitals are injected by
// `trace/gpu/kernel.rs`.

struct Ray {
    origin: vec3<f32>,
    t_min: f32,
    direction: vec3<f32>,
    t_max: f32,
}

// An inner node of the binary tree: both children's boxes and references.
struct BinaryNode {
    left_min: vec3<f32>,
    left: u32,
    left_max: vec3<f32>,
    spare_0: u32,
    right_min: vec3<f32>,
    right: u32,
    right_max: vec3<f32>,
    spare_1: u32,
}

// An inner node of the eight-wide tree. Its children's boxes have their faces at whole steps from `origin`, a byte a
// slot; they hold the exact boxes. `shape` has the biased exponents of the steps along x, y and z, a byte each, and
// in its highest byte a bit for every slot in use.
struct WideNode {
    origin: vec3<f32>,
    shape: u32,
    lower_x: vec2<u32>,
    upper_x: vec2<u32>,
    lower_y: vec2<u32>,
    upper_y: vec2<u32>,
    lower_z: vec2<u32>,
    upper_z: vec2<u32>,
    children: array<u32, 8>,
}

// Two triangles, a b c and c b d, in any turn of their corners; who they are stands in `identities`.
struct Pair {
    a: vec3<f32>,
    d_x: f32,
    b: vec3<f32>,
    d_y: f32,
    c: vec3<f32>,
    d_z: f32,
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

// A child reference is a node's index; or LEAF with one pair less than the leaf has in bits 28 to 30, MASKED where
// alpha decides about some of it, and the first pair's index; or NOWHERE. If MEMBERS, leaves above the members' trees
// are LEAF with a member's index.
//
// A pair's identities are two primitives, MISS where there is no second triangle, each with the turn that it is stored
// in: in its highest two bits, how many places the canonical first corner is behind the first of a b c, or of c b d.
//
// Group 0 binds nodes, pairs and identities, in pages, and members: `trace/gpu/pages.rs` declares them and the
// functions that read them (`node_at`, `pair_at`, `identity_at`).
@group(1) @binding(0) var<storage, read> rays: array<Ray>;
@group(1) @binding(1) var<uniform> params: Params;
// Binding 2 of group 1 takes the answers of each kernel.
