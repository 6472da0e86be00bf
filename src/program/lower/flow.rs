//! Statements.

use super::variable::VariableId;
use super::{Exit, Lowerer, PointMask, Scalar};
use crate::program::code::{Instruction, Register};
use crate::program::operation::Operation;
use crate::program::source::Fault;
use naga::{Block, Expression, Handle, Span, Statement, SwitchCase, SwitchValue};
use std::collections::BTreeSet;

/// Way in which a block ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Flow {
    /// Some points may reach what follows.
    On,
    /// No point does.
    Ended,
}

impl Lowerer<'_> {
    /// Lowers statements for the points of the mask. Afterwards the mask holds the points that go on.
    pub(super) fn block(&mut self, block: &Block) -> Result<Flow, Fault> {
        for (statement, &span) in block.span_iter() {
            self.check_length(span)?;
            self.place = place(span);
            self.begin_scopes(statement);
            if self.statement(statement, span).map_err(|fault| fault.at(span))? == Flow::Ended {
                return Ok(Flow::Ended);
            }
        }
        Ok(Flow::On)
    }

    fn statement(&mut self, statement: &Statement, span: Span) -> Result<Flow, Fault> {
        match statement {
            Statement::Emit(range) => {
                for expression in range.clone() {
                    self.evaluate(expression)?;
                }
            }
            Statement::Block(block) => return self.block(block),
            Statement::If { condition, accept, reject } => {
                let condition = self.scalar(*condition)?;
                return self.branch(condition, accept, reject);
            }
            Statement::Switch { selector, cases } => return self.switch(*selector, cases),
            Statement::Loop { body, continuing, break_if } => {
                return self.lower_loop(body, continuing, *break_if, span);
            }
            Statement::Break => return Ok(self.leave(true)),
            Statement::Continue => return Ok(self.leave(false)),
            Statement::Return { value } => return self.leave_function(*value),
            Statement::Store { pointer, value } => {
                let (place, scalars) = (self.place(*pointer)?, self.scalars(*value)?);
                self.store(&place, &scalars)?;
            }
            Statement::Call { function, arguments, result } => {
                self.call(*function, arguments, *result)?;
            }
            Statement::Kill => {
                return Err(Fault::new(
                    span,
                    "`discard` has no meaning here",
                    "return a finish of opacity 0",
                ));
            }
            _ => {
                return Err(Fault::new(
                    span,
                    "barriers, atomics and writes to textures have no meaning here",
                    "each call computes one point from its arguments alone",
                ));
            }
        }
        Ok(Flow::On)
    }

    /// `a & b` of masks; known if no point or all points remain.
    fn narrowed(&mut self, mask: PointMask, condition: Scalar, wanted: bool) -> Scalar {
        let mask = Self::mask_scalar(mask);
        match wanted {
            true => self.compute(Operation::And, &[condition, mask]),
            false => self.compute(Operation::AndNot, &[mask, condition]),
        }
    }

    /// Removes the points of the mask from a mask register.
    fn remove_from(&mut self, register: Register) {
        let mask = Self::mask_scalar(self.mask);
        self.write(Operation::AndNot, &[Scalar::Column(register), mask], register);
    }

    pub(super) fn branch(
        &mut self,
        condition: Scalar,
        accept: &Block,
        reject: &Block,
    ) -> Result<Flow, Fault> {
        if let Scalar::Word(truth) = condition {
            if (leaves(accept) || leaves(reject))
                && let Some(exit) = self.exits.last_mut()
            {
                exit.known_decisions += 1;
            }
            return self.block(if truth == 0 { reject } else { accept });
        }
        let (before, departures) = (self.mask, self.departures);
        let then = self.narrowed(before, condition, true);
        let other = self.narrowed(before, condition, false);
        let mut stored = BTreeSet::new();
        self.stored_in(accept, &mut stored);
        self.stored_in(reject, &mut stored);
        let homed = self.homed(&stored);
        let region = self.open_region(stored);
        let counts = self.counts;
        let accepted = self.masked_block(then, accept)?;
        self.restore(&region);
        let accepting = std::mem::replace(&mut self.counts, counts);
        let rejected = if reject.is_empty() { Flow::On } else { self.masked_block(other, reject)? };
        self.counts = self.counts.most(accepting);
        self.close_region(region, &homed);
        self.mask = before;
        self.drop_departed(departures);
        Ok(if accepted == rejected { accepted } else { Flow::On })
    }

    /// A block at the points of a mask, skipped where there are none.
    fn masked_block(&mut self, mask: Scalar, block: &Block) -> Result<Flow, Fault> {
        if block.is_empty() || mask == Scalar::Word(0) {
            return Ok(if block.is_empty() { Flow::On } else { Flow::Ended });
        }
        let register = self.column(mask);
        let acting = self.acting(register);
        let skip = self.code.instructions.len();
        self.code.instructions.push(Instruction::Skip { mask: acting, to: 0 });
        self.known.push(Default::default());
        self.mask = Some(register);
        let flow = self.block(block);
        self.known.pop();
        let end = self.code.instructions.len() as u32;
        self.code.instructions[skip] = Instruction::Skip { mask: acting, to: end };
        flow
    }

    /// Removes the points from the mask that have left since `departures`.
    pub(super) fn drop_departed(&mut self, departures: u64) {
        if self.departures == departures {
            return;
        }
        let Some(frame) = self.frames.last() else { return };
        let staying = match self.exits[frame.exits..].last() {
            Some(exit) => exit.running,
            None => frame.live,
        };
        let staying = Scalar::Column(self.copied(staying));
        let mask = self.compute(Operation::And, &[Self::mask_scalar(self.mask), staying]);
        self.mask = Some(self.column(mask));
    }

    /// The points of the mask leave the innermost loop or switch, or only this turn of the innermost loop.
    fn leave(&mut self, for_good: bool) -> Flow {
        let first = self.frames.last().map_or(0, |frame| frame.exits);
        let innermost = self.exits.len() - 1;
        if let Some(exit) = self.exits.last_mut()
            && exit.turn == Some(self.mask)
            && (for_good || exit.is_loop)
        {
            exit.left |= for_good;
            return Flow::Ended;
        }
        for index in (first..=innermost).rev() {
            let Exit { is_loop, live, running, .. } = self.exits[index];
            self.exits[index].varied = true;
            self.remove_from(running);
            if for_good {
                self.remove_from(live);
            }
            if for_good || is_loop {
                break;
            }
            // A turn of a loop that ends inside of a switch leaves the switch for good.
            self.remove_from(live);
        }
        self.departures += 1;
        Flow::Ended
    }

    fn leave_function(&mut self, value: Option<Handle<Expression>>) -> Result<Flow, Fault> {
        let scalars = value.map(|value| self.scalars(value)).transpose()?;
        let Some(frame) = self.frames.last() else { return Ok(Flow::Ended) };
        let (result, live, first) = (frame.result, frame.live, frame.exits);
        if let (Some(result), Some(scalars)) = (result, scalars) {
            let place = self.whole(result, value)?;
            self.store(&place, &scalars)?;
        }
        if let Some(frame) = self.frames.last_mut() {
            if frame.entry == self.mask && !frame.varied {
                frame.returned = true;
                return Ok(Flow::Ended);
            }
            frame.varied = true;
        }
        for index in first..self.exits.len() {
            let Exit { live, running, .. } = self.exits[index];
            self.exits[index].varied = true;
            self.remove_from(live);
            self.remove_from(running);
        }
        self.remove_from(live);
        self.departures += 1;
        Ok(Flow::Ended)
    }

    /// The mask register of points, and the exit around a loop or a switch.
    pub(super) fn enter(&mut self, is_loop: bool) -> usize {
        let entry = self.mask;
        let (live, running) = (self.mask_register(entry), self.mask_register(entry));
        let turn = Some(entry);
        let exit =
            Exit { is_loop, entry, turn, live, running, varied: false, left: false, known_decisions: 0 };
        self.exits.push(exit);
        self.exits.len() - 1
    }

    fn switch(&mut self, selector: Handle<Expression>, cases: &[SwitchCase]) -> Result<Flow, Fault> {
        let selector = self.scalar(selector)?;
        let (before, departures) = (self.mask, self.departures);
        self.enter(false);
        let mut matched = Scalar::truth(false);
        let mut pending = Scalar::truth(false);
        let mut conditions = Vec::new();
        for case in cases {
            let here = match case.value {
                SwitchValue::I32(value) => self.equals(selector, value as u32),
                SwitchValue::U32(value) => self.equals(selector, value),
                SwitchValue::Default => Scalar::truth(false),
            };
            matched = self.compute(Operation::Or, &[matched, here]);
            conditions.push((here, case.value == SwitchValue::Default));
        }
        let others = self.compute(Operation::Not, &[matched]);
        for (case, (here, is_default)) in cases.iter().zip(conditions) {
            let here = if is_default { others } else { here };
            pending = self.compute(Operation::Or, &[pending, here]);
            if case.fall_through {
                continue;
            }
            self.branch(pending, &case.body, &Block::new())?;
            let left = self.exits.last().is_some_and(|exit| exit.left);
            let returned = self.frames.last().is_some_and(|frame| frame.returned);
            if left || returned || pending == Scalar::truth(true) {
                break;
            }
            pending = Scalar::truth(false);
        }
        self.exits.pop();
        self.mask = before;
        if self.frames.last().is_some_and(|frame| frame.returned) {
            return Ok(Flow::Ended);
        }
        self.drop_departed(departures);
        Ok(Flow::On)
    }

    fn equals(&mut self, selector: Scalar, value: u32) -> Scalar {
        self.compute(Operation::EqualInt, &[selector, Scalar::Word(value)])
    }

    fn lower_loop(
        &mut self,
        body: &Block,
        continuing: &Block,
        break_if: Option<Handle<Expression>>,
        span: Span,
    ) -> Result<Flow, Fault> {
        if let Some(flow) = self.unrolled(body, continuing, break_if)? {
            return Ok(flow);
        }
        let (before, departures) = (self.mask, self.departures);
        let mut stored = BTreeSet::new();
        self.stored_in(body, &mut stored);
        self.stored_in(continuing, &mut stored);
        let homed: BTreeSet<VariableId> = self.homed(&stored);
        let region = self.open_region(stored);
        self.forget_stored(&region);
        let exit = self.enter(true);
        self.exits[exit].turn = None;
        let (live, running) = (self.exits[exit].live, self.exits[exit].running);
        if self.waits {
            self.write(Operation::AndNot, &[Scalar::Column(live), Scalar::Column(self.waiting)], live);
        }
        self.known.push(Default::default());
        let start = self.code.instructions.len() as u32;
        let turn = self.copied(live);
        self.write(Operation::Copy, &[Scalar::Column(turn)], running);
        self.mask = Some(turn);
        self.block(body)?;
        self.mask = Some(self.copied(live));
        self.block(continuing)?;
        if let Some(condition) = break_if {
            let condition = self.scalar(condition)?;
            self.write(Operation::AndNot, &[Scalar::Column(live), condition], live);
        }
        self.code.instructions.push(Instruction::Repeat { mask: live, to: start, place: place(span) });
        self.known.pop();
        self.exits.pop();
        self.close_region(region, &homed);
        self.mask = before;
        self.drop_departed(departures);
        Ok(Flow::On)
    }
}

/// The first byte of a place.
fn place(span: Span) -> u32 {
    span.to_range().map_or(0, |range| range.start as u32)
}

/// True if a block decides about leaving a loop.
fn leaves(block: &Block) -> bool {
    block.iter().any(|statement| match statement {
        Statement::Break | Statement::Return { .. } => true,
        Statement::Block(block) => leaves(block),
        Statement::If { accept, reject, .. } => leaves(accept) || leaves(reject),
        _ => false,
    })
}
