//! Queries of points: the nearest point of a mesh, and the side on which a point lies.

use super::columns::Divide;
use super::crossings::box_ray;
use super::nearest::{NearestPoint, nearest};
use super::nearest_lanes::nearest_of_each;
use super::shares::in_parts;
use super::target::Target;
use crate::geom::{Aabb, HalfOpenRay, is_on_triangle};
use crate::stream::{MISS, Ray};
use crate::trace::cpu::{Candidate, Tally, TriangleSink};
use glam::{DVec3, Vec3};

/// Points in arrays of the caller.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Points<'a> {
    /// Points in `f32`.
    F32(&'a [[f32; 3]]),
    /// Points in `f64`.
    F64(&'a [[f64; 3]]),
}

impl<'a> From<&'a [[f32; 3]]> for Points<'a> {
    fn from(points: &'a [[f32; 3]]) -> Self {
        Self::F32(points)
    }
}

impl<'a> From<&'a [[f64; 3]]> for Points<'a> {
    fn from(points: &'a [[f64; 3]]) -> Self {
        Self::F64(points)
    }
}

impl Points<'_> {
    /// Number of points.
    pub fn len(&self) -> usize {
        match self {
            Self::F32(points) => points.len(),
            Self::F64(points) => points.len(),
        }
    }

    /// True if there are no points.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    #[inline]
    fn get(&self, index: usize) -> DVec3 {
        match self {
            Self::F32(points) => Vec3::from_array(points[index]).as_dvec3(),
            Self::F64(points) => points[index].into(),
        }
    }
}

/// Columns of nearest points, each as long as the points, in memory of the caller. What is `None` is not written.
#[derive(Debug, Default)]
pub struct NearestColumns<'a> {
    /// Distance from the point that was asked for; +∞ if there is none.
    pub distance: Option<&'a mut [f32]>,
    /// The nearest point; NaN if there is none.
    pub position: Option<&'a mut [[f32; 3]]>,
    /// The nearest point in `f64`, for meshes that are far from the origin.
    pub position64: Option<&'a mut [[f64; 3]]>,
    /// Index of the triangle in its mesh; [`MISS`] if there is none.
    pub primitive: Option<&'a mut [u32]>,
    /// Index of the instance in its world, 0 for a mesh; [`MISS`] if there is none.
    pub instance: Option<&'a mut [u32]>,
    /// Barycentric weights of the triangle's second and third corner, 0 to 1; 0 if there is none.
    pub uv: Option<&'a mut [[f32; 2]]>,
}

impl NearestColumns<'_> {
    fn check(&self, points: usize) {
        let lengths = [
            self.distance.as_ref().map(|column| column.len()),
            self.position.as_ref().map(|column| column.len()),
            self.position64.as_ref().map(|column| column.len()),
            self.primitive.as_ref().map(|column| column.len()),
            self.instance.as_ref().map(|column| column.len()),
            self.uv.as_ref().map(|column| column.len()),
        ];
        assert!(lengths.into_iter().flatten().all(|len| len == points), "one row per point in each column");
    }

    fn reborrow(&mut self) -> NearestColumns<'_> {
        NearestColumns {
            distance: self.distance.as_deref_mut(),
            position: self.position.as_deref_mut(),
            position64: self.position64.as_deref_mut(),
            primitive: self.primitive.as_deref_mut(),
            instance: self.instance.as_deref_mut(),
            uv: self.uv.as_deref_mut(),
        }
    }

    fn write(&mut self, row: usize, target: &Target<'_>, nearest: Option<NearestPoint>) {
        let hit = nearest.map(|nearest| target.world_hit(&nearest.as_hit()));
        if let Some(column) = &mut self.distance {
            column[row] = nearest.map_or(f32::INFINITY, |nearest| nearest.distance);
        }
        if let Some(column) = &mut self.position {
            column[row] = nearest.map_or([f32::NAN; 3], |nearest| {
                // A mesh without a centre answers as `nearest_point` does.
                (nearest.position64 + target.center).as_vec3().to_array()
            });
        }
        if let Some(column) = &mut self.position64 {
            column[row] =
                nearest.map_or([f64::NAN; 3], |nearest| (nearest.position64 + target.center).to_array());
        }
        if let Some(column) = &mut self.primitive {
            column[row] = hit.map_or(MISS, |hit| hit.primitive);
        }
        if let Some(column) = &mut self.instance {
            column[row] = hit.map_or(MISS, |hit| hit.instance);
        }
        if let Some(column) = &mut self.uv {
            column[row] = nearest.map_or([0.0; 2], |nearest| [nearest.u, nearest.v]);
        }
    }
}

impl Divide for NearestColumns<'_> {
    fn split_first(&mut self, count: usize) -> Self {
        Self {
            distance: self.distance.split_first(count),
            position: self.position.split_first(count),
            position64: self.position64.split_first(count),
            primitive: self.primitive.split_first(count),
            instance: self.instance.split_first(count),
            uv: self.uv.split_first(count),
        }
    }
}

/// The most points that a thread takes at a time.
const POINTS_AT_ONCE: usize = 4096;

impl Target<'_> {
    /// The nearest points at most `max_distance` away.
    pub(super) fn nearest_points(
        &self,
        points: &Points<'_>,
        max_distance: f32,
        columns: &mut NearestColumns<'_>,
    ) {
        columns.check(points.len());
        in_parts(points.len(), columns.reborrow(), POINTS_AT_ONCE, |first, len, mut columns| {
            for (row, nearest) in self.nearest_of_part(points, first, len, max_distance) {
                columns.write(row, self, nearest);
            }
        });
    }

    /// The nearest points of consecutive points, each with the number of its row, in some order.
    fn nearest_of_part(
        &self,
        points: &Points<'_>,
        first: usize,
        len: usize,
        max_distance: f32,
    ) -> impl Iterator<Item = (usize, Option<NearestPoint>)> {
        let bvh = self.tracers.bvh();
        let point = |row: usize| points.get(first + row) - self.center;
        let bounds = bvh.bounds();
        let mut order: Vec<(u32, u32)> =
            (0..len).map(|row| (place_on_curve(&bounds, point(row).as_vec3()), row as u32)).collect();
        order.sort_unstable();
        let sorted: Vec<DVec3> = order.iter().map(|&(_, row)| point(row as usize)).collect();
        let mut answers = vec![None; len];
        if bvh.instances().is_empty() {
            nearest_of_each(bvh, &sorted, max_distance, &mut answers);
        } else {
            for (answer, point) in answers.iter_mut().zip(sorted) {
                *answer = nearest(bvh, point, max_distance);
            }
        }
        order.into_iter().zip(answers).map(|((_, row), answer)| (row as usize, answer))
    }

    /// For each point, true if it lies inside, or on the surface.
    pub(super) fn contains(&self, points: &Points<'_>, inside: &mut [bool]) {
        assert_eq!(points.len(), inside.len(), "one answer per point");
        in_parts(points.len(), inside, POINTS_AT_ONCE, |first, len, inside| {
            let sides = self.sides(points, first, len);
            inside.iter_mut().zip(sides).for_each(|(inside, side)| *inside = side != Side::Outside);
        });
    }

    /// Distances from the mesh, negative inside.
    pub(super) fn signed_distances(&self, points: &Points<'_>, distances: &mut [f32]) {
        assert_eq!(points.len(), distances.len(), "one distance per point");
        in_parts(points.len(), distances, POINTS_AT_ONCE, |first, len, distances| {
            let sides = self.sides(points, first, len);
            for (row, nearest) in self.nearest_of_part(points, first, len, f32::INFINITY) {
                let distance = nearest.map_or(f32::INFINITY, |nearest| nearest.distance);
                distances[row] = match sides[row] {
                    Side::Inside => -distance,
                    Side::Surface => 0.0,
                    Side::Outside => distance,
                };
            }
        });
    }

    /// The sides of consecutive points, by the parity of the crossings of a ray from each.
    fn sides(&self, points: &Points<'_>, first: usize, len: usize) -> Vec<Side> {
        let bounds = self.tracers.bvh().bounds();
        let middle = (0.5 * (bounds.min + bounds.max)).as_dvec3();
        let point = |row: usize| points.get(first + row) - self.center;
        let rays: Vec<Ray> = (0..len).map(|row| box_ray(point(row), away_from(middle, point(row)))).collect();
        let (mut counts, mut touched) = (vec![0; len], vec![false; len]);
        let exactly = matches!(points, Points::F32(_)) && self.center == DVec3::ZERO;
        let mut sides = Sides { point: &point, middle, exactly, counts: &mut counts, touched: &mut touched };
        self.tracers.stream().visit_candidates(&rays, &mut sides);
        let side = |(count, touched): (u32, bool)| match count % 2 {
            _ if touched => Side::Surface,
            1 => Side::Inside,
            _ => Side::Outside,
        };
        counts.into_iter().zip(touched).map(side).collect()
    }
}

/// Counts the crossings of the rays from points, and tells points that lie on a triangle.
struct Sides<'a, P> {
    point: &'a P,
    /// The middle of the mesh.
    middle: DVec3,
    /// True if the rays that are traced begin exactly at the points.
    exactly: bool,
    counts: &'a mut [u32],
    /// True for points on the surface.
    touched: &'a mut [bool],
}

impl<P: Fn(usize) -> DVec3> TriangleSink for Sides<'_, P> {
    fn take(&mut self, &Candidate { ray, corners, .. }: &Candidate) -> f32 {
        let point = (self.point)(ray);
        if touches_box(point, corners) && is_on_triangle(point, corners) {
            self.touched[ray] = true;
            return -1.0;
        }
        let exact = HalfOpenRay::new(point, away_from(self.middle, point), 0.0, f64::INFINITY);
        self.counts[ray] += u32::from(exact.crossing(corners).is_some());
        f32::INFINITY
    }

    fn tally(&mut self) -> Option<Tally<'_>> {
        self.exactly.then_some(Tally { counts: self.counts, enough: u32::MAX })
    }
}

/// The direction of the ray that decides on which side a point lies: away from the middle, where fewer triangles are
/// crossed. No component is 0, and no two are equal.
fn away_from(middle: DVec3, point: DVec3) -> DVec3 {
    let away = DVec3::new(1.0, 0.71875, 0.5625);
    DVec3::select((point - middle).cmplt(DVec3::ZERO), -away, away)
}

/// The place of a point on a curve that fills a box (Morton 1966): neighbours on the curve are neighbours in space.
fn place_on_curve(bounds: &Aabb, point: Vec3) -> u32 {
    let share = (point - bounds.min) / (bounds.max - bounds.min).max(Vec3::splat(f32::MIN_POSITIVE));
    // Casts saturate, and NaN becomes 0.
    let cell = (share * 1024.0).to_array().map(|at| (at as u32).min(1023));
    let spread = |mut x: u32| {
        x = (x | x << 16) & 0x0300_00ff;
        x = (x | x << 8) & 0x0300_f00f;
        x = (x | x << 4) & 0x030c_30c3;
        (x | x << 2) & 0x0924_9249
    };
    spread(cell[0]) | spread(cell[1]) << 1 | spread(cell[2]) << 2
}

/// Position of a point relative to a closed mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    Inside,
    Surface,
    Outside,
}

/// True if a point lies in a triangle's box.
fn touches_box(point: DVec3, [a, b, c]: [Vec3; 3]) -> bool {
    let (low, high) = (a.min(b).min(c).as_dvec3(), a.max(b).max(c).as_dvec3());
    low.cmple(point).all() && point.cmple(high).all()
}
