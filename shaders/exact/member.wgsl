// A member's corners in the world, moved as `geom::Placement` does.

fn moved_word(member: TreeInstance, p: vec3<u32>, axis: u32) -> u32 {
    let x = op_mul(bitcast<u32>(member.x[axis]), p.x);
    let y = op_mul(bitcast<u32>(member.y[axis]), p.y);
    let z = op_mul(bitcast<u32>(member.z[axis]), p.z);
    return op_add(op_add(op_add(x, y), z), bitcast<u32>(member.shift[axis]));
}

fn moved(member: TreeInstance, p: vec3<u32>) -> vec3<u32> {
    return vec3<u32>(moved_word(member, p, 0u), moved_word(member, p, 1u), moved_word(member, p, 2u));
}

fn in_world(corners: Corners, number: u32) -> Corners {
    let member = members[number];
    return Corners(
        moved(member, corners.v0),
        moved(member, corners.v1),
        moved(member, corners.v2),
        corners.primitive + member.first,
    );
}
