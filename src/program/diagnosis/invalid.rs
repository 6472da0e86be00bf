//! Errors of naga's validator.

use super::{conversion, sentence, type_name};
use crate::program::source::Fault;
use naga::front::Typifier;
use naga::proc::ResolveContext;
use naga::valid::{CallError, ComposeError, ExpressionError, FunctionError, LiteralError, ValidationError};
use naga::{BinaryOperator, Expression, Function, Handle, Module, Span, TypeInner, WithSpan};

/// The fault for a module that is not valid.
pub(in crate::program) fn of_invalid_module(found: &WithSpan<ValidationError>, module: &Module) -> Fault {
    // The narrowest place is the most precise.
    let spans = found.spans().filter_map(|(span, _)| Some((span.to_range()?.len(), *span)));
    let span = spans.min_by_key(|(bytes, _)| *bytes).map_or(Span::UNDEFINED, |(_, span)| span);
    let told = match found.as_inner() {
        ValidationError::Function { handle, source, name, .. } => {
            let function = &module.functions[*handle];
            let whole = module.functions.get_span(*handle);
            FunctionTypes::new(module, function).fault(
                source,
                name,
                if span.is_defined() { span } else { whole },
            )
        }
        ValidationError::EntryPoint { name, .. } => Some(Fault::new(
            span,
            format!("`{name}` is an entry point of a pipeline"),
            "leave `@vertex`, `@fragment` and `@compute` out",
        )),
        ValidationError::GlobalVariable { name, .. } => Some(Fault::new(
            span,
            format!("the variable `{name}` cannot be had here"),
            "variables of a module are `var<private> name: type = value;`; pass numbers as `override`s",
        )),
        _ => None,
    };
    told.unwrap_or_else(|| {
        let mut message = sentence(&found.to_string());
        let mut cause: Option<&dyn std::error::Error> = std::error::Error::source(found.as_inner());
        while let Some(because) = cause {
            message = sentence(&because.to_string());
            cause = because.source();
        }
        Fault::new(span, message, "")
    })
}

/// The types of a function's expressions.
struct FunctionTypes<'m> {
    module: &'m Module,
    function: &'m Function,
    types: Typifier,
    /// The number of expressions whose types are known: those before the first that has none.
    known: usize,
}

impl<'m> FunctionTypes<'m> {
    fn new(module: &'m Module, function: &'m Function) -> Self {
        let mut types = Typifier::new();
        let context = ResolveContext::with_locals(module, &function.local_variables, &function.arguments);
        let mut known = 0;
        for (handle, _) in function.expressions.iter() {
            if types.grow(handle, &function.expressions, &context).is_err() {
                break;
            }
            known += 1;
        }
        Self { module, function, types, known }
    }

    fn inner_name(&self, inner: &TypeInner) -> String {
        type_name(self.module, inner, None)
    }

    fn declared(&self, ty: Handle<naga::Type>) -> String {
        let ty = &self.module.types[ty];
        type_name(self.module, &ty.inner, ty.name.as_deref())
    }

    fn name(&self, handle: Handle<Expression>) -> String {
        if handle.index() >= self.known {
            return "another type".into();
        }
        self.inner_name(self.types.get(handle, &self.module.types))
    }

    fn span(&self, handle: Handle<Expression>) -> Span {
        self.function.expressions.get_span(handle)
    }

    fn fault(&self, error: &FunctionError, name: &str, span: Span) -> Option<Fault> {
        use FunctionError as F;
        Some(match error {
            F::Expression { handle, source } => return self.expression(source, *handle, span),
            F::InvalidStoreTypes { pointer, value } => {
                let (to, from) = (self.name(*pointer), self.name(*value));
                let message = format!("a value of type `{from}` is assigned to `{to}`");
                Fault::new(self.span(*value), message, conversion(&from, &to))
            }
            F::InvalidReturnType { expression, expected_ty } => {
                let to = expected_ty.map(|ty| self.declared(ty));
                let from = expression.map(|value| self.name(value));
                let at = expression.map_or(span, |value| self.span(value));
                match (from, to) {
                    (None, Some(to)) => Fault::new(
                        at,
                        format!("`{name}` does not return a value on every path"),
                        format!("end it with `return ..;` of type `{to}`"),
                    ),
                    (Some(from), Some(to)) => Fault::new(
                        at,
                        format!("`{name}` returns `{to}`, and this is `{from}`"),
                        conversion(&from, &to),
                    ),
                    (from, None) => Fault::new(
                        at,
                        format!("`{name}` has no result, and a value is returned"),
                        format!("write `-> {}` behind its arguments", from.unwrap_or_default()),
                    ),
                }
            }
            F::InvalidIfType(value) => {
                let from = self.name(*value);
                Fault::new(
                    self.span(*value),
                    format!("the condition is `{from}`"),
                    "compare: `x > 0.0`, `i != 0`",
                )
            }
            F::InvalidSwitchType(value) => {
                let from = self.name(*value);
                Fault::new(self.span(*value), format!("`switch` chooses by `{from}`"), "convert it: `i32(x)`")
            }
            F::MissingDefaultCase => Fault::new(span, "the `switch` has no default", "add `default: {}`"),
            F::BreakOutsideOfLoopOrSwitch => {
                Fault::new(span, "`break` stands outside of a loop", "`return` leaves a function")
            }
            F::ContinueOutsideOfLoop => {
                Fault::new(span, "`continue` stands outside of a loop", "`return` leaves a function")
            }
            F::InvalidCall { function, error } => return self.call(*function, error, span),
            F::InvalidStorePointer(pointer) => {
                Fault::new(self.span(*pointer), "this cannot be assigned to", "assign to a `var`")
            }
            _ => return None,
        })
    }

    fn call(&self, function: Handle<Function>, error: &CallError, span: Span) -> Option<Fault> {
        let called = &self.module.functions[function];
        let name = called.name.as_deref().unwrap_or_default();
        let arguments: Vec<String> = called
            .arguments
            .iter()
            .map(|argument| {
                let ty = self.declared(argument.ty);
                argument.name.as_ref().map_or(ty.clone(), |name| format!("{name}: {ty}"))
            })
            .collect();
        let signature = format!("it is `fn {name}({})`", arguments.join(", "));
        Some(match error {
            CallError::ArgumentCount { required, seen } => {
                Fault::new(span, format!("`{name}` takes {required} arguments, not {seen}"), signature)
            }
            CallError::ArgumentType { index, required, seen_expression } => {
                let (from, to) = (self.name(*seen_expression), self.declared(*required));
                let message =
                    format!("argument {} of `{name}` is `{from}` where `{to}` is needed", index + 1);
                Fault::new(
                    self.span(*seen_expression),
                    message,
                    format!("{signature}; {}", conversion(&from, &to)),
                )
            }
            _ => return None,
        })
    }

    fn expression(&self, error: &ExpressionError, handle: Handle<Expression>, span: Span) -> Option<Fault> {
        use ExpressionError as E;
        let span = if self.span(handle).is_defined() { self.span(handle) } else { span };
        Some(match error {
            E::InvalidBinaryOperandTypes { op, lhs_type, rhs_type, .. } => {
                let (left, right) = (self.inner_name(lhs_type), self.inner_name(rhs_type));
                let sign = sign(*op);
                let message = format!("`{left} {sign} {right}` does not exist");
                Fault::new(span, message, operands(&left, &right, sign))
            }
            E::InvalidUnaryOperandType(_, operand) => {
                let ty = self.name(*operand);
                Fault::new(
                    span,
                    format!("this operator does not exist for `{ty}`"),
                    "`-` is for signed numbers, `!` for bool",
                )
            }
            _ => return self.part(error, span).or_else(|| of_value(error, span)),
        })
    }

    /// The fault of a part of a value, or of a choice.
    fn part(&self, error: &ExpressionError, span: Span) -> Option<Fault> {
        use ExpressionError as E;
        Some(match error {
            E::IndexOutOfBounds(base, index) => {
                let ty = self.name(*base);
                Fault::new(span, format!("index {index} lies beyond the end of `{ty}`"), "indices begin at 0")
            }
            E::NegativeIndex(_) => Fault::new(span, "an index is negative", "indices begin at 0"),
            E::InvalidIndexType(index) => {
                let ty = self.name(*index);
                Fault::new(span, format!("an index is `{ty}`"), "convert it: `u32(x)`")
            }
            E::InvalidBaseType(base) => {
                let ty = self.name(*base);
                Fault::new(
                    span,
                    format!("`{ty}` has no parts to index"),
                    "index arrays, vectors and matrices",
                )
            }
            E::SelectConditionNotABool { actual } => {
                let ty = self.inner_name(actual);
                Fault::new(
                    span,
                    format!("the condition of `select` is `{ty}`"),
                    "it is the last argument: `select(if_false, if_true, condition)`",
                )
            }
            E::SelectValuesTypeMismatch { accept, reject } => {
                let (accept, reject) = (self.inner_name(accept), self.inner_name(reject));
                Fault::new(
                    span,
                    format!("`select` chooses between `{reject}` and `{accept}`"),
                    "give two of one type",
                )
            }
            E::InvalidArgumentType(_, index, value) => {
                let ty = self.name(*value);
                Fault::new(
                    self.span(*value),
                    format!("argument {} is `{ty}`", index + 1),
                    "convert it: `f32(x)`",
                )
            }
            _ => return None,
        })
    }
}

/// The fault of a value by itself.
fn of_value(error: &ExpressionError, span: Span) -> Option<Fault> {
    use ExpressionError as E;
    Some(match error {
        E::InvalidCastArgument => {
            Fault::new(span, "this value cannot be converted so", "numbers have 32 bits: `f32`, `i32`, `u32`")
        }
        E::Compose(ComposeError::ComponentCount { given, expected }) => Fault::new(
            span,
            format!("{given} components are given where {expected} are needed"),
            "give one for each component, or a single number for all",
        ),
        E::Compose(ComposeError::ComponentType { index }) => {
            Fault::new(span, format!("component {} has the wrong type", index + 1), "convert it: `f32(x)`")
        }
        E::Literal(LiteralError::Width(_)) => Fault::new(
            span,
            "a number with a fraction stands beside whole numbers",
            "convert the whole numbers: `f32(i) * 0.5`",
        ),
        E::Literal(_) => Fault::new(span, "the number is not finite", "write a number of at most 3.4e38"),
        E::MissingCapabilities(_) => Fault::new(
            span,
            "shaders have no numbers of this size",
            "numbers have 32 bits: `f32`, `i32`, `u32`",
        ),
        _ => return None,
    })
}

fn sign(op: BinaryOperator) -> &'static str {
    use BinaryOperator as B;
    match op {
        B::Add => "+",
        B::Subtract => "-",
        B::Multiply => "*",
        B::Divide => "/",
        B::Modulo => "%",
        B::Equal => "==",
        B::NotEqual => "!=",
        B::Less => "<",
        B::LessEqual => "<=",
        B::Greater => ">",
        B::GreaterEqual => ">=",
        B::And => "&",
        B::ExclusiveOr => "^",
        B::InclusiveOr => "|",
        B::LogicalAnd => "&&",
        B::LogicalOr => "||",
        B::ShiftLeft => "<<",
        B::ShiftRight => ">>",
    }
}

/// A remedy for operands of different types.
fn operands(left: &str, right: &str, sign: &str) -> String {
    if ["&&", "||"].contains(&sign) {
        return "both sides are conditions: `a > 0.0 && b > 0.0`".into();
    }
    if ["<<", ">>"].contains(&sign) {
        return "the distance is `u32`: `x << 3u`".into();
    }
    let is_float = |ty: &str| ty == "f32" || ty.ends_with('f') || ty == "a number";
    match (is_float(left), is_float(right)) {
        (true, false) => format!("convert the right side: `{}`", converted(left, right)),
        (false, true) => format!("convert the left side: `{}`", converted(right, left)),
        _ if left.starts_with("vec") && right.starts_with("vec") => conversion(right, left),
        _ => format!("convert one side: `{left}(..)`"),
    }
}

/// The conversion of a type to numbers with a fraction.
fn converted(to: &str, from: &str) -> String {
    match from.starts_with("vec") && from.len() == 5 {
        true => format!("{}f(..)", &from[..4]),
        false if to.starts_with("mat") => "give a vector of as many numbers".into(),
        false => "f32(..)".into(),
    }
}
