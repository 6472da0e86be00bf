//! Trigonometric functions in lanes, by fixed polynomials, so that every processor gives the same bits. Angles are in
//! turns (1 turn = 2π) unless said otherwise.

use super::{Lanes, Num};
use std::f32::consts::{FRAC_2_PI, FRAC_PI_2, FRAC_PI_4};

/// Sine and cosine of an angle in radians, −π/4 to π/4. The error is at most two units in the last place.
#[cfg_attr(not(unoptimised), inline(always))]
pub fn small_sin_cos<L: Lanes>(angle: Num<L>) -> (Num<L>, Num<L>) {
    let x2 = angle * angle;
    // Taylor series; the remainder is below 2⁻²⁸.
    let sine = ((x2 * (1.0 / 362_880.0) - 1.0 / 5040.0) * x2 + 1.0 / 120.0) * x2 - 1.0 / 6.0;
    let cosine =
        (((x2 * (-1.0 / 3_628_800.0) + 1.0 / 40_320.0) * x2 - 1.0 / 720.0) * x2 + 1.0 / 24.0) * x2 - 0.5;
    (angle + angle * x2 * sine, 1.0 + x2 * cosine)
}

/// Sine and cosine of an angle of 0 to 1 turn.
#[cfg_attr(not(unoptimised), inline(always))]
pub fn sin_cos_turns<L: Lanes>(turns: Num<L>) -> (Num<L>, Num<L>) {
    let quarters = turns * 4.0;
    let nearest = (quarters + 0.5).floor();
    let (s, c) = small_sin_cos((quarters - nearest) * FRAC_PI_2);
    let quadrant = nearest.clamp(0.0, 4.0).to_int();
    let swap = (quadrant & 1).is(1);
    let (sine, cosine) = (Num::select(swap, c, s), Num::select(swap, s, c));
    let (flip_sine, flip_cosine) = ((quadrant & 2).is(2), ((quadrant + 1) & 2).is(2));
    (Num::select(flip_sine, -sine, sine), Num::select(flip_cosine, -cosine, cosine))
}

/// Sine and cosine of an angle in radians. The error is a few units in the last place of 1 up to 10⁴ radians and grows
/// with the angle beyond; 0 and 1 where the angle is not finite.
#[cfg_attr(not(unoptimised), inline(always))]
pub fn sin_cos<L: Lanes>(angle: Num<L>) -> (Num<L>, Num<L>) {
    let quarters = (angle * FRAC_2_PI + 0.5).floor();
    // π/2 in three parts (Cody and Waite 1980). The first two products are exact for few quarters.
    let rest = angle - quarters * 1.570_312_5 - quarters * 4.837_513e-4 - quarters * 7.549_79e-8;
    let (s, c) = small_sin_cos(rest.clamp(-0.8, 0.8));
    let turn = quarters - (quarters * 0.25).floor() * 4.0;
    let quadrant = turn.clamp(0.0, 3.0).to_int();
    let swap = (quadrant & 1).is(1);
    let (sine, cosine) = (Num::select(swap, c, s), Num::select(swap, s, c));
    let (flip_sine, flip_cosine) = ((quadrant & 2).is(2), ((quadrant + 1) & 2).is(2));
    (Num::select(flip_sine, -sine, sine), Num::select(flip_cosine, -cosine, cosine))
}

/// The angle between the x axis and the point (`x`, `y`), −½ to ½ turn; 0 at the origin. The error is a few units in
/// the last place.
#[cfg_attr(not(unoptimised), inline(always))]
pub fn atan2_turns<L: Lanes>(y: Num<L>, x: Num<L>) -> Num<L> {
    let (ax, ay) = (x.abs(), y.abs());
    let (low, high) = (ax.min(ay), ax.max(ay));
    // tan(a − 1/8 turn) = (tan a − 1) / (tan a + 1) maps the upper half of the octant to the lower.
    let upper = (low * (1.0 + std::f32::consts::SQRT_2)).gt(high);
    let top = Num::select(upper, low - high, low);
    let bottom = Num::select(upper, low + high, high);
    let t = Num::select(bottom.above(0.0), top / bottom, bottom);
    let t2 = t * t;
    // Least-squares fit, reweighted until the error is even: 2·10⁻⁸ relative up to tan(1/16 turn).
    let series = ((t2 * 0.080_598_08 - 0.138_797_07) * t2 + 0.199_779_14) * t2 - 0.333_329_55;
    let angle = t + t * t2 * series;
    let octant = Num::select(upper, angle + FRAC_PI_4, angle);
    let turns = octant * (0.5 * std::f32::consts::FRAC_1_PI);
    let quadrant = Num::select(ay.gt(ax), 0.25 - turns, turns);
    let half = Num::select(x.below(0.0), 0.5 - quadrant, quadrant);
    half.copysign(y)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sines_of_radians_are_accurate() {
        let mut worst = 0.0f64;
        for i in -100_000..=100_000i32 {
            let angle = i as f32 * 0.1001;
            let (sine, cosine) = sin_cos(Num::from(angle));
            let (s, c) = f64::from(angle).sin_cos();
            worst = worst.max((f64::from(sine.get()) - s).abs()).max((f64::from(cosine.get()) - c).abs());
        }
        assert!(worst < 3e-7, "{worst}");
        for odd in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX] {
            let (sine, cosine) = sin_cos(Num::from(odd));
            assert!(sine.get().abs() <= 1.0 && cosine.get().abs() <= 1.0, "{odd}");
        }
    }

    #[test]
    fn angles_are_accurate_and_lead_back() {
        let mut worst = [0.0f64; 3];
        for i in 0..=100_000u32 {
            let turns = i as f32 / 100_000.0;
            let (sine, cosine) = sin_cos_turns(Num::from(turns));
            let exact = f64::from(turns) * std::f64::consts::TAU;
            let off = |found: f32, exact: f64| (f64::from(found) - exact).abs();
            worst[0] = worst[0].max(off(sine.get(), exact.sin()));
            worst[1] = worst[1].max(off(cosine.get(), exact.cos()));
            for scale in [1e-20, 1.0, 3e17] {
                let back = atan2_turns(sine * scale, cosine * scale).get();
                let off = (f64::from(back) - f64::from(turns)).rem_euclid(1.0);
                worst[2] = worst[2].max(off.min(1.0 - off));
            }
        }
        assert!(worst.iter().all(|&w| w < 2e-7), "{worst:?}");
        assert_eq!(atan2_turns(Num::from(0.0), Num::from(0.0)).get(), 0.0);
        assert_eq!(atan2_turns(Num::from(0.0), Num::from(-1.0)).get(), 0.5);
        assert_eq!(atan2_turns(Num::from(1.0), Num::from(0.0)).get(), 0.25);
    }
}
