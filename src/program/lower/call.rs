//! Calls, which are inlined.

use super::base::BASE;
use super::picture;
use super::scope::Scopes;
use super::shape::unsupported;
use super::{Frame, Lowerer, Scalar, Value};
use crate::program::attribute;
use crate::program::code::{Instruction, Register};
use crate::program::finish_call::FinishFunction;
use crate::program::integrator::HostFunction;
use crate::program::native::Native;
use crate::program::parameter;
use crate::program::source::Fault;
use naga::{Expression, Function, Handle, TypeInner};
use std::rc::Rc;

impl Lowerer<'_> {
    /// Makes the module's private variables.
    pub(super) fn declare_globals(&mut self) -> Result<(), Fault> {
        let module = self.input.module;
        for (handle, global) in module.global_variables.iter() {
            let span = module.global_variables.get_span(handle);
            if self.declare_picture(handle, global)? {
                continue;
            }
            let value = match global.init {
                Some(init) => self.global_scalars(init)?,
                None => self.zeros(&module.types[global.ty].inner).map_err(|fault| fault.at(span))?,
            };
            let value = match global.name.as_deref() {
                Some(parameter::VARIABLE) => self.with_parameters(&module.types[global.ty], value)?,
                Some(attribute::VARIABLE) => {
                    self.vertex_attributes(handle, &module.types[global.ty], value)?
                }
                _ => value,
            };
            let variable = self.declare(value);
            self.globals.insert(handle, variable);
        }
        Ok(())
    }

    /// The value of the variable of parameters: those that are set replace the defaults.
    fn with_parameters(&self, ty: &naga::Type, value: Rc<[Scalar]>) -> Result<Rc<[Scalar]>, Fault> {
        let TypeInner::Struct { members, .. } = &ty.inner else { return Ok(value) };
        let mut scalars = value.to_vec();
        let mut at = 0;
        for member in members {
            let name = member.name.as_deref().unwrap_or_default();
            let width = self.width(&self.input.module.types[member.ty].inner)? as usize;
            for (i, scalar) in scalars[at..at + width].iter_mut().enumerate() {
                let set = self.input.overrides.get(&format!("{name}.{i}"));
                if let Some(&word) = set.or_else(|| self.input.overrides.get(name)) {
                    *scalar = Scalar::Word(word);
                }
            }
            at += width;
        }
        Ok(scalars.into())
    }

    pub(super) fn zeros(&self, inner: &naga::TypeInner) -> Result<Rc<[Scalar]>, Fault> {
        Ok(vec![Scalar::Word(0); self.width(inner)? as usize].into())
    }

    pub(super) fn call(
        &mut self,
        function: Handle<Function>,
        arguments: &[Handle<Expression>],
        result: Option<Handle<Expression>>,
    ) -> Result<(), Fault> {
        let values = arguments.iter().map(|&argument| self.value(argument)).collect::<Result<Vec<_>, _>>()?;
        let scalars = self.called(function, values)?;
        if let Some(result) = result {
            self.set(result, Value::Scalars(scalars));
        }
        Ok(())
    }

    /// The result of a function.
    fn called(&mut self, function: Handle<Function>, values: Vec<Value>) -> Result<Rc<[Scalar]>, Fault> {
        let name = self.input.module.functions[function].name.as_deref().unwrap_or_default();
        let native = if self.input.natives { Native::named(name) } else { None };
        let host = self.input.host.and_then(|_| HostFunction::named(name));
        if name == BASE {
            return self.call_base(function, values);
        }
        if picture::FUNCTIONS.contains(&name) {
            return self.call_image(&values);
        }
        if let Some(function) = FinishFunction::named(name) {
            return self.call_finish(function, &values);
        }
        match (native, host) {
            (Some(native), _) => Ok(self.call_native(native, &values)),
            (None, Some(host)) => self.call_host(host, function, &values),
            (None, None) => self.inline(function, values),
        }
    }

    /// The result of a function of the prelude.
    pub(super) fn call_prelude(
        &mut self,
        name: &str,
        arguments: Vec<Rc<[Scalar]>>,
    ) -> Result<Rc<[Scalar]>, Fault> {
        let mut functions = self.input.module.functions.iter();
        let Some((function, _)) = functions.find(|(_, function)| function.name.as_deref() == Some(name))
        else {
            return Err(unsupported(format!("function `{name}` without the prelude")));
        };
        self.called(function, arguments.into_iter().map(Value::Scalars).collect())
    }

    fn call_native(&mut self, native: Native, arguments: &[Value]) -> Rc<[Scalar]> {
        let mut operands = Vec::new();
        for argument in arguments {
            let Value::Scalars(scalars) = argument else { continue };
            operands.extend(scalars.iter().map(|&scalar| self.column(scalar)));
        }
        let start = self.code.lists.len() as u32;
        self.code.lists.extend(operands);
        let end = self.code.lists.len() as u32;
        let to: Vec<Register> = (0..native.results()).map(|_| self.register()).collect();
        self.code.lists.extend(&to);
        let results = end..self.code.lists.len() as u32;
        self.code.instructions.push(Instruction::Call { native, operands: start..end, results });
        to.into_iter().map(Scalar::Column).collect()
    }

    /// Lowers a function's body in place. Returns its result.
    pub(super) fn inline(
        &mut self,
        handle: Handle<Function>,
        arguments: Vec<Value>,
    ) -> Result<Rc<[Scalar]>, Fault> {
        let module = self.input.module;
        let function = &module.functions[handle];
        let entry = self.mask;
        let live = self.mask_register(entry);
        let result = match &function.result {
            Some(result) => {
                let zeros = self.zeros(&module.types[result.ty].inner)?;
                Some(self.declare(zeros))
            }
            None => None,
        };
        self.frames.push(Frame {
            function,
            info: &self.input.info[handle],
            values: vec![None; function.expressions.len()],
            arguments,
            locals: Vec::new(),
            scopes: Rc::clone(self.scopes.entry(handle).or_insert_with(|| Rc::new(Scopes::of(function)))),
            result,
            entry,
            live,
            returned: false,
            varied: false,
            exits: self.exits.len(),
        });
        for (_, local) in function.local_variables.iter() {
            let value = match local.init {
                Some(init) => self.scalars(init)?,
                None => self.zeros(&module.types[local.ty].inner)?,
            };
            let variable = self.declare(value);
            if let Some(frame) = self.frames.last_mut() {
                frame.locals.push(variable);
            }
        }
        self.block(&function.body)?;
        self.frames.pop();
        self.mask = entry;
        Ok(match result {
            Some(result) => self.value_of(result),
            None => [].into(),
        })
    }
}
