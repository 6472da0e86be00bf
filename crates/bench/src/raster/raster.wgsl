// A picture of triangles by depth and the geometric normal alone.

struct View {
    clip: mat4x4<f32>,
    eye: vec4<f32>,
    to_light: vec4<f32>,
}

@group(0) @binding(0) var<uniform> view: View;

struct Corner {
    @builtin(position) @invariant clip: vec4<f32>,
    @location(0) world: vec3<f32>,
}

@vertex
fn corner(@location(0) position: vec3<f32>) -> Corner {
    return Corner(view.clip * vec4(position, 1.0), position);
}

@fragment
fn shade(seen: Corner) -> @location(0) vec4<f32> {
    var normal = normalize(cross(dpdx(seen.world), dpdy(seen.world)));
    if dot(normal, seen.world - view.eye.xyz) > 0.0 {
        normal = -normal;
    }
    let grey = max(dot(normal, view.to_light.xyz), 0.0) * view.to_light.w;
    return vec4(grey, grey, grey, 1.0);
}

// The number of the triangle plus one. Corners are not shared.

struct Numbered {
    @builtin(position) @invariant clip: vec4<f32>,
    @location(0) @interpolate(flat) number: u32,
}

@vertex
fn numbered_corner(@location(0) position: vec3<f32>, @builtin(vertex_index) index: u32) -> Numbered {
    return Numbered(view.clip * vec4(position, 1.0), index / 3u + 1u);
}

@fragment
fn number(seen: Numbered) -> @location(0) u32 {
    return seen.number;
}
