// A ray's way through the scene. The kernel says what becomes of a triangle that is not refused: `take`, which answers
// whether that is enough, and how far the ray still has to be looked at: `limit_of`. The tree says how to go on:
// `descend` from an inner node, `next` from a leaf.

fn traverse(ray: PreparedRay, found: ptr<function, Found>) {
    var way: Way;
    var member: Member;
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
        if MEMBERS && !way.inside {
            member = members[reference & ~LEAF];
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
