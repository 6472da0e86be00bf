//! Functions of BSDFs that call the native BSDF of a finish.

use crate::lanes::{Lanes, MAX_LANES, Num, OutlinedTask, Vector};
use crate::scene::{BlockColumns, Effects, Finish, FinishSource, Scattered, Transmission};
use crate::shade::bsdf::FinishBsdf;

/// The numbers of a call: the finish, a truth value that says whether the viewer is outside of the body, and six of
/// directions and random numbers.
pub(super) const OPERANDS: usize = BlockColumns::FINISH + 7;

/// The most results of a call.
pub(super) const RESULTS: usize = 7;

/// A function of the prelude that calls the native BSDF of a finish.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FinishFunction {
    /// `finish_evaluate`
    Evaluate,
    /// `finish_sample`
    Sample,
}

impl FinishFunction {
    /// The function of this name.
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "finish_evaluate" => Some(Self::Evaluate),
            "finish_sample" => Some(Self::Sample),
            _ => None,
        }
    }

    /// Number of results.
    pub fn results(self) -> usize {
        match self {
            Self::Evaluate => 4,
            Self::Sample => RESULTS,
        }
    }
}

/// Facts about the surface whose BSDF calls such functions.
#[derive(Clone, Copy, Debug)]
pub(super) struct FinishPlace {
    /// The way in which a finish transmits light, if it does.
    pub transmission: Transmission,
    /// True if the x axis of the shading basis is the rougher direction of the material.
    pub has_anisotropy: bool,
}

/// A call at the points of a vector.
pub(super) struct FinishCall<'a, L: Lanes> {
    pub function: FinishFunction,
    pub effects: &'a Effects,
    pub operands: &'a [Num<L>; OPERANDS],
}

impl<L: Lanes> OutlinedTask<L> for FinishCall<'_, L> {
    type Output = [Num<L>; RESULTS];

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) -> [Num<L>; RESULTS] {
        let Self { function, effects, operands } = self;
        let outside = !operands[BlockColumns::FINISH].to_bits().is(0);
        let [x, y, z, a, b, c] = std::array::from_fn(|i| operands[BlockColumns::FINISH + 1 + i]);
        let finish = Finish::read_from(l, &Scalars(operands), effects);
        let bsdf = FinishBsdf::new(finish, effects, outside, Vector::new(x, y, z));
        match function {
            FinishFunction::Evaluate => {
                let (value, pdf) = bsdf.evaluate(Vector::new(a, b, c));
                let zero = Num::zero(l);
                [value.x, value.y, value.z, pdf, zero, zero, zero]
            }
            FinishFunction::Sample => {
                let Scattered { wi, weight, pdf } = bsdf.sample(a, [b, c]);
                [wi.x, wi.y, wi.z, weight.x, weight.y, weight.z, pdf]
            }
        }
    }
}

/// The scalars of a finish, with which the numbers of a call begin.
struct Scalars<'a, L: Lanes>(&'a [Num<L>; OPERANDS]);

impl<L: Lanes> FinishSource for Scalars<'_, L> {
    #[inline(always)]
    fn get(&self, scalar: usize, column: &mut [f32; MAX_LANES]) {
        self.0[scalar].store(column);
    }
}
