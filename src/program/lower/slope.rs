//! Slopes of numbers: how fast they change from point to point, as far as that is a known factor. Pictures are averaged
//! over the coordinates that a ray's cone covers.

use super::{Lowerer, Scalar};
use crate::program::code::Register;
use crate::program::kernel::first_scalar;
use crate::program::operation::Operation;
use crate::scene::POINT_FIELDS;

/// The fields of points that coordinates are made of, and the fields that tell how much of each a cone covers.
const SEEDS: [(&str, &str); 6] = [
    ("uv", "footprint"),
    ("uv1", "footprint1"),
    ("uv2", "footprint2"),
    ("uv3", "footprint3"),
    ("position", "width"),
    ("object_position", "object_width"),
];

/// The slope of a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Slope {
    /// The place in [`SEEDS`] of the field that it follows.
    seed: usize,
    /// At least 0: how many times as fast as that field it changes.
    factor: f32,
}

/// The slope of a sum.
fn sum(a: Option<Slope>, b: Option<Slope>) -> Option<Slope> {
    match (a, b) {
        (Some(a), Some(b)) if a.seed == b.seed => {
            // Two components of a field change in directions at right angles.
            Some(Slope { factor: (a.factor * a.factor + b.factor * b.factor).sqrt(), ..a })
        }
        (Some(_), Some(_)) => None,
        // What else is added is taken to change slowly: a warp, a whole number.
        (one, None) | (None, one) => one,
    }
}

/// The steeper of two slopes.
fn steeper(a: Option<Slope>, b: Option<Slope>) -> Option<Slope> {
    match (a, b) {
        (Some(a), Some(b)) if a.seed == b.seed => Some(Slope { factor: a.factor.max(b.factor), ..a }),
        (Some(_), Some(_)) => None,
        (one, None) | (None, one) => one,
    }
}

impl Lowerer<'_> {
    /// The slope of a number; `None` if it is not known, or 0.
    fn slope(&self, scalar: Scalar) -> Option<Slope> {
        let Scalar::Column(register) = scalar else { return None };
        if let Some(&slope) = self.slopes.get(&register) {
            return Some(slope);
        }
        let &(input, _) = self.code.inputs.iter().find(|&&(_, input)| input == register)?;
        let is_seed = |field: &str| {
            let first = first_scalar(POINT_FIELDS, field) as u32;
            let row = POINT_FIELDS.iter().find(|row| row.name == field);
            row.is_some_and(|row| (first..first + row.kind.numbers() as u32).contains(&input))
        };
        let seed = SEEDS.iter().position(|(field, _)| is_seed(field))?;
        Some(Slope { seed, factor: 1.0 })
    }

    /// Takes note of the slope of what an operation computes.
    pub(super) fn note_slope(&mut self, operation: Operation, operands: &[Scalar], to: Register) {
        use Operation as O;
        if self.pictures.is_empty() {
            return;
        }
        let of = |at: usize| operands.get(at).and_then(|&scalar| self.slope(scalar));
        let number = |at: usize| match operands.get(at) {
            Some(&Scalar::Word(word)) => Some(f32::from_bits(word).abs()),
            _ => None,
        };
        let scaled =
            |slope: Option<Slope>, by: f32| slope.map(|slope| Slope { factor: slope.factor * by, ..slope });
        let slope = match operation {
            O::Copy | O::Neg | O::Abs => of(0),
            O::Add | O::Sub => sum(of(0), of(1)),
            O::Min | O::Max => steeper(of(0), of(1)),
            O::Select => steeper(of(1), of(2)),
            O::Mul => match (number(0), number(1)) {
                (None, Some(by)) => scaled(of(0), by),
                (Some(by), None) => scaled(of(1), by),
                _ => None,
            },
            O::Div => number(1).and_then(|by| scaled(of(0), 1.0 / by)),
            _ => None,
        };
        if let Some(slope) = slope.filter(|slope| slope.factor.is_finite()) {
            self.slopes.insert(to, slope);
        }
    }

    /// The side of the square that a ray's cone covers of coordinates: the geometric mean of both. 0 if neither has a
    /// known slope.
    pub(super) fn covered(&mut self, [u, v]: [Scalar; 2]) -> Scalar {
        let slope = match (self.slope(u), self.slope(v)) {
            (Some(a), Some(b)) if a.seed == b.seed => Slope { factor: (a.factor * b.factor).sqrt(), ..a },
            (Some(one), None) | (None, Some(one)) => one,
            _ => return Scalar::Word(0),
        };
        let size = self.point_scalar(first_scalar(POINT_FIELDS, SEEDS[slope.seed].1));
        self.compute(Operation::Mul, &[size, Scalar::number(slope.factor)])
    }

    /// A scalar of the point.
    pub(super) fn point_scalar(&self, scalar: usize) -> Scalar {
        let input = self.code.inputs.iter().find(|&&(input, _)| input as usize == scalar);
        input.map_or(Scalar::Word(0), |&(_, register)| Scalar::Column(register))
    }
}
