// Traversal of the eight-wide tree. The stack holds nodes, and for each node which of its children are still to be
// visited, in the order in which a ray of its octant meets them.
//
// Where a ray crosses a face q steps from `origin` is computed as fma(q, step * inverse, fma(origin, inverse, shift)).
// The product of the step, a power of two, is exact. In units of 2^-24 * scale * |inverse| (see `PreparedRay`) the
// inner fma may be off by 3 and the outer one, whose product may be twice the scale, by 4: 4 more than the 3 of the
// canonical one. The host compares faces rounded (`flatten/wide.rs`): 1 more. So crossings are within 27 of the 32
// units that the pads allow. A box that is entered a little too early changes no answer.
//
// Distances are compared as integers: a ray's interval is not below +0, so where a negative number counts at all, any
// negative number does.

struct Way {
    // Nodes, and at the same height their children that are still to be visited: one bit for each place in the order.
    nodes: array<u32, STACK_SIZE>,
    waiting: array<u32, STACK_SIZE>,
    height: u32,
    // Whether a member's tree is being traversed, and the height of the stack below that tree's entries.
    inside: bool,
    bottom: u32,
}

// Visits an inner node: pushes its children that the ray enters within `limit`, but for the first, and returns the next
// reference to visit.
fn descend(ray: PreparedRay, reference: u32, member: TreeInstance, limit: i32, way: ptr<function, Way>) -> u32 {
    let node = node_at(reference);
    if COUNTS {
        visit_node();
    }
    let shape = node.corner.w;
    let steps = vec3<f32>(step_of(shape), step_of(shape >> 8u), step_of(shape >> 16u));
    var slots: u32;
    if MEMBERS & (*way).inside {
        slots = met_moved(ray, node, steps, member, limit);
    } else {
        slots = met(ray, node, steps, limit);
    }
    let waiting = in_order(slots & (shape >> 24u), ray.octant);
    if waiting == 0u {
        return next(ray, limit, way);
    }
    let rest = waiting & (waiting - 1u);
    if rest != 0u {
        (*way).nodes[(*way).height] = reference;
        (*way).waiting[(*way).height] = rest;
        (*way).height += 1u;
    }
    if COUNTS {
        visit_child();
    }
    return child_at(reference, countTrailingZeros(waiting) ^ ray.octant);
}

// Pops the next reference to visit; NOWHERE at the end of the traversal.
fn next(ray: PreparedRay, limit: i32, way: ptr<function, Way>) -> u32 {
    if (*way).height == 0u {
        return NOWHERE;
    }
    (*way).inside = (*way).inside & ((*way).height > (*way).bottom);
    let top = (*way).height - 1u;
    let waiting = (*way).waiting[top];
    let rest = waiting & (waiting - 1u);
    (*way).waiting[top] = rest;
    (*way).height = select((*way).height, top, rest == 0u);
    if COUNTS {
        visit_child();
    }
    return child_at((*way).nodes[top], countTrailingZeros(waiting) ^ ray.octant);
}

fn step_of(shape: u32) -> f32 {
    return bitcast<f32>((shape & 0xffu) << 23u);
}

// Sorts slots by their place in the order of visits: bit p of the result is bit p ^ octant of `slots`.
fn in_order(slots: u32, octant: u32) -> u32 {
    var bits = slots;
    bits = select(bits, ((bits & 0x55u) << 1u) | ((bits >> 1u) & 0x55u), (octant & 1u) != 0u);
    bits = select(bits, ((bits & 0x33u) << 2u) | ((bits >> 2u) & 0x33u), (octant & 2u) != 0u);
    return select(bits, ((bits & 0x0fu) << 4u) | (bits >> 4u), (octant & 4u) != 0u);
}

// The slots whose boxes the ray enters within `limit`, one bit each.
fn met(ray: PreparedRay, node: WideNode, steps: vec3<f32>, limit: i32) -> u32 {
    let scale = steps * ray.inverse;
    let origin = bitcast<vec3<f32>>(node.corner.xyz);
    let near = near_fma3(origin, ray.inverse, ray.near);
    let far = near_fma3(origin, ray.inverse, ray.far);
    let first_x = select(node.x.zw, node.x.xy, ray.forward.x);
    let first_y = select(node.y.zw, node.y.xy, ray.forward.y);
    let first_z = select(node.z.zw, node.z.xy, ray.forward.z);
    let last_x = select(node.x.xy, node.x.zw, ray.forward.x);
    let last_y = select(node.y.xy, node.y.zw, ray.forward.y);
    let last_z = select(node.z.xy, node.z.zw, ray.forward.z);
    let begin = vec4<i32>(bitcast<i32>(ray.t_min));
    var slots = 0u;
    for (var half = 0u; half < 2u; half++) {
        let enter = max(
            max(crossed(first_x[half], scale.x, near.x), crossed(first_y[half], scale.y, near.y)),
            max(crossed(first_z[half], scale.z, near.z), begin),
        );
        let leave = min(
            min(crossed(last_x[half], scale.x, far.x), crossed(last_y[half], scale.y, far.y)),
            min(crossed(last_z[half], scale.z, far.z), vec4<i32>(limit)),
        );
        slots |= bits_of(enter <= leave) << (4u * half);
    }
    return slots;
}

// The distances at which the ray crosses four faces.
fn crossed(faces: u32, scale: f32, shift: f32) -> vec4<i32> {
    let counts = counted(unpack4xU8(faces));
    return bitcast<vec4<i32>>(near_fma4(counts, vec4<f32>(scale), vec4<f32>(shift)));
}

// Bytes as numbers: 2^23 + x without its 2^23 is x.
fn counted(bytes: vec4<u32>) -> vec4<f32> {
    return bitcast<vec4<f32>>(bytes | vec4<u32>(0x4b000000u)) - vec4<f32>(8388608.0);
}

fn bits_of(are: vec4<bool>) -> u32 {
    let bits = select(vec4<u32>(0u), vec4<u32>(1u, 2u, 4u, 8u), are);
    return bits.x | bits.y | bits.z | bits.w;
}

// Like `met`, for a node of a member's tree, whose boxes are moved into the world.
fn met_moved(ray: PreparedRay, node: WideNode, steps: vec3<f32>, member: TreeInstance, limit: i32) -> u32 {
    let origin = bitcast<vec3<f32>>(node.corner.xyz);
    let begin = bitcast<i32>(ray.t_min);
    var slots = 0u;
    for (var slot = 0u; slot < 8u; slot++) {
        let half = slot >> 2u;
        let byte = 8u * (slot & 3u);
        let faces_below = vec3<u32>(node.x[half], node.y[half], node.z[half]);
        let faces_above = vec3<u32>(node.x[2u + half], node.y[2u + half], node.z[2u + half]);
        let below = counted(vec4<u32>((faces_below >> vec3<u32>(byte)) & vec3<u32>(0xffu), 0u)).xyz;
        let above = counted(vec4<u32>((faces_above >> vec3<u32>(byte)) & vec3<u32>(0xffu), 0u)).xyz;
        // The product is exact, so the sum is rounded once, fused or not.
        let lower = below * steps + origin;
        let upper = above * steps + origin;
        let moved_lower = moved_corner(member, lower, upper);
        let moved_upper = moved_corner(member, upper, lower);
        let first = select(moved_upper, moved_lower, ray.forward);
        let last = select(moved_lower, moved_upper, ray.forward);
        let enters = bitcast<vec3<i32>>(near_fma3(first, ray.inverse, ray.near));
        let leaves = bitcast<vec3<i32>>(near_fma3(last, ray.inverse, ray.far));
        let enter = max(max(enters.x, enters.y), max(enters.z, begin));
        let leave = min(min(leaves.x, leaves.y), min(leaves.z, limit));
        slots |= select(0u, 1u << slot, enter <= leave);
    }
    return slots;
}
