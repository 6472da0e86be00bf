//! Scenes in POV-Ray's language.

use super::{PovRayError, SCENE, WrittenScene};
use glam::{DVec3, Vec3};
use raystream::scene::{Camera, Projection};
use std::fs::File;
use std::io::{self, BufWriter, Write};

/// Shadows of the light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shadows {
    /// No ray but camera rays is sent.
    Absent,
    /// Each hit that faces the light sends a shadow ray.
    Cast,
}

/// The view and the light of a picture.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// Columns and rows.
    pub size: [u32; 2],
    eye: DVec3,
    /// Width and height of the picture at distance 1.
    across: DVec3,
    up: DVec3,
    forward: DVec3,
}

impl View {
    /// The view of a camera.
    ///
    /// # Errors
    /// When POV-Ray gets no such camera.
    pub fn new(camera: &Camera, size: [u32; 2]) -> Result<Self, PovRayError> {
        let refused = || PovRayError::Camera(camera.to_string());
        let is_plain = matches!(camera.projection, Projection::Perspective { .. })
            && camera.shift == glam::Vec2::ZERO
            && camera.aperture.is_none();
        let axes = camera.to_world().ok().filter(|_| is_plain).ok_or_else(refused)?;
        let lens = camera.intrinsics(size[0], size[1]).ok_or_else(refused)?;
        Ok(Self {
            size,
            eye: camera.eye.as_dvec3(),
            across: axes.x_axis.truncate() * (f64::from(size[0]) / lens.fx),
            up: axes.y_axis.truncate() * (f64::from(size[1]) / lens.fy),
            forward: -axes.z_axis.truncate(),
        })
    }
}

/// Writes triangles of one matte colour as a `mesh2` in parallel light from the direction `to_light`.
///
/// # Errors
/// When the file cannot be written.
pub fn write_scene(
    (positions, triangles): (&[Vec3], &[[u32; 3]]),
    view: View,
    (to_light, albedo, shadows): (Vec3, f32, Shadows),
) -> Result<WrittenScene, PovRayError> {
    let folder = tempfile::tempdir()?;
    let mut out = BufWriter::with_capacity(1 << 20, File::create(folder.path().join(SCENE))?);
    head(&mut out, &view, to_light, shadows)?;
    // Without normals at its vertices a mesh is flat.
    write!(out, "mesh2 {{\nvertex_vectors {{ {}", positions.len())?;
    for p in positions {
        write!(out, ",\n<{},{},{}>", p.x, p.y, p.z)?;
    }
    write!(out, " }}\nface_indices {{ {}", triangles.len())?;
    for [a, b, c] in triangles {
        write!(out, ",\n<{a},{b},{c}>")?;
    }
    writeln!(out, " }}\npigment {{ color rgb {albedo} }}\nfinish {{ ambient 0 diffuse 1 }} }}")?;
    out.flush()?;
    Ok(WrittenScene { folder, view })
}

fn head(out: &mut impl Write, view: &View, to_light: Vec3, shadows: Shadows) -> io::Result<()> {
    let vector = |v: DVec3| format!("<{},{},{}>", v.x, v.y, v.z);
    let View { eye, across, up, forward, .. } = *view;
    // Parallel light is the same wherever it comes from; far away, all of the scene lies before it.
    let light = vector(to_light.as_dvec3() * 1e5);
    let shadowless = if shadows == Shadows::Absent { "shadowless" } else { "" };
    writeln!(out, "#version 3.7;\nglobal_settings {{ assumed_gamma 1.0 ambient_light 0 }}")?;
    writeln!(out, "camera {{ perspective location {}", vector(eye))?;
    writeln!(out, "right {} up {} direction {} }}", vector(across), vector(up), vector(forward))?;
    writeln!(out, "light_source {{ {light} color rgb 1 parallel point_at <0,0,0> {shadowless} }}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use raystream::scene::Aperture;

    #[test]
    fn a_triangle_is_written_as_povray_reads_it() {
        let camera = Camera::new(Vec3::Z * 5.0, Vec3::ZERO).with_fov(90.0);
        let view = View::new(&camera, [20, 10]).expect("a perspective");
        let (positions, triangles) = ([Vec3::ZERO, Vec3::X, Vec3::new(0.1, 1e-7, -2.5)], [[0, 1, 2]]);
        for (shadows, is_shadowless) in [(Shadows::Absent, true), (Shadows::Cast, false)] {
            let light = (Vec3::Y, 0.5, shadows);
            let written = write_scene((&positions, &triangles), view, light).expect("a folder");
            let text = std::fs::read_to_string(written.folder.path().join(SCENE)).expect("it is there");
            assert!(
                text.contains("vertex_vectors { 3,\n<0,0,0>,\n<1,0,0>,\n<0.1,0.0000001,-2.5> }"),
                "{text}"
            );
            assert!(text.contains("face_indices { 1,\n<0,1,2> }"), "{text}");
            assert_eq!(text.contains("shadowless"), is_shadowless);
            assert!(view.across.abs_diff_eq(DVec3::X * 4.0, 1e-6), "{view:?}");
            assert!(view.up.abs_diff_eq(DVec3::Y * 2.0, 1e-6) && view.forward == -DVec3::Z, "{view:?}");
        }
    }

    #[test]
    fn cameras_without_a_counterpart_are_refused() {
        let camera = Camera::new(Vec3::Z, Vec3::ZERO);
        let wide = camera.with_projection(Projection::Panorama);
        for camera in [wide, camera.with_aperture(Aperture::new(0.1, 1.0)), Camera::new(Vec3::Z, Vec3::Z)] {
            assert!(matches!(View::new(&camera, [8, 8]), Err(PovRayError::Camera(_))), "{camera}");
        }
    }
}
