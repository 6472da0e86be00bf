// A picture on a material, as large and where one likes, blended by its alpha. Bind the picture with `clamp`, so that
// its edge continues: `--surface mug=decal.wgsl,print=cat.png,clamp,size=0.4`.

var print: texture_2d<f32>;

struct Params { centre: vec2f }
// The middle of the picture, in texture coordinates.
var<private> params: Params = Params(vec2f(0.5));

// Its width, in texture coordinates, and the roughness of its ink.
override size: f32 = 0.5;
override roughness: f32 = 0.35;

fn pattern(at: Point) -> Finish {
    let place = (at.uv - params.centre) / size + 0.5;
    let inside = step(abs(place.x - 0.5), 0.5) * step(abs(place.y - 0.5), 0.5);
    let texel = image(print, place);
    let below = base(at);
    var ink = below;
    ink.colour = texel.rgb;
    ink.metallic = 0.0;
    ink.roughness = roughness;
    return mix_finish(below, ink, texel.a * inside);
}
