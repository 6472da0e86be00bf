// Whether anything is hit: OCCLUDED, MISS, or a primitive that is in the way unless rounding or alpha
// takes it away, with the flag MORE when there are others. UNDECIDED when nothing can be said.

@group(1) @binding(2) var<storage, read_write> answers: array<u32>;

@compute @workgroup_size(WORKGROUP_SIZE)
fn trace_any(@builtin(global_invocation_id) id: vec3<u32>) {
    let slot = id.x;
    if slot >= params.count {
        return;
    }
    var ray: PreparedRay;
    let fitness = prepare(rays[slot], &ray);
    if fitness != CERTAIN {
        answers[slot] = select(UNDECIDED, MISS, fitness == REFUSED);
        return;
    }

    var answer = MISS;
    var stack: array<u32, STACK_SIZE>;
    var height = 0u;
    var reference = 0u;
    // The member whose tree is gone through, and how much of the stack is above that.
    var inside = false;
    var member: Member;
    var bottom = 0u;
    loop {
        // Down to a leaf.
        loop {
            if (reference & LEAF) != 0u {
                break;
            }
            var node = node_at(reference);
            if MEMBERS && inside {
                node = moved_node(member, node);
            }
            let left = outer(ray, node.left_min, node.left_max);
            let right = outer(ray, node.right_min, node.right_max);
            let hit_left = left.enter <= min(left.leave, ray.t_max) && left.leave >= ray.t_min;
            let hit_right = right.enter <= min(right.leave, ray.t_max) && right.leave >= ray.t_min;
            if hit_left || hit_right {
                let left_first = hit_left && (!hit_right || left.enter <= right.enter);
                reference = select(node.right, node.left, left_first);
                if hit_left && hit_right {
                    stack[height] = select(node.left, node.right, left_first);
                    height += 1u;
                }
            } else {
                reference = NOWHERE;
                if height > 0u {
                    inside = inside && height > bottom;
                    height -= 1u;
                    reference = stack[height];
                }
            }
        }
        if reference == NOWHERE {
            break;
        }

        if MEMBERS && !inside {
            member = members[reference & ~LEAF];
            inside = true;
            bottom = height;
            reference = member.root;
            continue;
        }

        // Through the leaf.
        var index = reference & ~LEAF;
        loop {
            var triangle = triangle_at(index);
            if MEMBERS {
                triangle = moved_triangle(member, triangle);
            }
            let verdict = judge(ray, triangle);
            if verdict.kind == CERTAIN {
                answer = OCCLUDED;
                height = 0u;
                break;
            }
            if verdict.kind == UNCERTAIN {
                answer = select(answer | MORE, triangle.primitive, answer == MISS);
            }
            if (triangle.flags & LAST) != 0u {
                break;
            }
            index += 1u;
        }
        reference = NOWHERE;
        if height > 0u {
            inside = inside && height > bottom;
            height -= 1u;
            reference = stack[height];
        }
    }
    answers[slot] = answer;
}
