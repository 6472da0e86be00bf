//! The state of a path between its hits.

use super::Frame;
use crate::film::Film;
use crate::lanes::{Int, Lanes, Mask, Num, SingleLane, Vector};
use crate::shade::Cone;
use bytemuck::{Pod, Zeroable};

/// Bits of [`PathState::depth`] that count rays; depths go one beyond the last bounce.
pub(super) const DEPTH_BITS: u32 = 11;
pub(super) const DEPTH: u32 = (1 << DEPTH_BITS) - 1;

/// The bit of [`PathState::pixel`] that paths have until they have met the features that guide a denoiser.
pub(super) const SEEKS: u32 = 1 << 30;
const _: () = assert!(super::Settings::MAX_PIXELS <= SEEKS as u64 && Film::HALF > SEEKS);

/// The bit of [`PathState::depth`] that paths of one channel have.
pub(super) const ONE_CHANNEL: u32 = 1 << DEPTH_BITS;
pub(super) const FACING_SHIFT: u32 = DEPTH_BITS + 1;

/// Bits of [`PathState::index2_and_cone`] that are the index.
const INDEX2: u32 = u32::MAX << Cone::<SingleLane>::BITS;

/// The state of a path.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct PathState {
    /// Throughput: the weight of radiance along the ray in its pixel.
    pub(super) throughput: [f32; 3],
    /// Upper half: the high bits of the f32 squared index of refraction of the ray's medium, relative to the medium in
    /// which the path began. Lower half: the ray's [`Cone`].
    pub(super) index2_and_cone: u32,
    /// The pixel, and [`SEEKS`].
    pub(super) pixel: u32,
    pub(super) sample: u32,
    /// Lowest [`DEPTH_BITS`]: the number of rays before this one. Above them: whether the path has one
    /// channel, and the quantised shading normal of the surface that the ray leaves.
    pub(super) depth: u32,
    /// Probability density of the ray's direction per solid angle. +∞ if light sampling could not have chosen it;
    /// negative if it is [`Mirrored`].
    pub(super) pdf: f32,
}

impl PathState {
    /// The state of a camera ray, without pixel and sample.
    pub(super) fn start(cone: Cone<SingleLane>) -> Self {
        Self {
            throughput: [1.0; 3],
            index2_and_cone: 1.0f32.to_bits() + cone.pack().get(),
            pixel: 0,
            sample: 0,
            depth: 0,
            pdf: f32::INFINITY,
        }
    }

    /// The weight of radiance along the ray in its pixel.
    pub fn throughput(&self) -> [f32; 3] {
        self.throughput
    }

    /// The pixel, counted row by row from the top.
    pub fn pixel(&self) -> u32 {
        self.pixel & !SEEKS
    }

    /// The number of the pixel's sample.
    pub fn sample(&self) -> u32 {
        self.sample
    }

    /// The number of rays before this one.
    #[inline]
    pub fn depth(&self) -> u32 {
        self.depth & DEPTH
    }

    /// Probability density of the ray's direction per solid angle; +∞ if light sampling could not have chosen it.
    pub fn pdf(&self) -> f32 {
        if self.pdf.is_sign_negative() {
            Mirrored::<SingleLane>::of(self.pdf.into()).pdf.get()
        } else {
            self.pdf
        }
    }

    /// The ray's cone.
    pub fn cone(&self) -> Cone<SingleLane> {
        Cone::unpack(self.index2_and_cone.into())
    }
}

/// What a path keeps of its last scattered direction behind a flat mirror, instead of a density: numbers of 15 bits,
/// rounded towards 0, below a sign.
#[derive(Clone, Copy)]
pub(super) struct Mirrored<L: Lanes> {
    /// Density of the direction per solid angle, times the chance of being mirrored.
    pub pdf: Num<L>,
    /// The way to the mirror.
    pub before: Num<L>,
}

impl<L: Lanes> Mirrored<L> {
    const SIGN: u32 = 1 << 31;
    const UPPER: u32 = 0x7fff_0000;

    /// Both numbers, rounded.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn new(pdf: Num<L>, before: Num<L>) -> Self {
        let rounded = |x: Num<L>| (x.to_bits() & Self::UPPER).to_num_bits();
        Self { pdf: rounded(pdf), before: rounded(before) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn of(word: Num<L>) -> Self {
        let bits = word.to_bits();
        Self { pdf: (bits & Self::UPPER).to_num_bits(), before: (bits << 16).to_num_bits() }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn word(self) -> Num<L> {
        ((self.pdf.to_bits() | Self::SIGN) + (self.before.to_bits() >> 16)).to_num_bits()
    }

    /// Lanes whose word is that of a mirrored direction.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn is_in(word: Num<L>) -> Mask<L> {
        !(word.to_bits() & Self::SIGN).is(0)
    }
}

/// [`PathState`] in lanes.
#[derive(Clone, Copy)]
pub(super) struct States<L: Lanes> {
    pub throughput: Vector<L>,
    pub index2: Num<L>,
    pub cone: Cone<L>,
    pub pixel: Int<L>,
    /// [`SEEKS`] or 0.
    pub seeks: Int<L>,
    pub sample: Int<L>,
    pub depth: Int<L>,
    /// [`ONE_CHANNEL`] or 0.
    pub one_channel: Int<L>,
    pub facing: Int<L>,
    pub pdf: Num<L>,
}

impl<L: Lanes> States<L> {
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn of(payloads: &[PathState], ids: Int<L>) -> Self {
        let [r, g, b, packed, pixel, sample, depth, pdf] = ids.rows(bytemuck::cast_slice(payloads));
        Self {
            throughput: Vector::new(r.to_num_bits(), g.to_num_bits(), b.to_num_bits()),
            index2: (packed & INDEX2).to_num_bits(),
            cone: Cone::unpack(packed),
            pixel: pixel & !SEEKS,
            seeks: pixel & SEEKS,
            sample,
            depth: depth & DEPTH,
            one_channel: depth & ONE_CHANNEL,
            facing: depth >> FACING_SHIFT,
            pdf: pdf.to_num_bits(),
        }
    }

    /// [`Frame::target`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn target(&self, frame: &Frame) -> Int<L> {
        frame.target(self.pixel, self.sample)
    }

    /// As rows in memory: the lanes of a mask, packed.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn rows(self, lanes: Mask<L>) -> L::Array<[f32; 8]> {
        let [x, y, z] = [self.throughput.x, self.throughput.y, self.throughput.z];
        let depth = self.depth + self.one_channel + (self.facing << FACING_SHIFT);
        let [pixel, sample, depth] =
            [(self.pixel + self.seeks).to_num_bits(), self.sample.to_num_bits(), depth.to_num_bits()];
        let packed = (self.index2.to_bits() & INDEX2) + self.cone.pack();
        Num::packed_rows(lanes, [x, y, z, packed.to_num_bits(), pixel, sample, depth, self.pdf])
    }
}
