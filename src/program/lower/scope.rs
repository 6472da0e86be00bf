//! Scopes of variables.
//!
//! naga moves the variables of a function to its beginning. This finds again where each is needed: the first statement
//! of a block such that all its uses stand inside or behind it. Points that do not come there never read the variable,
//! so an assignment at all points that do replaces its value, and a counter in a branch stays known.

use naga::{Block, Expression, Function, Handle, LocalVariable, Statement};
use std::collections::HashMap;

/// The variables of a function whose scope begins with a statement, by the statement's address.
#[derive(Debug, Default)]
pub(super) struct Scopes(HashMap<*const Statement, Vec<Handle<LocalVariable>>>);

impl Scopes {
    pub fn of(function: &Function) -> Self {
        let mut walk = Walk::new(function);
        walk.block(&function.body, None, false);
        let mut scopes = Self::default();
        for (&variable, &(first, last)) in &walk.uses {
            if let Some(statement) = walk.begin(variable, first, last) {
                scopes.0.entry(statement).or_default().push(variable);
            }
        }
        scopes
    }

    /// The variables whose scope begins with a statement.
    pub fn begin(&self, statement: &Statement) -> &[Handle<LocalVariable>] {
        self.0.get(&std::ptr::from_ref(statement)).map_or(&[], Vec::as_slice)
    }
}

/// A block in the order of the text. A statement's position is the number of those before it.
struct Span {
    /// The block around it, and the position of the statement that has it.
    parent: Option<(usize, usize)>,
    in_loop: bool,
    /// The position behind its last statement.
    end: usize,
}

struct Walk<'m> {
    function: &'m Function,
    /// The statements: the block, and the variable that a store replaces as a whole.
    statements: Vec<(*const Statement, usize, Option<Handle<LocalVariable>>)>,
    blocks: Vec<Span>,
    /// The first and the last position at which a variable is used.
    uses: HashMap<Handle<LocalVariable>, (usize, usize)>,
}

impl<'m> Walk<'m> {
    fn new(function: &'m Function) -> Self {
        Self { function, statements: Vec::new(), blocks: Vec::new(), uses: HashMap::new() }
    }

    fn block(&mut self, block: &Block, parent: Option<(usize, usize)>, in_loop: bool) {
        let number = self.blocks.len();
        self.blocks.push(Span { parent, in_loop, end: 0 });
        for statement in block {
            self.statements.push((std::ptr::from_ref(statement), number, None));
            self.statement(statement, number, in_loop);
        }
        self.blocks[number].end = self.statements.len();
    }

    fn statement(&mut self, statement: &Statement, number: usize, in_loop: bool) {
        let at = self.statements.len() - 1;
        match statement {
            Statement::Emit(range) => {
                for handle in range.clone() {
                    if let Expression::Load { pointer } = self.function.expressions[handle] {
                        self.used(pointer, at);
                    }
                }
            }
            Statement::Store { pointer, .. } => {
                self.used(*pointer, at);
                if let Expression::LocalVariable(variable) = self.function.expressions[*pointer] {
                    self.statements[at].2 = Some(variable);
                }
            }
            Statement::Call { arguments, .. } => {
                arguments.iter().for_each(|&argument| self.used(argument, at))
            }
            Statement::Block(block) => self.block(block, Some((number, at)), in_loop),
            Statement::If { accept, reject, .. } => {
                self.block(accept, Some((number, at)), in_loop);
                self.block(reject, Some((number, at)), in_loop);
            }
            Statement::Switch { cases, .. } => {
                cases.iter().for_each(|case| self.block(&case.body, Some((number, at)), in_loop));
            }
            Statement::Loop { body, continuing, .. } => {
                self.block(body, Some((number, at)), true);
                self.block(continuing, Some((number, at)), true);
            }
            _ => {}
        }
    }

    fn used(&mut self, pointer: Handle<Expression>, at: usize) {
        match self.function.expressions[pointer] {
            Expression::Access { base, .. } | Expression::AccessIndex { base, .. } => self.used(base, at),
            Expression::LocalVariable(variable) => {
                self.uses.entry(variable).or_insert((at, at)).1 = at;
            }
            _ => {}
        }
    }

    /// The statement with which the scope of a variable begins.
    fn begin(&self, variable: Handle<LocalVariable>, first: usize, last: usize) -> Option<*const Statement> {
        let (mut statement, mut number) = (first, self.statements[first].1);
        loop {
            let block = &self.blocks[number];
            // A turn of a loop may read what the turn before it has left, unless it begins with another value.
            let is_new = statement == first && self.statements[first].2 == Some(variable);
            if last < block.end && (!block.in_loop || is_new) {
                return Some(self.statements[statement].0);
            }
            (number, statement) = block.parent?;
        }
    }
}
