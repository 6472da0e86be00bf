//! Queries over arrays, by those of single slices.

use glam::Vec3;
use raystream_rays::query::{Mesh, Ray, World, WorldHit};
use rayon::prelude::*;

/// Number of rays that one thread reads, traces and writes at a time: they stay in its cache.
const SHARE: usize = 1 << 14;

/// Interval of `t`.
#[derive(Clone, Copy, Debug)]
pub struct Range {
    pub t_min: f32,
    pub t_max: f32,
}

#[derive(Clone, Copy, Debug)]
pub enum Rays<'a> {
    Rays(&'a [Ray]),
    Rows(&'a [[f32; 6]], Range),
    Pairs(&'a [[f32; 3]], &'a [[f32; 3]], Range),
    Segments(&'a [[f32; 3]], &'a [[f32; 3]]),
}

impl<'a> Rays<'a> {
    pub fn len(&self) -> usize {
        match self {
            Self::Rays(rays) => rays.len(),
            Self::Rows(rows, _) => rows.len(),
            Self::Pairs(a, _, _) | Self::Segments(a, _) => a.len(),
        }
    }

    pub fn part(&self, range: std::ops::Range<usize>) -> Rays<'a> {
        match self {
            Self::Rays(rays) => Rays::Rays(&rays[range]),
            Self::Rows(rows, limits) => Rays::Rows(&rows[range], *limits),
            Self::Pairs(a, b, limits) => Rays::Pairs(&a[range.clone()], &b[range], *limits),
            Self::Segments(a, b) => Rays::Segments(&a[range.clone()], &b[range]),
        }
    }

    pub fn get(&self, index: usize) -> Ray {
        match self {
            Self::Rays(rays) => rays[index],
            Self::Rows(rows, range) => {
                let [x, y, z, dx, dy, dz] = rows[index];
                Ray { origin: [x, y, z], t_min: range.t_min, direction: [dx, dy, dz], t_max: range.t_max }
            }
            Self::Pairs(a, b, range) => {
                Ray { origin: a[index], t_min: range.t_min, direction: b[index], t_max: range.t_max }
            }
            Self::Segments(a, b) => {
                Ray { t_min: f32::MIN_POSITIVE, t_max: 1.0 - f32::EPSILON / 2.0, ..Ray::between(a[index], b[index]) }
            }
        }
    }

    pub fn is_traceable(&self, index: usize) -> bool {
        let ray = self.get(index);
        raystream_rays::geom::CanonicalRay::can_start(ray.origin, ray.direction)
            && !ray.t_min.is_nan()
            && !ray.t_max.is_nan()
    }
}

#[derive(Debug, Default)]
pub struct HitColumns<'a> {
    pub t: Option<&'a mut [f32]>,
    pub primitive: Option<&'a mut [u32]>,
    pub instance: Option<&'a mut [u32]>,
    pub uv: Option<&'a mut [[f32; 2]]>,
    pub normal: Option<&'a mut [[f32; 3]]>,
    pub position: Option<&'a mut [[f32; 3]]>,
}

fn first<'b, T>(column: &mut Option<&'b mut [T]>, count: usize) -> Option<&'b mut [T]> {
    let (first, others) = column.take()?.split_at_mut(count);
    *column = Some(others);
    Some(first)
}

impl<'a> HitColumns<'a> {
    pub fn take(&mut self, count: usize) -> HitColumns<'a> {
        HitColumns {
            t: first(&mut self.t, count),
            primitive: first(&mut self.primitive, count),
            instance: first(&mut self.instance, count),
            uv: first(&mut self.uv, count),
            normal: first(&mut self.normal, count),
            position: first(&mut self.position, count),
        }
    }

    pub fn write(&mut self, target: &Target, rays: &[Ray], hits: &[WorldHit]) {
        for (index, hit) in hits.iter().enumerate() {
            if let Some(t) = &mut self.t {
                t[index] = hit.t;
            }
            if let Some(primitive) = &mut self.primitive {
                primitive[index] = hit.primitive;
            }
            if let Some(instance) = &mut self.instance {
                instance[index] = hit.instance;
            }
            if let Some(uv) = &mut self.uv {
                uv[index] = [hit.u, hit.v];
            }
            if let Some(normal) = &mut self.normal {
                normal[index] = target.normal(hit).to_array();
            }
            if let Some(position) = &mut self.position {
                position[index] = if hit.is_miss() { [f32::NAN; 3] } else { rays[index].at(hit.t).to_array() };
            }
        }
    }
}

#[derive(Clone, Debug)]
pub enum Target {
    Mesh(Mesh),
    World(World),
}

impl Target {
    fn normal(&self, hit: &WorldHit) -> Vec3 {
        match self {
            Self::Mesh(mesh) if !hit.is_miss() => {
                mesh.normal(&raystream_rays::query::Hit { t: hit.t, u: hit.u, v: hit.v, primitive: hit.primitive })
            }
            Self::Mesh(_) => Vec3::ZERO,
            Self::World(world) => world.normal(hit),
        }
    }

    pub fn cast(&self, rays: Rays<'_>, columns: &mut HitColumns<'_>) {
        let (mut parts, mut begin) = (Vec::new(), 0);
        while begin < rays.len() {
            let count = SHARE.min(rays.len() - begin);
            parts.push((begin..begin + count, columns.take(count)));
            begin += count;
        }
        let part = |(range, mut columns): (std::ops::Range<usize>, HitColumns<'_>)| {
            let rays: Vec<Ray> = range.map(|index| rays.get(index)).collect();
            let hits: Vec<WorldHit> = match self {
                Self::Mesh(mesh) => {
                    let mut hits = vec![raystream_rays::query::Hit::NONE; rays.len()];
                    if rays.len() == 1 {
                        hits[0] = mesh.closest_one(&rays[0]);
                    } else {
                        raystream_rays::stream::Tracer::closest(mesh.tracer(), &rays, &mut hits);
                    }
                    let instance = |hit: &raystream_rays::query::Hit| if hit.is_miss() { u32::MAX } else { 0 };
                    let world = |hit: raystream_rays::query::Hit| WorldHit {
                        t: hit.t,
                        u: hit.u,
                        v: hit.v,
                        instance: instance(&hit),
                        primitive: hit.primitive,
                    };
                    hits.into_iter().map(world).collect()
                }
                Self::World(world) => world.closest(&rays),
            };
            columns.write(self, &rays, &hits);
        };
        if parts.len() == 1 {
            parts.into_iter().for_each(part);
        } else {
            parts.into_par_iter().for_each(part);
        }
    }

    pub fn occluded(&self, rays: Rays<'_>, occluded: &mut [bool]) {
        let part = |(share, occluded): (usize, &mut [bool])| {
            let rays: Vec<Ray> = (0..occluded.len()).map(|index| rays.get(share * SHARE + index)).collect();
            match self {
                Self::Mesh(mesh) => mesh.occluded_into(&rays, occluded),
                Self::World(world) => world.occluded_into(&rays, occluded),
            }
        };
        if occluded.len() <= SHARE {
            part((0, occluded));
        } else {
            occluded.par_chunks_mut(SHARE).enumerate().for_each(part);
        }
    }

    /// Hits and their number of each ray.
    pub fn all_hits(&self, rays: Rays<'_>) -> (Vec<WorldHit>, Vec<std::ops::Range<usize>>) {
        let rays: Vec<Ray> = (0..rays.len()).map(|index| rays.get(index)).collect();
        match self {
            Self::Mesh(mesh) => {
                let (hits, ranges) = mesh.all_hits(&rays);
                let world =
                    |h: raystream_rays::query::Hit| WorldHit { t: h.t, u: h.u, v: h.v, instance: 0, primitive: h.primitive };
                (hits.into_iter().map(world).collect(), ranges)
            }
            Self::World(world) => world.all_hits(&rays),
        }
    }
}

#[derive(Debug, Default)]
pub struct PointColumns<'a> {
    pub distance: Option<&'a mut [f32]>,
    pub position: Option<&'a mut [[f32; 3]]>,
    pub primitive: Option<&'a mut [u32]>,
    pub uv: Option<&'a mut [[f32; 2]]>,
    pub normal: Option<&'a mut [[f32; 3]]>,
}

impl<'a> PointColumns<'a> {
    pub fn take(&mut self, count: usize) -> PointColumns<'a> {
        PointColumns {
            distance: first(&mut self.distance, count),
            position: first(&mut self.position, count),
            primitive: first(&mut self.primitive, count),
            uv: first(&mut self.uv, count),
            normal: first(&mut self.normal, count),
        }
    }
}

impl Target {
    pub fn nearest(&self, points: &[[f32; 3]], max_distance: f32, columns: &mut PointColumns<'_>) {
        let Self::Mesh(mesh) = self else { return };
        let found: Vec<_> = points.par_iter().map(|point| mesh.nearest_point(*point, max_distance)).collect();
        for (index, found) in found.iter().enumerate() {
            if let Some(distance) = &mut columns.distance {
                distance[index] = found.map_or(f32::INFINITY, |found| found.distance);
            }
            if let Some(position) = &mut columns.position {
                position[index] = found.map_or([f32::NAN; 3], |found| found.position.to_array());
            }
            if let Some(primitive) = &mut columns.primitive {
                primitive[index] = found.map_or(u32::MAX, |found| found.primitive);
            }
            if let Some(uv) = &mut columns.uv {
                uv[index] = found.map_or([0.0; 2], |found| [found.u, found.v]);
            }
            if let Some(normal) = &mut columns.normal {
                normal[index] = found.map_or([0.0; 3], |found| {
                    let (t, u, v, primitive) = (0.0, found.u, found.v, found.primitive);
                    mesh.normal(&raystream_rays::query::Hit { t, u, v, primitive }).to_array()
                });
            }
        }
    }
}

/// Numbers as rows of vectors.
pub fn rows<T: bytemuck::Pod>(numbers: &mut [f32]) -> &mut [T] {
    bytemuck::cast_slice_mut(numbers)
}
