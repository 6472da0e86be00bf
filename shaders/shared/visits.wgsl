// What a ray visits (`stream::Visits`), in kernels that answer with that. Others have COUNTS false, and no trace of it.

struct Visits {
    nodes: u32,
    triangles: u32,
    bytes: u32,
    instances: u32,
}

var<private> visits: Visits;

// A node but for its children's references.
fn visit_node() {
    visits.nodes += 1u;
    visits.bytes += 64u;
}

// A reference that is followed.
fn visit_child() {
    visits.bytes += 4u;
}

fn visit_pair(index: u32) {
    visits.triangles += select(2u, 1u, identity_at(index).y == MISS);
    visits.bytes += 48u;
}

fn visit_identities() {
    visits.bytes += 8u;
}

fn visit_instance() {
    visits.instances += 1u;
    visits.bytes += 64u;
}

// The answer.
fn visited() -> vec4<u32> {
    return vec4<u32>(visits.nodes, visits.triangles, visits.bytes, visits.instances);
}
