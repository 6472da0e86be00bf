// Traversal of the eight-wide tree. The stack holds nodes, and for each node which of its children are still to be
// visited, in the order in which a ray of its octant meets them.
//
// Where a ray crosses a face q steps from `origin` is computed as fma(q, step * inverse, fma(origin, inverse, shift)).
// The product of the step, a power of two, is exact. In units of 2^-24 * scale * |inverse| (see `PreparedRay`) the
// inner fma may be off by 3 and the outer one, whose product may be twice the scale, by 4: 4 more than the 3 of
// `outer`. The host compares faces rounded (`flatten/wide.rs`): 1 more. So crossings are within 27 of the 32 units that
// the pads allow.

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
fn descend(ray: PreparedRay, reference: u32, member: TreeInstance, limit: f32, way: ptr<function, Way>) -> u32 {
    let node = node_at(reference);
    if COUNTS {
        visit_node();
    }
    let steps = vec3<f32>(step_of(node.shape), step_of(node.shape >> 8u), step_of(node.shape >> 16u));
    var slots: u32;
    if MEMBERS && (*way).inside {
        slots = met_moved(ray, node, steps, member, limit);
    } else {
        slots = met(ray, node, steps, limit);
    }
    let waiting = in_order(slots & (node.shape >> 24u), ray.octant);
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
fn next(ray: PreparedRay, limit: f32, way: ptr<function, Way>) -> u32 {
    if (*way).height == 0u {
        return NOWHERE;
    }
    (*way).inside = (*way).inside && (*way).height > (*way).bottom;
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
fn met(ray: PreparedRay, node: WideNode, steps: vec3<f32>, limit: f32) -> u32 {
    let scale = steps * ray.inverse;
    let near = fma(node.origin, ray.inverse, ray.near);
    let far = fma(node.origin, ray.inverse, ray.far);
    let first_x = select(node.upper_x, node.lower_x, ray.forward.x);
    let first_y = select(node.upper_y, node.lower_y, ray.forward.y);
    let first_z = select(node.upper_z, node.lower_z, ray.forward.z);
    let last_x = select(node.lower_x, node.upper_x, ray.forward.x);
    let last_y = select(node.lower_y, node.upper_y, ray.forward.y);
    let last_z = select(node.lower_z, node.upper_z, ray.forward.z);
    var slots = 0u;
    for (var half = 0u; half < 2u; half++) {
        let enter = max(
            max(crossed(first_x[half], scale.x, near.x), crossed(first_y[half], scale.y, near.y)),
            crossed(first_z[half], scale.z, near.z),
        );
        let leave = min(
            min(crossed(last_x[half], scale.x, far.x), crossed(last_y[half], scale.y, far.y)),
            crossed(last_z[half], scale.z, far.z),
        );
        let is_met = (enter <= min(leave, vec4<f32>(limit))) & (leave >= vec4<f32>(ray.t_min));
        slots |= bits_of(is_met) << (4u * half);
    }
    return slots;
}

// The distances at which the ray crosses four faces.
fn crossed(faces: u32, scale: f32, shift: f32) -> vec4<f32> {
    return fma(vec4<f32>(unpack4xU8(faces)), vec4<f32>(scale), vec4<f32>(shift));
}

fn bits_of(are: vec4<bool>) -> u32 {
    let bits = select(vec4<u32>(0u), vec4<u32>(1u, 2u, 4u, 8u), are);
    return bits.x | bits.y | bits.z | bits.w;
}

// Like `met`, for a node of a member's tree, whose boxes are moved into the world.
fn met_moved(ray: PreparedRay, node: WideNode, steps: vec3<f32>, member: TreeInstance, limit: f32) -> u32 {
    var slots = 0u;
    for (var slot = 0u; slot < 8u; slot++) {
        let half = slot >> 2u;
        let byte = 8u * (slot & 3u);
        let faces_below = vec3<u32>(node.lower_x[half], node.lower_y[half], node.lower_z[half]);
        let faces_above = vec3<u32>(node.upper_x[half], node.upper_y[half], node.upper_z[half]);
        let below = vec3<f32>((faces_below >> vec3<u32>(byte)) & vec3<u32>(0xffu));
        let above = vec3<f32>((faces_above >> vec3<u32>(byte)) & vec3<u32>(0xffu));
        // The product is exact, so the sum is rounded once, fused or not.
        let lower = fma(below, steps, node.origin);
        let upper = fma(above, steps, node.origin);
        let met = outer(ray, moved_corner(member, lower, upper), moved_corner(member, upper, lower));
        let is_met = met.enter <= min(met.leave, limit) && met.leave >= ray.t_min;
        slots |= select(0u, 1u << slot, is_met);
    }
    return slots;
}
