//! The operations of programs: each is one operation of IEEE 754 binary32 or of 32-bit integers on words.
//!
//! The table below is the only definition. It gives the enumeration, the folding of constants and the loops of the
//! executor, so they cannot differ. Truth values are words: all bits or none. `docs/design/wgsl-arithmetic.md` says
//! what the operations do with NaN, infinities, subnormals and out-of-range conversions.

use crate::lanes::{for_pairs, for_pairs_mut};
use std::cell::Cell;

/// The number that a word is.
#[inline(always)]
fn n(word: u32) -> f32 {
    f32::from_bits(word)
}

/// The word of a number.
#[inline(always)]
fn w(number: f32) -> u32 {
    number.to_bits()
}

/// The signed integer that a word is.
#[inline(always)]
fn i(word: u32) -> i32 {
    word as i32
}

/// The word of a truth value.
#[inline(always)]
fn t(truth: bool) -> u32 {
    if truth { u32::MAX } else { 0 }
}

/// Calls a macro with the table of operations: name, operands, meaning.
macro_rules! with_operations {
    ($use:ident $($more:tt)*) => {
        $use! {
            $($more)*
            // Words.
            Copy(a) "a" => a;
            Not(a) "every bit of a inverted" => !a;
            And(a, b) "a & b" => a & b;
            AndNot(a, b) "a & !b" => a & !b;
            Or(a, b) "a | b" => a | b;
            Xor(a, b) "a ^ b" => a ^ b;
            Select(a, b, c) "b where a is true, else c" => (b & a) | (c & !a);
            // Numbers.
            Add(a, b) "a + b" => w(n(a) + n(b));
            Sub(a, b) "a - b" => w(n(a) - n(b));
            Mul(a, b) "a * b" => w(n(a) * n(b));
            Div(a, b) "a / b" => w(n(a) / n(b));
            Neg(a) "-a" => a ^ 0x8000_0000;
            Abs(a) "|a|" => a & 0x7fff_ffff;
            Sqrt(a) "square root" => w(n(a).sqrt());
            Floor(a) "greatest integer not above a" => w(n(a).floor());
            Ceil(a) "least integer not below a" => w(n(a).ceil());
            Trunc(a) "a without its fraction" => w(n(a).trunc());
            Round(a) "nearest integer, ties to even" => w(n(a).round_ties_even());
            Min(a, b) "a if a < b, else b" => if n(a) < n(b) { a } else { b };
            Max(a, b) "a if a > b, else b" => if n(a) > n(b) { a } else { b };
            Less(a, b) "a < b" => t(n(a) < n(b));
            LessEqual(a, b) "a <= b" => t(n(a) <= n(b));
            Equal(a, b) "a == b" => t(n(a) == n(b));
            // Pairs of operations on numbers: each still rounds by itself.
            MulAdd(a, b, c) "(a * b) + c" => w(n(a) * n(b) + n(c));
            MulSub(a, b, c) "(a * b) - c" => w(n(a) * n(b) - n(c));
            SubMul(a, b, c) "c - (a * b)" => w(n(c) - n(a) * n(b));
            ScaledSum(a, b, c) "(a + b) * c" => w((n(a) + n(b)) * n(c));
            ScaledDifference(a, b, c) "(a - b) * c" => w((n(a) - n(b)) * n(c));
            MulMul(a, b, c) "(a * b) * c" => w(n(a) * n(b) * n(c));
            AddAdd(a, b, c) "(a + b) + c" => w(n(a) + n(b) + n(c));
            Lerp(a, b, c) "a + ((b - a) * c)" => w(n(a) + (n(b) - n(a)) * n(c));
            Clamp(a, b, c) "min(max(a, b), c)" => {
                let raised = if n(a) > n(b) { a } else { b };
                if n(raised) < n(c) { raised } else { c }
            };
            // Pairs of operations on integers.
            MulXor(a, b, c) "(a * b) ^ c" => a.wrapping_mul(b) ^ c;
            XorMul(a, b, c) "(a ^ b) * c" => (a ^ b).wrapping_mul(c);
            ShrXor(a, b, c) "(a >> (b mod 32)) ^ c" => a.wrapping_shr(b) ^ c;
            // Integers.
            AddInt(a, b) "a + b, wrapping" => a.wrapping_add(b);
            SubInt(a, b) "a - b, wrapping" => a.wrapping_sub(b);
            MulInt(a, b) "a * b, wrapping" => a.wrapping_mul(b);
            DivUint(a, b) "a / b; a where b is 0" => a.checked_div(b).unwrap_or(a);
            RemUint(a, b) "a % b; 0 where b is 0" => a.checked_rem(b).unwrap_or(0);
            DivSint(a, b) "a / b; a where b is 0 or the quotient does not fit" =>
                i(a).checked_div(i(b)).unwrap_or(i(a)) as u32;
            RemSint(a, b) "a % b with the sign of a; 0 where a / b is undefined" =>
                i(a).checked_rem(i(b)).unwrap_or(0) as u32;
            Shl(a, b) "a << (b mod 32)" => a.wrapping_shl(b);
            ShrUint(a, b) "a >> (b mod 32), zeros enter" => a.wrapping_shr(b);
            ShrSint(a, b) "a >> (b mod 32), the sign enters" => i(a).wrapping_shr(b) as u32;
            LessUint(a, b) "a < b" => t(a < b);
            LessSint(a, b) "a < b" => t(i(a) < i(b));
            EqualInt(a, b) "a == b" => t(a == b);
            CountOnes(a) "number of bits that are 1" => a.count_ones();
            LeadingZeros(a) "number of zeros before the highest 1" => a.leading_zeros();
            TrailingZeros(a) "number of zeros after the lowest 1" => a.trailing_zeros();
            ReverseBits(a) "bits in reverse order" => a.reverse_bits();
            // Conversions.
            SintToNumber(a) "nearest number, ties to even" => w(i(a) as f32);
            UintToNumber(a) "nearest number, ties to even" => w(a as f32);
            NumberToSint(a) "truncated and clamped to the range; 0 for NaN" => (n(a) as i32) as u32;
            NumberToUint(a) "truncated and clamped to the range; 0 for NaN" => n(a) as u32;
        }
    };
}

macro_rules! define {
    ($($name:ident($($operand:ident),*) $doc:literal => $meaning:expr;)*) => {
        /// Function of its operands that an operation computes.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum Operation {
            $(#[doc = concat!("`", $doc, "`")] $name,)*
        }

        impl Operation {
            /// The result for these operands; those beyond the operation's number are ignored.
            #[allow(unused_variables, reason = "operations of fewer operands")]
            pub fn of(self, [a, b, c]: [u32; 3]) -> u32 {
                match self {
                    $(Self::$name => operation!(($($operand),*), (a, b, c), $meaning),)*
                }
            }

            /// Its meaning, in words.
            #[cfg(feature = "gpu")]
            pub fn meaning(self) -> &'static str {
                match self {
                    $(Self::$name => $doc,)*
                }
            }

            /// Number of operands.
            pub fn operands(self) -> usize {
                match self {
                    $(Self::$name => [$(stringify!($operand)),*].len(),)*
                }
            }
        }
    };
}

/// The meaning of an operation with its operands bound.
macro_rules! operation {
    (($x:ident), ($a:ident, $b:ident, $c:ident), $meaning:expr) => {{
        let $x = $a;
        $meaning
    }};
    (($x:ident, $y:ident), ($a:ident, $b:ident, $c:ident), $meaning:expr) => {{
        let ($x, $y) = ($a, $b);
        $meaning
    }};
    (($x:ident, $y:ident, $z:ident), ($a:ident, $b:ident, $c:ident), $meaning:expr) => {{
        let ($x, $y, $z) = ($a, $b, $c);
        $meaning
    }};
}

with_operations!(define);

/// Operands in chunks, as the executor's loops read them.
pub(super) const CHUNK: usize = crate::lanes::MAX_LANES;

/// A register as operations read it: a column of words, or one chunk that stands for all.
#[derive(Clone, Copy, Debug)]
pub(super) struct Operand<'a> {
    /// At least [`CHUNK`] words.
    pub words: &'a [Cell<u32>],
    /// All bits of a point's index for a column, none for one chunk.
    pub mask: usize,
}

impl Operand<'_> {
    /// The words of a chunk that starts at a point.
    #[inline(always)]
    fn chunk(self, start: usize) -> [u32; CHUNK] {
        let start = start & self.mask;
        let mut words = [0; CHUNK];
        for_pairs_mut(&mut words, &self.words[start..start + CHUNK], |word, cell| *word = cell.get());
        words
    }

    /// The word of a point.
    #[inline(always)]
    pub fn at(self, point: usize) -> u32 {
        self.words[point & (self.mask | (CHUNK - 1))].get()
    }

    /// Some words from a point on; no chunk may end among them.
    #[inline(always)]
    pub fn some(&self, start: usize, count: usize) -> &[Cell<u32>] {
        &self.words[start & (self.mask | (CHUNK - 1))..][..count]
    }
}

macro_rules! chunks {
    ($($name:ident($($operand:ident),*) $doc:literal => $meaning:expr;)*) => {
        impl Operation {
            /// The results of all points, a chunk at a time. It is compiled into vector instructions wherever it is
            /// inlined.
            #[inline(always)]
            #[allow(unused_variables, reason = "operations of fewer operands")]
            pub(super) fn chunks(self, operands: [Operand<'_>; 3], to: &[Cell<u32>]) {
                let [from_a, from_b, from_c] = operands;
                match self {
                    $(Self::$name => {
                        for (chunk, to) in to.chunks_exact(CHUNK).enumerate() {
                            let start = chunk * CHUNK;
                            chunk_loop!(($($operand),*), (from_a, from_b, from_c), to, start, $meaning);
                        }
                    })*
                }
            }
        }
    };
}

/// Reads a chunk of each operand, computes, and writes the results.
macro_rules! chunk_loop {
    (($($operand:ident),*), ($a:ident, $b:ident, $c:ident), $to:ident, $start:ident, $meaning:expr) => {{
        let mut results = [0u32; CHUNK];
        let columns = chunk_columns!(($($operand),*), ($a, $b, $c), $start);
        for lane in 0..CHUNK {
            chunk_bind!(($($operand),*), columns, lane);
            results[lane] = $meaning;
        }
        for_pairs($to, &results, |to, &result| to.set(result));
    }};
}

macro_rules! chunk_columns {
    (($x:ident), ($a:ident, $b:ident, $c:ident), $start:ident) => {
        [$a.chunk($start)]
    };
    (($x:ident, $y:ident), ($a:ident, $b:ident, $c:ident), $start:ident) => {
        [$a.chunk($start), $b.chunk($start)]
    };
    (($x:ident, $y:ident, $z:ident), ($a:ident, $b:ident, $c:ident), $start:ident) => {
        [$a.chunk($start), $b.chunk($start), $c.chunk($start)]
    };
}

macro_rules! chunk_bind {
    (($x:ident), $columns:ident, $lane:ident) => {
        let $x = $columns[0][$lane];
    };
    (($x:ident, $y:ident), $columns:ident, $lane:ident) => {
        let ($x, $y) = ($columns[0][$lane], $columns[1][$lane]);
    };
    (($x:ident, $y:ident, $z:ident), $columns:ident, $lane:ident) => {
        let ($x, $y, $z) = ($columns[0][$lane], $columns[1][$lane], $columns[2][$lane]);
    };
}

with_operations!(chunks);
