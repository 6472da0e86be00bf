//! A second meaning of WGSL: an evaluator that walks naga's IR for one point at a time. It shares no code with the
//! lowerer, the executor and the table of operations.

use naga::{
    BinaryOperator, Block, Expression, Function, Handle, Literal, MathFunction, Module, RelationalFunction,
    ScalarKind, Statement, SwitchCase, SwitchValue, TypeInner, UnaryOperator,
};
use std::collections::BTreeMap;

/// A scalar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Word {
    F(f32),
    I(i32),
    U(u32),
    B(bool),
}

impl Word {
    pub fn bits(self) -> u32 {
        match self {
            Self::F(x) => x.to_bits(),
            Self::I(x) => x as u32,
            Self::U(x) => x,
            Self::B(x) => u32::from(x) * u32::MAX,
        }
    }
}

/// A value as a tree.
#[derive(Clone, Debug)]
pub enum Value {
    Word(Word),
    List(Vec<Value>),
    /// A variable of a frame on the stack and a path into it.
    Pointer(usize, usize, Vec<usize>),
}

impl Value {
    fn word(&self) -> Word {
        match self {
            Self::Word(word) => *word,
            other => panic!("{other:?} is no scalar"),
        }
    }

    /// All scalars, in order.
    pub fn words(&self) -> Vec<Word> {
        match self {
            Self::Word(word) => vec![*word],
            Self::List(list) => list.iter().flat_map(Value::words).collect(),
            Self::Pointer(..) => panic!("a pointer"),
        }
    }
}

enum Flow {
    On,
    Break,
    Continue,
    Return(Option<Value>),
}

struct Frame {
    values: BTreeMap<Handle<Expression>, Value>,
    locals: Vec<Value>,
    arguments: Vec<Value>,
}

pub struct Oracle<'m> {
    module: &'m Module,
    /// The first holds the variables of the module.
    frames: Vec<Frame>,
}

impl<'m> Oracle<'m> {
    pub fn new(module: &'m Module) -> Self {
        let mut oracle = Self { module, frames: Vec::new() };
        let locals = module.global_variables.iter().map(|(_, global)| match global.init {
            Some(init) => oracle.global(init),
            None => oracle.zero(&module.types[global.ty].inner),
        });
        let locals = locals.collect();
        oracle.frames.push(Frame { values: BTreeMap::new(), locals, arguments: Vec::new() });
        oracle
    }

    pub fn call(&mut self, function: &'m Function, arguments: Vec<Value>) -> Option<Value> {
        self.frames.push(Frame { values: BTreeMap::new(), locals: Vec::new(), arguments });
        for (_, local) in function.local_variables.iter() {
            let value = match local.init {
                Some(init) => self.value(function, init),
                None => self.zero(&self.module.types[local.ty].inner),
            };
            self.frame().locals.push(value);
        }
        let flow = self.block(function, &function.body);
        self.frames.pop();
        match flow {
            Flow::Return(value) => value,
            _ => None,
        }
    }

    fn frame(&mut self) -> &mut Frame {
        self.frames.last_mut().expect("a call")
    }

    fn zero(&self, inner: &TypeInner) -> Value {
        let scalar = |kind| {
            Value::Word(match kind {
                ScalarKind::Float => Word::F(0.0),
                ScalarKind::Sint => Word::I(0),
                ScalarKind::Uint => Word::U(0),
                _ => Word::B(false),
            })
        };
        match inner {
            TypeInner::Scalar(s) => scalar(s.kind),
            TypeInner::Vector { size, scalar: s } => Value::List(vec![scalar(s.kind); *size as usize]),
            TypeInner::Array { base, size: naga::ArraySize::Constant(count), .. } => {
                Value::List(vec![self.zero(&self.module.types[*base].inner); count.get() as usize])
            }
            TypeInner::Struct { members, .. } => Value::List(
                members.iter().map(|member| self.zero(&self.module.types[member.ty].inner)).collect(),
            ),
            other => panic!("{other:?}"),
        }
    }

    fn block(&mut self, function: &'m Function, block: &'m Block) -> Flow {
        for statement in block {
            match self.statement(function, statement) {
                Flow::On => {}
                flow => return flow,
            }
        }
        Flow::On
    }

    fn statement(&mut self, function: &'m Function, statement: &'m Statement) -> Flow {
        match statement {
            Statement::Emit(range) => {
                for handle in range.clone() {
                    let value = self.compute(function, handle);
                    self.frame().values.insert(handle, value);
                }
            }
            Statement::Block(block) => return self.block(function, block),
            Statement::If { condition, accept, reject } => {
                let taken = self.value(function, *condition).word() == Word::B(true);
                return self.block(function, if taken { accept } else { reject });
            }
            Statement::Switch { selector, cases } => return self.switch(function, *selector, cases),
            Statement::Loop { body, continuing, break_if } => loop {
                match self.block(function, body) {
                    Flow::Break => break,
                    Flow::On | Flow::Continue => {}
                    flow => return flow,
                }
                self.block(function, continuing);
                if break_if.is_some_and(|condition| self.value(function, condition).word() == Word::B(true)) {
                    break;
                }
            },
            Statement::Break => return Flow::Break,
            Statement::Continue => return Flow::Continue,
            Statement::Return { value } => {
                return Flow::Return(value.map(|value| self.value(function, value)));
            }
            Statement::Store { pointer, value } => {
                let value = self.value(function, *value);
                let Value::Pointer(frame, local, path) = self.value(function, *pointer) else {
                    panic!("no pointer")
                };
                let mut place = &mut self.frames[frame].locals[local];
                for index in path {
                    let Value::List(list) = place else { panic!("no parts") };
                    let last = list.len() - 1;
                    place = &mut list[index.min(last)];
                }
                *place = value;
            }
            Statement::Call { function: callee, arguments, result } => {
                let arguments = arguments.iter().map(|&argument| self.value(function, argument)).collect();
                let value = self.call(&self.module.functions[*callee], arguments);
                if let (Some(result), Some(value)) = (result, value) {
                    self.frame().values.insert(*result, value);
                }
            }
            other => panic!("{other:?}"),
        }
        Flow::On
    }

    fn switch(
        &mut self,
        function: &'m Function,
        selector: Handle<Expression>,
        cases: &'m [SwitchCase],
    ) -> Flow {
        let selector = self.value(function, selector).word();
        let matches = |value: &SwitchValue| match (value, selector) {
            (SwitchValue::I32(a), Word::I(b)) => *a == b,
            (SwitchValue::U32(a), Word::U(b)) => *a == b,
            _ => false,
        };
        let first = cases.iter().position(|case| matches(&case.value));
        let first = first.or_else(|| cases.iter().position(|case| case.value == SwitchValue::Default));
        for case in &cases[first.expect("a default")..] {
            match self.block(function, &case.body) {
                Flow::On if case.fall_through => {}
                Flow::On | Flow::Break => break,
                flow => return flow,
            }
        }
        Flow::On
    }

    fn value(&mut self, function: &'m Function, handle: Handle<Expression>) -> Value {
        match self.frame().values.get(&handle) {
            Some(value) => value.clone(),
            None => self.compute(function, handle),
        }
    }

    fn global(&self, handle: Handle<Expression>) -> Value {
        match &self.module.global_expressions[handle] {
            Expression::Literal(literal) => Value::Word(word(*literal)),
            Expression::Constant(constant) => self.global(self.module.constants[*constant].init),
            Expression::Compose { components, .. } => {
                Value::List(components.iter().map(|&component| self.global(component)).collect())
            }
            Expression::Splat { size, value } => Value::List(vec![self.global(*value); *size as usize]),
            Expression::ZeroValue(ty) => self.zero(&self.module.types[*ty].inner),
            other => panic!("{other:?}"),
        }
    }

    fn composed(
        &mut self,
        function: &'m Function,
        ty: Handle<naga::Type>,
        parts: &[Handle<Expression>],
    ) -> Value {
        let is_vector = matches!(self.module.types[ty].inner, TypeInner::Vector { .. });
        let mut list = Vec::new();
        for &part in parts {
            match self.value(function, part) {
                Value::List(components) if is_vector => list.extend(components),
                part => list.push(part),
            }
        }
        Value::List(list)
    }

    fn compute(&mut self, function: &'m Function, handle: Handle<Expression>) -> Value {
        let depth = self.frames.len() - 1;
        match &function.expressions[handle] {
            Expression::Literal(literal) => Value::Word(word(*literal)),
            Expression::Constant(constant) => self.global(self.module.constants[*constant].init),
            // The prelude's factor of 1.
            Expression::Override(_) => Value::Word(Word::F(1.0)),
            Expression::ZeroValue(ty) => self.zero(&self.module.types[*ty].inner),
            Expression::FunctionArgument(index) => self.frame().arguments[*index as usize].clone(),
            Expression::GlobalVariable(global) => Value::Pointer(0, global.index(), Vec::new()),
            Expression::LocalVariable(local) => Value::Pointer(depth, local.index(), Vec::new()),
            Expression::Compose { ty, components } => self.composed(function, *ty, components),
            Expression::Splat { size, value } => {
                Value::List(vec![self.value(function, *value); *size as usize])
            }
            Expression::Swizzle { size, vector, pattern } => {
                let Value::List(list) = self.value(function, *vector) else { panic!("no vector") };
                Value::List(
                    pattern[..*size as usize].iter().map(|&from| list[from as usize].clone()).collect(),
                )
            }
            Expression::Access { base, index } => {
                let index = self.value(function, *index).word().bits() as usize;
                part(self.value(function, *base), index)
            }
            Expression::AccessIndex { base, index } => part(self.value(function, *base), *index as usize),
            Expression::Load { pointer } => {
                let Value::Pointer(frame, local, path) = self.value(function, *pointer) else {
                    panic!("no pointer")
                };
                path.into_iter().fold(self.frames[frame].locals[local].clone(), part)
            }
            Expression::Unary { op, expr } => {
                map(&[self.value(function, *expr)], &|words| unary(*op, words[0]))
            }
            Expression::Binary { op, left, right } => {
                let operands = [self.value(function, *left), self.value(function, *right)];
                map(&operands, &|words| binary(*op, words[0], words[1]))
            }
            Expression::Select { condition, accept, reject } => {
                let parts = [*reject, *accept, *condition].map(|part| self.value(function, part));
                map(&parts, &|words| if words[2] == Word::B(true) { words[1] } else { words[0] })
            }
            Expression::Relational { fun, argument } => {
                let words = self.value(function, *argument).words();
                let mut truths = words.into_iter().map(|word| word == Word::B(true));
                Value::Word(Word::B(match fun {
                    RelationalFunction::All => truths.all(|truth| truth),
                    _ => truths.any(|truth| truth),
                }))
            }
            Expression::Math { fun, arg, arg1, arg2, .. } => {
                let operands = [Some(*arg), *arg1, *arg2].into_iter().flatten();
                let operands: Vec<Value> = operands.map(|operand| self.value(function, operand)).collect();
                math(*fun, &operands)
            }
            Expression::As { expr, kind, convert } => {
                let (kind, converts) = (*kind, convert.is_some());
                map(&[self.value(function, *expr)], &|words| converted(words[0], kind, converts))
            }
            other => panic!("{other:?}"),
        }
    }
}

fn word(literal: Literal) -> Word {
    match literal {
        Literal::F32(x) => Word::F(x),
        Literal::I32(x) => Word::I(x),
        Literal::U32(x) => Word::U(x),
        Literal::Bool(x) => Word::B(x),
        other => panic!("{other:?}"),
    }
}

fn part(value: Value, index: usize) -> Value {
    match value {
        Value::List(list) => list[index.min(list.len() - 1)].clone(),
        Value::Pointer(frame, local, mut path) => {
            path.push(index);
            Value::Pointer(frame, local, path)
        }
        Value::Word(word) => panic!("{word:?} has no parts"),
    }
}

/// Applies a function to scalars, component by component; scalars beside vectors are repeated.
fn map(operands: &[Value], function: &dyn Fn(&[Word]) -> Word) -> Value {
    let length = operands.iter().find_map(|operand| match operand {
        Value::List(list) => Some(list.len()),
        _ => None,
    });
    match length {
        None => Value::Word(function(&operands.iter().map(Value::word).collect::<Vec<_>>())),
        Some(length) => Value::List(
            (0..length)
                .map(|i| {
                    let components: Vec<Value> = operands
                        .iter()
                        .map(|operand| match operand {
                            Value::List(list) => list[i].clone(),
                            other => other.clone(),
                        })
                        .collect();
                    map(&components, function)
                })
                .collect(),
        ),
    }
}

fn unary(op: UnaryOperator, a: Word) -> Word {
    match (op, a) {
        (UnaryOperator::Negate, Word::F(x)) => Word::F(-x),
        (UnaryOperator::Negate, Word::I(x)) => Word::I(x.wrapping_neg()),
        (UnaryOperator::LogicalNot, Word::B(x)) => Word::B(!x),
        (UnaryOperator::BitwiseNot, Word::I(x)) => Word::I(!x),
        (UnaryOperator::BitwiseNot, Word::U(x)) => Word::U(!x),
        other => panic!("{other:?}"),
    }
}

fn binary(op: BinaryOperator, a: Word, b: Word) -> Word {
    use BinaryOperator as O;
    match (a, b) {
        (Word::F(a), Word::F(b)) => match op {
            O::Add => Word::F(a + b),
            O::Subtract => Word::F(a - b),
            O::Multiply => Word::F(a * b),
            O::Divide => Word::F(a / b),
            O::Modulo => Word::F(a - b * (a / b).trunc()),
            _ => compare(op, a.partial_cmp(&b)),
        },
        (Word::I(a), Word::I(b)) => match op {
            O::Add => Word::I(a.wrapping_add(b)),
            O::Subtract => Word::I(a.wrapping_sub(b)),
            O::Multiply => Word::I(a.wrapping_mul(b)),
            O::Divide => Word::I(if b == 0 || (a == i32::MIN && b == -1) { a } else { a / b }),
            O::Modulo => Word::I(if b == 0 || b == -1 { 0 } else { a % b }),
            O::And => Word::I(a & b),
            O::InclusiveOr => Word::I(a | b),
            O::ExclusiveOr => Word::I(a ^ b),
            _ => compare(op, Some(a.cmp(&b))),
        },
        (Word::U(a), Word::U(b)) => match op {
            O::Add => Word::U(a.wrapping_add(b)),
            O::Subtract => Word::U(a.wrapping_sub(b)),
            O::Multiply => Word::U(a.wrapping_mul(b)),
            O::Divide => Word::U(a.checked_div(b).unwrap_or(a)),
            O::Modulo => Word::U(if b == 0 { 0 } else { a % b }),
            O::And => Word::U(a & b),
            O::InclusiveOr => Word::U(a | b),
            O::ExclusiveOr => Word::U(a ^ b),
            O::ShiftLeft => Word::U(a << (b & 31)),
            O::ShiftRight => Word::U(a >> (b & 31)),
            _ => compare(op, Some(a.cmp(&b))),
        },
        (Word::I(a), Word::U(b)) => match op {
            O::ShiftLeft => Word::I(a << (b & 31)),
            O::ShiftRight => Word::I(a >> (b & 31)),
            _ => panic!("{op:?}"),
        },
        (Word::B(a), Word::B(b)) => match op {
            O::LogicalAnd | O::And => Word::B(a && b),
            O::LogicalOr | O::InclusiveOr => Word::B(a || b),
            _ => compare(op, Some(a.cmp(&b))),
        },
        other => panic!("{op:?} {other:?}"),
    }
}

fn compare(op: BinaryOperator, order: Option<std::cmp::Ordering>) -> Word {
    use BinaryOperator as O;
    use std::cmp::Ordering::{Equal, Greater, Less};
    Word::B(match op {
        O::Equal => order == Some(Equal),
        O::NotEqual => order != Some(Equal),
        O::Less => order == Some(Less),
        O::LessEqual => matches!(order, Some(Less | Equal)),
        O::Greater => order == Some(Greater),
        O::GreaterEqual => matches!(order, Some(Greater | Equal)),
        _ => panic!("{op:?}"),
    })
}

fn converted(word: Word, kind: ScalarKind, converts: bool) -> Word {
    if !converts {
        let bits = word.bits();
        return match kind {
            ScalarKind::Float => Word::F(f32::from_bits(bits)),
            ScalarKind::Sint => Word::I(bits as i32),
            _ => Word::U(bits),
        };
    }
    match (word, kind) {
        (Word::F(x), ScalarKind::Sint) => Word::I(x as i32),
        (Word::F(x), ScalarKind::Uint) => Word::U(x as u32),
        (Word::F(x), ScalarKind::Bool) => Word::B(x != 0.0),
        (Word::I(x), ScalarKind::Float) => Word::F(x as f32),
        (Word::I(x), ScalarKind::Uint) => Word::U(x as u32),
        (Word::I(x), ScalarKind::Bool) => Word::B(x != 0),
        (Word::U(x), ScalarKind::Float) => Word::F(x as f32),
        (Word::U(x), ScalarKind::Sint) => Word::I(x as i32),
        (Word::U(x), ScalarKind::Bool) => Word::B(x != 0),
        (Word::B(x), ScalarKind::Float) => Word::F(if x { 1.0 } else { 0.0 }),
        (Word::B(x), ScalarKind::Sint) => Word::I(i32::from(x)),
        (Word::B(x), ScalarKind::Uint) => Word::U(u32::from(x)),
        (word, _) => word,
    }
}

fn number(word: Word) -> f32 {
    match word {
        Word::F(x) => x,
        other => panic!("{other:?} is no number"),
    }
}

fn math(fun: MathFunction, operands: &[Value]) -> Value {
    use MathFunction as M;
    let numbers = |i: usize| operands[i].words().into_iter().map(number).collect::<Vec<f32>>();
    let dot =
        |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).reduce(|sum, x| sum + x).unwrap_or(0.0);
    let list =
        |numbers: Vec<f32>| Value::List(numbers.into_iter().map(|x| Value::Word(Word::F(x))).collect());
    match fun {
        M::Dot => Value::Word(Word::F(dot(&numbers(0), &numbers(1)))),
        M::Length => Value::Word(Word::F(dot(&numbers(0), &numbers(0)).sqrt())),
        M::Normalize => {
            let a = numbers(0);
            let inverse = 1.0 / dot(&a, &a).sqrt();
            list(a.iter().map(|x| x * inverse).collect())
        }
        M::Cross => {
            let (a, b) = (numbers(0), numbers(1));
            let minor = |i: usize, j: usize| a[i] * b[j] - a[j] * b[i];
            list(vec![minor(1, 2), minor(2, 0), minor(0, 1)])
        }
        _ => map(operands, &|words| component(fun, words)),
    }
}

fn component(fun: MathFunction, words: &[Word]) -> Word {
    use MathFunction as M;
    let min = |a: f32, b: f32| if a < b { a } else { b };
    let max = |a: f32, b: f32| if a > b { a } else { b };
    match words {
        [Word::F(a)] => Word::F(match fun {
            M::Abs => a.abs(),
            M::Floor => a.floor(),
            M::Ceil => a.ceil(),
            M::Fract => a - a.floor(),
            M::Sqrt => a.sqrt(),
            M::Trunc => a.trunc(),
            M::Round => a.round_ties_even(),
            M::Saturate => min(max(*a, 0.0), 1.0),
            M::Sign if *a > 0.0 => 1.0,
            M::Sign if *a < 0.0 => -1.0,
            M::Sign => 0.0,
            _ => panic!("{fun:?}"),
        }),
        [Word::F(a), Word::F(b)] => Word::F(match fun {
            M::Min => min(*a, *b),
            M::Max => max(*a, *b),
            M::Step => f32::from(u8::from(b >= a)),
            _ => panic!("{fun:?}"),
        }),
        [Word::F(a), Word::F(b), Word::F(c)] => Word::F(match fun {
            M::Clamp => min(max(*a, *b), *c),
            M::Mix => a + (b - a) * c,
            M::Fma => a * b + c,
            M::SmoothStep => {
                let t = min(max((c - a) / (b - a), 0.0), 1.0);
                t * t * (3.0 - 2.0 * t)
            }
            _ => panic!("{fun:?}"),
        }),
        [Word::I(a), Word::I(b)] if fun == M::Min => Word::I(*a.min(b)),
        [Word::I(a), Word::I(b)] if fun == M::Max => Word::I(*a.max(b)),
        [Word::U(a), Word::U(b)] if fun == M::Min => Word::U(*a.min(b)),
        [Word::U(a), Word::U(b)] if fun == M::Max => Word::U(*a.max(b)),
        [Word::I(a)] if fun == M::Abs => Word::I(a.wrapping_abs()),
        [Word::U(a)] => Word::U(match fun {
            M::CountOneBits => a.count_ones(),
            M::ReverseBits => a.reverse_bits(),
            M::CountLeadingZeros => a.leading_zeros(),
            M::CountTrailingZeros => a.trailing_zeros(),
            _ => panic!("{fun:?}"),
        }),
        other => panic!("{fun:?} {other:?}"),
    }
}
