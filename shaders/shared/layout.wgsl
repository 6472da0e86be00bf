// Structs and bindings that host and device share. The structs are defined in Rust first (`trace/gpu/layout.rs`); a
// test compares names, offsets and strides. The constants in capitals are injected by `trace/gpu/kernel.rs`.

struct Ray {
    origin: vec3<f32>,
    t_min: f32,
    direction: vec3<f32>,
    t_max: f32,
}

// An inner node of the eight-wide tree, which is loaded 16 bytes at a time. The faces of its children's boxes are at
// whole steps from its origin, the first three words of `corner`: a byte for each slot, of lower faces, then of upper
// ones. These boxes contain the exact ones. The fourth word, the node's shape, has the biased exponents of the steps
// along x, y and z, a byte each, and in its highest byte a bit for every slot in use.
struct WideNode {
    corner: vec4<u32>,
    x: vec4<u32>,
    y: vec4<u32>,
    z: vec4<u32>,
    children: array<u32, 8>,
}

// Two triangles, a b c and c b d, their corners rotated in any way. The fourth numbers are those of d. `identities` has
// their primitives.
struct Pair {
    a: vec4<f32>,
    b: vec4<f32>,
    c: vec4<f32>,
}

// A tree instance: the columns of the matrix that moves its tree into the world, its root as a child reference, and
// what is added to the primitive ids of its tree.
struct TreeInstance {
    x: vec3<f32>,
    root: u32,
    y: vec3<f32>,
    first: u32,
    z: vec3<f32>,
    spare_0: u32,
    shift: vec3<f32>,
    spare_1: u32,
}

// Where the nearest hit of a ray may be. The canonical hit is on one of up to three primitives, in order of distance
// (MISS where there are fewer), unless a primitive that was left out is as near: none of those is nearer than `rest`
// (LARGEST_FLOAT when none was left out).
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
    // Always 0, which compilers do not know; see `rounded`.
    zero: u32,
    spare: u32,
}

// A child reference is one of: a node's index; a leaf; NOWHERE. The reference of a leaf has the bit LEAF, the number of
// its pairs less one in bits 28 to 30, MASKED if alpha decides about hits of some of its triangles, and the index of
// its first pair. If MEMBERS, a leaf of the top-level tree is LEAF with a member's index.
//
// A pair's identities are two primitives, MISS where there is no second triangle. The highest two bits of an identity
// are its turn: how many places the canonical first corner is behind the first of a b c, or of c b d.
//
// Group 0 binds nodes, pairs and identities, in pages, and members. `trace/gpu/pages.rs` declares them and the
// functions that read them (`node_at`, `pair_at`, `identity_at`).
@group(1) @binding(0) var<storage, read> rays: array<Ray>;
@group(1) @binding(1) var<uniform> params: Params;
// Binding 2 of group 1 takes the answers of each kernel.
