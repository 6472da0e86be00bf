//! Exact sums and products of floating-point numbers: Shewchuk 1997, *Adaptive Precision Floating-Point Arithmetic*.
//!
//! An expansion is a sum of `f64` numbers that do not overlap, so its largest one has the sign of the sum. Numbers made
//! of `f32` coordinates by three products neither overflow nor underflow, so sums and products here are exact.

/// An exact number: the sum of its terms, which ascend in size and do not overlap. Zero has none.
#[derive(Clone, Debug, Default)]
pub(crate) struct Expansion {
    terms: Vec<f64>,
}

impl Expansion {
    /// Zero, with room for terms.
    pub fn zero() -> Self {
        Self { terms: Vec::with_capacity(16) }
    }

    /// Adds a number. (Shewchuk: GROW-EXPANSION, without zeros.)
    pub fn add(&mut self, number: f64) {
        let (mut sum, mut kept) = (number, 0);
        for at in 0..self.terms.len() {
            let rest;
            (sum, rest) = two_sum(sum, self.terms[at]);
            if rest != 0.0 {
                self.terms[kept] = rest;
                kept += 1;
            }
        }
        self.terms.truncate(kept);
        if sum != 0.0 {
            self.terms.push(sum);
        }
    }

    /// Adds a product of two numbers.
    pub fn add_product(&mut self, a: f64, b: f64) {
        let (product, rest) = two_product(a, b);
        if rest != 0.0 {
            self.add(rest);
        }
        if product != 0.0 {
            self.add(product);
        }
    }

    /// Adds a product of three numbers.
    pub fn add_triple(&mut self, a: f64, b: f64, c: f64) {
        let (product, rest) = two_product(a, b);
        if rest != 0.0 {
            self.add_product(rest, c);
        }
        self.add_product(product, c);
    }

    /// Adds another number, times a factor.
    pub fn add_scaled(&mut self, other: &Self, factor: f64) {
        for &term in &other.terms {
            self.add_product(term, factor);
        }
    }

    /// The product of two numbers.
    pub fn times(&self, other: &Self) -> Self {
        let mut product = Self::zero();
        for &term in &other.terms {
            product.add_scaled(self, term);
        }
        product
    }

    /// The sign: -1, 0 or 1.
    pub fn sign(&self) -> i32 {
        self.terms.last().map_or(0, |&largest| if largest > 0.0 { 1 } else { -1 })
    }

    /// The number to about the precision of `f64`.
    pub fn value(&self) -> f64 {
        self.terms.iter().sum()
    }

    /// The nearest `f32`.
    pub fn to_f32(&self) -> f32 {
        let mut terms = self.terms.iter().rev();
        let mut sum = terms.next().copied().unwrap_or(0.0);
        for &term in terms {
            let rest;
            (sum, rest) = two_sum(sum, term);
            if rest != 0.0 {
                // Rounded to odd, the sum is rounded only once more, to f32. (What follows is smaller than the rest.)
                if sum.to_bits() & 1 == 0 {
                    sum = if (rest > 0.0) == (sum > 0.0) {
                        f64::from_bits(sum.to_bits() + 1)
                    } else {
                        f64::from_bits(sum.to_bits() - 1)
                    };
                }
                break;
            }
        }
        sum as f32
    }
}

/// The rounded sum of two numbers, and the rest.
#[inline]
pub(crate) fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let virtual_b = sum - a;
    let virtual_a = sum - virtual_b;
    (sum, (a - virtual_a) + (b - virtual_b))
}

/// The rounded difference of two numbers, and the rest.
#[inline]
pub(crate) fn two_difference(a: f64, b: f64) -> (f64, f64) {
    two_sum(a, -b)
}

/// The rounded product of two numbers, and the rest. (Dekker's, which needs no fused multiply-add.)
#[inline]
fn two_product(a: f64, b: f64) -> (f64, f64) {
    let product = a * b;
    let ((a_high, a_low), (b_high, b_low)) = (split(a), split(b));
    let rest = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low;
    (product, rest)
}

/// A number as the sum of two with at most 26 bits each.
#[inline]
fn split(a: f64) -> (f64, f64) {
    let c = ((1u64 << 27) + 1) as f64 * a;
    let high = c - (c - a);
    (high, a - high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::mix;
    use num_rational::BigRational;
    use num_traits::{Signed, Zero};

    fn rational(number: f64) -> BigRational {
        BigRational::from_float(number).expect("finite")
    }

    /// A number with few or many bits, of any exponent that occurs.
    fn number(i: u32) -> f64 {
        let bits = f64::from(mix(i) as i32) * f64::from(mix(i ^ 0x5555)) + f64::from(mix(i ^ 0x77) & 1);
        let bits = if mix(i ^ 0x1234).is_multiple_of(3) { (mix(i) % 8) as f64 - 4.0 } else { bits };
        bits * f64::powi(2.0, (mix(i ^ 0xabc) % 80) as i32 - 60)
    }

    #[test]
    fn sums_and_products_are_exact() {
        for i in 0..3000 {
            let n = |k: u32| number(20 * i + k);
            let (mut sum, mut exact) = (Expansion::zero(), BigRational::zero());
            for k in 0..4 {
                let (a, b, c) = (n(3 * k), n(3 * k + 1), n(3 * k + 2));
                sum.add_triple(a, b, c);
                exact += rational(a) * rational(b) * rational(c);
                // What cancels leaves zeros.
                if mix(i).is_multiple_of(2) {
                    sum.add_triple(-a, c, b);
                    exact -= rational(a) * rational(b) * rational(c);
                }
            }
            let terms: BigRational = sum.terms.iter().map(|&term| rational(term)).sum();
            assert_eq!(terms, exact);
            assert_eq!(
                sum.sign(),
                if exact.is_zero() {
                    0
                } else if exact.is_positive() {
                    1
                } else {
                    -1
                }
            );
            let square: BigRational = sum.times(&sum).terms.iter().map(|&term| rational(term)).sum();
            assert_eq!(square, exact.clone() * exact);
        }
    }
}
