//! The cases that show whether a device computes operations as the host does.

use super::kernel::expression;
use super::program::Program;
use crate::geom::mix;
use crate::program::code::{Code, Instruction};
use crate::program::operation::Operation;
use crate::scene::{FieldType, POINT_FIELDS};

/// Cases of each probe.
const CASES: u32 = 1 << 17;

/// An operation, or several that a driver may join or reorder.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Probe {
    /// A single operation.
    Operation(Operation),
    /// Several in a row: their name, their WGSL, and the host's result.
    Shape(&'static str, &'static str, fn([f32; 3]) -> f32),
}

/// What drivers are known to contract, reorder or drop.
const SHAPES: [Probe; 12] = [
    Probe::Shape("a * b + c", "op_add(op_mul(a, b), c)", |[a, b, c]| a * b + c),
    Probe::Shape("a * b - c", "op_sub(op_mul(a, b), c)", |[a, b, c]| a * b - c),
    Probe::Shape("c - a * b", "op_sub(c, op_mul(a, b))", |[a, b, c]| c - a * b),
    Probe::Shape("(a + b) - a", "op_sub(op_add(a, b), a)", |[a, b, _]| (a + b) - a),
    Probe::Shape("(a + b) + c", "op_add(op_add(a, b), c)", |[a, b, c]| (a + b) + c),
    Probe::Shape("(a * b) * c", "op_mul(op_mul(a, b), c)", |[a, b, c]| (a * b) * c),
    Probe::Shape("a * b + a * c", "op_add(op_mul(a, b), op_mul(a, c))", |[a, b, c]| a * b + a * c),
    Probe::Shape("(a * 0.1) * 3.7", "op_mul(op_mul(a, 0x3dcccccdu), 0x406ccccdu)", |[a, ..]| (a * 0.1) * 3.7),
    Probe::Shape("(a + 0.1) + 3.7", "op_add(op_add(a, 0x3dcccccdu), 0x406ccccdu)", |[a, ..]| (a + 0.1) + 3.7),
    Probe::Shape("a + 0", "op_add(a, params.z)", |[a, ..]| a + 0.0),
    Probe::Shape("a * 0", "op_mul(a, params.z)", |[a, ..]| a * 0.0),
    Probe::Shape("a - a", "op_sub(a, a)", |[a, ..]| if a.is_finite() { 0.0 } else { f32::NAN }),
];

impl Probe {
    /// The name that reports use.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Operation(operation) => operation.meaning(),
            Self::Shape(name, ..) => name,
        }
    }

    /// WGSL of the words `a`, `b` and `c`.
    pub fn expression(&self) -> String {
        match self {
            Self::Operation(operation) => {
                let names: Vec<String> = ["a", "b", "c"].map(str::to_owned).to_vec();
                expression(*operation, &names[..operation.operands()])
            }
            Self::Shape(_, expression, _) => (*expression).to_owned(),
        }
    }

    /// The host's result.
    pub fn expected(&self, words: [u32; 3]) -> u32 {
        match self {
            Self::Operation(operation) => operation.of(words),
            Self::Shape(_, _, of) => of(words.map(f32::from_bits)).to_bits(),
        }
    }
}

/// The operations of programs, each once, and the shapes.
pub(super) fn probes<'c>(codes: impl Iterator<Item = &'c Code>) -> Vec<Probe> {
    let mut operations: Vec<Operation> = Vec::new();
    for instruction in codes.flat_map(|code| &code.instructions) {
        if let Instruction::Compute { operation, .. } = instruction
            && !operations.contains(operation)
        {
            operations.push(*operation);
        }
    }
    operations.into_iter().map(Probe::Operation).chain(SHAPES).collect()
}

/// Words that are often special cases.
const SPECIAL: [u32; 24] = [
    0,
    0x8000_0000,
    1,
    0x8000_0001,
    0x007f_ffff,
    0x0080_0000,
    0x0080_0001,
    0x3eff_ffff,
    0x3f00_0000,
    0x3f7f_ffff,
    0x3f80_0000,
    0xbf80_0000,
    0x3f80_0001,
    0x4b00_0000,
    0x4b7f_ffff,
    0x4b80_0000,
    0x4eff_ffff,
    0x4f00_0000,
    0xcf00_0000,
    0x4f80_0000,
    0x7f7f_ffff,
    0x7f80_0000,
    0xff80_0000,
    0x7fc0_0000,
];

/// A number whose exponent is one of `span` from `least` on.
fn number(random: u32, least: u32, span: u32) -> u32 {
    (random & 0x807f_ffff) | ((least + (random >> 23) % span) << 23)
}

/// Triples of operands: random words, numbers of like size, ties, near and below the least normal number, integers,
/// short fractions, and special words.
pub(crate) fn cases() -> Vec<[u32; 3]> {
    let triple = |i: u32| {
        let [x, y, z] = [0, 1, 2].map(|k| mix(mix(3 * i + k) ^ 0x9e37_79b9));
        match i % 8 {
            0 => [x, y, z],
            1 => [x, y, z].map(|word| number(word, 117, 20)),
            // Sums of operands that nearly cancel.
            2 => {
                let a = number(x, 60, 130);
                [a, (a ^ 0x8000_0000).wrapping_add(y % 9).wrapping_sub(4), number(z, 117, 20)]
            }
            // Sums and products halfway between two numbers.
            3 => {
                let a = number(x, 100, 60) & 0xffff_f000;
                let half = ((a >> 23 & 0xff) - 24) << 23 | y & 0x8000_0000;
                [a | y & 1, half | z >> 8 & 1, (0x3f80_0000 | (1 << (z % 23))) ^ (y & 0x8000_0000)]
            }
            // Products and quotients near the least normal number.
            4 => [number(x, 0, 70), number(y, 40, 60), number(z, 0, 40)],
            5 => [x >> (x & 31), y >> (y & 31), z >> (z & 31)],
            6 => [x, y, z].map(|word| ((word as i32 >> 16) as f32 / 8.0).to_bits()),
            _ => [x, y, z].map(|word| match word % 3 {
                0 => number(word, 125, 5),
                _ => SPECIAL[(word >> 8) as usize % SPECIAL.len()],
            }),
        }
    };
    (0..CASES).map(triple).collect()
}

/// Columns of a program's inputs at `points` random points, those of different `seed`s differ.
pub(crate) fn sample_points(program: &Program, inputs: &[u32], points: usize, seed: u32) -> Vec<u32> {
    let kinds: Vec<FieldType> =
        POINT_FIELDS.iter().flat_map(|field| std::iter::repeat_n(field.kind, field.kind.numbers())).collect();
    let seed = mix(seed ^ program.code.registers);
    let random = |scalar: u32, point: usize| {
        mix(mix(point as u32 ^ seed).wrapping_add(0x85eb_ca6bu32.wrapping_mul(scalar)))
    };
    let word = |column: usize, point: usize| {
        let (scalar, bits) = (inputs[column], random(column as u32, point));
        match kinds.get(scalar as usize) {
            Some(FieldType::Bool) => 0u32.wrapping_sub(bits & 1),
            Some(FieldType::U32) => bits >> (bits & 31),
            // From 2^-12 to 2^8, of either sign.
            Some(_) => number(mix(bits), 115, 20),
            None => {
                let unit =
                    |i: usize| (random((kinds.len() + i) as u32, point) >> 8) as f32 / (1 << 24) as f32;
                asked(scalar as usize - kinds.len(), unit).to_bits()
            }
        }
    };
    (0..inputs.len()).flat_map(|column| (0..points).map(move |point| word(column, point))).collect()
}

/// A scalar of what a BSDF is asked, made of random numbers in [0, 1): directions of about unit length, `wo` above the
/// surface.
fn asked(scalar: usize, unit: impl Fn(usize) -> f32) -> f32 {
    let around = |i: usize| 2.0 * unit(i) - 1.0;
    match scalar {
        0..6 => {
            let first = scalar - scalar % 3;
            let length = [0, 1, 2].map(|i| around(first + i) * around(first + i)).iter().sum::<f32>().sqrt();
            let component = around(scalar) / length.max(1e-3);
            if scalar == 2 { component.abs() } else { component }
        }
        _ => unit(scalar),
    }
}
