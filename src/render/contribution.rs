//! Contributions of shadow rays.

use super::{Frame, NewRays};
use crate::film::Film;
use crate::lanes::{Int, LaneTask, Lanes, Mask, Num, SingleLane, Vector, for_parts};
use crate::schedule::Output;
use crate::stream::Ray;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// The radiance that a shadow ray adds if nothing occludes it.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Contribution {
    /// Weighted radiance.
    pub radiance: [f32; 3],
    /// Pixel, as [`Frame::target`] gives it.
    pub pixel: u32,
}

/// Contributions whose shadow rays have been traced.
struct Answered<'a> {
    film: &'a Film,
    payloads: &'a [Contribution],
    occluded: &'a [u32],
}

impl LaneTask for Answered<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let places = Int::iota(l);
        for_parts(self.payloads.len().min(self.occluded.len()), L::LANES, |part| {
            let (payloads, some) = (&self.payloads[part.clone()], &self.occluded[part]);
            let open = Int::some(l, some, 1).0.is(0);
            let [x, y, z, pixel] =
                places.at_most(payloads.len() as u32 - 1).rows(bytemuck::cast_slice(payloads));
            let radiance = Vector::new(x.to_num_bits(), y.to_num_bits(), z.to_num_bits());
            self.film.splat_lanes(open, pixel, radiance);
        });
    }
}

impl Frame {
    /// Emits the shadow rays of a mask, each with the radiance that it adds to its pixel if nothing occludes it. The
    /// radiance was computed at hits on a material, or `None`. A radiance that is negative or not finite is dropped
    /// instead: see [`Frame::splat_lanes`].
    #[inline(always)]
    pub fn send_contributions<P, L: Lanes>(
        &self,
        out: &mut Output<'_, P, Contribution>,
        material: Option<u32>,
        lanes: Mask<L>,
        rays: &NewRays<L>,
        radiance: Vector<L>,
        pixel: Int<L>,
    ) {
        let lanes = self.addable_lanes(material, lanes, pixel, radiance);
        let rays = rays.rows(lanes);
        let brought = [radiance.x, radiance.y, radiance.z, pixel.to_num_bits()];
        let contributions = Num::packed_quads(lanes, brought);
        let (rays, contributions) =
            (bytemuck::cast_slice(rays.as_ref()), bytemuck::cast_slice(contributions.as_ref()));
        out.shadow_row(lanes.count(), rays, contributions);
    }

    /// [`Frame::send_contributions`] for one ray.
    pub fn send_contribution<P>(
        &self,
        out: &mut Output<'_, P, Contribution>,
        material: Option<u32>,
        ray: Ray,
        contribution: Contribution,
    ) {
        let Contribution { radiance, pixel } = contribution;
        let lanes = Mask::splat(SingleLane, true);
        if self.addable_lanes(material, lanes, pixel.into(), Vec3::from_array(radiance).into()).any() {
            out.shadow(ray, contribution);
        }
    }

    /// Splats the contributions of unoccluded shadow rays.
    pub fn add_unoccluded(&self, payloads: &[Contribution], occluded: &[u32]) {
        self.simd().run(Answered { film: self.film(), payloads, occluded });
    }
}
