// Nearest hit of every ray: a primitive, MISS, or UNDECIDED where rounding could change the answer.
//
// The canonical hit is among the triangles not refused. `best` is the certain one that is nearest,
// at most `best_high` away; `rival` is the least distance at which any other may be. When the rival
// cannot be as near as the best, the best is the canonical hit (a tie would make a rival).

@compute @workgroup_size(WORKGROUP_SIZE)
fn trace_closest(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.count {
        return;
    }
    let slot = params.first + id.x;
    var ray: PreparedRay;
    let fitness = prepare(rays[slot], &ray);
    if fitness != CERTAIN {
        answers[slot] = select(UNDECIDED, MISS, fitness == REFUSED);
        return;
    }

    var best = MISS;
    var best_low = LARGEST_FLOAT;
    var best_high = ray.t_max;
    var rival = LARGEST_FLOAT;
    var rivals = false;

    var stack: array<u32, STACK_SIZE>;
    var height = 0u;
    var reference = 0u;
    loop {
        if (reference & LEAF) == 0u {
            let node = nodes[reference];
            let left = outer(ray, node.left_min, node.left_max);
            let right = outer(ray, node.right_min, node.right_max);
            let hit_left = left.enter <= min(left.leave, best_high) && left.leave >= ray.t_min;
            let hit_right = right.enter <= min(right.leave, best_high) && right.leave >= ray.t_min;
            if hit_left || hit_right {
                let left_first = hit_left && (!hit_right || left.enter <= right.enter);
                reference = select(node.right, node.left, left_first);
                if hit_left && hit_right {
                    stack[height] = select(node.left, node.right, left_first);
                    height += 1u;
                }
                continue;
            }
        } else {
            var index = reference & ~LEAF;
            loop {
                let triangle = triangles[index];
                let verdict = judge(ray, triangle);
                // A triangle may lie in several leaves.
                if verdict.kind != REFUSED && triangle.primitive != best {
                    if verdict.kind == CERTAIN && verdict.high <= best_high {
                        if best != MISS {
                            rival = min(rival, best_low);
                            rivals = true;
                        }
                        best = triangle.primitive;
                        best_low = verdict.low;
                        best_high = verdict.high;
                    } else {
                        rival = min(rival, verdict.low);
                        rivals = true;
                    }
                }
                if (triangle.flags & LAST) != 0u {
                    break;
                }
                index += 1u;
            }
        }
        if height == 0u {
            break;
        }
        height -= 1u;
        reference = stack[height];
    }

    answers[slot] = select(best, UNDECIDED, rivals && rival <= best_high);
}
