//! Calls of host functions: what an integrator asks of the renderer.
//!
//! A point that traces a ray waits for its answer: from there on it has no effects, and what is computed at it means
//! nothing. The mask of waiting points says so. When the answer is there, the point goes on behind the call with no
//! point waiting; [`crate::program::integrator`] makes programs of the rests of a function.

use super::{Lowerer, PointMask, Scalar, Value};
use crate::program::code::{Instruction, Register};
use crate::program::integrator::HostFunction;
use crate::program::operation::Operation;
use crate::program::source::Fault;
use naga::{Function, Handle, Span};
use std::rc::Rc;

/// Inputs of host functions while a function is lowered.
#[derive(Clone, Copy, Debug)]
pub(in crate::program) struct HostInput<'m> {
    /// The scalars of entry and payload that `resume` reads: what a pushed entry keeps.
    pub kept: &'m [u32],
    /// Scalars of the payload, which are the last inputs of the function.
    pub payload: u32,
    /// True if rays have been hit: not in `miss` and `resume`.
    pub has_hit: bool,
    /// True if entries may be pushed.
    pub may_push: bool,
}

/// A question to the host, which is not asked again at the same points.
pub(super) struct Asked {
    function: HostFunction,
    operands: Vec<Scalar>,
    mask: PointMask,
    results: Rc<[Scalar]>,
}

/// The most effects that a point has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::program) struct Counts {
    pub splats: u64,
    pub shadows: u64,
    pub rays: u64,
    pub entries: u64,
    /// Questions whether a ray hits nothing.
    pub questions: u64,
}

impl Counts {
    /// Splats and shadow rays.
    pub fn additions(self) -> u64 {
        self.splats + self.shadows
    }

    /// The greater of each.
    pub fn most(self, other: Self) -> Self {
        Self {
            splats: self.splats.max(other.splats),
            shadows: self.shadows.max(other.shadows),
            rays: self.rays.max(other.rays),
            entries: self.entries.max(other.entries),
            questions: self.questions.max(other.questions),
        }
    }
}

impl Lowerer<'_> {
    /// The points of a mask that do not wait.
    pub(super) fn acting(&mut self, mask: Register) -> Register {
        if !self.waits {
            return mask;
        }
        let acting = self.register();
        self.write(Operation::AndNot, &[Scalar::Column(mask), Scalar::Column(self.waiting)], acting);
        acting
    }

    /// A call of a host function.
    pub(super) fn call_host(
        &mut self,
        function: HostFunction,
        handle: Handle<Function>,
        arguments: &[Value],
    ) -> Result<Rc<[Scalar]>, Fault> {
        self.check_host(function)?;
        let mut operands = Vec::new();
        for argument in arguments {
            let Value::Scalars(scalars) = argument else { continue };
            operands.extend_from_slice(scalars);
        }
        if function == HostFunction::Push {
            operands = self.kept_of(&operands);
        }
        let is_same = |asked: &&Asked| {
            (asked.function, asked.mask) == (function, self.mask) && asked.operands == operands
        };
        if let Some(asked) = self.asked.iter().find(is_same) {
            return Ok(Rc::clone(&asked.results));
        }
        let question = (!function.is_effect()).then(|| operands.clone());
        let module = self.input.module;
        let mut width = match &module.functions[handle].result {
            Some(result) => self.width(&module.types[result.ty].inner)?,
            None => 0,
        };
        // Which points wait for the ray.
        width += u32::from(function.wait().is_some());
        let mask = self.column(Self::mask_scalar(self.mask));
        let mask = self.acting(mask);
        let start = self.code.lists.len() as u32;
        let operands: Vec<Register> = operands.into_iter().map(|scalar| self.column(scalar)).collect();
        self.code.lists.extend(operands);
        let end = self.code.lists.len() as u32;
        let results: Vec<Register> = (0..width).map(|_| self.register()).collect();
        self.code.lists.extend(&results);
        let (operands, results_at, place) = (start..end, end..end + width, self.place);
        self.code.instructions.push(Instruction::Host {
            function,
            mask,
            operands,
            results: results_at,
            place,
        });
        let mut results: Vec<Scalar> = results.into_iter().map(Scalar::Column).collect();
        if function.wait().is_some()
            && let Some(waits) = results.pop()
        {
            let waiting = self.waiting;
            self.write(Operation::Or, &[Scalar::Column(waiting), waits], waiting);
            self.waits = true;
        }
        let results: Rc<[Scalar]> = results.into();
        if let Some(operands) = question {
            let (mask, results) = (self.mask, Rc::clone(&results));
            self.asked.push(Asked { function, operands, mask, results });
        }
        Ok(results)
    }

    /// Refuses calls that have no meaning here, and counts effects.
    fn check_host(&mut self, function: HostFunction) -> Result<(), Fault> {
        let host = self.input.host;
        if function.needs_hit() && !host.is_some_and(|host| host.has_hit) {
            return Err(Fault::new(
                Span::UNDEFINED,
                format!("`{}` needs a surface; there is one in `hit` only", function.name()),
                "call it in `hit`, and keep the result in the entry or the payload",
            ));
        }
        if !function.is_effect() {
            return Ok(());
        }
        if function == HostFunction::Push && !host.is_some_and(|host| host.may_push) {
            return Err(Fault::new(
                Span::UNDEFINED,
                "`push` has no entry to push here",
                "define `struct Entry` and `fn resume(e: Entry, came: vec3f, p: Payload)`; in `resume`, also say how \
                 often an entry is pushed again at most: `const max_turns: u32 = 8;`",
            ));
        }
        if self.exits.iter().any(|exit| exit.is_loop && exit.turn.is_none()) {
            return Err(Fault::new(
                Span::UNDEFINED,
                format!("`{}` is called in a loop whose number of turns is not known", function.name()),
                "give the loop a constant end, `for (var i = 0u; i < 8u; i++)`, leave it by no `break`, and put \
                 conditions into it",
            ));
        }
        let counts = &mut self.counts;
        match function {
            HostFunction::Splat => counts.splats += 1,
            HostFunction::Shadow => counts.shadows += 1,
            HostFunction::Push => counts.entries += 1,
            HostFunction::Visible(_) => counts.questions += 1,
            _ => counts.rays += 1,
        }
        Ok(())
    }

    /// Of an entry's scalars and the payload's those that are kept.
    fn kept_of(&self, entry: &[Scalar]) -> Vec<Scalar> {
        let Some(host) = self.input.host else { return Vec::new() };
        let payload = self.code.inputs.len().saturating_sub(host.payload as usize);
        let payload = self.code.inputs[payload..].iter().map(|&(_, register)| Scalar::Column(register));
        let all: Vec<Scalar> = entry.iter().copied().chain(payload).collect();
        host.kept.iter().filter_map(|&at| all.get(at as usize).copied()).collect()
    }
}
