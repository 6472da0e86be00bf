//! Built-in functions, written out as operations in the order that `docs/design/wgsl-arithmetic.md` states.

use super::shape::{size, unsupported};
use super::{Lowerer, Scalar};
use crate::program::operation::Operation as O;
use crate::program::source::Fault;
use naga::{Expression, Handle, MathFunction as M, ScalarKind, TypeInner};
use std::borrow::Borrow;
use std::rc::Rc;

/// The function of the prelude that computes each component of a built-in function.
fn component_function(fun: M, kind: ScalarKind) -> Option<&'static str> {
    let is_signed = kind == ScalarKind::Sint;
    Some(match fun {
        M::Sin => "sin_of",
        M::Cos => "cos_of",
        M::Tan => "tan_of",
        M::Asin => "asin_of",
        M::Acos => "acos_of",
        M::Atan => "atan_of",
        M::Atan2 => "atan2_of",
        M::Sinh => "sinh_of",
        M::Cosh => "cosh_of",
        M::Tanh => "tanh_of",
        M::Asinh => "asinh_of",
        M::Acosh => "acosh_of",
        M::Atanh => "atanh_of",
        M::Exp => "exp_of",
        M::Exp2 => "exp2_of",
        M::Log => "log_of",
        M::Log2 => "log2_of",
        M::Pow => "pow_of",
        M::Ldexp => "ldexp_of",
        M::QuantizeToF16 => "quantize_to_half_of",
        M::ExtractBits if is_signed => "extract_signed_of",
        M::ExtractBits => "extract_unsigned_of",
        M::InsertBits => "insert_of",
        M::FirstLeadingBit if is_signed => "first_leading_signed_of",
        M::FirstLeadingBit => "first_leading_unsigned_of",
        M::FirstTrailingBit => "first_trailing_of",
        _ => return None,
    })
}

/// The function of the prelude that computes a built-in function as a whole.
fn whole_function(fun: M) -> Option<&'static str> {
    Some(match fun {
        M::Pack4x8snorm => "pack4x8snorm_of",
        M::Pack4x8unorm => "pack4x8unorm_of",
        M::Pack2x16snorm => "pack2x16snorm_of",
        M::Pack2x16unorm => "pack2x16unorm_of",
        M::Pack2x16float => "pack2x16float_of",
        M::Pack4xI8 | M::Pack4xU8 => "pack4x_integer_of",
        M::Pack4xI8Clamp => "pack4x_signed_clamp_of",
        M::Pack4xU8Clamp => "pack4x_unsigned_clamp_of",
        M::Unpack4x8snorm => "unpack4x8snorm_of",
        M::Unpack4x8unorm => "unpack4x8unorm_of",
        M::Unpack2x16snorm => "unpack2x16snorm_of",
        M::Unpack2x16unorm => "unpack2x16unorm_of",
        M::Unpack2x16float => "unpack2x16float_of",
        M::Unpack4xI8 => "unpack4x_signed_of",
        M::Unpack4xU8 => "unpack4x_unsigned_of",
        M::Dot4I8Packed => "dot4_signed_of",
        M::Dot4U8Packed => "dot4_unsigned_of",
        _ => return None,
    })
}

impl Lowerer<'_> {
    /// A built-in function.
    pub(super) fn math(
        &mut self,
        fun: M,
        first: Handle<Expression>,
        operands: &[Rc<[Scalar]>],
    ) -> Result<Rc<[Scalar]>, Fault> {
        let kind = self.kind(first)?;
        let [a, rest @ ..] = operands else { return Err(unsupported("functions without arguments")) };
        let b = rest.first().unwrap_or(a);
        let c = rest.get(1).unwrap_or(b);
        Ok(match fun {
            M::Dot => [self.dot(kind, a, b)].into(),
            M::Cross => self.cross(a, b),
            M::Length => [self.length(a)].into(),
            M::Distance => {
                let difference = self.differences(a, b);
                [self.length(&difference)].into()
            }
            M::Normalize => {
                let length = self.length(a);
                let inverse = self.compute(O::Div, &[Scalar::number(1.0), length]);
                a.iter().map(|&x| self.compute(O::Mul, &[x, inverse])).collect()
            }
            M::FaceForward => {
                let side = self.dot(kind, b, c);
                let forward = self.compute(O::Less, &[side, Scalar::Word(0)]);
                a.iter().map(|&x| self.with_sign_where(forward, x)).collect()
            }
            M::Reflect => {
                let twice = self.dot(kind, a, b);
                let twice = self.compute(O::Mul, &[Scalar::number(2.0), twice]);
                let moved = |me: &mut Self, i: usize| {
                    let along = me.compute(O::Mul, &[twice, b[i]]);
                    me.compute(O::Sub, &[a[i], along])
                };
                (0..a.len()).map(|i| moved(self, i)).collect()
            }
            M::Refract => self.refract(a, b, c[0]),
            M::Transpose => self.transposed(first, a)?,
            M::Determinant => [self.determinant(first, a)?].into(),
            M::Inverse | M::Outer => return Err(unsupported("inverses and outer products")),
            M::Modf => {
                let whole: Vec<Scalar> = a.iter().map(|&x| self.compute(O::Trunc, &[x])).collect();
                let rest = self.differences(a, &whole);
                rest.into_iter().chain(whole).collect()
            }
            M::Frexp => {
                let mantissas = self.each_component("mantissa_of", &[a])?;
                let exponents = self.each_component("exponent_of", &[a])?;
                mantissas.iter().chain(&*exponents).copied().collect()
            }
            _ if let Some(name) = component_function(fun, kind) => self.each_component(name, operands)?,
            _ if let Some(name) = whole_function(fun) => {
                self.call_prelude(name, operands.iter().map(Rc::clone).collect())?
            }
            _ => {
                let at = |scalars: &Rc<[Scalar]>, i: usize| scalars[if scalars.len() == 1 { 0 } else { i }];
                let mut results = Vec::with_capacity(a.len());
                for i in 0..a.len() {
                    results.push(self.math_scalar(fun, kind, [at(a, i), at(b, i), at(c, i)])?);
                }
                results.into()
            }
        })
    }

    /// A function of the prelude, component by component; single numbers go with each component.
    fn each_component(
        &mut self,
        name: &str,
        operands: &[impl Borrow<Rc<[Scalar]>>],
    ) -> Result<Rc<[Scalar]>, Fault> {
        let count = operands[0].borrow().len();
        let mut results = Vec::with_capacity(count);
        for i in 0..count {
            let at = |scalars: &Rc<[Scalar]>| Rc::from([scalars[if scalars.len() == 1 { 0 } else { i }]]);
            let arguments = operands.iter().map(|operand| at(operand.borrow())).collect();
            results.extend_from_slice(&self.call_prelude(name, arguments)?);
        }
        Ok(results.into())
    }

    /// The determinant of a matrix, by its first column.
    fn determinant(&mut self, first: Handle<Expression>, a: &[Scalar]) -> Result<Scalar, Fault> {
        let TypeInner::Matrix { columns, .. } = self.inner(first) else {
            return Err(unsupported("determinants of this type"));
        };
        let n = size(columns) as usize;
        let columns: Vec<&[Scalar]> = a.chunks(n).collect();
        Ok(self.minor(&columns, &(0..n).collect::<Vec<_>>()))
    }

    /// The determinant of some columns at some rows.
    fn minor(&mut self, columns: &[&[Scalar]], rows: &[usize]) -> Scalar {
        let ([first, rest @ ..], false) = (columns, rows.len() == 1) else { return columns[0][rows[0]] };
        let mut sum = None;
        for (at, &row) in rows.iter().enumerate() {
            let others: Vec<usize> = rows.iter().copied().filter(|&other| other != row).collect();
            let minor = self.minor(rest, &others);
            let product = self.compute(O::Mul, &[first[row], minor]);
            let operation = if at % 2 == 0 { O::Add } else { O::Sub };
            sum = Some(sum.map_or(product, |sum| self.compute(operation, &[sum, product])));
        }
        sum.unwrap_or(Scalar::Word(0))
    }

    /// A function that works component by component.
    fn math_scalar(&mut self, fun: M, kind: ScalarKind, [a, b, c]: [Scalar; 3]) -> Result<Scalar, Fault> {
        let one = Scalar::number(1.0);
        Ok(match fun {
            M::Abs | M::Min | M::Max | M::Clamp | M::Sign => self.ordered(fun, kind, [a, b, c]),
            M::Saturate => self.clamped([a, Scalar::Word(0), one]),
            M::Ceil => self.compute(O::Ceil, &[a]),
            M::Floor => self.compute(O::Floor, &[a]),
            M::Round => self.compute(O::Round, &[a]),
            M::Trunc => self.compute(O::Trunc, &[a]),
            M::Fract => {
                let floor = self.compute(O::Floor, &[a]);
                self.compute(O::Sub, &[a, floor])
            }
            M::Sqrt => self.compute(O::Sqrt, &[a]),
            M::InverseSqrt => {
                let root = self.compute(O::Sqrt, &[a]);
                self.compute(O::Div, &[one, root])
            }
            M::Fma => {
                let product = self.compute(O::Mul, &[a, b]);
                self.compute(O::Add, &[product, c])
            }
            M::Mix => {
                let difference = self.compute(O::Sub, &[b, a]);
                let part = self.compute(O::Mul, &[difference, c]);
                self.compute(O::Add, &[a, part])
            }
            M::Step => {
                let reached = self.compute(O::LessEqual, &[a, b]);
                self.compute(O::And, &[reached, one])
            }
            M::SmoothStep => self.smooth_step(a, b, c),
            M::Radians => self.compute(O::Mul, &[a, Scalar::number(std::f32::consts::PI / 180.0)]),
            M::Degrees => self.compute(O::Mul, &[a, Scalar::number(180.0 / std::f32::consts::PI)]),
            M::CountOneBits => self.compute(O::CountOnes, &[a]),
            M::CountLeadingZeros => self.compute(O::LeadingZeros, &[a]),
            M::CountTrailingZeros => self.compute(O::TrailingZeros, &[a]),
            M::ReverseBits => self.compute(O::ReverseBits, &[a]),
            other => return Err(unsupported(format!("function like {other:?}"))),
        })
    }

    fn ordered(&mut self, fun: M, kind: ScalarKind, [a, b, c]: [Scalar; 3]) -> Scalar {
        if kind == ScalarKind::Float {
            return match fun {
                M::Abs => self.compute(O::Abs, &[a]),
                M::Min => self.compute(O::Min, &[a, b]),
                M::Max => self.compute(O::Max, &[a, b]),
                M::Clamp => self.clamped([a, b, c]),
                _ => {
                    let positive = self.compute(O::Less, &[Scalar::Word(0), a]);
                    let negative = self.compute(O::Less, &[a, Scalar::Word(0)]);
                    let sign = self.compute(O::Select, &[positive, Scalar::number(1.0), Scalar::Word(0)]);
                    self.compute(O::Select, &[negative, Scalar::number(-1.0), sign])
                }
            };
        }
        let less = if kind == ScalarKind::Sint { O::LessSint } else { O::LessUint };
        match fun {
            M::Min => self.chosen(less, a, b, a, b),
            M::Max => self.chosen(less, b, a, a, b),
            M::Clamp => {
                let low = self.chosen(less, a, b, b, a);
                self.chosen(less, c, low, c, low)
            }
            M::Abs if kind == ScalarKind::Sint => {
                let negated = self.compute(O::SubInt, &[Scalar::Word(0), a]);
                self.chosen(less, a, Scalar::Word(0), negated, a)
            }
            M::Abs => a,
            _ => {
                let positive = self.compute(less, &[Scalar::Word(0), a]);
                let negative = self.compute(less, &[a, Scalar::Word(0)]);
                let one = self.compute(O::And, &[positive, Scalar::Word(1)]);
                self.compute(O::Or, &[one, negative])
            }
        }
    }

    /// `then` where `x < y`, else `other`.
    fn chosen(&mut self, less: O, x: Scalar, y: Scalar, then: Scalar, other: Scalar) -> Scalar {
        let condition = self.compute(less, &[x, y]);
        self.compute(O::Select, &[condition, then, other])
    }

    /// `min(max(a, low), high)`.
    fn clamped(&mut self, [a, low, high]: [Scalar; 3]) -> Scalar {
        let raised = self.compute(O::Max, &[a, low]);
        self.compute(O::Min, &[raised, high])
    }

    fn smooth_step(&mut self, low: Scalar, high: Scalar, x: Scalar) -> Scalar {
        let (above, range) = (self.compute(O::Sub, &[x, low]), self.compute(O::Sub, &[high, low]));
        let share = self.compute(O::Div, &[above, range]);
        let t = self.clamped([share, Scalar::Word(0), Scalar::number(1.0)]);
        let twice = self.compute(O::Mul, &[Scalar::number(2.0), t]);
        let rest = self.compute(O::Sub, &[Scalar::number(3.0), twice]);
        let square = self.compute(O::Mul, &[t, t]);
        self.compute(O::Mul, &[square, rest])
    }

    fn with_sign_where(&mut self, keeps: Scalar, x: Scalar) -> Scalar {
        let negated = self.compute(O::Neg, &[x]);
        self.compute(O::Select, &[keeps, x, negated])
    }

    fn dot(&mut self, kind: ScalarKind, a: &[Scalar], b: &[Scalar]) -> Scalar {
        let (mul, add) = if kind == ScalarKind::Float { (O::Mul, O::Add) } else { (O::MulInt, O::AddInt) };
        let mut sum = self.compute(mul, &[a[0], b[0]]);
        for (&a, &b) in a.iter().zip(b).skip(1) {
            let product = self.compute(mul, &[a, b]);
            sum = self.compute(add, &[sum, product]);
        }
        sum
    }

    fn cross(&mut self, a: &[Scalar], b: &[Scalar]) -> Rc<[Scalar]> {
        let mut minor = |i: usize, j: usize| {
            let (left, right) = (self.compute(O::Mul, &[a[i], b[j]]), self.compute(O::Mul, &[a[j], b[i]]));
            self.compute(O::Sub, &[left, right])
        };
        [minor(1, 2), minor(2, 0), minor(0, 1)].into()
    }

    fn differences(&mut self, a: &[Scalar], b: &[Scalar]) -> Vec<Scalar> {
        a.iter().zip(b).map(|(&a, &b)| self.compute(O::Sub, &[a, b])).collect()
    }

    fn length(&mut self, a: &[Scalar]) -> Scalar {
        if let [a] = a {
            return self.compute(O::Abs, &[*a]);
        }
        let square = self.dot(ScalarKind::Float, a, a);
        self.compute(O::Sqrt, &[square])
    }

    fn refract(&mut self, a: &[Scalar], n: &[Scalar], eta: Scalar) -> Rc<[Scalar]> {
        let one = Scalar::number(1.0);
        let cosine = self.dot(ScalarKind::Float, n, a);
        let square = self.compute(O::Mul, &[cosine, cosine]);
        let sine2 = self.compute(O::Sub, &[one, square]);
        let eta2 = self.compute(O::Mul, &[eta, eta]);
        let bent = self.compute(O::Mul, &[eta2, sine2]);
        let k = self.compute(O::Sub, &[one, bent]);
        let total = self.compute(O::Less, &[k, Scalar::Word(0)]);
        let root = self.compute(O::Sqrt, &[k]);
        let along = self.compute(O::Mul, &[eta, cosine]);
        let along = self.compute(O::Add, &[along, root]);
        let mut part = |i: usize| {
            let (scaled, back) = (self.compute(O::Mul, &[eta, a[i]]), self.compute(O::Mul, &[along, n[i]]));
            let direction = self.compute(O::Sub, &[scaled, back]);
            self.compute(O::Select, &[total, Scalar::Word(0), direction])
        };
        (0..a.len()).map(&mut part).collect()
    }

    fn transposed(&mut self, first: Handle<Expression>, a: &[Scalar]) -> Result<Rc<[Scalar]>, Fault> {
        let TypeInner::Matrix { columns, rows, .. } = self.inner(first) else {
            return Err(unsupported("transposes of this type"));
        };
        let (columns, rows) = (size(columns) as usize, size(rows) as usize);
        Ok((0..columns * rows).map(|i| a[i % columns * rows + i / columns]).collect())
    }

    /// A product with a matrix; `None` if neither operand is one, or one is a number.
    pub(super) fn matrix_product(
        &mut self,
        (a_inner, a): (&TypeInner, &[Scalar]),
        (b_inner, b): (&TypeInner, &[Scalar]),
    ) -> Option<Rc<[Scalar]>> {
        // Rows of the left and columns of the right factor.
        let (rows, inner) = match a_inner {
            TypeInner::Matrix { columns, rows, .. } => (size(*rows) as usize, size(*columns) as usize),
            TypeInner::Vector { size: n, .. } => (1, size(*n) as usize),
            _ => return None,
        };
        let columns = match b_inner {
            TypeInner::Matrix { columns, .. } => size(*columns) as usize,
            TypeInner::Vector { .. } => 1,
            _ => return None,
        };
        if !matches!(a_inner, TypeInner::Matrix { .. }) && !matches!(b_inner, TypeInner::Matrix { .. }) {
            return None;
        }
        let mut product = Vec::with_capacity(rows * columns);
        for column in 0..columns {
            for row in 0..rows {
                let left: Vec<Scalar> = (0..inner).map(|k| a[k * rows + row]).collect();
                product.push(self.dot(ScalarKind::Float, &left, &b[column * inner..][..inner]));
            }
        }
        Some(product.into())
    }
}
