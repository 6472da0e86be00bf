//! Points and lines, which have no surface: balls and tubes stand for them.

use super::warnings::Warnings;
use crate::geom::Aabb;
use crate::scene::{MeshSize, TriangleMesh};
use glam::{DVec3, Vec3};
use std::ops::Range;
use std::sync::LazyLock;

/// Points of one part of a file that become balls of 20 triangles. More become balls of 8.
const MOST_FINE: u64 = 100_000;

/// The widths by themselves, as parts of the longest side of the scene's box: of tubes, and of balls from very many to
/// few.
const TUBE: f32 = 1.0 / 150.0;
const BALLS: Range<f32> = 1.0 / 1000.0..1.0 / 100.0;

/// A tube has this many sides, and a tip at each end.
const SIDES: usize = 6;

/// A closed shape around a point: unit vectors from its centre to its vertices, and triangles.
struct Hull {
    vertices: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

/// Balls of many triangles and of few.
static FINE: LazyLock<Hull> = LazyLock::new(icosahedron);
static COARSE: LazyLock<Hull> = LazyLock::new(octahedron);

fn icosahedron() -> Hull {
    // The corners of three rectangles of the golden ratio.
    let (short, long) = (0.525_731_1, 0.850_650_8);
    let rectangle = |axis: usize| {
        [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].map(|(a, b)| {
            let mut corner = [0.0; 3];
            (corner[axis], corner[(axis + 1) % 3]) = (a * short, b * long);
            Vec3::from(corner)
        })
    };
    Hull::of((0..3).flat_map(rectangle).collect())
}

fn octahedron() -> Hull {
    Hull::of(Vec3::AXES.into_iter().flat_map(|axis| [axis, -axis]).collect())
}

impl Hull {
    /// The hull of a regular solid whose faces are triangles: all triples of neighbours.
    fn of(vertices: Vec<Vec3>) -> Self {
        let distance = |a: usize, b: usize| vertices[a].distance_squared(vertices[b]);
        let edge = (1..vertices.len()).map(|b| distance(0, b)).fold(f32::INFINITY, f32::min);
        let is_edge = |a, b| distance(a, b) < 1.1 * edge;
        let mut triangles = Vec::new();
        for (a, b, c) in (0..vertices.len())
            .flat_map(|a| (a + 1..vertices.len()).map(move |b| (a, b)))
            .flat_map(|(a, b)| (b + 1..vertices.len()).map(move |c| (a, b, c)))
        {
            if is_edge(a, b) && is_edge(b, c) && is_edge(c, a) {
                let is_outward = vertices[a].dot(vertices[b].cross(vertices[c])) > 0.0;
                let (b, c) = if is_outward { (b, c) } else { (c, b) };
                triangles.push([a as u32, b as u32, c as u32]);
            }
        }
        Self { vertices, triangles }
    }

    /// The ball of one of so many points.
    fn ball(points: u64) -> &'static Self {
        if points > MOST_FINE { &COARSE } else { &FINE }
    }
}

/// The vertices of a tube: a half around its beginning, the other around its end, each with the tip as its last.
const TUBE_VERTICES: usize = 2 * (SIDES + 1);

/// Unit vectors from the ends of a line along a direction to the vertices of its tube.
fn tube(direction: DVec3) -> [Vec3; TUBE_VERTICES] {
    const HALF_ROOT: f64 = 0.866_025_403_784_438_6;
    const AROUND: [(f64, f64); SIDES] =
        [(1.0, 0.0), (0.5, HALF_ROOT), (-0.5, HALF_ROOT), (-1.0, 0.0), (-0.5, -HALF_ROOT), (0.5, -HALF_ROOT)];
    let (x, y) = direction.any_orthonormal_pair();
    std::array::from_fn(|vertex| match (vertex / (SIDES + 1), vertex % (SIDES + 1)) {
        (0, SIDES) => (-direction).as_vec3(),
        (_, SIDES) => direction.as_vec3(),
        (_, side) => (x * AROUND[side].0 + y * AROUND[side].1).as_vec3(),
    })
}

/// The triangles of a tube.
const TUBE_TRIANGLES: [[u32; 3]; 4 * SIDES] = {
    let (mut triangles, mut side) = ([[0; 3]; 4 * SIDES], 0);
    let (tip, end) = (SIDES as u32, SIDES as u32 + 1);
    while side < tip {
        let (next, first) = ((side + 1) % tip, 4 * side as usize);
        triangles[first] = [tip, next, side];
        triangles[first + 1] = [side, next, end + side];
        triangles[first + 2] = [end + side, next, end + next];
        triangles[first + 3] = [end + side, end + next, end + tip];
        side += 1;
    }
    triangles
};

/// The size of the balls or tubes of so many points or lines.
pub(super) fn size_of_points(points: u64) -> MeshSize {
    let ball = Hull::ball(points);
    let [vertices, triangles] =
        [ball.vertices.len(), ball.triangles.len()].map(|each| points.saturating_mul(each as u64));
    MeshSize { vertices, triangles, normals: true, ..MeshSize::default() }
}

/// The size of the tubes of so many lines.
#[cfg(feature = "formats")]
pub(super) fn size_of_lines(lines: u64) -> MeshSize {
    let [vertices, triangles] =
        [TUBE_VERTICES, TUBE_TRIANGLES.len()].map(|each| lines.saturating_mul(each as u64));
    MeshSize { vertices, triangles, normals: true, ..MeshSize::default() }
}

/// The balls and tubes in a mesh so far.
#[derive(Debug, Default)]
pub(super) struct Strokes {
    /// Their vertices, which lie in the centres of balls and at the ends of lines until the width is known.
    vertices: Vec<Range<usize>>,
    balls: u64,
    tubes: u64,
}

impl Strokes {
    /// Adds balls and tubes to a mesh whose normals are as many as its positions: a ball for a pair of equal ends, a
    /// tube for two ends of other places. Attributes other than positions, normals and triangles are left to the
    /// caller.
    ///
    /// Returns the end that each new vertex stands for.
    pub(super) fn add(&mut self, mesh: &mut TriangleMesh, ends: &[[u32; 2]], positions: &[Vec3]) -> Vec<u32> {
        let (first, mut stands_for) = (mesh.positions.len(), Vec::new());
        let ball = Hull::ball(ends.len() as u64);
        for &[from, to] in ends {
            let places = [from, to].map(|end| positions[end as usize]);
            let base = mesh.positions.len() as u32;
            let direction = (places[1].as_dvec3() - places[0].as_dvec3()).try_normalize();
            let tube = direction.map(tube);
            let (vertices, triangles) = match &tube {
                Some(vertices) => {
                    self.tubes += 1;
                    (&vertices[..], &TUBE_TRIANGLES[..])
                }
                None => {
                    self.balls += 1;
                    (&ball.vertices[..], &ball.triangles[..])
                }
            };
            let is_end = |vertex: usize| tube.is_some() && vertex > SIDES;
            for (vertex, &normal) in vertices.iter().enumerate() {
                mesh.positions.push(places[usize::from(is_end(vertex))]);
                mesh.normals.push(normal);
                stands_for.push(if is_end(vertex) { to } else { from });
            }
            mesh.triangles.extend(triangles.iter().map(|triangle| triangle.map(|vertex| base + vertex)));
        }
        self.vertices.push(first..mesh.positions.len());
        stands_for
    }

    /// Gives balls and tubes their width in the scene, one that follows from the box of all positions unless it is
    /// given. Returns it, if there are any.
    pub(super) fn finish(
        self,
        mesh: &mut TriangleMesh,
        width: Option<f32>,
        warnings: &mut Warnings,
    ) -> Option<f32> {
        let Self { vertices, balls, tubes } = self;
        if balls + tubes == 0 {
            return None;
        }
        let placed = mesh.positions.iter().copied().filter(|position| position.is_finite());
        let bounds = Aabb::around(placed);
        let longest = (bounds.max - bounds.min).max_element();
        let longest = if longest > 0.0 { longest } else { 1.0 };
        let width = width.unwrap_or_else(|| {
            // Twice the distance of neighbours on a square, so that surfaces look closed.
            let spaced = 2.0 / (balls as f32).sqrt();
            longest * if tubes > 0 { TUBE } else { spaced.clamp(BALLS.start, BALLS.end) }
        });
        for vertex in vertices.into_iter().flatten() {
            mesh.positions[vertex] += mesh.normals[vertex] * (width / 2.0);
        }
        let shown: Vec<String> = [(balls, "point", "ball"), (tubes, "line", "tube")]
            .into_iter()
            .filter(|(count, ..)| *count > 0)
            .map(|(count, what, shape)| match count {
                1 => format!("1 {what} is shown as a {shape}"),
                _ => format!("{count} {what}s are shown as {shape}s"),
            })
            .collect();
        // Three digits are enough for a reader.
        let told = format!("{width:.2e}").parse().unwrap_or(width);
        warnings.add(format!(
            "Points and lines have no surface: {}, {told} wide (--stroke-width).",
            shown.join(" and ")
        ));
        Some(width)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    /// Checks that each edge has two triangles, one in each direction, and that all look outward.
    fn assert_closed(vertices: &[Vec3], triangles: &[[u32; 3]], thickness: &[Vec3]) {
        let mut edges = BTreeMap::new();
        for &[a, b, c] in triangles {
            for edge in [[a, b], [b, c], [c, a]] {
                assert!(edges.insert(edge, ()).is_none(), "{edge:?} twice");
            }
            let [p, q, r] = [a, b, c].map(|vertex| thickness[vertex as usize]);
            let normal = (q - p).cross(r - p);
            for vertex in [a, b, c] {
                assert!(normal.dot(vertices[vertex as usize]) > 0.0, "{a} {b} {c}");
            }
        }
        assert!(edges.keys().all(|&[a, b]| edges.contains_key(&[b, a])));
        assert!(vertices.iter().all(|vertex| (vertex.length() - 1.0).abs() < 1.0e-6));
    }

    #[test]
    fn balls_and_tubes_are_closed_and_look_outward() {
        for (ball, counts) in [(&FINE, (12, 20)), (&COARSE, (6, 8))] {
            assert_closed(&ball.vertices, &ball.triangles, &ball.vertices);
            assert_eq!((ball.vertices.len(), ball.triangles.len()), counts);
        }
        for direction in [DVec3::X, DVec3::NEG_Y, DVec3::Z, DVec3::new(0.6, -0.48, 0.64)] {
            let tube = tube(direction);
            let place = |vertex: usize| if vertex > SIDES { direction.as_vec3() * 3.0 } else { Vec3::ZERO };
            let placed: Vec<Vec3> = (0..tube.len()).map(|v| tube[v] + place(v)).collect();
            assert_closed(&tube, &TUBE_TRIANGLES, &placed);
        }
    }

    #[test]
    fn sizes_are_those_of_what_is_made() {
        for (ends, size) in [
            (vec![[0, 0], [1, 1]], size_of_points(2)),
            (vec![[0, 0]; MOST_FINE as usize + 1], size_of_points(MOST_FINE + 1)),
            #[cfg(feature = "formats")]
            (vec![[0, 1]; 5], size_of_lines(5)),
        ] {
            let (mut mesh, mut strokes) = (TriangleMesh::default(), Strokes::default());
            let stands_for = strokes.add(&mut mesh, &ends, &[Vec3::ZERO, Vec3::X]);
            assert_eq!(
                (mesh.positions.len() as u64, mesh.triangles.len() as u64),
                (size.vertices, size.triangles)
            );
            assert_eq!((mesh.normals.len(), stands_for.len()), (mesh.positions.len(), mesh.positions.len()));
        }
    }

    #[test]
    fn widths_follow_the_scene_unless_they_are_given() {
        let widths = |ends: &[[u32; 2]], width| {
            let (mut mesh, mut strokes) = (TriangleMesh::default(), Strokes::default());
            let (positions, mut warnings) = ([Vec3::ZERO, Vec3::X * 60.0], Warnings::default());
            strokes.add(&mut mesh, ends, &positions);
            strokes.finish(&mut mesh, width, &mut warnings);
            let heights = mesh.positions.iter().map(|position| position.y.abs().max(position.z.abs()));
            (2.0 * heights.fold(0.0, f32::max), warnings.into_list().remove(0))
        };
        let (width, told) = widths(&[[0, 0], [1, 1]], None);
        assert!((width - 0.6).abs() < 0.1, "{width}");
        assert!(told.contains("2 points are shown as balls, 0.6 wide (--stroke-width)"), "{told}");
        let (width, told) = widths(&[[0, 1]], None);
        assert!((width - 0.4).abs() < 0.06, "{width}");
        assert!(told.contains("1 line is shown as a tube, 0.4 wide"), "{told}");
        assert!((widths(&[[0, 1]], Some(5.0)).0 - 5.0).abs() < 0.7);
        let (width, told) = widths(&[[0, 1], [1, 1], [0, 0]], Some(1.0));
        assert!(
            (width - 1.0).abs() < 0.15 && told.contains("2 points are shown as balls and 1 line"),
            "{told}"
        );
    }
}
