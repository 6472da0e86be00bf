//! The principled BSDF's functions, compiled out of line: they are large, and many shaders use them.

use super::{Principled, Sample, Smooth, Smoothness};
use crate::lanes::{Lanes, Mask, Num, OutlinedTask, Vector};
use crate::scene::{self, Effects, Finish, Scene, TexturePoint};
use crate::shade::CoatShape;

/// [`Principled::new`].
pub struct Construct<'a, L: Lanes> {
    pub scene: &'a Scene,
    pub surface: &'a scene::Principled,
    pub texture: &'a TexturePoint<L>,
    pub coat: &'a Option<CoatShape<L>>,
    pub outside: Mask<L>,
    pub smoothness: Smoothness,
}

impl<L: Lanes> OutlinedTask<L> for Construct<'_, L> {
    type Output = Principled<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> Principled<L> {
        let Self { scene, surface, texture, coat, outside, smoothness } = self;
        Principled::new(scene, surface, texture, coat, outside, smoothness)
    }
}

/// [`Principled::finished`].
pub struct Finished<'a, L: Lanes> {
    pub finish: &'a Finish<L>,
    pub effects: &'a Effects,
    pub coat: &'a Option<CoatShape<L>>,
    pub outside: Mask<L>,
    pub smoothness: Smoothness,
}

impl<L: Lanes> OutlinedTask<L> for Finished<'_, L> {
    type Output = Principled<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> Principled<L> {
        Principled::finished(self.finish, self.effects, self.coat, self.outside, self.smoothness)
    }
}

/// [`Principled::evaluate`].
pub struct Evaluate<'a, L: Lanes> {
    pub surface: &'a Principled<L>,
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

/// [`Principled::sample`].
pub struct Sampling<'a, L: Lanes> {
    pub surface: &'a Principled<L>,
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

/// [`Principled::smooth`].
pub struct Mirroring<'a, L: Lanes> {
    pub surface: &'a Principled<L>,
    pub wo: Vector<L>,
}

impl<L: Lanes> OutlinedTask<L> for Mirroring<'_, L> {
    type Output = Smooth<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> Smooth<L> {
        self.surface.smooth(self.wo)
    }
}
