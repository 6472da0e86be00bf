// Traversal of the binary tree: visits the nearer child first and puts the other one on the stack.

struct Way {
    stack: array<u32, STACK_SIZE>,
    // The distances at which the ray enters the boxes of the stack's entries.
    enters: array<f32, STACK_SIZE>,
    height: u32,
    // Whether a member's tree is being traversed, and the height of the stack below that tree's entries.
    inside: bool,
    bottom: u32,
}

// Visits an inner node: pushes a child that the ray enters within `limit` if it enters both, and returns the next
// reference to visit.
fn descend(ray: PreparedRay, reference: u32, member: TreeInstance, limit: f32, way: ptr<function, Way>) -> u32 {
    var node = node_at(reference);
    if MEMBERS && (*way).inside {
        node = moved_node(member, node);
    }
    let left = outer(ray, node.left_min, node.left_max);
    let right = outer(ray, node.right_min, node.right_max);
    let hit_left = left.enter <= min(left.leave, limit) && left.leave >= ray.t_min;
    let hit_right = right.enter <= min(right.leave, limit) && right.leave >= ray.t_min;
    if !(hit_left || hit_right) {
        return next(ray, limit, way);
    }
    let left_first = hit_left && (!hit_right || left.enter <= right.enter);
    if hit_left && hit_right {
        (*way).stack[(*way).height] = select(node.left, node.right, left_first);
        if CULLS {
            (*way).enters[(*way).height] = max(left.enter, right.enter);
        }
        (*way).height += 1u;
    }
    return select(node.right, node.left, left_first);
}

// Pops the next reference to visit; NOWHERE at the end of the traversal.
fn next(ray: PreparedRay, limit: f32, way: ptr<function, Way>) -> u32 {
    loop {
        if (*way).height == 0u {
            return NOWHERE;
        }
        (*way).inside = (*way).inside && (*way).height > (*way).bottom;
        (*way).height -= 1u;
        if !CULLS || (*way).enters[(*way).height] <= limit {
            return (*way).stack[(*way).height];
        }
    }
    return NOWHERE;
}

fn moved_node(member: TreeInstance, node: BinaryNode) -> BinaryNode {
    var out = node;
    out.left_min = moved_corner(member, node.left_min, node.left_max);
    out.left_max = moved_corner(member, node.left_max, node.left_min);
    out.right_min = moved_corner(member, node.right_min, node.right_max);
    out.right_max = moved_corner(member, node.right_max, node.right_min);
    return out;
}
