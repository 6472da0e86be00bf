//! Exact arithmetic on the numbers of tests: as integers, in units of 2⁻¹⁰⁰⁰.

use glam::DVec3;
use num_bigint::{BigInt, Sign};
use num_traits::Zero;

pub(crate) type Vector = [BigInt; 3];

/// 2 to the power of `exponent`, which is at least -1000.
pub(crate) fn power(exponent: i32) -> BigInt {
    BigInt::from(1) << (exponent + 1000) as usize
}

/// A number that is a multiple of 2⁻¹⁰⁰⁰, as all that have an absolute value above 2⁻⁹⁴⁷ are.
fn number(x: f64) -> BigInt {
    let (mantissa, exponent, sign) = num_traits::float::FloatCore::integer_decode(x);
    if mantissa == 0 {
        return BigInt::zero();
    }
    assert!(exponent >= -1000, "{x} is not a multiple of 2⁻¹⁰⁰⁰");
    (BigInt::from(mantissa) << (exponent as i32 + 1000) as usize) * sign
}

pub(crate) fn vector(v: DVec3) -> Vector {
    v.to_array().map(number)
}

pub(crate) fn minus(a: &Vector, b: &Vector) -> Vector {
    [&a[0] - &b[0], &a[1] - &b[1], &a[2] - &b[2]]
}

/// The cross product, in the product of both units: enough for signs and quotients.
pub(crate) fn cross(a: &Vector, b: &Vector) -> Vector {
    let part = |i: usize, k: usize| &a[i] * &b[k] - &a[k] * &b[i];
    [part(1, 2), part(2, 0), part(0, 1)]
}

/// The dot product, in the product of both units.
pub(crate) fn dot(a: &Vector, b: &Vector) -> BigInt {
    &a[0] * &b[0] + &a[1] * &b[1] + &a[2] * &b[2]
}

/// -1, 0 or 1.
pub(crate) fn sign(x: &BigInt) -> i32 {
    match x.sign() {
        Sign::Minus => -1,
        Sign::NoSign => 0,
        Sign::Plus => 1,
    }
}
