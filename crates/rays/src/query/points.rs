//! Queries of points: the nearest point of a mesh, and the side on which a point lies.

use super::columns::Divide;
use super::crossings::box_ray;
use super::nearest::{NearestPoint, nearest};
use super::shares::in_parts;
use super::target::Target;
use crate::geom::{HalfOpenRay, is_on_triangle};
use crate::stream::{MISS, Ray};
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
            for row in 0..len {
                let nearest = self.nearest(points.get(first + row), max_distance);
                columns.write(row, self, nearest);
            }
        });
    }

    fn nearest(&self, point: DVec3, max_distance: f32) -> Option<NearestPoint> {
        nearest(self.tracers.bvh(), point - self.center, max_distance)
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
            for (row, (distance, side)) in distances.iter_mut().zip(sides).enumerate() {
                let nearest = || self.nearest(points.get(first + row), f32::INFINITY);
                let found = || nearest().map_or(f32::INFINITY, |nearest| nearest.distance);
                *distance = match side {
                    Side::Inside => -found(),
                    Side::Surface => 0.0,
                    Side::Outside => found(),
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
        let mut sides = vec![Side::Outside; len];
        self.visit_candidates(&rays, |candidate| {
            let (side, corners) = (&mut sides[candidate.ray], candidate.corners);
            let point = point(candidate.ray);
            if touches_box(point, corners) && is_on_triangle(point, corners) {
                *side = Side::Surface;
                return -1.0;
            }
            let exact = HalfOpenRay::new(point, away_from(middle, point), 0.0, f64::INFINITY);
            if exact.crossing(corners).is_some() {
                *side = if *side == Side::Inside { Side::Outside } else { Side::Inside };
            }
            f32::INFINITY
        });
        sides
    }
}

/// The direction of the ray that decides on which side a point lies: away from the middle, where fewer triangles are
/// crossed. No component is 0, and no two are equal.
fn away_from(middle: DVec3, point: DVec3) -> DVec3 {
    let away = DVec3::new(1.0, 0.71875, 0.5625);
    DVec3::select((point - middle).cmplt(DVec3::ZERO), -away, away)
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
