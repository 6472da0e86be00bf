//! The variable of vertex attributes, whose scalars are inputs.

use super::{Lowerer, Scalar};
use crate::program::attribute::{FIRST_INPUT, STRUCT, requests};
use crate::program::source::Fault;
use naga::{GlobalVariable, Handle, Type};
use std::rc::Rc;

impl Lowerer<'_> {
    /// The value of the variable of vertex attributes at the points; `zeros` if its type has another name.
    ///
    /// # Errors
    /// When a member is no number and no vector of numbers, or there are no points here.
    pub(super) fn vertex_attributes(
        &mut self,
        handle: Handle<GlobalVariable>,
        ty: &Type,
        zeros: Rc<[Scalar]>,
    ) -> Result<Rc<[Scalar]>, Fault> {
        if ty.name.as_deref() != Some(STRUCT) {
            return Ok(zeros);
        }
        let module = self.input.module;
        let span = module.global_variables.get_span(handle);
        if self.input.host.is_some() {
            return Err(Fault::new(
                span,
                "an integrator reads no vertex attributes",
                "read them in a pattern or a BSDF: `bsdf_evaluate` and `at.colour` know what it says there",
            ));
        }
        requests(module, ty).map_err(|fault| fault.at(span))?;
        if let Some(value) = &self.attributes {
            return Ok(Rc::clone(value));
        }
        let mut value = Vec::with_capacity(zeros.len());
        for number in 0..zeros.len() as u32 {
            let register = self.register();
            self.code.inputs.push((FIRST_INPUT + number, register));
            value.push(Scalar::Column(register));
        }
        let value: Rc<[Scalar]> = value.into();
        self.attributes = Some(Rc::clone(&value));
        Ok(value)
    }
}
