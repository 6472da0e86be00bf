// The canonical motion of a member's geometry into the world (`geom::Placement`): every product and every sum is
// rounded once, in the same order, so corners and boxes are the host's to the bit. (A device that flushes tiny products
// to zero moves them by less than the smallest normal number, which TINY and the slabs' pads cover: see `prepare`.)

fn moved(member: Member, p: vec3<f32>) -> vec3<f32> {
    let x = rounded(member.x * p.x);
    let y = rounded(member.y * p.y);
    let z = rounded(member.z * p.z);
    return rounded(rounded(rounded(x + y) + z) + member.shift);
}

// The lower corner of the moved box when `lower` and `upper` are its corners, else the upper.
fn moved_corner(member: Member, lower: vec3<f32>, upper: vec3<f32>) -> vec3<f32> {
    let zero = vec3<f32>(0.0);
    let x = rounded(member.x * select(upper.xxx, lower.xxx, member.x >= zero));
    let y = rounded(member.y * select(upper.yyy, lower.yyy, member.y >= zero));
    let z = rounded(member.z * select(upper.zzz, lower.zzz, member.z >= zero));
    return rounded(rounded(rounded(x + y) + z) + member.shift);
}
