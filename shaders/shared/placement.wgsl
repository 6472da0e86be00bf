// The canonical motion of a member's geometry into the world (`geom::Placement`). Every product and every sum is
// rounded once, in the same order as on the host, so corners and boxes equal the host's to the bit. (A device that
// flushes tiny products to zero moves them by less than the smallest normal number. TINY and the pads of the slabs
// cover that: see `prepare`.)

fn moved(member: TreeInstance, p: vec3<f32>) -> vec3<f32> {
    let x = rounded(member.x * vec3<f32>(p.x));
    let y = rounded(member.y * vec3<f32>(p.y));
    let z = rounded(member.z * vec3<f32>(p.z));
    return rounded(rounded(rounded(x + y) + z) + member.shift);
}

// A corner of the moved box: the lower one if called with (`lower`, `upper`), the upper one if called with the two
// exchanged.
fn moved_corner(member: TreeInstance, lower: vec3<f32>, upper: vec3<f32>) -> vec3<f32> {
    let zero = vec3<i32>(0);
    let x = rounded(member.x * select(upper.xxx, lower.xxx, bitcast<vec3<i32>>(member.x) >= zero));
    let y = rounded(member.y * select(upper.yyy, lower.yyy, bitcast<vec3<i32>>(member.y) >= zero));
    let z = rounded(member.z * select(upper.zzz, lower.zzz, bitcast<vec3<i32>>(member.z) >= zero));
    return rounded(rounded(rounded(x + y) + z) + member.shift);
}
