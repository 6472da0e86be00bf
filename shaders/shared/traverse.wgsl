// Traversal of the scene. The kernel defines `open_triangles`, the triangles of a pair that may be hit; `take`, which
// tests such a triangle, keeps what it has found, and returns whether the ray is done; and `limit_of`, the bits of the
// distance up to which hits matter. `descend` visits an inner node, and `next` follows a leaf (`wide.wgsl`).

fn traverse(ray: PreparedRay, found: ptr<function, Found>) {
    var way: Way;
    var member: TreeInstance;
    var reference = 0u;
    loop {
        loop {
            if (reference & LEAF) != 0u {
                break;
            }
            reference = descend(ray, reference, member, limit_of(found), &way);
        }
        if reference == NOWHERE {
            return;
        }
        if MEMBERS & !way.inside {
            member = members[reference & ~LEAF];
            if COUNTS {
                visit_instance();
            }
            way.inside = true;
            way.bottom = way.height;
            reference = member.root;
            continue;
        }
        if through_leaf(ray, reference, member, found) {
            return;
        }
        reference = next(ray, limit_of(found), &way);
    }
}
