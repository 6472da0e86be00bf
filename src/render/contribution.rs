//! What shadow rays bring.

use super::Frame;
use crate::film::Film;
use crate::lanes::{Int, Kernel, Lanes, Vector};
use bytemuck::{Pod, Zeroable};

/// What a shadow ray adds if nothing is in its way.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Contribution {
    /// Radiance that reaches the film.
    pub radiance: [f32; 3],
    /// Where.
    pub pixel: u32,
}

impl Contribution {
    /// Those of the lanes of a mask, one after the other.
    #[inline(always)]
    pub(super) fn rows<L: Lanes>(lanes: u32, radiance: Vector<L>, pixel: Int<L>) -> [Self; 16] {
        let mut rows = [Self::zeroed(); 16];
        let (x, y, z) = (radiance.x.pack(lanes), radiance.y.pack(lanes), radiance.z.pack(lanes));
        let columns = [x.to_array(), y.to_array(), z.to_array()];
        let pixels = pixel.to_num_bits().pack(lanes).to_bits().to_array();
        for (lane, row) in rows.iter_mut().enumerate().take(L::LANES) {
            row.radiance = [columns[0][lane], columns[1][lane], columns[2][lane]];
            row.pixel = pixels[lane];
        }
        rows
    }
}

/// Contributions whose shadow rays have been traced.
struct Answered<'a> {
    film: &'a Film,
    payloads: &'a [Contribution],
    occluded: &'a [u32],
}

impl Kernel for Answered<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let mut places = [0; 16];
        for (lane, place) in places.iter_mut().enumerate() {
            *place = lane as u32;
        }
        let places = Int::from_array(l, &places);
        for (payloads, some) in self.payloads.chunks(L::LANES).zip(self.occluded.chunks(L::LANES)) {
            let mut occluded = [1; 16];
            occluded[..some.len()].copy_from_slice(some);
            let open = Int::from_array(l, &occluded).is(0);
            let [x, y, z, pixel] =
                places.at_most(payloads.len() as u32 - 1).rows(bytemuck::cast_slice(payloads));
            let radiance = Vector::new(x.to_num_bits(), y.to_num_bits(), z.to_num_bits());
            self.film.splat_lanes(open, pixel, radiance);
        }
    }
}

impl Frame {
    /// Splats the contributions of the shadow rays that nothing is in the way of.
    pub fn add_unoccluded(&self, payloads: &[Contribution], occluded: &[u32]) {
        self.simd().run(Answered { film: self.film(), payloads, occluded });
    }
}
