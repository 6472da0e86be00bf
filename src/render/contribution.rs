//! Contributions of shadow rays.

use super::Frame;
use super::frame::ray_rows;
use crate::film::Film;
use crate::lanes::{Int, LaneTask, Lanes, Mask, Num, Vector};
use crate::schedule::Output;
use bytemuck::{Pod, Zeroable};

/// The radiance that a shadow ray adds if nothing occludes it.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Contribution {
    /// Weighted radiance.
    pub radiance: [f32; 3],
    /// Pixel.
    pub pixel: u32,
}

impl Contribution {
    /// Emits the shadow rays of a mask with their contributions.
    #[inline(always)]
    pub(super) fn emit<P, L: Lanes>(
        out: &mut Output<'_, P, Self>,
        lanes: Mask<L>,
        origin: Vector<L>,
        direction: Vector<L>,
        t_max: Num<L>,
        radiance: Vector<L>,
        pixel: Int<L>,
    ) {
        let rays = ray_rows(lanes, origin, direction, t_max);
        let brought = [radiance.x, radiance.y, radiance.z, pixel.to_num_bits()];
        let contributions = Num::packed_quads(lanes, brought);
        let (rays, contributions) =
            (bytemuck::cast_slice(rays.as_ref()), bytemuck::cast_slice(contributions.as_ref()));
        out.shadow_row(lanes.count(), rays, contributions);
    }
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
        for (payloads, some) in self.payloads.chunks(L::LANES).zip(self.occluded.chunks(L::LANES)) {
            let open = Int::some(l, some, 1).0.is(0);
            let [x, y, z, pixel] =
                places.at_most(payloads.len() as u32 - 1).rows(bytemuck::cast_slice(payloads));
            let radiance = Vector::new(x.to_num_bits(), y.to_num_bits(), z.to_num_bits());
            self.film.splat_lanes(open, pixel, radiance);
        }
    }
}

impl Frame {
    /// Splats the contributions of unoccluded shadow rays.
    pub fn add_unoccluded(&self, payloads: &[Contribution], occluded: &[u32]) {
        self.simd().run(Answered { film: self.film(), payloads, occluded });
    }
}
