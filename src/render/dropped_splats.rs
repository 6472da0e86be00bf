//! Materials that made splats that the film dropped.

use super::Frame;
use crate::film::Film;
use crate::lanes::{Int, Lanes, Mask, Num, OutlinedTask, Vector};
use glam::Vec3;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// Splats of one material that the film dropped, because they were negative or not finite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Dropped {
    /// Their number.
    pub splats: u64,
    /// The first pixel that lacks some, row by row from the top.
    pub first_pixel: u32,
}

/// Dropped splats by the index of the material at whose hit they were computed. `None` stands for splats of no known
/// material: the environment's, those of recursive shaders, and those added to the film directly.
pub type DroppedByMaterial = BTreeMap<Option<u32>, Dropped>;

/// The dropped splats of a frame. Any thread may add to it.
#[derive(Debug, Default)]
pub(super) struct DroppedSplats(Mutex<DroppedByMaterial>);

impl DroppedSplats {
    /// Adds a splat for each of these pixels. Out of line, so that the loops that splat stay small.
    #[cold]
    #[inline(never)]
    fn note(&self, material: Option<u32>, pixels: &[u32]) {
        for first_pixel in pixels.iter().map(|pixel| pixel & !Film::HALF) {
            self.add(material, Dropped { splats: 1, first_pixel });
        }
    }

    fn add(&self, material: Option<u32>, more: Dropped) {
        let mut by_material = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let first_pixel = more.first_pixel;
        let sum = by_material.entry(material).or_insert(Dropped { splats: 0, first_pixel });
        sum.splats += more.splats;
        sum.first_pixel = sum.first_pixel.min(first_pixel);
    }

    /// Adds what another frame dropped.
    pub fn add_all(&self, other: &Self) {
        for (material, dropped) in other.by_material() {
            self.add(material, dropped);
        }
    }

    pub fn by_material(&self) -> DroppedByMaterial {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// [`Frame::splat_lanes`], out of line: few hits shine, and shaders splat at several places.
struct Splat<'a, L: Lanes> {
    frame: &'a Frame,
    material: Option<u32>,
    lanes: Mask<L>,
    pixel: Int<L>,
    radiance: Vector<L>,
}

impl<L: Lanes> OutlinedTask<L> for Splat<'_, L> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) {
        let Self { frame, material, lanes, pixel, radiance } = self;
        let dropped = frame.film().splat_lanes(lanes, pixel, radiance);
        if dropped.any() {
            frame.note_dropped(material, dropped, pixel);
        }
    }
}

impl Frame {
    /// Adds the radiance of a hit on a material to a pixel, or of a ray that hit nothing (`None`). Splats that are
    /// negative or not finite are dropped, counted, and known by their material ([`Frame::dropped_by_material`]).
    pub fn splat(&self, material: Option<u32>, pixel: u32, radiance: Vec3) {
        if !self.film().splat(pixel, radiance) {
            self.dropped().note(material, &[pixel]);
        }
    }

    /// [`Frame::splat`] for each lane of a mask.
    #[inline(always)]
    pub fn splat_lanes<L: Lanes>(
        &self,
        material: Option<u32>,
        lanes: Mask<L>,
        pixel: Int<L>,
        radiance: Vector<L>,
    ) {
        if lanes.any() {
            pixel.lanes().outlined(Splat { frame: self, material, lanes, pixel, radiance });
        }
    }

    /// Lanes of a mask whose weight is finite. The others can add nothing to the picture; they are dropped, counted,
    /// and known by their material. A shader that ends such paths names the material that is to blame instead of those
    /// that the path meets afterwards.
    #[inline(always)]
    pub fn finite_lanes<L: Lanes>(
        &self,
        material: Option<u32>,
        lanes: Mask<L>,
        pixel: Int<L>,
        weight: Vector<L>,
    ) -> Mask<L> {
        // The sum is finite only if each channel is. The reverse fails for sums beyond 3e38.
        if (lanes & !weight.element_sum().is_finite()).none() {
            return lanes;
        }
        let finite = weight.x.is_finite() & weight.y.is_finite() & weight.z.is_finite();
        self.keep(material, lanes, finite, pixel)
    }

    /// Lanes of a mask whose radiance the film can add: finite and not negative. The others are dropped, counted, and
    /// known by their material.
    #[inline(always)]
    pub(super) fn addable_lanes<L: Lanes>(
        &self,
        material: Option<u32>,
        lanes: Mask<L>,
        pixel: Int<L>,
        radiance: Vector<L>,
    ) -> Mask<L> {
        let positive = radiance.x.min(radiance.y).min(radiance.z).ge(Num::zero(pixel.lanes()));
        if (lanes & !(radiance.element_sum().is_finite() & positive)).none() {
            return lanes;
        }
        let zero = Num::zero(pixel.lanes());
        let (x, y, z) = (radiance.x, radiance.y, radiance.z);
        let finite = x.is_finite() & y.is_finite() & z.is_finite();
        let valid = finite & x.ge(zero) & y.ge(zero) & z.ge(zero);
        self.keep(material, lanes, valid, pixel)
    }

    /// The valid lanes of a mask. The others are counted as dropped.
    #[inline(always)]
    fn keep<L: Lanes>(
        &self,
        material: Option<u32>,
        lanes: Mask<L>,
        valid: Mask<L>,
        pixel: Int<L>,
    ) -> Mask<L> {
        let dropped = lanes & !valid;
        if dropped.any() {
            self.film().count_dropped(dropped.count() as u64);
            self.note_dropped(material, dropped, pixel);
        }
        lanes & valid
    }

    #[inline(always)]
    fn note_dropped<L: Lanes>(&self, material: Option<u32>, lanes: Mask<L>, pixel: Int<L>) {
        let mut pixels = L::array(0);
        let count = pixel.append(lanes, pixels.as_mut());
        self.dropped().note(material, &pixels.as_ref()[..count]);
    }

    /// Dropped splats so far, by material. Their sum is [`crate::film::Film::dropped_splats`], less what was added to
    /// the film directly.
    pub fn dropped_by_material(&self) -> DroppedByMaterial {
        self.dropped().by_material()
    }

    /// A sentence for each material that made splats which were dropped.
    pub fn dropped_warnings(&self) -> Vec<String> {
        let width = self.settings().width;
        let sentence = |(material, Dropped { splats, first_pixel }): (Option<u32>, Dropped)| {
            let (x, y) = (first_pixel % width, first_pixel / width);
            let of = match material.and_then(|material| self.scene().materials.get(material as usize)) {
                Some(material) => format!("material {:?}", material.name),
                None => "no known material".to_owned(),
            };
            format!(
                "dropped {splats} splats of {of} that were negative or not finite; the first at column {x}, row {y}"
            )
        };
        self.dropped_by_material().into_iter().map(sentence).collect()
    }
}
