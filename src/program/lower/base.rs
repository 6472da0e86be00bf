//! Calls of `base`: the finish of the material that has the shader. Its scalars are inputs behind those of the point.

use super::{Lowerer, Scalar, Value};
use crate::program::kernel::first_scalar;
use crate::program::source::Fault;
use crate::scene::{BlockColumns, POINT_FIELDS};
use naga::{Function, Handle, Span};
use std::rc::Rc;

/// The function of the prelude.
pub(super) const BASE: &str = "base";

/// Meaning of `base` in a shader.
#[derive(Clone, Copy, Debug)]
pub(in crate::program) enum Base<'m> {
    /// There is none.
    Refused,
    /// The material is not known: what the prelude says.
    Unknown,
    /// The words of those scalars that are the same all over the material.
    Of(&'m [Option<u32>]),
}

impl Lowerer<'_> {
    /// A call of `base`.
    pub(super) fn call_base(
        &mut self,
        function: Handle<Function>,
        values: Vec<Value>,
    ) -> Result<Rc<[Scalar]>, Fault> {
        if matches!(self.input.base, Base::Refused) {
            return Err(Fault::new(
                Span::UNDEFINED,
                "`base` is the finish of a material in whose place a pattern or a BSDF stands; there is none here",
                "call it in `pattern` or `prepare`",
            ));
        }
        let point = match values.first() {
            Some(Value::Scalars(point)) => Rc::clone(point),
            _ => [].into(),
        };
        let given = self.code.inputs.iter().take(BlockColumns::POINT);
        if !given.map(|&(_, register)| Scalar::Column(register)).eq(point.iter().copied()) {
            return Err(Fault::new(
                Span::UNDEFINED,
                "`base` asks for another point than the shader's",
                "hand on the argument of `pattern` or `prepare` as it is",
            ));
        }
        self.asks_base = true;
        let Base::Of(words) = self.input.base else { return self.inline(function, values) };
        // The normals of a material are those of the point.
        let normal = first_scalar(POINT_FIELDS, "normal");
        let of_finish = first_scalar(crate::scene::FINISH_FIELDS, "normal");
        let mut scalars = Vec::with_capacity(words.len());
        for (i, word) in words.iter().enumerate() {
            scalars.push(match *word {
                Some(word) => Scalar::Word(word),
                None if (of_finish..of_finish + 3).contains(&i) => point[normal + i - of_finish],
                None => self.base_scalar((BlockColumns::POINT + i) as u32),
            });
        }
        Ok(scalars.into())
    }

    /// The input of this number.
    fn base_scalar(&mut self, number: u32) -> Scalar {
        let known = self.code.inputs.iter().find(|&&(input, _)| input == number);
        if let Some(&(_, register)) = known {
            return Scalar::Column(register);
        }
        let register = self.register();
        self.code.inputs.push((number, register));
        Scalar::Column(register)
    }
}
