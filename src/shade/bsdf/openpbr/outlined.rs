//! The functions of OpenPBR's BSDF, compiled out of line: they are large, and many shaders use them.

use super::super::{Sample, Smooth, Smoothness};
use super::{OpenPbr, Parameters};
use crate::lanes::{Lanes, Mask, Num, OutlinedTask, Vector};
use crate::scene::{self, Scene, TexturePoint};

/// Makes the BSDF at points.
pub struct Construct<'a, L: Lanes> {
    pub scene: &'a Scene,
    pub surface: &'a scene::OpenPbr,
    pub texture: &'a TexturePoint<L>,
    pub outside: Mask<L>,
    pub smoothness: Smoothness,
}

impl<L: Lanes> OutlinedTask<L> for Construct<'_, L> {
    type Output = OpenPbr<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> OpenPbr<L> {
        let parameters = Parameters::at(self.scene, self.surface, self.texture);
        OpenPbr::of(&parameters, self.outside, self.smoothness)
    }
}

/// [`OpenPbr::evaluate`].
pub struct Evaluate<'a, L: Lanes> {
    pub surface: &'a OpenPbr<L>,
    pub wo: Vector<L>,
    pub wi: Vector<L>,
}

impl<L: Lanes> OutlinedTask<L> for Evaluate<'_, L> {
    type Output = (Vector<L>, Num<L>);

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> Self::Output {
        self.surface.evaluate(self.wo, self.wi)
    }
}

/// [`OpenPbr::sample`].
pub struct Sampling<'a, L: Lanes> {
    pub surface: &'a OpenPbr<L>,
    pub wo: Vector<L>,
    pub u: Num<L>,
    pub u2: [Num<L>; 2],
}

impl<L: Lanes> OutlinedTask<L> for Sampling<'_, L> {
    type Output = Sample<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> Sample<L> {
        self.surface.sample(self.wo, self.u, self.u2)
    }
}

/// [`OpenPbr::smooth`].
pub struct Mirroring<'a, L: Lanes> {
    pub surface: &'a OpenPbr<L>,
    pub wo: Vector<L>,
}

impl<L: Lanes> OutlinedTask<L> for Mirroring<'_, L> {
    type Output = Smooth<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> Smooth<L> {
        self.surface.smooth(self.wo)
    }
}
