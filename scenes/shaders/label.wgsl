// A printed label on a material: a band around the object with stripes, as glossy as paper under varnish.

// Height of the label's middle, and half of its height, in units of the world.
override middle: f32 = 0.0;
override half_height: f32 = 0.25;
// Stripes in a unit of length.
override stripes: f32 = 12.0;

fn pattern(at: Point) -> Finish {
    let height = (at.position.y - middle) / half_height;
    var print = matte(at);
    print.colour = vec3f(0.9, 0.87, 0.78);
    print.roughness = 0.5;
    print.clearcoat = 0.6;
    print.clearcoat_roughness = 0.15;
    let stripe = step(0.5, fract(at.position.x * stripes));
    let printed = step(abs(height), 0.75) * step(0.45, abs(height));
    print.colour = mix(print.colour, vec3f(0.55, 0.06, 0.08), stripe * printed);
    return mix_finish(base(at), print, step(abs(height), 1.0));
}
