//! Lowers naga's IR to instructions. This folder alone names naga's IR.
//!
//! The lowerer evaluates what it can. A scalar is a known word or a register; operations on known words are folded, a
//! branch on a known condition is taken, and a loop whose end is known is unrolled. Vectors, structs and arrays are
//! scalars, calls are inlined, and a variable is the value that it was assigned last. What depends on a point remains:
//! operations at all points, under masks of the points that take a branch.
//!
//! A mask is `None` where it holds all points. Inside a branch or a loop a variable also has *homes*: registers that
//! each assignment writes under the mask, so that points that skip the branch keep their values.

mod attribute;
mod base;
mod call;
mod expression;
mod finish_call;
mod flow;
mod host;
mod math;
mod picture;
mod scope;
mod shape;
mod slope;
mod unroll;
mod variable;

use super::code::{Code, Instruction, Register};
use super::finish_call::FinishPlace;
use super::operation::Operation;
use super::source::{Fault, SourceText};
use crate::scene::BlockColumns;
pub(super) use base::Base;
use host::Asked;
pub(super) use host::{Counts, HostInput};
use naga::valid::ModuleInfo;
use naga::{Function, Handle, Module, Span, TypeInner};
use picture::LookedUp;
use scope::Scopes;
use slope::Slope;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::rc::Rc;
use variable::{Place, VariableId, Variables};

/// The most instructions of a program.
const MOST_INSTRUCTIONS: usize = 1 << 16;

/// The most statements that are lowered, those of calls and turns counted each time.
const MOST_STATEMENTS: u32 = 1 << 20;

/// A scalar at all points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Scalar {
    /// The same known word.
    Word(u32),
    /// A register that is never written again.
    Column(Register),
}

impl Scalar {
    pub(super) fn number(x: f32) -> Self {
        Self::Word(x.to_bits())
    }

    pub(super) fn truth(truth: bool) -> Self {
        Self::Word(if truth { u32::MAX } else { 0 })
    }
}

/// Value that an expression denotes.
#[derive(Clone, Debug)]
enum Value {
    /// Its scalars: the components of a vector, the members of a struct, ..
    Scalars(Rc<[Scalar]>),
    /// A pointer.
    Place(Place),
    /// A picture, by number.
    Picture(u32),
}

/// The points at which a statement acts.
type PointMask = Option<Register>;

/// A call that is being inlined.
struct Frame<'m> {
    function: &'m Function,
    info: &'m naga::valid::FunctionInfo,
    values: Vec<Option<Value>>,
    arguments: Vec<Value>,
    locals: Vec<VariableId>,
    scopes: Rc<Scopes>,
    result: Option<VariableId>,
    /// The points at which the function was called.
    entry: PointMask,
    /// A mask that loses the points that return.
    live: Register,
    /// True if all points have returned.
    returned: bool,
    /// True if some points have returned before others.
    varied: bool,
    /// Loops and switches around the current statement: where they start in [`Lowerer::exits`].
    exits: usize,
}

/// A loop or a switch around the current statement.
struct Exit {
    is_loop: bool,
    /// The points that entered.
    entry: PointMask,
    /// The points with which the present turn began; `None` if one turn is lowered for all.
    turn: Option<PointMask>,
    /// A mask that loses the points that leave it.
    live: Register,
    /// A mask that loses the points that leave this turn of it.
    running: Register,
    /// True if some points have left before others.
    varied: bool,
    /// True if all points have left.
    left: bool,
    /// Number of decisions about leaving that were known.
    known_decisions: u32,
}

/// A module as the lowerer sees it.
#[derive(Clone, Copy)]
pub(super) struct Input<'m> {
    pub module: &'m Module,
    pub info: &'m ModuleInfo,
    /// The words of overrides by name.
    pub overrides: &'m BTreeMap<String, u32>,
    /// True if functions of the prelude become calls of native kernels.
    pub natives: bool,
    /// The text, for the names of overrides.
    pub text: &'m SourceText,
    /// Translation of calls of host functions; `None` in shaders that have none.
    pub host: Option<HostInput<'m>>,
    /// Meaning of `base`.
    pub base: Base<'m>,
    /// Translation of calls of native BSDFs; `None` in shaders that are no BSDFs.
    pub finishes: Option<FinishPlace>,
}

/// Facts about a scalar of the result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Output {
    /// It is this word at all points.
    Known(u32),
    /// It is an input, by its number.
    Input(u32),
    /// It is computed.
    Computed,
}

struct Lowerer<'m> {
    input: Input<'m>,
    code: Code,
    constants: HashMap<u32, Register>,
    /// Operations computed before, by scope: what a branch computes is unknown after it.
    known: Vec<HashMap<(Operation, [Scalar; 3]), Scalar>>,
    variables: Variables,
    /// The scalars of variables with homes that have been assigned since the innermost region began.
    assigned: HashSet<(VariableId, usize)>,
    globals: HashMap<Handle<naga::GlobalVariable>, VariableId>,
    /// The value of the variable of vertex attributes.
    attributes: Option<Rc<[Scalar]>>,
    /// Pictures with their numbers, in the order of the module.
    pictures: HashMap<Handle<naga::GlobalVariable>, u32>,
    looked_up: Vec<LookedUp>,
    /// Slopes of registers that are never written again.
    slopes: HashMap<Register, Slope>,
    /// Of functions called so far.
    scopes: HashMap<Handle<Function>, Rc<Scopes>>,
    frames: Vec<Frame<'m>>,
    exits: Vec<Exit>,
    mask: PointMask,
    /// Number of times that some points left before others.
    departures: u64,
    /// Number of statements lowered so far.
    statements: u32,
    /// The current statement's first byte in the text that was parsed.
    place: u32,
    /// A mask that gains the points that wait for a ray: see [`host`].
    waiting: Register,
    /// True if some points may wait.
    waits: bool,
    /// Effects so far.
    counts: Counts,
    /// Calls of host functions, with their points and results.
    asked: Vec<Asked>,
    /// True if `base` is called.
    asks_base: bool,
    /// True if a native BSDF that transmits light is called.
    scatters_through: bool,
    /// Scalars of arguments that were made inputs.
    given: u32,
}

/// A lowered function before its instructions are optimised.
pub(super) struct Lowered {
    pub code: Code,
    /// Facts about each scalar of the result.
    pub outputs: Vec<Output>,
    /// The mask of points that wait for a ray.
    pub waiting: Register,
    /// The most effects of a point.
    pub counts: Counts,
    /// True if it asks for the finish of its material.
    pub asks_base: bool,
    /// True if it calls a native BSDF that transmits light.
    pub scatters_through: bool,
}

impl Lowered {
    fn optimised(self) -> Self {
        Self { code: self.code.without_dead_instructions().with_pairs().with_few_registers(), ..self }
    }
}

/// Lowers a function whose arguments are the inputs, one number for each scalar, and whose outputs are the scalars of
/// its result.
///
/// # Errors
/// When the function uses what programs lack, or is too long.
pub(super) fn lower(input: Input<'_>, function: Handle<Function>) -> Result<Lowered, Fault> {
    Ok(lowered(input, &[function])?.optimised())
}

/// [`lower`] for functions that are called one after the other: the result of each is the first argument of the next.
/// The inputs are the arguments of the first function, the finish of the material if `base` is no error, then what the
/// others take besides.
///
/// # Errors
/// When a function uses what programs lack, or they are too long.
pub(super) fn lower_chain(input: Input<'_>, functions: &[Handle<Function>]) -> Result<Lowered, Fault> {
    Ok(lowered(input, functions)?.optimised())
}

/// Lowers a function and two that take its result. The third takes the first `shared` arguments of the second, and the
/// outputs are the results of the second, then those of the third. The inputs are the arguments of the first function,
/// then what the second takes besides, then the third.
///
/// # Errors
/// When a function uses what programs lack, or they are too long.
#[cfg(feature = "gpu")]
pub(super) fn lower_fork(
    input: Input<'_>,
    first: Handle<Function>,
    [second, third]: [Handle<Function>; 2],
    shared: usize,
) -> Result<Code, Fault> {
    let mut lowerer = Lowerer::new(input);
    let (result, _) = lowerer.call_whole(first, Vec::new())?;
    let (results, mut arguments) = lowerer.call_whole(second, vec![Value::Scalars(result)])?;
    arguments.truncate(shared);
    let (more, _) = lowerer.call_whole(third, arguments)?;
    let results: Vec<Scalar> = results.iter().chain(more.iter()).copied().collect();
    Ok(lowerer.finish(&results).optimised().code)
}

/// [`lower_chain`] without the optimisations that follow. The last argument of a single function may be a pointer to a
/// result; it points to zeros.
///
/// # Errors
/// When a function uses what programs lack, or they are too long.
pub(super) fn lowered(input: Input<'_>, functions: &[Handle<Function>]) -> Result<Lowered, Fault> {
    let mut lowerer = Lowerer::new(input);
    let (mut results, mut given) = (Rc::from([]), Vec::new());
    for &function in functions {
        (results, _) = lowerer.call_whole(function, given)?;
        if !matches!(input.base, Base::Refused) {
            lowerer.given = lowerer.given.max((BlockColumns::POINT + BlockColumns::FINISH) as u32);
        }
        given = vec![Value::Scalars(Rc::clone(&results))];
    }
    Ok(lowerer.finish(&results))
}

impl<'m> Lowerer<'m> {
    fn new(input: Input<'m>) -> Self {
        let mut lowerer = Self {
            input,
            code: Code::default(),
            constants: HashMap::new(),
            known: vec![HashMap::new()],
            variables: Variables::default(),
            assigned: HashSet::new(),
            globals: HashMap::new(),
            attributes: None,
            pictures: HashMap::new(),
            looked_up: Vec::new(),
            slopes: HashMap::new(),
            scopes: HashMap::new(),
            frames: Vec::new(),
            exits: Vec::new(),
            mask: None,
            departures: 0,
            statements: 0,
            place: 0,
            waiting: 0,
            waits: false,
            counts: Counts::default(),
            asked: Vec::new(),
            asks_base: false,
            scatters_through: false,
            given: 0,
        };
        lowerer.waiting = lowerer.register();
        let waiting = lowerer.waiting;
        lowerer.write(Operation::Copy, &[Scalar::truth(false)], waiting);
        lowerer
    }

    /// Calls a function of the file with some arguments, and inputs for the others: its result and all arguments.
    fn call_whole(
        &mut self,
        function: Handle<Function>,
        given: Vec<Value>,
    ) -> Result<(Rc<[Scalar]>, Vec<Value>), Fault> {
        let (arguments, pointed) = self.arguments(function, given)?;
        // Each call begins with the initial values of the module's variables.
        self.declare_globals()?;
        let mut results = self.inline(function, arguments.clone())?;
        if let Some(variable) = pointed {
            results = self.value_of(variable);
        }
        Ok((results, arguments))
    }

    /// The program of these results.
    fn finish(mut self, results: &[Scalar]) -> Lowered {
        let inputs: HashMap<Register, u32> =
            self.code.inputs.iter().map(|&(input, register)| (register, input)).collect();
        let outputs = results
            .iter()
            .map(|scalar| match scalar {
                Scalar::Word(word) => Output::Known(*word),
                Scalar::Column(register) => {
                    inputs.get(register).map_or(Output::Computed, |&input| Output::Input(input))
                }
            })
            .collect();
        self.code.outputs = results.iter().map(|&scalar| self.column(scalar)).collect();
        let Lowerer { mut code, constants, counts, waiting, asks_base, scatters_through, .. } = self;
        code.constants = constants.into_iter().map(|(word, register)| (register, word)).collect();
        code.constants.sort_unstable();
        Lowered { code, outputs, waiting, counts, asks_base, scatters_through }
    }

    /// The arguments of a function: those that are given, then inputs; and what the last one points to.
    fn arguments(
        &mut self,
        function: Handle<Function>,
        given: Vec<Value>,
    ) -> Result<(Vec<Value>, Option<VariableId>), Fault> {
        let module = self.input.module;
        let mut arguments = given;
        let mut pointed = None;
        for argument in &module.functions[function].arguments[arguments.len()..] {
            let inner = &module.types[argument.ty].inner;
            if let TypeInner::Pointer { base, .. } = inner {
                let inner = module.types[*base].inner.clone();
                let zeros = self.zeros(&inner)?;
                let variable = self.declare(zeros);
                pointed = Some(variable);
                arguments.push(Value::Place(Place { variable, offset: 0, inner, indices: Vec::new() }));
                continue;
            }
            let scalars: Rc<[Scalar]> = (0..self.width(inner)?).map(|_| self.input_scalar()).collect();
            arguments.push(Value::Scalars(scalars));
        }
        Ok((arguments, pointed))
    }

    /// The next input.
    fn input_scalar(&mut self) -> Scalar {
        let register = self.register();
        self.code.inputs.push((self.given, register));
        self.given += 1;
        Scalar::Column(register)
    }

    /// A new register.
    fn register(&mut self) -> Register {
        self.code.registers += 1;
        self.code.registers - 1
    }

    /// The register of a scalar.
    fn column(&mut self, scalar: Scalar) -> Register {
        match scalar {
            Scalar::Column(register) => register,
            Scalar::Word(word) => match self.constants.get(&word) {
                Some(&register) => register,
                None => {
                    let register = self.register();
                    self.constants.insert(word, register);
                    register
                }
            },
        }
    }

    /// The result of an operation: folded, known from before, or computed by a new instruction.
    fn compute(&mut self, operation: Operation, operands: &[Scalar]) -> Scalar {
        let mut all = [Scalar::Word(0); 3];
        all[..operands.len()].copy_from_slice(operands);
        if let Some(scalar) = simplified(operation, all) {
            return scalar;
        }
        let key = (operation, all);
        if let Some(&scalar) = self.known.iter().rev().find_map(|scope| scope.get(&key)) {
            return scalar;
        }
        let to = self.register();
        self.write(operation, operands, to);
        self.note_slope(operation, operands, to);
        let scalar = Scalar::Column(to);
        if let Some(scope) = self.known.last_mut() {
            scope.insert(key, scalar);
        }
        scalar
    }

    /// Writes the result of an operation to a register that may be written several times.
    fn write(&mut self, operation: Operation, operands: &[Scalar], to: Register) {
        let mut columns = [0; 3];
        for (column, &operand) in columns.iter_mut().zip(operands) {
            *column = self.column(operand);
        }
        self.code.instructions.push(Instruction::Compute { operation, operands: columns, to });
    }

    /// The present value of a register that may be written again.
    fn copied(&mut self, from: Register) -> Register {
        let to = self.register();
        self.write(Operation::Copy, &[Scalar::Column(from)], to);
        to
    }

    /// A mask as a scalar.
    fn mask_scalar(mask: PointMask) -> Scalar {
        mask.map_or(Scalar::truth(true), Scalar::Column)
    }

    /// A register that holds a mask now and may be written later.
    fn mask_register(&mut self, mask: PointMask) -> Register {
        let to = self.register();
        self.write(Operation::Copy, &[Self::mask_scalar(mask)], to);
        to
    }

    fn check_length(&mut self, span: Span) -> Result<(), Fault> {
        self.statements += 1;
        if self.code.instructions.len() <= MOST_INSTRUCTIONS && self.statements <= MOST_STATEMENTS {
            return Ok(());
        }
        Err(Fault::new(
            span,
            format!(
                "calls inlined, there are over {MOST_INSTRUCTIONS} operations or {MOST_STATEMENTS} statements"
            ),
            "call fewer or shorter functions, or put the calls into a loop",
        ))
    }
}

/// The result of an operation that needs no instruction.
pub(super) fn simplified(operation: Operation, [a, b, c]: [Scalar; 3]) -> Option<Scalar> {
    let all = Scalar::truth(true);
    let one = Scalar::number(1.0);
    match (operation, a, b, c) {
        (Operation::Copy, a, ..) => return Some(a),
        (Operation::Select, Scalar::Word(truth), b, c) => return Some(if truth == 0 { c } else { b }),
        (Operation::Select, _, b, c) if b == c => return Some(b),
        (Operation::EqualInt, a, b, _) if a == b => return Some(all),
        (Operation::And, x, y, _) if y == all || x == y => return Some(x),
        (Operation::And, x, y, _) if x == all => return Some(y),
        (Operation::And | Operation::AndNot, x @ Scalar::Word(0), ..) => return Some(x),
        (Operation::And, _, y @ Scalar::Word(0), _) => return Some(y),
        (Operation::AndNot, _, y, _) if y == all => return Some(Scalar::Word(0)),
        (Operation::Or, x, y, _) if x == all || y == all => return Some(all),
        (Operation::AndNot | Operation::Or | Operation::AddInt, x, Scalar::Word(0), _) => return Some(x),
        (Operation::Or | Operation::AddInt, Scalar::Word(0), y, _) => return Some(y),
        (Operation::Mul, x, y, _) if y == one => return Some(x),
        (Operation::Mul, x, y, _) if x == one => return Some(y),
        (Operation::MulInt, x, Scalar::Word(1), _) | (Operation::MulInt, Scalar::Word(1), x, _) => {
            return Some(x);
        }
        _ => {}
    }
    let word = |scalar| match scalar {
        Scalar::Word(word) => Some(word),
        Scalar::Column(_) => None,
    };
    let operands = [a, b, c].map(word);
    let known = operands[..operation.operands()].iter().all(Option::is_some);
    known.then(|| Scalar::Word(operation.of(operands.map(Option::unwrap_or_default))))
}
