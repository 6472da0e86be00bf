//! Shapes of types: how many scalars a value has, and where its parts are.

use super::{Fault, Lowerer};
use naga::{ArraySize, ScalarKind, Span, TypeInner, VectorSize};

/// The most scalars of a variable.
const MOST_SCALARS: u32 = 1 << 10;

/// A part of a value.
pub(super) struct Part {
    /// The first scalar of part 0.
    pub offset: u32,
    /// Scalars from one part to the next.
    pub stride: u32,
    /// Number of parts.
    pub count: u32,
    /// Type of the part.
    pub inner: TypeInner,
}

pub(super) fn unsupported(what: impl std::fmt::Display) -> Fault {
    Fault::new(
        Span::UNDEFINED,
        format!("programs have no {what}"),
        "use f32, i32, u32, bool, vectors, matrices, structs and arrays of a constant size",
    )
}

/// Number of components.
pub(super) fn size(size: VectorSize) -> u32 {
    size as u32
}

impl Lowerer<'_> {
    /// Number of scalars of a value.
    pub(super) fn width(&self, inner: &TypeInner) -> Result<u32, Fault> {
        let width = match inner {
            TypeInner::Scalar(scalar)
            | TypeInner::Vector { scalar, .. }
            | TypeInner::Matrix { scalar, .. }
                if scalar.kind != ScalarKind::Bool && scalar.width != 4 =>
            {
                return Err(unsupported(format!("{}-bit numbers", 8 * u32::from(scalar.width))));
            }
            TypeInner::Scalar(_) => 1,
            TypeInner::Vector { size: n, .. } => size(*n),
            TypeInner::Matrix { columns, rows, .. } => size(*columns) * size(*rows),
            TypeInner::Array { base, size: ArraySize::Constant(count), .. } => {
                let width = self.width(&self.input.module.types[*base].inner)?;
                width.saturating_mul(count.get())
            }
            TypeInner::Struct { members, .. } => {
                let mut sum = 0u32;
                for member in members {
                    sum = sum.saturating_add(self.width(&self.input.module.types[member.ty].inner)?);
                }
                sum
            }
            TypeInner::Array { .. } => return Err(unsupported("arrays without a constant size")),
            _ => return Err(unsupported("textures, samplers, atomics and pointers in variables")),
        };
        if width > MOST_SCALARS {
            return Err(unsupported(format!(
                "values of more than {MOST_SCALARS} numbers; this one has {width}"
            )));
        }
        Ok(width)
    }

    /// A part of a value of this type by its index; for structs the part of this index alone.
    pub(super) fn part(&self, inner: &TypeInner, index: u32) -> Result<Part, Fault> {
        let types = &self.input.module.types;
        Ok(match inner {
            TypeInner::Vector { size: n, scalar } => {
                Part { offset: 0, stride: 1, count: size(*n), inner: TypeInner::Scalar(*scalar) }
            }
            TypeInner::Matrix { columns, rows, scalar } => Part {
                offset: 0,
                stride: size(*rows),
                count: size(*columns),
                inner: TypeInner::Vector { size: *rows, scalar: *scalar },
            },
            TypeInner::Array { base, size: ArraySize::Constant(count), .. } => {
                let inner = types[*base].inner.clone();
                Part { offset: 0, stride: self.width(&inner)?, count: count.get(), inner }
            }
            TypeInner::Struct { members, .. } => {
                let mut offset = 0;
                for member in &members[..index as usize] {
                    offset += self.width(&types[member.ty].inner)?;
                }
                Part { offset, stride: 0, count: 1, inner: types[members[index as usize].ty].inner.clone() }
            }
            _ => return Err(unsupported("parts of this type")),
        })
    }
}
