//! Flat smooth surfaces in which lamps are mirrored: panes, mirrors, polished floors.
//!
//! Light that a lamp sends to a point by such a surface comes along a straight line from the lamp's mirror image. It is
//! found by a light sample for the point's own image: the line from there to the lamp crosses the surface where the
//! light is reflected, and its length is that of the way. So density, distance and angle are those of light that comes
//! without a detour.

use super::{EmitterSample, Emitters, SHADOW_MARGIN};
use crate::geom::Aabb;
use crate::lanes::{Int, Lanes, Mask, Num, SingleLane, Vector};
use crate::scene::Scene;
use crate::shade::bsdf::{Bsdf, Smoothness, is_pane, mirrors_evenly};
use crate::shade::{Hits, Interaction, offset};
use crate::stream::{Hit, Ray};
use glam::Vec3;
use std::collections::BTreeMap;

/// The most reflectors. Points choose one of them by chance.
const MOST: usize = 8;

/// The least area of a reflector, as a share of the surface of the scene's bounds.
const LEAST_AREA: f32 = 1.0 / 512.0;

/// The least area of a reflector's triangles, as a share of the same surface: fine meshes are not looked through plane
/// by plane.
const LEAST_TRIANGLE: f32 = 1.0 / (1u32 << 21) as f32;

/// The most that the normals of a reflector differ, and the most that its corners are off its plane, as a share of the
/// scene's greatest coordinate.
const FLATNESS: f32 = 1e-4;
const THICKNESS: f32 = 1e-5;

/// Triangles are of one plane if their numbers agree to this many steps.
const STEPS: f32 = 4096.0;

/// Words of a row of [`Reflectors::rows`].
const WORDS: usize = 8;

/// The largest flat smooth surfaces of a scene.
#[derive(Clone, Debug)]
pub struct Reflectors {
    all: Vec<Reflector>,
    /// Two rows for each reflector: normal, height and lower bounds; upper bounds.
    rows: Vec<[f32; WORDS]>,
    /// For each triangle the number of its reflector, from 1 on, or 0.
    of: Vec<u32>,
    /// For each material, true if a reflector is of it.
    materials: Vec<bool>,
}

/// Triangles of one plane and material.
#[derive(Clone, Debug)]
struct Reflector {
    material: u32,
    /// Unit normal.
    normal: Vec3,
    /// The product of the normal and the points of the plane.
    height: f32,
    /// Distance from the plane at which rays start that leave it.
    offset: f32,
    bounds: Aabb,
    area: f32,
    triangles: Vec<u32>,
}

/// Sampled points of lamps that points see in reflectors.
#[derive(Clone, Copy, Debug)]
pub struct ReflectedSample<L: Lanes> {
    /// Lanes that have a sample; the other fields mean nothing in the other lanes.
    pub valid: Mask<L>,
    /// Unit direction from the receiver to the point of the reflector.
    pub wi: Vector<L>,
    /// The lamp's mirror image.
    pub image: Vector<L>,
    /// Radiance of the lamp. [`Reflectors::reflectance`] is the share of it that is reflected.
    pub radiance: Vector<L>,
    /// Density per solid angle at the receiver.
    pub pdf: Num<L>,
    /// Length of the way to the lamp.
    pub distance: Num<L>,
    /// Length of its part before the reflector.
    pub before: Num<L>,
    /// The number of the reflector.
    pub reflector: Int<L>,
}

/// A shadow ray that ends at a reflector, and is to be continued there.
#[derive(Clone, Copy, Debug)]
pub struct Reflection {
    /// The ray about the point where it should meet the reflector.
    pub probe: Ray,
    /// The ray from there to the lamp.
    pub rest: Ray,
    /// The number of the reflector.
    pub reflector: u32,
}

impl Reflectors {
    /// Those of a scene; `None` if it has none. Shading with them scatters light in media.
    pub fn of(scene: &Scene) -> Option<Self> {
        let candidates: Vec<bool> = scene.materials.iter().map(mirrors_evenly).collect();
        if !candidates.contains(&true) {
            return None;
        }
        let bounds = scene.bounds();
        let (surface, extent) = (2.0 * bounds.half_area(), bounds.max_abs());
        let mut all = planes(scene, &candidates, extent, surface * LEAST_TRIANGLE);
        all.retain(|one| one.area >= surface * LEAST_AREA && one.reflects(scene));
        all.sort_by(|a, b| b.area.total_cmp(&a.area).then(a.triangles.cmp(&b.triangles)));
        let mut kept: Vec<Reflector> = Vec::new();
        for one in all {
            // A ray tells by the plane at which reflector it ends.
            let is_apart = |other: &Reflector| {
                one.normal.cross(other.normal).length() > FLATNESS
                    || (one.height - other.height).abs() > THICKNESS * extent
            };
            if kept.len() < MOST && kept.iter().all(is_apart) {
                kept.push(one);
            }
        }
        (!kept.is_empty()).then(|| Self::new(scene, kept))
    }

    fn new(scene: &Scene, all: Vec<Reflector>) -> Self {
        let mut of = vec![0; scene.mesh.triangles.len()];
        let mut materials = vec![false; scene.materials.len()];
        let mut rows = Vec::with_capacity(2 * all.len());
        for (number, one) in (1..).zip(&all) {
            one.triangles.iter().for_each(|&triangle| of[triangle as usize] = number);
            materials[one.material as usize] = true;
            let (n, Aabb { min, max }) = (one.normal, one.bounds);
            rows.push([n.x, n.y, n.z, one.height, min.x, min.y, min.z, 0.0]);
            rows.push([max.x, max.y, max.z, 0.0, 0.0, 0.0, 0.0, 0.0]);
        }
        Self { all, rows, of, materials }
    }

    /// The number of reflectors.
    pub fn len(&self) -> usize {
        self.all.len()
    }

    /// Never true.
    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// True if a reflector is of a material, numbered in the scene.
    #[inline]
    pub fn has_material(&self, material: u32) -> bool {
        self.materials[material as usize]
    }

    /// Lanes whose triangles are of reflectors.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn are_of<L: Lanes>(&self, triangles: Int<L>) -> Mask<L> {
        let [number] = triangles.rows(&self.of);
        !number.is(0)
    }

    /// Samples points of lamps that points at `from` see in reflectors. `u` chooses the reflector, `u2` lamp and point.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn sample<L: Lanes>(
        &self,
        (scene, emitters): (&Scene, &Emitters),
        from: Vector<L>,
        u: Num<L>,
        u2: [Num<L>; 2],
    ) -> Option<ReflectedSample<L>> {
        let count = self.all.len() as u32;
        let reflector = (u * count as f32).to_int().at_most(count - 1);
        let rows: &[f32] = self.rows.as_flattened();
        let [nx, ny, nz, height, x0, y0, z0, _] = (reflector << 1).rows_of(rows);
        let [x1, y1, z1, ..] = ((reflector << 1) + 1).rows_of::<WORDS>(rows);
        let normal = Vector::new(nx, ny, nz);
        // The receiver's mirror image.
        let image = from - normal * (2.0 * (normal.dot(from) - height));
        let EmitterSample { valid, position, wi, radiance, pdf } =
            emitters.sample_by_power(scene, image, u2)?;
        let (below, above) = (normal.dot(image) - height, normal.dot(position) - height);
        let share = below / (below - above);
        let way = position - image;
        let at = image + way * share;
        let inside = at.x.ge(x0) & at.y.ge(y0) & at.z.ge(z0) & at.x.le(x1) & at.y.le(y1) & at.z.le(z1);
        let crosses = (below * above).below(0.0);
        let distance = way.length();
        Some(ReflectedSample {
            valid: valid & crosses & inside,
            wi: wi - normal * (2.0 * normal.dot(wi)),
            image: position - normal * (2.0 * above),
            radiance,
            pdf: pdf * (1.0 / count as f32),
            distance,
            before: distance * share,
            reflector,
        })
    }

    /// The density per solid angle with which [`Reflectors::sample`] returns a point of a triangle, at a way of this
    /// squared length; `cosine` is that to the triangle's normal.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn pdf<L: Lanes>(
        &self,
        emitters: &Emitters,
        primitive: Int<L>,
        distance2: Num<L>,
        cosine: Num<L>,
    ) -> Num<L> {
        emitters.pdf_by_power(primitive, distance2, cosine) * (1.0 / self.all.len() as f32)
    }

    /// The share of light from direction `wi` that each lane's reflector mirrors.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn reflectance<L: Lanes>(
        &self,
        scene: &Scene,
        lanes: Mask<L>,
        reflector: Int<L>,
        wi: Vector<L>,
    ) -> Vector<L> {
        let mut reflectance = Vector::zero(wi.lanes());
        for (number, one) in (0..).zip(&self.all) {
            let of_this = lanes & reflector.is(number);
            if of_this.any() {
                let share = one.reflectance(scene, wi);
                reflectance = Vector::select(of_this, share, reflectance);
            }
        }
        reflectance
    }

    /// The multiple of a direction at which rays from `origin` meet the plane of a reflector.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn meeting<L: Lanes>(&self, reflector: Int<L>, origin: Vector<L>, direction: Vector<L>) -> Num<L> {
        let rows: &[f32] = self.rows.as_flattened();
        let [nx, ny, nz, height, ..] = (reflector << 1).rows_of::<WORDS>(rows);
        let normal = Vector::new(nx, ny, nz);
        (height - normal.dot(origin)) / normal.dot(direction)
    }

    /// The end of a shadow ray that would meet a reflector at `meeting` times its direction.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn end<L: Lanes>(meeting: Num<L>) -> Num<L> {
        meeting * (1.0 - SHADOW_MARGIN)
    }

    /// The reflection of a shadow ray, if it ends at a reflector: its direction leads to a lamp's mirror image.
    pub fn reflection(&self, ray: &Ray) -> Option<Reflection> {
        if ray.t_max >= Self::end(Num::from(1.0)).get() {
            return None;
        }
        let (origin, direction) = (Vec3::from_array(ray.origin), Vec3::from_array(ray.direction));
        let meets = |number: u32| self.meeting::<SingleLane>(number.into(), origin.into(), direction.into());
        let ends = |&number: &u32| Self::end(meets(number)).get() == ray.t_max;
        let reflector = (0..self.all.len() as u32).find(ends)?;
        let one = &self.all[reflector as usize];
        let t = meets(reflector).get();
        let along = one.normal.dot(direction);
        let at = origin + direction * t - one.normal * one.offset.copysign(along);
        let mirrored = (direction - one.normal * (2.0 * along)) * (1.0 - t);
        let probe = Ray { t_min: ray.t_max.next_up(), t_max: t * (1.0 + SHADOW_MARGIN), ..*ray };
        let rest = Ray { t_max: 1.0 - SHADOW_MARGIN, ..Ray::new(at, mirrored) };
        Some(Reflection { probe, rest, reflector })
    }

    /// True if a hit is on this reflector.
    pub fn is_on(&self, reflector: u32, hit: &Hit) -> bool {
        !hit.is_miss() && self.of[hit.primitive as usize] == reflector + 1
    }
}

impl Reflector {
    /// The share of light from direction `wi` that is mirrored, in each channel.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn reflectance<L: Lanes>(&self, scene: &Scene, wi: Vector<L>) -> Vector<L> {
        let l = wi.lanes();
        let third = Num::splat(l, 1.0 / 3.0);
        let primitive = Int::splat(l, self.triangles[0]);
        let hits = Hits { t: third, u: third, v: third, primitive };
        let material = &scene.materials[self.material as usize];
        let at = Interaction::without_finish(scene, material, wi, &hits, Num::zero(l));
        let smoothness = Smoothness { stayed: is_pane(material), ..Smoothness::IN_MEDIA };
        let bsdf = Bsdf::new(scene, &material.surface, &at, smoothness);
        bsdf.mirrored_share(at.basis.local(at.wo))
    }

    /// True if it mirrors light that comes along its normal.
    fn reflects(&self, scene: &Scene) -> bool {
        let share = self.reflectance::<SingleLane>(scene, Vector::from(self.normal));
        share.max_element().get() > 0.0
    }
}

/// The triangles of some materials that have at least this area and whose corners have one normal, by material and
/// plane.
fn planes(scene: &Scene, materials: &[bool], extent: f32, least: f32) -> Vec<Reflector> {
    let mesh = &scene.mesh;
    let mut planes: BTreeMap<(u32, [i32; 4]), Reflector> = BTreeMap::new();
    for (triangle, &material) in (0..).zip(&mesh.materials) {
        if !materials[material as usize] {
            continue;
        }
        let corners = mesh.corners(triangle);
        let plane = offset::plane(&corners.map(Vector::from), Vec3::ZERO.into());
        let area = 0.5 * plane.twice_area.get();
        if !plane.there.get() || area < least {
            continue;
        }
        let mut normal = Vec3::from(plane.normal);
        let is_flat = mesh.normals.is_empty()
            || mesh.triangles[triangle as usize].iter().all(|&corner| {
                let at_corner = mesh.normals[corner as usize];
                at_corner.cross(normal).length() <= FLATNESS * at_corner.length()
            });
        if !is_flat {
            continue;
        }
        if normal[normal.abs().max_position()] < 0.0 {
            normal = -normal;
        }
        let height = normal.dot(corners[0]);
        let step = |x: f32| (x * STEPS).round() as i32;
        let key = [step(normal.x), step(normal.y), step(normal.z), step(height / extent)];
        let one = planes.entry((material, key)).or_insert_with(|| Reflector {
            material,
            normal,
            height,
            offset: 0.0,
            bounds: Aabb::EMPTY,
            area: 0.0,
            triangles: Vec::new(),
        });
        let is_off = |corner: &Vec3| (one.normal.dot(*corner) - one.height).abs() > THICKNESS * extent;
        if one.normal.cross(normal).length() > FLATNESS || corners.iter().any(is_off) {
            continue;
        }
        let margin = Vec3::splat(THICKNESS * extent);
        one.bounds = corners.iter().fold(one.bounds, |bounds, &corner| {
            bounds.union(Aabb { min: corner - margin, max: corner + margin })
        });
        one.offset = one.offset.max(plane.offset.get());
        one.area += area;
        one.triangles.push(triangle);
    }
    planes.into_values().collect()
}
