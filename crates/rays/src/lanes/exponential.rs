//! Exponentials and logarithms in lanes, by fixed polynomials, so that every processor gives the same bits.

use super::{Lanes, Num};
use std::f32::consts::{LN_2, LOG2_E, SQRT_2};

/// 2 to the power `x`; 0 below −126, and above 126 the value at 126. The error is a few units in the last place.
#[cfg_attr(not(unoptimised), inline(always))]
pub fn exp2<L: Lanes>(x: Num<L>) -> Num<L> {
    let held = x.clamp(-126.0, 126.0);
    let whole = (held + 0.5).floor();
    let f = (held - whole) * LN_2;
    // Taylor series; for |x − whole| ≤ ½ the remainder is below 2⁻²⁶.
    let tail = ((f * (1.0 / 5040.0) + 1.0 / 720.0) * f + 1.0 / 120.0) * f + 1.0 / 24.0;
    let series = (((tail * f + 1.0 / 6.0) * f + 0.5) * f + 1.0) * f + 1.0;
    let power = ((whole + 127.0).to_int() << 23).to_num_bits();
    (series * power).only(x.ge(Num::splat(x.lanes(), -126.0)))
}

/// e to the power `x`, with the limits of [`exp2`] at `x · log₂ e`.
#[cfg_attr(not(unoptimised), inline(always))]
pub fn exp<L: Lanes>(x: Num<L>) -> Num<L> {
    exp2(x * LOG2_E)
}

/// The logarithm to base 2; `x` is positive and normal. The error is a few units in the last place of the result or of
/// 1, whichever is greater.
#[cfg_attr(not(unoptimised), inline(always))]
pub fn log2<L: Lanes>(x: Num<L>) -> Num<L> {
    let bits = x.to_bits();
    let power = (bits >> 23).to_num() - 127.0;
    let mantissa = ((bits & 0x7f_ffff) + 0x3f80_0000).to_num_bits();
    let upper = mantissa.above(SQRT_2);
    let m = Num::select(upper, mantissa * 0.5, mantissa);
    let power = Num::select(upper, power + 1.0, power);
    // ln m = 2 artanh(s) with s = (m − 1) / (m + 1), whose magnitude is at most 0.172.
    let s = (m - 1.0) / (m + 1.0);
    let s2 = s * s;
    let series = (((s2 * (1.0 / 9.0) + 1.0 / 7.0) * s2 + 0.2) * s2 + 1.0 / 3.0) * s2 + 1.0;
    power + s * series * (2.0 * LOG2_E)
}

/// `base` to the power `power`, neither below 0. A `base` of at most [`f32::MIN_POSITIVE`] gives 0, whatever the power.
#[cfg_attr(not(unoptimised), inline(always))]
pub fn pow<L: Lanes>(base: Num<L>, power: Num<L>) -> Num<L> {
    let some = base.above(f32::MIN_POSITIVE);
    let safe = Num::select(some, base, Num::splat(base.lanes(), 1.0));
    exp2(power * log2(safe)).only(some)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_and_logarithms_are_accurate() {
        for i in 0..20_000 {
            let x = -40.0 + i as f32 * 0.004;
            let (found, exact) = (exp(Num::from(x)).get(), f64::from(x).exp());
            // The argument of the power is rounded to 2⁻²⁴ of itself.
            assert!((f64::from(found) / exact - 1.0).abs() < 3e-7 + 1.2e-7 * f64::from(x).abs(), "exp({x})");
            let y = libm::expf(x);
            let (found, exact) = (log2(Num::from(y)).get(), f64::from(y).log2());
            assert!((f64::from(found) - exact).abs() < 2e-7 * exact.abs().max(1.0), "log2({y})");
        }
        assert_eq!(exp2(Num::from(-200.0)).get(), 0.0);
        assert_eq!(exp2(Num::from(f32::NEG_INFINITY)).get(), 0.0);
        assert_eq!((exp2(Num::from(0.0)).get(), exp2(Num::from(10.0)).get()), (1.0, 1024.0));
    }

    #[test]
    fn powers_of_zero_are_zero() {
        assert_eq!(pow(Num::from(0.0), Num::from(3.0)).get(), 0.0);
        assert_eq!(pow(Num::from(1.0), Num::from(200.0)).get(), 1.0);
        assert!((pow(Num::from(0.5), Num::from(3.0)).get() - 0.125).abs() < 1e-7);
    }
}
