//! Absorption along rays between surfaces.

use super::Interaction;
use crate::lanes::{Lanes, Num, Vector, exponential};
use crate::scene::Medium;

/// Transmittance of `medium` along rays of length `t` to a surface; 1 in lanes that hit the surface from
/// outside.
#[inline(always)]
pub fn passed<L: Lanes>(medium: &Medium, at: &Interaction<L>, t: Num<L>) -> Vector<L> {
    let one = Num::splat(t.lanes(), 1.0);
    let [r, g, b] = (medium.absorption * -std::f32::consts::LOG2_E).to_array();
    let share = Vector::new(exponential::exp2(t * r), exponential::exp2(t * g), exponential::exp2(t * b));
    Vector::select(at.outside, Vector::grey(one), share)
}
