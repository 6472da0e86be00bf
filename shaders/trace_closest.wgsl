// Nearest hits: of every ray, the primitives among which the canonical nearest hit is.
//
// `limit` is the least distance within which some triangle is certainly hit, so the canonical hit is
// at most so far. Triangles that are not refused and may be so near are kept, in order of their least
// distances; one that does not fit lowers `rest`.

@group(1) @binding(2) var<storage, read_write> answers: array<Candidates>;

@compute @workgroup_size(WORKGROUP_SIZE)
fn trace_closest(@builtin(global_invocation_id) id: vec3<u32>) {
    let slot = id.x;
    if slot >= params.count {
        return;
    }
    var ray: PreparedRay;
    let fitness = prepare(rays[slot], &ray);
    if fitness != CERTAIN {
        answers[slot] = Candidates(MISS, MISS, MISS, select(-1.0, LARGEST_FLOAT, fitness == REFUSED));
        return;
    }

    var limit = ray.t_max;
    var kept = vec3<u32>(MISS);
    var lows = vec3<f32>(LARGEST_FLOAT);
    var rest = LARGEST_FLOAT;

    // What waits to be visited, and where the ray enters it.
    var stack: array<u32, STACK_SIZE>;
    var enters: array<f32, STACK_SIZE>;
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
            let hit_left = left.enter <= min(left.leave, limit) && left.leave >= ray.t_min;
            let hit_right = right.enter <= min(right.leave, limit) && right.leave >= ray.t_min;
            if hit_left || hit_right {
                let left_first = hit_left && (!hit_right || left.enter <= right.enter);
                reference = select(node.right, node.left, left_first);
                if hit_left && hit_right {
                    stack[height] = select(node.left, node.right, left_first);
                    enters[height] = max(left.enter, right.enter);
                    height += 1u;
                }
            } else {
                reference = NOWHERE;
                loop {
                    if height == 0u {
                        break;
                    }
                    inside = inside && height > bottom;
                    height -= 1u;
                    if enters[height] <= limit {
                        reference = stack[height];
                        break;
                    }
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
            if verdict.kind != REFUSED && verdict.low <= limit {
                if verdict.kind == CERTAIN {
                    limit = min(limit, verdict.high);
                }
                // Sorts the triangle in; the last one drops out.
                rest = min(rest, max(lows.z, verdict.low));
                let low = vec3<f32>(verdict.low);
                let primitive = vec3<u32>(triangle.primitive);
                let before = low < lows;
                let moved = vec3<bool>(false, before.xy);
                kept = select(kept, select(primitive, kept.xxy, moved), before);
                lows = select(lows, select(low, lows.xxy, moved), before);
            }
            if (triangle.flags & LAST) != 0u {
                break;
            }
            index += 1u;
        }
        reference = NOWHERE;
        loop {
            if height == 0u {
                break;
            }
            inside = inside && height > bottom;
            height -= 1u;
            if enters[height] <= limit {
                reference = stack[height];
                break;
            }
        }
    }

    let near = select(vec3<u32>(MISS), kept, lows <= vec3<f32>(limit));
    answers[slot] = Candidates(near.x, near.y, near.z, select(LARGEST_FLOAT, rest, rest <= limit));
}
