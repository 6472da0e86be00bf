//! First hits of camera rays: the layers of a frame besides radiance.

use super::aov::{Aov, COUNTS};
use super::frame_layers::{Column, FrameLayers};
use super::{CameraSample, Frame, hits_of, rays_of};
use crate::film::{CentreHit, Film, LayerPlan};
use crate::lanes::{Int, LaneTask, Lanes, MAX_LANES, Mask, Num, OutlinedTask, Vector, for_pairs_mut};
use crate::scene::{Material, Objects};
use crate::schedule::Batch;
use crate::shade::{Cone, Interaction, base_colour, lookup, material_of, sort};
use crate::stream::{Hit, Ray};
use glam::Vec3;
use std::cell::Cell;

/// The most channels that are averaged.
const MAX_SUMS: usize = 17;

thread_local! {
    /// The lists of the last batch of this thread. They are reused, so that no batch after the first allocates.
    static SPARE: Cell<FirstHits> = const { Cell::new(FirstHits::NONE) };
}

/// Camera rays of a batch, and their pixels and samples.
#[derive(Debug)]
struct FirstHits {
    /// Empty if all rays of the batch are camera rays.
    rays: Vec<Ray>,
    hits: Vec<Hit>,
    samples: Vec<[u32; 2]>,
}

impl FirstHits {
    const NONE: Self = Self { rays: Vec::new(), hits: Vec::new(), samples: Vec::new() };

    /// Fills `samples` if all rays of the batch are samples of the picture; returns whether they are.
    fn fill_if_all<P>(&mut self, payloads: &[P], sample_of: impl Fn(&P) -> Option<CameraSample>) -> bool {
        for payload in payloads {
            match sample_of(payload) {
                Some(CameraSample { pixel, sample }) if sample != CameraSample::CENTRE => {
                    self.samples.push([pixel, sample]);
                }
                _ => {
                    self.samples.clear();
                    return false;
                }
            }
        }
        true
    }

    fn clear(&mut self) {
        self.rays.clear();
        self.hits.clear();
        self.samples.clear();
    }
}

impl Default for FirstHits {
    fn default() -> Self {
        Self::NONE
    }
}

/// The rays of a batch that a shader is given, if it is not given all.
#[derive(Debug)]
pub(super) struct GivenRays<P> {
    rays: Vec<Ray>,
    hits: Vec<Hit>,
    payloads: Vec<P>,
}

impl<P: Copy> GivenRays<P> {
    /// The rays of a batch without some of them, which are given by ascending index.
    pub(super) fn without(batch: &Batch<'_, P>, left_out: &[u32]) -> Self {
        let len = batch.rays.len() - left_out.len();
        let (mut rays, mut hits, mut payloads) =
            (Vec::with_capacity(len), Vec::with_capacity(len), Vec::with_capacity(len));
        let mut start = 0;
        for end in left_out.iter().map(|&i| i as usize).chain([batch.rays.len()]) {
            rays.extend_from_slice(&batch.rays[start..end]);
            hits.extend_from_slice(&batch.hits[start..end]);
            payloads.extend_from_slice(&batch.payloads[start..end]);
            start = end + 1;
        }
        Self { rays, hits, payloads }
    }

    pub fn is_empty(&self) -> bool {
        self.rays.is_empty()
    }

    /// As a batch.
    pub fn batch(&self) -> Batch<'_, P> {
        Batch { rays: &self.rays, hits: &self.hits, payloads: &self.payloads }
    }
}

impl Frame {
    /// Adds the camera rays of a batch to the frame's layers; without `adds_hits` only those through the centres of
    /// pixels, since the shader adds the others by [`Frame::add_first_hits_on`]. Returns the rays that the shader is
    /// given if it is not given all of them: rays through the centres of pixels are not part of the picture, and
    /// neither are camera rays that miss if the picture is transparent.
    pub(super) fn add_first_hits<P: Copy>(
        &self,
        batch: &Batch<'_, P>,
        adds_hits: bool,
        sample_of: impl Fn(&P) -> Option<CameraSample>,
    ) -> Option<GivenRays<P>> {
        let (layers, plan) = (self.layers()?, self.film().plan()?);
        let transparent = layers.aovs.is_transparent();
        let wants_hits = adds_hits && (plan.hits || !plan.coverage.is_empty());
        let (mut first, mut left_out) = (SPARE.take(), Vec::new());
        first.clear();
        if !transparent && wants_hits && first.fill_if_all(batch.payloads, &sample_of) {
            // Misses among them are passed over while sorting.
            let first_hits = Batch { rays: batch.rays, hits: batch.hits, payloads: &first.samples };
            self.simd().run(AddHits { frame: self, layers, plan, first: first_hits });
            SPARE.set(first);
            return None;
        }
        for (i, payload) in batch.payloads.iter().enumerate() {
            let Some(CameraSample { pixel, sample }) = sample_of(payload) else { continue };
            let hit = batch.hits[i];
            if sample == CameraSample::CENTRE {
                left_out.push(i as u32);
                self.film().set_centre(pixel, self.centre_hit(&hit));
            } else if hit.is_miss() {
                if transparent {
                    left_out.push(i as u32);
                }
            } else if wants_hits {
                first.rays.push(batch.rays[i]);
                first.hits.push(hit);
                first.samples.push([pixel, sample]);
            }
        }
        if !first.rays.is_empty() {
            let first_hits = Batch { rays: &first.rays, hits: &first.hits, payloads: &first.samples };
            self.simd().run(AddHits { frame: self, layers, plan, first: first_hits });
        }
        SPARE.set(first);
        (!left_out.is_empty()).then(|| GivenRays::without(batch, &left_out))
    }

    /// Adds what camera rays hit on a material to the frame's layers, if it has any: the lanes of a mask.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn add_first_hits_on<L: Lanes>(
        &self,
        material: u32,
        at: &Interaction<L>,
        pixel: Int<L>,
        lanes: Mask<L>,
    ) {
        let (Some(layers), Some(plan)) = (self.layers(), self.film().plan()) else { return };
        if lanes.any() && (plan.hits || !plan.coverage.is_empty()) {
            // A copy: `at` stays in registers where no call refers to it.
            let at = &{ *at };
            pixel.lanes().outlined(AddHit { frame: self, layers, plan, material, at, pixel, lanes });
        }
    }

    /// Adds what paths see on a material, weighted by their throughput, to the features that guide a denoiser, if the
    /// frame has them: the lanes of a mask.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn add_features_on<L: Lanes>(
        &self,
        material: u32,
        at: &Interaction<L>,
        pixel: Int<L>,
        throughput: Vector<L>,
        lanes: Mask<L>,
    ) {
        let Some(to) = self.feature_sums() else { return };
        if lanes.any() {
            // A copy: `at` stays in registers where no call refers to it.
            let at = &{ *at };
            pixel.lanes().outlined(AddFeatures { to, material, at, pixel, throughput, lanes });
        }
    }

    /// Adds the weighted radiance that paths see where they leave the scene to the features that guide a denoiser, if
    /// the frame has them: the lanes of a mask.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn add_sky_features<L: Lanes>(&self, pixel: Int<L>, radiance: Vector<L>, lanes: Mask<L>) {
        let Some(to) = self.feature_sums() else { return };
        if lanes.any() {
            pixel.lanes().outlined(AddSky { to, pixel, radiance, lanes });
        }
    }

    #[inline]
    fn feature_sums(&self) -> Option<FeatureSums<'_>> {
        let layers = self.layers()?;
        let first = layers.features?;
        Some(FeatureSums { frame: self, kinds: &layers.columns[first..], first })
    }

    /// True if the frame has features that guide a denoiser.
    #[inline(always)]
    pub(super) fn has_features(&self) -> bool {
        self.layers().is_some_and(|layers| layers.features.is_some())
    }

    fn centre_hit(&self, hit: &Hit) -> Option<CentreHit> {
        let Hit { primitive, t, .. } = *hit;
        (!hit.is_miss()).then(|| CentreHit { primitive, t, material: material_of(self.scene(), hit) })
    }
}

/// Adds hits to the film's layers.
struct AddHits<'a> {
    frame: &'a Frame,
    layers: &'a FrameLayers,
    plan: &'a LayerPlan,
    /// Camera rays with their pixels and samples.
    first: Batch<'a, [u32; 2]>,
}

impl LaneTask for AddHits<'_> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) {
        let Self { frame, layers, plan, first: batch } = self;
        let scene = frame.scene();
        // The cone that paths begin with.
        let cone = Cone::unpack(Int::splat(l, frame.cone().pack().to_array()[0]));
        for run in sort(l, batch.hits, scene).runs() {
            let Some(material) = run.material else { continue };
            for rays in run.rays.chunks(L::LANES) {
                // Lanes that are left over repeat the first ray and are masked out.
                let (ids, lanes) = Int::some(l, rays, rays[0]);
                let [pixel, _] = ids.rows(batch.payloads.as_flattened());
                let (_, direction) = rays_of(&batch, ids);
                let hits = hits_of(&batch, ids);
                let width = cone.at(hits.t).width;
                let at =
                    &Interaction::new(scene, &scene.materials[material as usize], direction, &hits, width);
                l.outlined(AddHit { frame, layers, plan, material, at, pixel, lanes });
                frame.add_features_on(material, at, pixel, Vector::splat(l, Vec3::ONE), lanes);
            }
        }
    }
}

/// Adds hits on a material to the film's layers, out of line.
struct AddHit<'a, 'b, L: Lanes> {
    frame: &'a Frame,
    layers: &'a FrameLayers,
    plan: &'a LayerPlan,
    /// Its number.
    material: u32,
    at: &'b Interaction<L>,
    pixel: Int<L>,
    lanes: Mask<L>,
}

impl<L: Lanes> OutlinedTask<L> for AddHit<'_, '_, L> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) {
        let Self { frame, material, at, pixel, lanes, .. } = self;
        let (mut pixels, count) = (L::array(0), lanes.count());
        pixel.append(lanes, pixels.as_mut());
        let pixels = &pixels.as_ref()[..count];
        if self.plan.hits {
            self.add_means(&frame.scene().materials[material as usize], at, lanes, pixels);
        }
        if !self.plan.coverage.is_empty() {
            self.count(material, at.texture.primitive, lanes, pixels);
        }
    }
}

/// Adds features of hits on a material, out of line.
struct AddFeatures<'a, 'b, L: Lanes> {
    to: FeatureSums<'a>,
    /// The material's number.
    material: u32,
    at: &'b Interaction<L>,
    pixel: Int<L>,
    throughput: Vector<L>,
    lanes: Mask<L>,
}

impl<L: Lanes> OutlinedTask<L> for AddFeatures<'_, '_, L> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) {
        let Self { to, material, at, pixel, throughput, lanes } = self;
        let scene = to.frame.scene();
        let material = &scene.materials[material as usize];
        let mut colour = base_colour(scene, material, at);
        if let Some(emission) = &material.emission {
            colour += lookup::emission(scene, emission, &at.texture, at.front);
        }
        to.add(pixel, throughput * colour, at.basis.normal, lanes);
    }
}

/// Adds features of rays that leave the scene, out of line.
struct AddSky<'a, L: Lanes> {
    to: FeatureSums<'a>,
    pixel: Int<L>,
    /// Weighted radiance.
    radiance: Vector<L>,
    lanes: Mask<L>,
}

impl<L: Lanes> OutlinedTask<L> for AddSky<'_, L> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) {
        self.to.add(self.pixel, self.radiance, Vector::zero(l), self.lanes);
    }
}

/// The sums of a frame's features, which are the film's last.
#[derive(Clone, Copy)]
struct FeatureSums<'a> {
    frame: &'a Frame,
    kinds: &'a [Column],
    first: usize,
}

impl FeatureSums<'_> {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn add<L: Lanes>(&self, pixel: Int<L>, colour: Vector<L>, normal: Vector<L>, lanes: Mask<L>) {
        let (mut pixels, count) = (L::array(0), lanes.count());
        pixel.append(lanes, pixels.as_mut());
        let mut columns =
            Columns { kinds: self.kinds, lanes, integers: [[0; MAX_LANES]; MAX_SUMS], count: 0 };
        columns.push_vector(colour.clamp(0.0, 1.0));
        columns.push_vector(normal);
        let columns = &columns.integers[..columns.count];
        self.frame.film().add_hits(&pixels.as_ref()[..count], (self.first, columns), false);
    }
}

impl<L: Lanes> AddHit<'_, '_, L> {
    /// True if the frame has an AOV.
    #[inline(always)]
    fn has(&self, aov: Aov) -> bool {
        self.layers.bits & aov.bit() > 0
    }

    /// Adds to the sums, in the order of [`super::aov::MEANS`].
    #[cfg_attr(not(unoptimised), inline(always))]
    fn add_means(&self, material: &Material, at: &Interaction<L>, lanes: Mask<L>, pixels: &[u32]) {
        let scene = self.frame.scene();
        let kinds = &self.layers.columns;
        let mut columns = Columns { kinds, lanes, integers: [[0; MAX_LANES]; MAX_SUMS], count: 0 };
        if self.has(Aov::Normal) {
            columns.push_vector(at.normal);
        }
        if self.has(Aov::ShadingNormal) {
            columns.push_vector(at.basis.normal);
        }
        if self.has(Aov::Position) {
            columns.push_vector(at.position);
        }
        if self.has(Aov::Albedo) {
            columns.push_vector(base_colour(scene, material, at));
        }
        if self.has(Aov::Uv) {
            let [u, v] = at.texture.uv;
            columns.push(u);
            columns.push(v);
        }
        if self.has(Aov::Emission) {
            let mut emitted = Vector::zero(at.wo.lanes());
            if let Some(emission) = &material.emission {
                emitted = lookup::emission(scene, emission, &at.texture, at.front);
            }
            if let Some(computed) = at.computed_emission(scene, material) {
                emitted += computed;
            }
            columns.push_vector(emitted);
        }
        self.film().add_hits(pixels, (0, &columns.integers[..columns.count]), true);
    }

    /// Counts what the hits show, in the order of [`COUNTS`].
    #[cfg_attr(not(unoptimised), inline(always))]
    fn count(&self, material: u32, primitive: Int<L>, lanes: Mask<L>, pixels: &[u32]) {
        let mut objects = L::array(0);
        self.frame.scene().objects.at(primitive).append(lanes, objects.as_mut());
        let mut ids = [0; MAX_LANES];
        let ids = &mut ids[..pixels.len()];
        for (table, aov) in COUNTS.iter().filter(|aov| self.has(**aov)).enumerate() {
            for_pairs_mut(ids, objects.as_ref(), |id, &object| {
                *id = match aov {
                    Aov::CryptoMaterial => material,
                    Aov::CryptoAsset if object != Objects::NONE => self.layers.asset(object),
                    _ => object,
                };
            });
            self.film().count_ids(table, pixels, ids);
        }
    }

    fn film(&self) -> &Film {
        self.frame.film()
    }
}

/// Numbers of hits in fixed point, one column for each sum.
struct Columns<'a, L: Lanes> {
    kinds: &'a [Column],
    lanes: Mask<L>,
    integers: [[i64; MAX_LANES]; MAX_SUMS],
    count: usize,
}

impl<L: Lanes> Columns<'_, L> {
    /// Adds a column of the numbers in the lanes of the mask, packed. What is not finite counts as 0.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn push(&mut self, number: Num<L>) {
        let Column { bound, scale } = self.kinds[self.count];
        let number = number.only(number.is_finite()).clamp(-bound, bound).pack(self.lanes);
        let magnitudes = number.abs().to_fixed(scale);
        let signs = number.to_array();
        let integers = &mut self.integers[self.count][..L::LANES];
        for (lane, integer) in integers.iter_mut().enumerate() {
            let sign = i64::from(signs[lane].to_bits() as i32 >> 31);
            *integer = (magnitudes[lane] ^ sign) - sign;
        }
        self.count += 1;
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn push_vector(&mut self, v: Vector<L>) {
        self.push(v.x);
        self.push(v.y);
        self.push(v.z);
    }
}
