//! Variables and places in them.

use super::{Lowerer, PointMask, Scalar};
use crate::program::code::{Instruction, Register};
use crate::program::operation::Operation;
use crate::program::source::Fault;
use naga::{Block, Expression, Handle, Statement, TypeInner};
use std::collections::{BTreeSet, HashSet};
use std::rc::Rc;

/// The most parts among which an index chooses.
const MOST_CHOICES: u32 = 256;

/// Number of a variable.
pub(super) type VariableId = usize;

/// A variable: its scalars.
#[derive(Clone, Debug)]
pub(super) struct Variable {
    /// The present value; `None` if only the homes have it.
    value: Option<Rc<[Scalar]>>,
    homes: Vec<Register>,
    /// True if assignments write the homes.
    is_homed: bool,
    /// The points at which the variable was made. An assignment at all of them replaces the value.
    made_at: PointMask,
}

/// All variables.
#[derive(Clone, Debug, Default)]
pub(super) struct Variables(Vec<Variable>);

/// A part of a variable.
#[derive(Clone, Debug)]
pub(super) struct Place {
    pub variable: VariableId,
    pub offset: u32,
    pub inner: TypeInner,
    /// Indices that are not known: index, number of parts, scalars from one part to the next.
    pub indices: Vec<(Scalar, u32, u32)>,
}

/// Variables as they were before a branch.
pub(super) struct Region {
    before: Variables,
    stored: BTreeSet<VariableId>,
    /// The scalars that have been assigned when the region began.
    assigned: HashSet<(VariableId, usize)>,
}

impl<'m> Lowerer<'m> {
    /// A new variable.
    pub(super) fn declare(&mut self, value: Rc<[Scalar]>) -> VariableId {
        let made_at = self.mask;
        self.variables.0.push(Variable { value: Some(value), homes: Vec::new(), is_homed: false, made_at });
        self.variables.0.len() - 1
    }

    /// Begins the scopes of variables that begin with a statement: points outside of the mask never read them.
    pub(super) fn begin_scopes(&mut self, statement: &Statement) {
        let Some(frame) = self.frames.last() else { return };
        for local in frame.scopes.begin(statement) {
            if let Some(&variable) = frame.locals.get(local.index()) {
                self.variables.0[variable].made_at = self.mask;
            }
        }
    }

    /// The present value of a variable.
    pub(super) fn value_of(&mut self, variable: VariableId) -> Rc<[Scalar]> {
        if let Some(value) = &self.variables.0[variable].value {
            return Rc::clone(value);
        }
        // The homes are written again, so what is read now is copied.
        let homes = self.variables.0[variable].homes.clone();
        let value: Rc<[Scalar]> = homes.into_iter().map(|home| Scalar::Column(self.copied(home))).collect();
        self.variables.0[variable].value = Some(Rc::clone(&value));
        value
    }

    /// Replaces scalars of a variable at the points of the mask.
    fn assign(&mut self, variable: VariableId, first: usize, scalars: &[Scalar]) {
        let old = self.value_of(variable);
        let mut new = old.to_vec();
        let mask = self.mask;
        let replaces = mask == self.variables.0[variable].made_at;
        for (place, &scalar) in new[first..].iter_mut().zip(scalars) {
            *place = match replaces {
                true => scalar,
                false => self.compute(Operation::Select, &[Self::mask_scalar(mask), scalar, *place]),
            };
        }
        if self.variables.0[variable].is_homed {
            // The homes also hold what points of another branch have assigned.
            for (i, &scalar) in (first..).zip(scalars) {
                // The home has it already.
                if scalar == old[i] {
                    continue;
                }
                self.assigned.insert((variable, i));
                let home = self.variables.0[variable].homes[i];
                self.write(Operation::Select, &[Self::mask_scalar(mask), scalar, Scalar::Column(home)], home);
            }
        }
        self.variables.0[variable].value = Some(new.into());
    }

    /// The register index of a place's unknown indices, and the number of choices.
    fn choice(&mut self, place: &Place) -> Result<(Scalar, u32), Fault> {
        let mut choices = 1u32;
        let mut chosen = Scalar::Word(0);
        for &(index, count, _) in &place.indices {
            choices = choices.saturating_mul(count);
            if choices > MOST_CHOICES {
                return Err(super::shape::unsupported(format!(
                    "indices that choose among more than {MOST_CHOICES} parts"
                )));
            }
            let last = Scalar::Word(count - 1);
            let inside = self.compute(Operation::LessUint, &[index, Scalar::Word(count)]);
            let index = self.compute(Operation::Select, &[inside, index, last]);
            let scaled = self.compute(Operation::MulInt, &[chosen, Scalar::Word(count)]);
            chosen = self.compute(Operation::AddInt, &[scaled, index]);
        }
        Ok((chosen, choices))
    }

    /// The offset of each choice.
    fn offsets(place: &Place) -> Vec<u32> {
        let mut offsets = vec![place.offset];
        for &(_, count, stride) in &place.indices {
            offsets = offsets.iter().flat_map(|&at| (0..count).map(move |i| at + i * stride)).collect();
        }
        offsets
    }

    /// The value at a place.
    pub(super) fn load(&mut self, place: &Place) -> Result<Rc<[Scalar]>, Fault> {
        let width = self.width(&place.inner)? as usize;
        let value = self.value_of(place.variable);
        if place.indices.is_empty() {
            return Ok(value[place.offset as usize..][..width].into());
        }
        let (chosen, _) = self.choice(place)?;
        let offsets = Self::offsets(place);
        Ok((0..width)
            .map(|i| self.element(offsets.iter().map(|&at| value[at as usize + i]), chosen))
            .collect())
    }

    /// One of some scalars.
    pub(super) fn element(&mut self, scalars: impl Iterator<Item = Scalar>, chosen: Scalar) -> Scalar {
        let scalars: Vec<Scalar> = scalars.collect();
        if let Scalar::Word(index) = chosen {
            return scalars[(index as usize).min(scalars.len() - 1)];
        }
        if scalars.iter().all(|scalar| *scalar == scalars[0]) {
            return scalars[0];
        }
        let start = self.code.lists.len() as u32;
        let registers: Vec<Register> = scalars.into_iter().map(|scalar| self.column(scalar)).collect();
        self.code.lists.extend(registers);
        let columns = start..self.code.lists.len() as u32;
        let (index, to) = (self.column(chosen), self.register());
        self.code.instructions.push(Instruction::Element { columns, index, to });
        Scalar::Column(to)
    }

    /// Assigns a value to a place at the points of the mask.
    pub(super) fn store(&mut self, place: &Place, scalars: &[Scalar]) -> Result<(), Fault> {
        if place.indices.is_empty() {
            self.assign(place.variable, place.offset as usize, scalars);
            return Ok(());
        }
        let (chosen, _) = self.choice(place)?;
        for (choice, at) in (0..).zip(Self::offsets(place)) {
            let here = self.compute(Operation::EqualInt, &[chosen, Scalar::Word(choice)]);
            let old = self.value_of(place.variable);
            let new: Vec<Scalar> = (scalars.iter().zip(&old[at as usize..]))
                .map(|(&new, &old)| self.compute(Operation::Select, &[here, new, old]))
                .collect();
            self.assign(place.variable, at as usize, &new);
        }
        Ok(())
    }

    /// Begins a branch or a loop that assigns these variables: from here on they have homes.
    pub(super) fn open_region(&mut self, stored: BTreeSet<VariableId>) -> Region {
        for &variable in &stored {
            if self.variables.0[variable].is_homed {
                continue;
            }
            let value = self.value_of(variable);
            let homes: Vec<Register> = value.iter().map(|_| self.register()).collect();
            for (&scalar, &home) in value.iter().zip(&homes) {
                self.write(Operation::Copy, &[scalar], home);
            }
            let variable = &mut self.variables.0[variable];
            (variable.homes, variable.is_homed) = (homes, true);
        }
        Region { before: self.variables.clone(), stored, assigned: std::mem::take(&mut self.assigned) }
    }

    /// Begins another branch of a region, or its end.
    pub(super) fn restore(&mut self, region: &Region) {
        let declared = self.variables.0.split_off(region.before.0.len());
        self.variables.0.clone_from(&region.before.0);
        self.variables.0.extend(declared);
    }

    /// Only the homes have the values of what a region assigns.
    pub(super) fn forget_stored(&mut self, region: &Region) {
        for &variable in &region.stored {
            self.variables.0[variable].value = None;
        }
    }

    /// Ends a region. `homed` are the variables that had homes before it.
    pub(super) fn close_region(&mut self, region: Region, homed: &BTreeSet<VariableId>) {
        self.restore(&region);
        for &variable in &region.stored {
            let Variable { value, homes, .. } = self.variables.0[variable].clone();
            // Scalars that no branch has assigned are what they were.
            let new = value.map(|old| {
                let old = old.iter().zip(homes).enumerate();
                old.map(|(i, (&old, home))| match self.assigned.contains(&(variable, i)) {
                    true => Scalar::Column(self.copied(home)),
                    false => old,
                })
                .collect()
            });
            let stays_homed = homed.contains(&variable);
            let variable = &mut self.variables.0[variable];
            (variable.value, variable.is_homed) = (new, stays_homed);
        }
        self.assigned.extend(region.assigned);
    }

    /// Those of some variables that have homes.
    pub(super) fn homed(&self, among: &BTreeSet<VariableId>) -> BTreeSet<VariableId> {
        among.iter().copied().filter(|&variable| self.variables.0[variable].is_homed).collect()
    }

    /// All variables as they are, to return to.
    pub(super) fn variables_now(&self) -> Variables {
        self.variables.clone()
    }

    /// The variables that statements of the present function assign.
    pub(super) fn stored_in(&self, block: &Block, stored: &mut BTreeSet<VariableId>) {
        for statement in block {
            match statement {
                Statement::Store { pointer, .. } => stored.extend(self.root(*pointer)),
                Statement::Call { arguments, .. } => {
                    stored.extend(arguments.iter().filter_map(|&argument| self.root(argument)));
                    stored.extend(self.globals.values().copied());
                }
                Statement::Return { .. } => stored.extend(self.frames.last().and_then(|frame| frame.result)),
                Statement::Block(block) => self.stored_in(block, stored),
                Statement::If { accept, reject, .. } => {
                    self.stored_in(accept, stored);
                    self.stored_in(reject, stored);
                }
                Statement::Switch { cases, .. } => {
                    cases.iter().for_each(|case| self.stored_in(&case.body, stored));
                }
                Statement::Loop { body, continuing, .. } => {
                    self.stored_in(body, stored);
                    self.stored_in(continuing, stored);
                }
                _ => {}
            }
        }
    }

    /// The variable that a pointer leads to; `None` if the expression is no pointer.
    fn root(&self, pointer: Handle<Expression>) -> Option<VariableId> {
        let frame = self.frames.last()?;
        match frame.function.expressions[pointer] {
            Expression::Access { base, .. } | Expression::AccessIndex { base, .. } => self.root(base),
            Expression::LocalVariable(local) => frame.locals.get(local.index()).copied(),
            Expression::GlobalVariable(global) => self.globals.get(&global).copied(),
            Expression::FunctionArgument(argument) => match frame.arguments.get(argument as usize) {
                Some(super::Value::Place(place)) => Some(place.variable),
                _ => None,
            },
            _ => None,
        }
    }
}
