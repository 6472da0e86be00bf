//! Rays that pass some of the surfaces that they meet.
//!
//! A ray that passes what it has hit goes into a stream again, from just behind its hit, as if the surface were not
//! there.
//!
//! Of shadow rays, traversal answers only that something is hit. Where a renderer has such surfaces, the occluded rays
//! of a stream are traced once more for what they hit first, all together; the renderer decides which of them pass, and
//! those go on from just behind their hits until none is left. A shadow ray may also end at a mirror: if nothing
//! occludes it, the mirror's place is probed, and the way on from there is traced like another shadow ray.

use super::renderer::{Batch, Output, ReflectedRay, Renderer, SeeThrough};
use crate::stream::{Hit, Ray, TracedRays, Tracer};

/// Emits the rays that pass what they have hit, and shades the others.
pub fn pass_or_shade<R: Renderer>(
    renderer: &R,
    traced: TracedRays<'_, R::Payload>,
    out: &mut Output<'_, R::Payload, R::ShadowPayload>,
) {
    let TracedRays { rays, hits, payloads } = traced;
    let passing = renderer.passing(&Batch { rays, hits, payloads });
    let mut len = rays.len();
    for i in passing.iter().map(|&i| i as usize).rev() {
        out.ray(behind(&rays[i], &hits[i]), payloads[i]);
        // The last ray takes the place.
        len -= 1;
        (rays[i], hits[i], payloads[i]) = (rays[len], hits[len], payloads[len]);
    }
    if len > 0 {
        renderer.shade(Batch { rays: &rays[..len], hits: &hits[..len], payloads: &payloads[..len] }, out);
    }
}

/// A ray from just behind what it has hit.
fn behind(ray: &Ray, hit: &Hit) -> Ray {
    Ray { t_min: hit.t.next_up(), ..*ray }
}

/// Clears the answer of each occluded ray that passes all that it meets, and sets those of rays that end at mirrors.
pub fn trace_on(surfaces: &dyn SeeThrough, tracer: &dyn Tracer, rays: &[Ray], occluded: &mut [u32]) {
    pass(surfaces, tracer, rays, occluded);
    let reflected = surfaces.reflected(rays, occluded);
    if !reflected.is_empty() {
        let ways = ways(surfaces, tracer, &reflected);
        for (ray, occludes) in reflected.iter().zip(ways) {
            occluded[ray.place as usize] = occludes;
        }
    }
}

/// The answers of rays that end at mirrors: 0 if the mirror is there and nothing occludes the way on, else 1.
fn ways(surfaces: &dyn SeeThrough, tracer: &dyn Tracer, reflected: &[ReflectedRay]) -> Vec<u32> {
    let probes: Vec<Ray> = reflected.iter().map(|ray| ray.probe).collect();
    let mut hits = vec![Hit::NONE; probes.len()];
    tracer.closest(&probes, &mut hits);
    let is_there = |i: &usize| surfaces.is_mirror(&reflected[*i], &hits[*i]);
    let there: Vec<usize> = (0..reflected.len()).filter(is_there).collect();
    let rest: Vec<Ray> = there.iter().map(|&i| reflected[i].rest).collect();
    let mut occluded = vec![0; rest.len()];
    tracer.occluded(&rest, &mut occluded);
    pass(surfaces, tracer, &rest, &mut occluded);
    let mut answers = vec![1; reflected.len()];
    there.iter().zip(occluded).for_each(|(&i, answer)| answers[i] = answer);
    answers
}

/// Clears the answer of each occluded ray that passes all that it meets.
fn pass(surfaces: &dyn SeeThrough, tracer: &dyn Tracer, rays: &[Ray], occluded: &mut [u32]) {
    let met = surfaces.may_meet(rays, occluded);
    let mut left: Vec<usize> = met.iter().map(|&place| place as usize).collect();
    let mut on: Vec<Ray> = left.iter().map(|&i| rays[i]).collect();
    let mut hits = Vec::new();
    // A ray that passes begins behind its hit, so it ends where the triangles do.
    while !on.is_empty() {
        hits.clear();
        hits.resize(on.len(), Hit::NONE);
        tracer.closest(&on, &mut hits);
        for (&i, hit) in left.iter().zip(&hits) {
            if hit.is_miss() {
                occluded[i] = 0;
            }
        }
        let passing = surfaces.passing(&on, &hits);
        let places = || passing.iter().map(|&place| place as usize);
        left = places().map(|place| left[place]).collect();
        on = places().map(|place| behind(&on[place], &hits[place])).collect();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Walls at whole numbers on the x axis; those below a number are passed.
    struct Walls {
        last: f32,
        passed_below: f32,
        /// How far a ray reaches to meet one of them.
        met_from: f32,
    }

    impl Tracer for Walls {
        fn closest(&self, rays: &[Ray], hits: &mut [Hit]) {
            for (ray, hit) in rays.iter().zip(hits) {
                let t = ray.t_min.max(1.0).ceil();
                let is_hit = t <= ray.t_max && t <= self.last;
                *hit = if is_hit { Hit { t, primitive: 0, ..Hit::NONE } } else { Hit::NONE };
            }
        }

        fn occluded(&self, rays: &[Ray], occluded: &mut [u32]) {
            let mut hits = vec![Hit::NONE; rays.len()];
            self.closest(rays, &mut hits);
            occluded.iter_mut().zip(hits).for_each(|(answer, hit)| *answer = u32::from(!hit.is_miss()));
        }
    }

    impl SeeThrough for Walls {
        fn may_meet(&self, rays: &[Ray], occluded: &[u32]) -> Vec<u32> {
            let may = |&i: &usize| occluded[i] != 0 && rays[i].t_max >= self.met_from;
            (0..rays.len()).filter(may).map(|i| i as u32).collect()
        }

        fn passing(&self, rays: &[Ray], hits: &[Hit]) -> Vec<u32> {
            assert_eq!(rays.len(), hits.len());
            let passes = |i: &u32| !hits[*i as usize].is_miss() && hits[*i as usize].t < self.passed_below;
            (0..rays.len() as u32).filter(passes).collect()
        }
    }

    /// A mirror in the plane x = 1 for rays that end at a half, which sends them back. It reaches as far as `width`
    /// along z.
    struct Mirror {
        width: f32,
        behind: Walls,
    }

    impl Tracer for Mirror {
        fn closest(&self, rays: &[Ray], hits: &mut [Hit]) {
            for (ray, hit) in rays.iter().zip(hits) {
                let meets = ray.t_min < 1.0 && ray.t_max > 1.0 && ray.origin[2] < self.width;
                *hit = if meets { Hit { t: 1.0, primitive: 7, ..Hit::NONE } } else { Hit::NONE };
            }
        }

        fn occluded(&self, rays: &[Ray], occluded: &mut [u32]) {
            self.behind.occluded(rays, occluded);
        }
    }

    impl SeeThrough for Mirror {
        fn passing(&self, _: &[Ray], _: &[Hit]) -> Vec<u32> {
            Vec::new()
        }

        fn reflected(&self, rays: &[Ray], occluded: &[u32]) -> Vec<ReflectedRay> {
            let ends = |i: &usize| occluded[*i] == 0 && rays[*i].t_max == 0.5;
            let way = |i: usize| ReflectedRay {
                place: i as u32,
                mirror: 7,
                probe: Ray { t_min: 0.5, t_max: 1.5, ..rays[i] },
                rest: Ray { t_max: rays[i].origin[1], ..rays[i] },
            };
            (0..rays.len()).filter(ends).map(way).collect()
        }

        fn is_mirror(&self, ray: &ReflectedRay, hit: &Hit) -> bool {
            hit.primitive == ray.mirror
        }
    }

    #[test]
    fn rays_that_end_at_mirrors_need_the_mirror_and_the_way_on() {
        let walls = Walls { last: 1.0, passed_below: 0.0, met_from: 0.0 };
        let mirror = Mirror { width: 1.0, behind: walls };
        // The way on is as long as y; the only wall is at 1.
        let ray = |t_max, y, z| Ray { t_max, ..Ray::new([0.0, y, z], [1.0, 0.0, 0.0]) };
        let rays = [
            ray(0.5, 0.9, 0.0),
            ray(0.5, 2.0, 0.0),
            ray(0.5, 0.9, 3.0),
            ray(0.4, 2.0, 3.0),
            ray(1.5, 0.0, 0.0),
        ];
        let mut occluded = vec![0; rays.len()];
        mirror.occluded(&rays, &mut occluded);
        assert_eq!(occluded, [0, 0, 0, 0, 1]);
        trace_on(&mirror, &mirror, &rays, &mut occluded);
        assert_eq!(
            occluded,
            [0, 1, 1, 0, 1],
            "open, occluded behind, no mirror, no end at one, occluded before"
        );
    }

    fn answers(walls: &Walls, ends: &[f32]) -> Vec<u32> {
        let ray = |&t_max: &f32| Ray { t_max, ..Ray::new([0.0; 3], [1.0, 0.0, 0.0]) };
        let rays: Vec<Ray> = ends.iter().map(ray).collect();
        let mut occluded = vec![0; rays.len()];
        walls.occluded(&rays, &mut occluded);
        trace_on(walls, walls, &rays, &mut occluded);
        occluded
    }

    #[test]
    fn rays_pass_until_something_stops_them() {
        let walls = Walls { last: 9.0, passed_below: 5.0, met_from: 0.0 };
        assert_eq!(answers(&walls, &[0.5, 1.5, 4.5, 5.5, f32::INFINITY, 3.0]), [0, 0, 0, 1, 1, 0]);
        assert_eq!(answers(&Walls { last: 4.0, ..walls }, &[f32::INFINITY, 0.5]), [0, 0]);
        assert_eq!(answers(&Walls { met_from: 2.0, ..walls }, &[1.5, 4.5]), [1, 0], "the first meets none");
        assert!(answers(&Walls { last: 4.0, ..walls }, &[]).is_empty());
    }
}
