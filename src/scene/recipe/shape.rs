//! Generated shapes. Shared edges have the same vertex positions to the bit, so bodies are watertight.

use super::fractal::Fractal;
use super::{positive, readable, within};
use crate::scene::{MeshSize, TriangleMesh};
use glam::{DMat4, DQuat, DVec3, Quat, Vec2, Vec3};
use rayon::prelude::*;
use serde::Deserialize;
use std::f32::consts::TAU;

/// A shape. Lengths are in world units. `cells` counts quads along an edge, each of two triangles.
#[derive(Clone, Debug, Deserialize)]
#[serde(tag = "shape", rename_all = "snake_case", deny_unknown_fields)]
pub enum Shape {
    /// A parallelogram. Its normal is in the direction of `u × v`.
    Quad {
        /// First corner, with texture coordinates (0, 1).
        corner: Vec3,
        /// Edge along the image's rows.
        u: Vec3,
        /// Edge against the image's columns (up).
        v: Vec3,
        /// Repetitions of the texture along u and v.
        #[serde(default = "one")]
        repeat: Vec2,
    },
    /// A flat convex polygon. Its points are counter-clockwise seen from the front.
    Polygon {
        /// At least three corners.
        points: Vec<Vec3>,
    },
    /// A box with rounded edges.
    Block {
        /// Its centre.
        centre: Vec3,
        /// Half the lengths of its edges.
        half: Vec3,
        /// Radius of the rounding, 0 to the least half edge.
        round: f32,
        /// Rotation about +y in degrees.
        #[serde(default)]
        turn_degrees: f32,
        /// Cells along each edge of each face, 1 to 1024.
        cells: u32,
    },
    /// A sphere. With `rough` it is a stone: displaced outwards and inwards by fractal noise.
    Sphere {
        /// Its centre.
        centre: Vec3,
        /// Radius before displacement, above 0.
        radius: f32,
        /// Cells along each edge of each of its six faces, 1 to 1024.
        cells: u32,
        /// Displacement.
        #[serde(default)]
        rough: Option<FractalNoise>,
    },
    /// A tube around an upright (p, q) torus knot.
    Knot {
        /// Its centre.
        centre: Vec3,
        /// Radius of the torus that the knot winds around.
        radius: f32,
        /// Radius of the tube.
        tube: f32,
        /// Windings around the axis, ≥ 1.
        p: u32,
        /// Windings through the hole, ≥ 1.
        q: u32,
        /// Rotation about +y in degrees.
        #[serde(default)]
        turn_degrees: f32,
        /// Cells along and around the tube, 3 to 65536 each.
        cells: [u32; 2],
    },
    /// Hills: a square of ground displaced upwards by fractal noise.
    Terrain {
        /// Centre of the ground.
        centre: Vec3,
        /// Length of its edges, above 0.
        size: f32,
        /// Displacement. `frequency` is relative to `size`.
        rough: FractalNoise,
        /// Radius of a flat disk around the centre. The hills rise to their full height between this radius and twice
        /// this radius.
        #[serde(default)]
        clearing: f32,
        /// Cells along each edge, 1 to 4096.
        cells: u32,
    },
}

/// Fractal noise.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FractalNoise {
    /// Approximate largest displacement.
    pub height: f32,
    /// Features per unit of length.
    pub frequency: f64,
    /// Octaves, 1 to 12.
    pub octaves: usize,
    /// Seed of the noise.
    #[serde(default)]
    pub seed: u32,
}

/// Most features of the coarsest octave between the origin of noise and the farthest point. The finest octave has some
/// 3000 times as many, and the `noise` crate counts them in integers.
const MAX_FEATURES: f64 = 1e12;

impl FractalNoise {
    /// The displacement at points whose coordinates are at most `reach` in magnitude.
    fn noise(&self, reach: f32) -> Result<impl Fn(Vec3) -> f32 + Sync + use<>, String> {
        within("octaves", self.octaves, 1, 12)?;
        let features = self.frequency * f64::from(reach);
        if features.is_nan() || features.abs() > MAX_FEATURES {
            return Err(format!(
                "frequency is {}, which makes {features:e} features; there may be {MAX_FEATURES:e}",
                readable(self.frequency)
            ));
        }
        let fractal = Fractal::new(self.seed, self.octaves, self.frequency);
        let height = self.height;
        Ok(move |p: Vec3| height * fractal.at_3d(p.as_dvec3().to_array()) as f32)
    }
}

fn one() -> Vec2 {
    Vec2::ONE
}

impl Shape {
    /// The numbers of vertices and triangles. An error names a number of cells that is out of range.
    pub(super) fn size(&self) -> Result<MeshSize, String> {
        let sheet = |[across, up]: [u32; 2], sheets: u64| MeshSize {
            vertices: sheets * (u64::from(across) + 1) * (u64::from(up) + 1),
            triangles: sheets * 2 * u64::from(across) * u64::from(up),
            ..MeshSize::default()
        };
        Ok(match self {
            Self::Quad { .. } => sheet([1, 1], 1),
            Self::Polygon { points } => {
                let vertices = points.len() as u64;
                MeshSize { vertices, triangles: vertices.saturating_sub(2), ..MeshSize::default() }
            }
            Self::Block { cells, .. } | Self::Sphere { cells, .. } => {
                within("cells", *cells, 1, 1024)?;
                sheet([*cells; 2], 6)
            }
            Self::Knot { cells, .. } => {
                within("cells", cells[0].min(cells[1]), 3, 65536)?;
                within("cells", cells[0].max(cells[1]), 3, 65536)?;
                sheet(*cells, 1)
            }
            Self::Terrain { cells, .. } => {
                within("cells", *cells, 1, 4096)?;
                sheet([*cells; 2], 1)
            }
        })
    }

    /// The way from the shape's own space into the world: its turn about its centre.
    pub(super) fn placement(&self) -> DMat4 {
        let (centre, degrees) = match self {
            Self::Quad { .. } | Self::Polygon { .. } => return DMat4::IDENTITY,
            Self::Block { centre, turn_degrees, .. } | Self::Knot { centre, turn_degrees, .. } => {
                (centre, *turn_degrees)
            }
            Self::Sphere { centre, .. } | Self::Terrain { centre, .. } => (centre, 0.0),
        };
        let turn = DQuat::from_axis_angle(DVec3::Y, f64::from(degrees).to_radians());
        DMat4::from_rotation_translation(turn, centre.as_dvec3())
    }

    /// Appends the shape's triangles, as many as [`Shape::size`] says. An error names a number that is out of range.
    pub(super) fn tessellate(&self, material: u32, mesh: &mut TriangleMesh) -> Result<(), String> {
        match self {
            Self::Quad { corner, u, v, repeat } => {
                let normal =
                    u.cross(*v).try_normalize().ok_or("u and v must be neither zero nor parallel")?;
                let uv = |[x, y]: [f32; 2]| Vec2::new(x, 1.0 - y) * *repeat;
                grid([1, 1], [false; 2], material, mesh, uv, |[x, y]| (*corner + *u * x + *v * y, normal));
            }
            Self::Polygon { points } => polygon(points, material, mesh)?,
            Self::Block { centre, half, round, turn_degrees, cells } => {
                let least = half.min_element();
                if !(least > 0.0 && (0.0..=least).contains(round)) {
                    return Err(format!(
                        "half is {half} and round is {round}; half must be positive, and round from 0 \
                         to its least component"
                    ));
                }
                let turn = Quat::from_rotation_y(turn_degrees.to_radians());
                let core = *half - Vec3::splat(*round);
                cube(*cells, material, mesh, |face, p| {
                    let p = p * *half;
                    let inner = p.clamp(-core, core);
                    let out = (p - inner).try_normalize().unwrap_or(face);
                    (*centre + turn * (inner + out * *round), turn * out)
                });
            }
            Self::Sphere { centre, radius, cells, rough } => {
                sphere(*centre, *radius, *cells, rough.as_ref(), material, mesh)?;
            }
            Self::Knot { centre, radius, tube, p, q, turn_degrees, cells } => {
                positive("radius", *radius)?;
                positive("tube", *tube)?;
                within("p", *p, 1, 64)?;
                within("q", *q, 1, 64)?;
                let turn = Quat::from_rotation_y(turn_degrees.to_radians());
                let curve = |t: f32| torus_knot(*radius, *p as f32 * t, *q as f32 * t);
                let uv = |[x, y]: [f32; 2]| Vec2::new(x * 24.0, y);
                grid(*cells, [true; 2], material, mesh, uv, |[x, y]| {
                    let t = x * TAU;
                    let along = (curve(t + 1e-3) - curve(t - 1e-3)).normalize();
                    // The tangent never points at the knot's centre, so this frame does not flip.
                    let side = along.cross(curve(t)).normalize();
                    let up = side.cross(along);
                    let out = side * libm::cosf(y * TAU) + up * libm::sinf(y * TAU);
                    (*centre + turn * (curve(t) + out * *tube), turn * out)
                });
            }
            Self::Terrain { centre, size, rough, clearing, cells } => {
                positive("size", *size)?;
                let noise = rough.noise(1.0)?;
                let height = |x: f32, z: f32| {
                    let share = faded(x, z, *clearing);
                    if share == 0.0 { 0.0 } else { share * noise(Vec3::new(x / *size, 0.5, z / *size)).abs() }
                };
                let uv = |[u, v]: [f32; 2]| Vec2::new(u, 1.0 - v);
                grid([*cells; 2], [false; 2], material, mesh, uv, |[u, v]| {
                    let (x, z) = ((u - 0.5) * *size, (0.5 - v) * *size);
                    let step = 0.5 * *size / *cells as f32;
                    let fall = |dx: f32, dz: f32| height(x - dx, z - dz) - height(x + dx, z + dz);
                    let normal = Vec3::new(fall(step, 0.0), 2.0 * step, fall(0.0, step));
                    (*centre + Vec3::new(x, height(x, z), z), normal.normalize())
                });
            }
        }
        Ok(())
    }
}

/// A point of a torus knot: `a` is the angle around the axis, `b` the angle around the tube of the torus, in radians.
fn torus_knot(radius: f32, a: f32, b: f32) -> Vec3 {
    let r = radius * (1.0 + 0.45 * libm::cosf(b));
    Vec3::new(r * libm::cosf(a), r * libm::sinf(a), 0.45 * radius * libm::sinf(b))
}

/// A convex polygon as a fan of triangles.
fn polygon(points: &[Vec3], material: u32, mesh: &mut TriangleMesh) -> Result<(), String> {
    if points.len() < 3 {
        return Err(format!("{} points; a polygon needs at least 3", points.len()));
    }
    let normal = (points[1] - points[0]).cross(points[2] - points[0]);
    normal.try_normalize().ok_or("the first three points must not be on a line")?;
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(points);
    // Zero normals: each triangle has its geometric normal.
    mesh.normals.extend(points.iter().map(|_| Vec3::ZERO));
    mesh.uvs.extend(points.iter().map(|_| Vec2::ZERO));
    for k in 1..points.len() as u32 - 1 {
        mesh.triangles.push([first, first + k, first + k + 1]);
        mesh.materials.push(material);
    }
    Ok(())
}

fn sphere(
    centre: Vec3,
    radius: f32,
    cells: u32,
    rough: Option<&FractalNoise>,
    material: u32,
    mesh: &mut TriangleMesh,
) -> Result<(), String> {
    positive("radius", radius)?;
    match rough {
        None => cube(cells, material, mesh, |_, p| {
            let out = p.normalize();
            (centre + out * radius, out)
        }),
        Some(rough) => {
            let noise = rough.noise(radius)?;
            let at = |p: Vec3| {
                let out = p.normalize();
                out * (radius + noise(out * radius))
            };
            cube(cells, material, mesh, |face, p| {
                let (a, b) = face.any_orthonormal_pair();
                let step = 0.5 / cells as f32;
                let slope = |e: Vec3| at(p + e * step) - at(p - e * step);
                (centre + at(p), slope(a).cross(slope(b)).normalize_or(p))
            });
        }
    }
    Ok(())
}

/// The factor of a terrain's height: 0 within the radius `clearing`, rising to 1 at twice that radius.
fn faded(x: f32, z: f32, clearing: f32) -> f32 {
    let away = (x * x + z * z).sqrt();
    let fade = ((away - clearing) / clearing.max(1e-6)).clamp(0.0, 1.0);
    fade * fade * (3.0 - 2.0 * fade)
}

/// A grid of quads over [0, 1]², counter-clockwise. In closed directions, the first and last vertices have the same
/// position but different texture coordinates.
fn grid(
    cells: [u32; 2],
    closed: [bool; 2],
    material: u32,
    mesh: &mut TriangleMesh,
    uv: impl Fn([f32; 2]) -> Vec2,
    surface: impl Fn([f32; 2]) -> (Vec3, Vec3) + Sync,
) {
    let (first, row) = (mesh.positions.len() as u32, cells[0] + 1);
    let at = |i: u32, axis: usize| i as f32 / cells[axis] as f32;
    append_vertices(mesh, row * (cells[1] + 1), |k| {
        let along = |i: u32, axis: usize| at(if closed[axis] { i % cells[axis] } else { i }, axis);
        surface([along(k % row, 0), along(k / row, 1)])
    });
    for j in 0..=cells[1] {
        mesh.uvs.extend((0..=cells[0]).map(|i| uv([at(i, 0), at(j, 1)])));
    }
    for j in 0..cells[1] {
        for i in 0..cells[0] {
            let a = first + j * row + i;
            quad([a, a + 1, a + row + 1, a + row], material, mesh);
        }
    }
}

/// The surface of the cube −1..1, each face a grid. `place(face normal, point)` maps points to positions and normals.
/// Points on shared edges are equal to the bit.
fn cube(
    cells: u32,
    material: u32,
    mesh: &mut TriangleMesh,
    place: impl Fn(Vec3, Vec3) -> (Vec3, Vec3) + Sync,
) {
    for side in 0..6 {
        let face = Vec3::AXES[side % 3] * if side < 3 { 1.0 } else { -1.0 };
        let right = Vec3::AXES[(side + 1) % 3];
        let up = face.cross(right);
        let (first, row) = (mesh.positions.len() as u32, cells + 1);
        let at = |i: u32| -1.0 + 2.0 * i as f32 / cells as f32;
        append_vertices(mesh, row * row, |k| {
            // The second half is counted from the other end, so that both faces of an edge compute the same number.
            let along = |axis: Vec3, i: u32| {
                if axis.element_sum() > 0.0 { axis * at(i) } else { -axis * at(cells - i) }
            };
            place(face, face + along(right, k % row) + along(up, k / row))
        });
        for j in 0..=cells {
            mesh.uvs.extend((0..=cells).map(|i| Vec2::new(i as f32, (cells - j) as f32) / cells as f32));
        }
        for j in 0..cells {
            for i in 0..cells {
                let a = first + j * row + i;
                quad([a, a + 1, a + row + 1, a + row], material, mesh);
            }
        }
    }
}

/// Appends positions and normals, which all threads of rayon's pool compute: noise takes long.
fn append_vertices(mesh: &mut TriangleMesh, count: u32, vertex: impl Fn(u32) -> (Vec3, Vec3) + Sync) {
    let TriangleMesh { positions, normals, .. } = mesh;
    let (first_position, first_normal) = (positions.len(), normals.len());
    positions.resize(first_position + count as usize, Vec3::ZERO);
    normals.resize(first_normal + count as usize, Vec3::ZERO);
    let appended = positions[first_position..].par_iter_mut().zip(&mut normals[first_normal..]);
    appended.enumerate().for_each(|(k, (position, normal))| (*position, *normal) = vertex(k as u32));
}

fn quad([a, b, c, d]: [u32; 4], material: u32, mesh: &mut TriangleMesh) {
    mesh.triangles.extend([[a, b, c], [a, c, d]]);
    mesh.materials.extend([material; 2]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    fn mesh(shape: &str) -> TriangleMesh {
        let shape: Shape = serde_json::from_str(shape).expect("shape");
        let mut mesh = TriangleMesh::default();
        shape.tessellate(0, &mut mesh).expect("in range");
        mesh.validate(1).expect("valid");
        mesh
    }

    /// Asserts that every edge of a closed body belongs to two triangles, which traverse it in opposite directions.
    fn assert_closed(mesh: &TriangleMesh) {
        let mut edges: BTreeMap<[[u32; 3]; 2], i32> = BTreeMap::new();
        for t in 0..mesh.triangles.len() as u32 {
            let corners = mesh.corners(t).map(|p| (p + 0.0).to_array().map(f32::to_bits));
            for k in 0..3 {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                if a != b {
                    *edges.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
                }
            }
        }
        assert!(edges.values().all(|&balance| balance == 0));
    }

    #[test]
    fn bodies_are_closed_and_their_normals_point_outwards() {
        for shape in [
            r#"{ "shape": "sphere", "centre": [1,2,3], "radius": 2, "cells": 9 }"#,
            r#"{ "shape": "sphere", "centre": [0,0,0], "radius": 1, "cells": 24,
                 "rough": { "height": 0.2, "frequency": 2, "octaves": 4 } }"#,
            r#"{ "shape": "block", "centre": [0,0,0], "half": [1,2,3], "round": 0.2, "turn_degrees": 30, "cells": 8 }"#,
            r#"{ "shape": "knot", "centre": [0,1,0], "radius": 1, "tube": 0.2, "p": 2, "q": 3, "cells": [200, 12] }"#,
        ] {
            let mesh = mesh(shape);
            assert_closed(&mesh);
            for t in 0..mesh.triangles.len() as u32 {
                let [a, b, c] = mesh.corners(t);
                let normal = (b - a).cross(c - a);
                let shading = mesh.normals[mesh.triangles[t as usize][0] as usize];
                assert!(normal.dot(shading) >= 0.0, "{shape}: triangle {t} turns its back");
            }
        }
    }

    #[test]
    fn open_surfaces_face_up() {
        for shape in [
            r#"{ "shape": "terrain", "centre": [0,0,0], "size": 10, "clearing": 2, "cells": 32,
                 "rough": { "height": 1, "frequency": 3, "octaves": 6 } }"#,
            r#"{ "shape": "quad", "corner": [0,0,0], "u": [1,0,0], "v": [0,0,-1] }"#,
        ] {
            let mesh = mesh(shape);
            for t in 0..mesh.triangles.len() as u32 {
                let [a, b, c] = mesh.corners(t);
                assert!(
                    (b - a).cross(c - a).y > 0.0
                        && mesh.normals[mesh.triangles[t as usize][0] as usize].y > 0.0
                );
            }
        }
    }
}
