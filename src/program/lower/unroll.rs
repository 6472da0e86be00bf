//! Loops whose end is known while lowering.

use super::flow::Flow;
use super::{Lowerer, Scalar};
use crate::program::operation::Operation;
use crate::program::source::Fault;
use naga::{Block, Expression, Handle};

/// The most turns of a loop that are lowered one by one.
const MOST_TURNS: u32 = 1024;

/// The most instructions of such a loop.
const MOST_INSTRUCTIONS: usize = 1 << 13;

/// The most statements of a program after which loops are no longer unrolled: nested attempts multiply.
const MOST_STATEMENTS: u32 = 1 << 18;

impl Lowerer<'_> {
    /// Lowers each turn of a loop by itself, so that what counts turns is known. `None` if the end is not known, or too
    /// far away; then nothing has been lowered.
    pub(super) fn unrolled(
        &mut self,
        body: &Block,
        continuing: &Block,
        break_if: Option<Handle<Expression>>,
    ) -> Result<Option<Flow>, Fault> {
        if self.statements > MOST_STATEMENTS {
            return Ok(None);
        }
        let (instructions, lists) = (self.code.instructions.len(), self.code.lists.len());
        let (variables, before, departures) = (self.variables_now(), self.mask, self.departures);
        let (counts, asked) = (self.counts, self.asked.len());
        let varied: Vec<bool> = self.exits.iter().map(|exit| exit.varied).collect();
        let has_returned = self.frames.last().is_some_and(|frame| frame.varied);
        self.known.push(Default::default());
        let exit = self.enter(true);
        let mut flow = None;
        for turn in 0..MOST_TURNS {
            flow = self.turn(exit, body, continuing, break_if)?;
            let is_known = turn > 0 || self.exits[exit].known_decisions > 0;
            let length = self.code.instructions.len() - instructions;
            if flow.is_some() || !is_known || length > MOST_INSTRUCTIONS || self.statements > MOST_STATEMENTS
            {
                break;
            }
        }
        self.exits.pop();
        let known = self.known.pop().unwrap_or_default();
        self.mask = before;
        if flow.is_none() {
            self.code.instructions.truncate(instructions);
            self.code.lists.truncate(lists);
            self.variables = variables;
            self.departures = departures;
            self.counts = counts;
            self.asked.truncate(asked);
            for (exit, varied) in self.exits.iter_mut().zip(varied) {
                exit.varied = varied;
            }
            if let Some(frame) = self.frames.last_mut() {
                frame.varied = has_returned;
            }
            return Ok(None);
        }
        // What the turns have computed is computed wherever the loop is.
        if let Some(scope) = self.known.last_mut() {
            scope.extend(known);
        }
        if flow == Some(Flow::On) {
            self.drop_departed(departures);
        }
        Ok(flow)
    }

    /// One turn. The flow behind the loop, if all points have left it.
    fn turn(
        &mut self,
        exit: usize,
        body: &Block,
        continuing: &Block,
        break_if: Option<Handle<Expression>>,
    ) -> Result<Option<Flow>, Fault> {
        let (live, running) = (self.exits[exit].live, self.exits[exit].running);
        if self.exits[exit].varied {
            let turn = self.copied(live);
            self.write(Operation::Copy, &[Scalar::Column(turn)], running);
            self.mask = Some(turn);
        } else {
            self.mask = self.exits[exit].entry;
        }
        self.exits[exit].turn = Some(self.mask);
        self.block(body)?;
        if self.frames.last().is_some_and(|frame| frame.returned) {
            return Ok(Some(Flow::Ended));
        }
        if self.exits[exit].left {
            return Ok(Some(Flow::On));
        }
        self.mask = if self.exits[exit].varied { Some(self.copied(live)) } else { self.exits[exit].entry };
        self.block(continuing)?;
        let Some(condition) = break_if else { return Ok(None) };
        match self.scalar(condition)? {
            Scalar::Word(0) => self.exits[exit].known_decisions += 1,
            Scalar::Word(_) => return Ok(Some(Flow::On)),
            condition => {
                self.exits[exit].varied = true;
                self.write(Operation::AndNot, &[Scalar::Column(live), condition], live);
                self.departures += 1;
            }
        }
        Ok(None)
    }
}
