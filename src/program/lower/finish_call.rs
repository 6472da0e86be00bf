//! Calls of the native BSDF of a finish.

use super::{Lowerer, Scalar, Value};
use crate::program::code::{Instruction, Register};
use crate::program::finish_call::{FinishFunction, FinishPlace};
use crate::program::kernel::first_scalar;
use crate::program::source::Fault;
use crate::scene::{BlockColumns, Effects, FINISH_FIELDS, POINT_FIELDS, Transmission};
use naga::Span;
use std::rc::Rc;

impl Lowerer<'_> {
    /// A call of a [`FinishFunction`].
    pub(super) fn call_finish(
        &mut self,
        function: FinishFunction,
        values: &[Value],
    ) -> Result<Rc<[Scalar]>, Fault> {
        let Some(place) = self.input.finishes else {
            return Err(Fault::new(
                Span::UNDEFINED,
                "the native BSDF of a finish can be called by a BSDF alone",
                "call it in `evaluate` or `sample`; a pattern returns the finish",
            ));
        };
        let mut scalars = Vec::new();
        for value in values {
            let Value::Scalars(more) = value else { continue };
            scalars.extend_from_slice(more);
        }
        let effects = effects(&scalars[..BlockColumns::FINISH], place);
        let outside = match effects.transmission {
            Some(Transmission::Body { .. }) => self.point_scalar(first_scalar(POINT_FIELDS, "outside")),
            _ => Scalar::truth(true),
        };
        self.scatters_through |= effects.transmission.is_some() || effects.has_diffuse_transmission;
        scalars.insert(BlockColumns::FINISH, outside);
        let operands: Vec<Register> = scalars.into_iter().map(|scalar| self.column(scalar)).collect();
        let to: Vec<Register> = (0..function.results()).map(|_| self.register()).collect();
        let start = self.code.lists.len() as u32;
        self.code.lists.extend(operands);
        let end = self.code.lists.len() as u32;
        self.code.lists.extend(&to);
        let results = end..self.code.lists.len() as u32;
        let operands = start..end;
        self.code.instructions.push(Instruction::Finish { function, effects, operands, results });
        Ok(to.into_iter().map(Scalar::Column).collect())
    }
}

/// The layers that finishes may have: those whose fields are not known to be the default. Only they are computed.
fn effects(finish: &[Scalar], place: FinishPlace) -> Effects {
    let may_be = |name: &str| {
        let field = FINISH_FIELDS.iter().find(|field| field.name == name);
        let first = first_scalar(FINISH_FIELDS, name);
        let scalars = &finish[first..first + field.map_or(0, |field| field.kind.numbers())];
        scalars.iter().any(|&scalar| scalar != Scalar::number(0.0))
    };
    Effects {
        transmission: may_be("transmission").then_some(place.transmission),
        has_anisotropy: place.has_anisotropy && may_be("anisotropy"),
        has_sheen: may_be("sheen"),
        has_film: may_be("film"),
        has_diffuse_transmission: may_be("diffuse_transmission"),
        ..Effects::default()
    }
}
