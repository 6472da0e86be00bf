//! The state of a path between its hits.

use crate::film::Film;
use crate::lanes::SingleLane;
use crate::shade::Cone;
use bytemuck::{Pod, Zeroable};

/// Bits of [`PathState::depth`] that count rays; depths go one beyond the last bounce.
pub(super) const DEPTH_BITS: u32 = 11;
pub(super) const DEPTH: u32 = (1 << DEPTH_BITS) - 1;

/// The bit of [`PathState::pixel`] that paths have until they have met the features that guide a denoiser.
pub(super) const SEEKS: u32 = 1 << 30;
const _: () = assert!(super::Settings::MAX_PIXELS <= SEEKS as u64 && Film::HALF > SEEKS);

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
    /// Probability density of the ray's direction per solid angle. +∞ if light sampling could not have chosen it; a
    /// little less if the ray has passed surfaces since.
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
        self.pdf
    }

    /// The ray's cone.
    pub fn cone(&self) -> Cone<SingleLane> {
        Cone::unpack(self.index2_and_cone.into())
    }
}
