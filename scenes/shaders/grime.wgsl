// Grime where a mask is bright, more of it on what points up. The mask is projected along three axes, so the material
// needs no texture coordinates: `--surface "*"=grime.wgsl,mask=dirt.png,linear`.

var mask: texture_2d<f32>;

// Repetitions of the mask in a unit of length, and the share of the surface that is dirty, 0 to 1.
override scale: f32 = 1.0;
override cover: f32 = 0.5;

fn masked(at: Point) -> f32 {
    let p = at.object_position * scale;
    let n = at.geometric_normal * at.geometric_normal;
    return image(mask, p.zy).r * n.x + image(mask, p.xz).r * n.y + image(mask, p.xy).r * n.z;
}

fn pattern(at: Point) -> Finish {
    var grime = matte(at);
    grime.colour = vec3f(0.14, 0.1, 0.06);
    let dirty = masked(at) + 0.25 * at.geometric_normal.y;
    let edge = 1.0 - cover;
    return mix_finish(base(at), grime, smoothstep(edge - 0.1, edge + 0.1, dirty));
}
