//! Expressions.

use super::shape::{size, unsupported};
use super::variable::Place;
use super::{Lowerer, Scalar, Value, VariableId};
use crate::program::operation::Operation;
use crate::program::source::Fault;
use crate::program::translation::UNFOLDED;
use naga::{
    BinaryOperator, Expression, Handle, Literal, RelationalFunction, ScalarKind, Span, TypeInner,
    UnaryOperator,
};
use std::rc::Rc;

impl<'m> Lowerer<'m> {
    /// The expression of the present function.
    fn expression(&self, handle: Handle<Expression>) -> Option<&'m Expression> {
        self.frames.last().map(|frame| &frame.function.expressions[handle])
    }

    /// The type of an expression of the present function.
    pub(super) fn inner(&self, handle: Handle<Expression>) -> TypeInner {
        let types = &self.input.module.types;
        match self.frames.last() {
            Some(frame) => frame.info[handle].ty.inner_with(types).clone(),
            None => self.input.info[handle].inner_with(types).clone(),
        }
    }

    /// The kind of an expression's scalars.
    pub(super) fn kind(&self, handle: Handle<Expression>) -> Result<ScalarKind, Fault> {
        self.inner(handle).scalar_kind().ok_or_else(|| unsupported("operators on this type"))
    }

    pub(super) fn set(&mut self, handle: Handle<Expression>, value: Value) {
        if let Some(frame) = self.frames.last_mut() {
            frame.values[handle.index()] = Some(value);
        }
    }

    /// Evaluates an expression where it stands in the program.
    pub(super) fn evaluate(&mut self, handle: Handle<Expression>) -> Result<(), Fault> {
        let value = self.compute_value(handle).map_err(|fault| match self.frames.last() {
            Some(frame) => fault.at(frame.function.expressions.get_span(handle)),
            None => fault,
        })?;
        self.set(handle, value);
        Ok(())
    }

    /// Value that an expression denotes. Literals, arguments and variables need no evaluation and are denoted at once.
    pub(super) fn value(&mut self, handle: Handle<Expression>) -> Result<Value, Fault> {
        let known = self.frames.last().and_then(|frame| frame.values[handle.index()].clone());
        match known {
            Some(value) => Ok(value),
            None => self.compute_value(handle),
        }
    }

    pub(super) fn scalars(&mut self, handle: Handle<Expression>) -> Result<Rc<[Scalar]>, Fault> {
        match self.value(handle)? {
            Value::Scalars(scalars) => Ok(scalars),
            Value::Place(place) => self.load(&place),
            Value::Picture(_) => Err(Self::no_value()),
        }
    }

    pub(super) fn scalar(&mut self, handle: Handle<Expression>) -> Result<Scalar, Fault> {
        Ok(self.scalars(handle)?[0])
    }

    pub(super) fn place(&mut self, handle: Handle<Expression>) -> Result<Place, Fault> {
        match self.value(handle)? {
            Value::Place(place) => Ok(place),
            Value::Scalars(_) | Value::Picture(_) => Err(unsupported("pointers of this kind")),
        }
    }

    /// All of a variable that an expression is assigned to.
    pub(super) fn whole(
        &self,
        variable: VariableId,
        value: Option<Handle<Expression>>,
    ) -> Result<Place, Fault> {
        let inner = value.map_or(TypeInner::Scalar(naga::Scalar::BOOL), |value| self.inner(value));
        Ok(Place { variable, offset: 0, inner, indices: Vec::new() })
    }

    fn compute_value(&mut self, handle: Handle<Expression>) -> Result<Value, Fault> {
        let Some(expression) = self.expression(handle) else { return Err(unsupported("expressions here")) };
        let scalars: Rc<[Scalar]> = match *expression {
            Expression::FunctionArgument(index) => {
                let frame = self.frames.last().ok_or_else(|| unsupported("arguments here"))?;
                return Ok(frame.arguments[index as usize].clone());
            }
            Expression::LocalVariable(local) => {
                let frame = self.frames.last().ok_or_else(|| unsupported("variables here"))?;
                let inner = self.input.module.types[frame.function.local_variables[local].ty].inner.clone();
                let variable = frame.locals[local.index()];
                return Ok(Value::Place(Place { variable, offset: 0, inner, indices: Vec::new() }));
            }
            Expression::GlobalVariable(global) => {
                if let Some(&picture) = self.pictures.get(&global) {
                    return Ok(Value::Picture(picture));
                }
                let inner =
                    self.input.module.types[self.input.module.global_variables[global].ty].inner.clone();
                let variable = *self.globals.get(&global).ok_or_else(|| unsupported("this variable"))?;
                return Ok(Value::Place(Place { variable, offset: 0, inner, indices: Vec::new() }));
            }
            Expression::Access { base, index } => {
                let index = self.scalar(index)?;
                return self.access(base, index);
            }
            Expression::AccessIndex { base, index } => return self.access(base, Scalar::Word(index)),
            Expression::Load { pointer } => {
                let place = self.place(pointer)?;
                self.load(&place)?
            }
            Expression::CallResult(_) => return Err(unsupported("results of calls that have not returned")),
            ref other => self.pure(other, false)?,
        };
        Ok(Value::Scalars(scalars))
    }

    /// The scalars of an expression outside of functions.
    pub(super) fn global_scalars(&mut self, handle: Handle<Expression>) -> Result<Rc<[Scalar]>, Fault> {
        let module = self.input.module;
        let frames = std::mem::take(&mut self.frames);
        let scalars = self.pure(&module.global_expressions[handle], true);
        self.frames = frames;
        scalars.map_err(|fault| fault.at(module.global_expressions.get_span(handle)))
    }

    /// The scalars of an operand, in or outside of a function.
    fn operand(&mut self, handle: Handle<Expression>, is_global: bool) -> Result<Rc<[Scalar]>, Fault> {
        if is_global { self.global_scalars(handle) } else { self.scalars(handle) }
    }

    /// The scalars of an expression that depends on nothing but its operands.
    fn pure(&mut self, expression: &Expression, is_global: bool) -> Result<Rc<[Scalar]>, Fault> {
        let module = self.input.module;
        Ok(match *expression {
            Expression::Literal(literal) => [literal_word(literal)?].into(),
            Expression::Constant(constant) => self.global_scalars(module.constants[constant].init)?,
            Expression::Override(handle) => self.override_scalars(handle)?,
            Expression::ZeroValue(ty) => self.zeros(&module.types[ty].inner)?,
            Expression::Compose { ref components, .. } => {
                let mut all = Vec::new();
                for &component in components {
                    all.extend_from_slice(&self.operand(component, is_global)?);
                }
                all.into()
            }
            Expression::Splat { size: n, value } => {
                let scalar = self.operand(value, is_global)?[0];
                vec![scalar; size(n) as usize].into()
            }
            Expression::Swizzle { size: n, vector, pattern } => {
                let scalars = self.operand(vector, is_global)?;
                pattern[..size(n) as usize].iter().map(|&from| scalars[from as usize]).collect()
            }
            Expression::AccessIndex { base, index } if is_global => {
                let part = self.part(&self.inner(base), index)?;
                let (first, width) = (part.offset + index * part.stride, self.width(&part.inner)?);
                self.operand(base, true)?[first as usize..][..width as usize].into()
            }
            Expression::Unary { op, expr } => self.unary(op, expr, is_global)?,
            // The factor only keeps naga from computing the other.
            Expression::Binary { op: BinaryOperator::Multiply, left, right }
                if self.is_unfolded(left, is_global) =>
            {
                self.operand(right, is_global)?
            }
            Expression::Binary { op, left, right } => {
                let (a, b) = (self.operand(left, is_global)?, self.operand(right, is_global)?);
                self.binary(op, (left, &a), (right, &b))?
            }
            ref other => self.applied(other, is_global)?,
        })
    }

    /// [`Lowerer::pure`] of functions, choices and conversions.
    fn applied(&mut self, expression: &Expression, is_global: bool) -> Result<Rc<[Scalar]>, Fault> {
        Ok(match *expression {
            Expression::Select { condition, accept, reject } => {
                let [condition, a, b] = [condition, accept, reject].map(|part| self.operand(part, is_global));
                let (condition, a, b) = (condition?, a?, b?);
                let at = |i: usize| condition[if condition.len() == 1 { 0 } else { i }];
                (0..a.len()).map(|i| self.compute(Operation::Select, &[at(i), a[i], b[i]])).collect()
            }
            Expression::Relational { fun, argument } => {
                let scalars = self.operand(argument, is_global)?;
                let (operation, first) = match fun {
                    RelationalFunction::All => (Operation::And, Scalar::truth(true)),
                    RelationalFunction::Any => (Operation::Or, Scalar::truth(false)),
                    _ => return Err(unsupported("tests for NaN and infinity")),
                };
                [scalars.iter().fold(first, |sum, &scalar| self.compute(operation, &[sum, scalar]))].into()
            }
            Expression::Math { fun, arg, arg1, arg2, arg3 } => {
                let mut operands = vec![self.operand(arg, is_global)?];
                for more in [arg1, arg2, arg3].into_iter().flatten() {
                    operands.push(self.operand(more, is_global)?);
                }
                self.math(fun, arg, &operands)?
            }
            Expression::As { expr, kind, convert } => {
                let from = self.kind(expr)?;
                let scalars = self.operand(expr, is_global)?;
                if convert.is_some_and(|bytes| bytes != 4 && kind != ScalarKind::Bool) {
                    return Err(unsupported("numbers of other sizes than 32 bits"));
                }
                scalars.iter().map(|&scalar| self.converted(scalar, from, kind, convert.is_some())).collect()
            }
            Expression::Derivative { .. } => {
                let message = "derivatives have no meaning here: each point is computed by itself";
                let remedy = "use `at.width` and `at.footprint`, the sizes of a pixel";
                return Err(Fault::new(Span::UNDEFINED, message, remedy));
            }
            _ => {
                let message = "this function of textures and buffers does not exist here";
                let remedy = "write `image(picture, uv)`";
                return Err(Fault::new(Span::UNDEFINED, message, remedy));
            }
        })
    }

    /// A part of a value or of a place.
    fn access(&mut self, base: Handle<Expression>, index: Scalar) -> Result<Value, Fault> {
        match self.value(base)? {
            Value::Place(place) => {
                let known = if let Scalar::Word(word) = index { word } else { 0 };
                let part = self.part(&place.inner, known)?;
                let mut part_of = Place { inner: part.inner, offset: place.offset + part.offset, ..place };
                match index {
                    Scalar::Word(word) => {
                        part_of.offset += word.min(part.count.saturating_sub(1)) * part.stride
                    }
                    index => part_of.indices.push((index, part.count, part.stride)),
                }
                Ok(Value::Place(part_of))
            }
            Value::Picture(_) => Err(Self::no_value()),
            Value::Scalars(scalars) => {
                let known = if let Scalar::Word(word) = index { word } else { 0 };
                let part = self.part(&self.inner(base), known)?;
                let width = self.width(&part.inner)?;
                let last = part.count - 1;
                let chosen = match index {
                    Scalar::Word(word) => Scalar::Word(word.min(last)),
                    index => {
                        let inside = self.compute(Operation::LessUint, &[index, Scalar::Word(part.count)]);
                        self.compute(Operation::Select, &[inside, index, Scalar::Word(last)])
                    }
                };
                let parts = (0..width).map(|i| {
                    let first = part.offset + i;
                    let choices = (0..part.count).map(|k| scalars[(first + k * part.stride) as usize]);
                    self.element(choices, chosen)
                });
                Ok(Value::Scalars(parts.collect()))
            }
        }
    }

    /// True if an expression is the prelude's `override` of 1.
    fn is_unfolded(&self, handle: Handle<Expression>, is_global: bool) -> bool {
        let module = self.input.module;
        let expression = match is_global {
            true => Some(&module.global_expressions[handle]),
            false => self.expression(handle),
        };
        matches!(expression, Some(&Expression::Override(one))
            if module.overrides[one].name.as_deref() == Some(UNFOLDED))
    }

    fn override_scalars(&mut self, handle: Handle<naga::Override>) -> Result<Rc<[Scalar]>, Fault> {
        let parameter = &self.input.module.overrides[handle];
        let name = self.input.text.own_name(parameter.name.as_deref().unwrap_or_default());
        if let Some(&word) = self.input.overrides.get(name) {
            return Ok([Scalar::Word(word)].into());
        }
        match parameter.init {
            Some(init) => self.global_scalars(init),
            None => Err(Fault::new(
                self.input.module.overrides.get_span(handle),
                format!("the parameter `{name}` has no value"),
                format!("set it ({name}=VALUE) or give it a default: `override {name} = 1.0;`"),
            )),
        }
    }

    fn unary(
        &mut self,
        op: UnaryOperator,
        expr: Handle<Expression>,
        is_global: bool,
    ) -> Result<Rc<[Scalar]>, Fault> {
        let kind = self.kind(expr)?;
        let scalars = self.operand(expr, is_global)?;
        Ok(scalars
            .iter()
            .map(|&scalar| match (op, kind) {
                (UnaryOperator::Negate, ScalarKind::Float) => self.compute(Operation::Neg, &[scalar]),
                (UnaryOperator::Negate, _) => self.compute(Operation::SubInt, &[Scalar::Word(0), scalar]),
                (UnaryOperator::LogicalNot | UnaryOperator::BitwiseNot, _) => {
                    self.compute(Operation::Not, &[scalar])
                }
            })
            .collect())
    }

    fn binary(
        &mut self,
        op: BinaryOperator,
        (left, a): (Handle<Expression>, &[Scalar]),
        (right, b): (Handle<Expression>, &[Scalar]),
    ) -> Result<Rc<[Scalar]>, Fault> {
        let kind = self.kind(left)?;
        let (a_inner, b_inner) = (self.inner(left), self.inner(right));
        if op == BinaryOperator::Multiply
            && let Some(product) = self.matrix_product((&a_inner, a), (&b_inner, b))
        {
            return Ok(product);
        }
        let at = |scalars: &[Scalar], i: usize| scalars[if scalars.len() == 1 { 0 } else { i }];
        let mut results = Vec::with_capacity(a.len().max(b.len()));
        for i in 0..a.len().max(b.len()) {
            results.push(self.binary_scalar(op, kind, at(a, i), at(b, i)));
        }
        Ok(results.into())
    }

    fn binary_scalar(&mut self, op: BinaryOperator, kind: ScalarKind, a: Scalar, b: Scalar) -> Scalar {
        use BinaryOperator as B;
        use Operation as O;
        let (is_float, is_signed) = (kind == ScalarKind::Float, kind == ScalarKind::Sint);
        let by_kind = |float, signed, unsigned| {
            if is_float {
                float
            } else if is_signed {
                signed
            } else {
                unsigned
            }
        };
        let less = by_kind(O::Less, O::LessSint, O::LessUint);
        let equal = by_kind(O::Equal, O::EqualInt, O::EqualInt);
        match op {
            B::Add => self.compute(by_kind(O::Add, O::AddInt, O::AddInt), &[a, b]),
            B::Subtract => self.compute(by_kind(O::Sub, O::SubInt, O::SubInt), &[a, b]),
            B::Multiply => self.compute(by_kind(O::Mul, O::MulInt, O::MulInt), &[a, b]),
            B::Divide => self.compute(by_kind(O::Div, O::DivSint, O::DivUint), &[a, b]),
            B::Modulo if is_float => {
                // a − b · trunc(a / b), as WGSL defines it.
                let quotient = self.compute(O::Div, &[a, b]);
                let whole = self.compute(O::Trunc, &[quotient]);
                let product = self.compute(O::Mul, &[b, whole]);
                self.compute(O::Sub, &[a, product])
            }
            B::Modulo => self.compute(by_kind(O::RemSint, O::RemSint, O::RemUint), &[a, b]),
            B::Equal => self.compute(equal, &[a, b]),
            B::NotEqual => {
                let same = self.compute(equal, &[a, b]);
                self.compute(O::Not, &[same])
            }
            B::Less => self.compute(less, &[a, b]),
            B::Greater => self.compute(less, &[b, a]),
            B::LessEqual if is_float => self.compute(O::LessEqual, &[a, b]),
            B::GreaterEqual if is_float => self.compute(O::LessEqual, &[b, a]),
            B::LessEqual => {
                let greater = self.compute(less, &[b, a]);
                self.compute(O::Not, &[greater])
            }
            B::GreaterEqual => {
                let lesser = self.compute(less, &[a, b]);
                self.compute(O::Not, &[lesser])
            }
            B::And | B::LogicalAnd => self.compute(O::And, &[a, b]),
            B::InclusiveOr | B::LogicalOr => self.compute(O::Or, &[a, b]),
            B::ExclusiveOr => self.compute(O::Xor, &[a, b]),
            B::ShiftLeft => self.compute(O::Shl, &[a, b]),
            B::ShiftRight => self.compute(by_kind(O::ShrUint, O::ShrSint, O::ShrUint), &[a, b]),
        }
    }

    fn converted(&mut self, scalar: Scalar, from: ScalarKind, to: ScalarKind, converts: bool) -> Scalar {
        use Operation as O;
        use ScalarKind::{Bool, Float, Sint, Uint};
        if !converts {
            return scalar;
        }
        match (from, to) {
            (Bool, Float) => self.compute(O::And, &[scalar, Scalar::number(1.0)]),
            (Bool, Sint | Uint) => self.compute(O::And, &[scalar, Scalar::Word(1)]),
            (Float, Bool) => {
                let zero = self.compute(O::Equal, &[scalar, Scalar::Word(0)]);
                self.compute(O::Not, &[zero])
            }
            (Sint | Uint, Bool) => {
                let zero = self.compute(O::EqualInt, &[scalar, Scalar::Word(0)]);
                self.compute(O::Not, &[zero])
            }
            (Sint, Float) => self.compute(O::SintToNumber, &[scalar]),
            (Uint, Float) => self.compute(O::UintToNumber, &[scalar]),
            (Float, Sint) => self.compute(O::NumberToSint, &[scalar]),
            (Float, Uint) => self.compute(O::NumberToUint, &[scalar]),
            _ => scalar,
        }
    }
}

fn literal_word(literal: Literal) -> Result<Scalar, Fault> {
    Ok(match literal {
        Literal::F32(x) => Scalar::number(x),
        Literal::U32(x) => Scalar::Word(x),
        Literal::I32(x) => Scalar::Word(x as u32),
        Literal::Bool(x) => Scalar::truth(x),
        Literal::AbstractFloat(x) => Scalar::number(x as f32),
        Literal::AbstractInt(x) => Scalar::Word(x as u32),
        _ => return Err(unsupported("numbers of other sizes than 32 bits")),
    })
}
