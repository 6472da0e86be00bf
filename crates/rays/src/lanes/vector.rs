//! [`Vector`]: three numbers in lanes, with operators.

use super::{Lanes, Mask, Num, SingleLane};
use glam::Vec3;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// A vector of three, or a colour, in each lane.
#[derive(Clone, Copy, Debug)]
pub struct Vector<L: Lanes> {
    /// x, or red.
    pub x: Num<L>,
    /// y, or green.
    pub y: Num<L>,
    /// z, or blue.
    pub z: Num<L>,
}

impl<L: Lanes> Vector<L> {
    /// A vector with these components.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn new(x: Num<L>, y: Num<L>, z: Num<L>) -> Self {
        Self { x, y, z }
    }

    /// The same vector in each lane.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn splat(l: L, v: Vec3) -> Self {
        Self { x: Num::splat(l, v.x), y: Num::splat(l, v.y), z: Num::splat(l, v.z) }
    }

    /// The zero vector, or black, in each lane.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn zero(l: L) -> Self {
        Self::splat(l, Vec3::ZERO)
    }

    /// The same number as each component.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn grey(x: Num<L>) -> Self {
        Self { x, y: x, z: x }
    }

    /// A vector with these components, as an array.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn from_columns([x, y, z]: [Num<L>; 3]) -> Self {
        Self { x, y, z }
    }

    /// `a` in the lanes of `mask`, `b` in the others.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn select(mask: Mask<L>, a: Self, b: Self) -> Self {
        Self {
            x: Num::select(mask, a.x, b.x),
            y: Num::select(mask, a.y, b.y),
            z: Num::select(mask, a.z, b.z),
        }
    }

    /// `self` in the lanes of `mask`, 0 in the others.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn only(self, mask: Mask<L>) -> Self {
        Self { x: self.x.only(mask), y: self.y.only(mask), z: self.z.only(mask) }
    }

    /// Dot product.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn dot(self, other: Self) -> Num<L> {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    /// Cross product.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn cross(self, other: Self) -> Self {
        Self {
            x: self.y * other.z - other.y * self.z,
            y: self.z * other.x - other.z * self.x,
            z: self.x * other.y - other.x * self.y,
        }
    }

    /// Squared length.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn length_squared(self) -> Num<L> {
        self.dot(self)
    }

    /// Length.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn length(self) -> Num<L> {
        self.length_squared().sqrt()
    }

    /// The unit vector of the same direction. The vector must be neither zero nor so long that its square overflows.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn normalize(self) -> Self {
        self * (1.0 / self.length())
    }

    /// The unit vector of the same direction, and the lanes in which there is one; `other` in the others.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn normalize_or(self, other: Self) -> (Self, Mask<L>) {
        let scale = 1.0 / self.length();
        let valid = scale.is_finite() & scale.above(0.0);
        (Self::select(valid, self * scale, other), valid)
    }

    /// The magnitude of each component.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn abs(self) -> Self {
        Self { x: self.x.abs(), y: self.y.abs(), z: self.z.abs() }
    }

    /// The lesser of both, component by component.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn min(self, other: Self) -> Self {
        Self { x: self.x.min(other.x), y: self.y.min(other.y), z: self.z.min(other.z) }
    }

    /// The greater of both, component by component.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn max(self, other: Self) -> Self {
        Self { x: self.x.max(other.x), y: self.y.max(other.y), z: self.z.max(other.z) }
    }

    /// Each component, but at least `low` and at most `high`; `low` for NaN.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn clamp(self, low: f32, high: f32) -> Self {
        Self { x: self.x.clamp(low, high), y: self.y.clamp(low, high), z: self.z.clamp(low, high) }
    }

    /// The greatest component.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn max_element(self) -> Num<L> {
        self.x.max(self.y).max(self.z)
    }

    /// Sum of the components.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn element_sum(self) -> Num<L> {
        self.x + self.y + self.z
    }

    /// Lanes in which all components are 0.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn is_zero(self) -> Mask<L> {
        self.x.is_zero() & self.y.is_zero() & self.z.is_zero()
    }

    /// Linear interpolation: `self` where `share` is 0, `other` where it is 1.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn lerp(self, other: Self, share: Num<L>) -> Self {
        self + (other - self) * share
    }

    /// `self / other`, component by component.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn over(self, other: Self) -> Self {
        Self { x: self.x / other.x, y: self.y / other.y, z: self.z / other.z }
    }

    /// The token.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn lanes(self) -> L {
        self.x.lanes()
    }
}

impl From<Vec3> for Vector<SingleLane> {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn from(v: Vec3) -> Self {
        Self::splat(SingleLane, v)
    }
}

impl From<Vector<SingleLane>> for Vec3 {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn from(v: Vector<SingleLane>) -> Self {
        Self::new(v.x.get(), v.y.get(), v.z.get())
    }
}

impl<L: Lanes> Add for Vector<L> {
    type Output = Self;
    #[cfg_attr(not(unoptimised), inline(always))]
    fn add(self, other: Self) -> Self {
        Self { x: self.x + other.x, y: self.y + other.y, z: self.z + other.z }
    }
}

impl<L: Lanes> AddAssign for Vector<L> {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<L: Lanes> Sub for Vector<L> {
    type Output = Self;
    #[cfg_attr(not(unoptimised), inline(always))]
    fn sub(self, other: Self) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }
}

impl<L: Lanes> Mul for Vector<L> {
    type Output = Self;
    #[cfg_attr(not(unoptimised), inline(always))]
    fn mul(self, other: Self) -> Self {
        Self { x: self.x * other.x, y: self.y * other.y, z: self.z * other.z }
    }
}

impl<L: Lanes> Mul<Num<L>> for Vector<L> {
    type Output = Self;
    #[cfg_attr(not(unoptimised), inline(always))]
    fn mul(self, scale: Num<L>) -> Self {
        Self { x: self.x * scale, y: self.y * scale, z: self.z * scale }
    }
}

impl<L: Lanes> Mul<f32> for Vector<L> {
    type Output = Self;
    #[cfg_attr(not(unoptimised), inline(always))]
    fn mul(self, scale: f32) -> Self {
        Self { x: self.x * scale, y: self.y * scale, z: self.z * scale }
    }
}

impl<L: Lanes> Div<Num<L>> for Vector<L> {
    type Output = Self;
    #[cfg_attr(not(unoptimised), inline(always))]
    fn div(self, by: Num<L>) -> Self {
        Self { x: self.x / by, y: self.y / by, z: self.z / by }
    }
}

impl<L: Lanes> Neg for Vector<L> {
    type Output = Self;
    #[cfg_attr(not(unoptimised), inline(always))]
    fn neg(self) -> Self {
        Self { x: -self.x, y: -self.y, z: -self.z }
    }
}
