//! Splits a function at its calls of `trace` and `visible` into a hit shader and loop shaders (RA sections 3.3 and 5).
//!
//! A lowered function is a list of instructions in which control only goes forwards, but for loops, and no ray is
//! traced in those. So the rest of the list behind a call is what is left to do at a point that has waited there. The
//! rest is specialised: what is known at such a point (the masks of the branches that lead to the call hold it) is
//! folded, and branches that it cannot take disappear. The registers that the rest then reads before it writes them
//! are what a loop entry keeps.

use super::HostFunction;
use crate::program::code::{Code, Instruction, Register};
use crate::program::lower::{Scalar, simplified};
use crate::program::operation::Operation;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::ops::Range;

/// The most calls of `trace` and `visible` of a function, loops unrolled.
pub(super) const MOST_TRACES: usize = 32;

/// Work that is left behind a call of `trace`, or a whole function.
#[derive(Clone, Debug, Default)]
pub(super) struct Rest {
    pub code: Code,
    /// Words that an entry keeps.
    pub words: Vec<Register>,
    /// Truth values that an entry keeps.
    pub truths: Vec<Register>,
    /// The registers of the answer.
    pub came: Vec<Register>,
    /// True if nothing is left to do but to hand the answer on.
    pub is_nothing: bool,
}

impl Rest {
    /// Registers in the order in which they are kept.
    fn kept(&self) -> impl Iterator<Item = Register> + '_ {
        self.words.iter().chain(&self.truths).copied()
    }
}

/// A function whose calls need the surface after a ray was traced, and the call's first byte in the parsed text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct NeedsHit {
    pub place: u32,
    pub function: HostFunction,
}

/// Splits a function: the whole function, whose calls of `trace` are numbered, and the rest behind each.
///
/// # Errors
/// When a rest asks for something of the surface that depends on the answer.
pub(super) fn split(mut code: Code, waiting: Register) -> Result<(Rest, Vec<Rest>), NeedsHit> {
    number_traces(&mut code);
    loop {
        let splitter = Splitter::new(&code, waiting);
        let (whole, rests) = splitter.split();
        let asking = rests.iter().enumerate().find_map(|(trace, rest)| {
            rest.code.instructions.iter().find_map(|instruction| match instruction {
                Instruction::Host { function, results, place, .. } if function.needs_hit() => {
                    let result = rest.code.list(results)[0];
                    Some((trace, result, NeedsHit { place: *place, function: *function }))
                }
                _ => None,
            })
        });
        let Some((trace, result, fault)) = asking else {
            let finished = |mut rest: Rest| {
                rest.finish();
                rest
            };
            return Ok((finished(whole), rests.into_iter().map(finished).collect()));
        };
        let before = splitter.traces[trace];
        code = splitter.moved(result, before).ok_or(fault)?;
    }
}

fn number_traces(code: &mut Code) {
    let mut number = 0;
    for instruction in &mut code.instructions {
        if let Instruction::Host { function, .. } = instruction
            && function.wait().is_some()
        {
            *function = function.numbered(number);
            number += 1;
        }
    }
}

/// Number of calls that wait for a ray.
pub(super) fn traces(code: &Code) -> usize {
    code.instructions.iter().filter(|instruction| waits(instruction)).count()
}

/// True for an instruction that waits for a ray.
fn waits(instruction: &Instruction) -> bool {
    matches!(instruction, Instruction::Host { function, .. } if function.wait().is_some())
}

struct Splitter<'a> {
    code: &'a Code,
    waiting: Register,
    /// The instructions that wait for a ray.
    traces: Vec<usize>,
    /// The instructions that write each register.
    definitions: Vec<Vec<usize>>,
    constants: HashMap<Register, u32>,
    /// Registers that hold truth values alone.
    truths: Vec<bool>,
    /// Loops: their first and last instruction.
    loops: Vec<Range<usize>>,
}

impl<'a> Splitter<'a> {
    fn new(code: &'a Code, waiting: Register) -> Self {
        let mut definitions = vec![Vec::new(); code.registers as usize];
        let (mut traces, mut loops) = (Vec::new(), Vec::new());
        for (at, instruction) in code.instructions.iter().enumerate() {
            code.writes(instruction).into_iter().for_each(|to| definitions[to as usize].push(at));
            match instruction {
                instruction if waits(instruction) => traces.push(at),
                Instruction::Repeat { to, .. } => loops.push(*to as usize..at),
                _ => {}
            }
        }
        let constants = code.constants.iter().copied().collect();
        let mut splitter = Self { code, waiting, traces, definitions, constants, truths: Vec::new(), loops };
        splitter.truths = splitter.truths();
        splitter
    }

    fn split(&self) -> (Rest, Vec<Rest>) {
        let mut rests: Vec<Rest> = vec![Rest::default(); self.traces.len()];
        for trace in (0..self.traces.len()).rev() {
            let at = self.traces[trace];
            let (came, waits) = self.answer(at);
            let mut known = self.known_at(at);
            known.insert(waits, Scalar::truth(false));
            known.insert(self.waiting, Scalar::truth(false));
            let mut rest = self.rest(at + 1, known, &rests);
            let live = live_in(&rest.code);
            let constant = |register: &Register| rest.code.constants.iter().any(|(c, _)| c == register);
            let kept: Vec<Register> =
                live.into_iter().filter(|register| !came.contains(register) && !constant(register)).collect();
            (rest.truths, rest.words) =
                kept.into_iter().partition(|&register| self.truths[register as usize]);
            let has_effect = rest.code.instructions.iter().any(
                |instruction| matches!(instruction, Instruction::Host { function, .. } if function.is_effect()),
            );
            rest.is_nothing = !has_effect && (rest.code.outputs.is_empty() || rest.code.outputs == came);
            rest.came = came;
            rests[trace] = rest;
        }
        (self.rest(0, HashMap::new(), &rests), rests)
    }

    /// The registers of a call's answer, and that of the points that wait.
    fn answer(&self, trace: usize) -> (Vec<Register>, Register) {
        let mut results = self.code.writes(&self.code.instructions[trace]);
        let waits = results.pop().unwrap_or(self.waiting);
        (results, waits)
    }

    /// Registers whose every word is a truth value.
    fn truths(&self) -> Vec<bool> {
        use Operation as O;
        let mut truths: Vec<bool> = self.definitions.iter().map(|writes| !writes.is_empty()).collect();
        for (&register, &word) in &self.constants {
            truths[register as usize] = word == 0 || word == u32::MAX;
        }
        loop {
            let mut changed = false;
            for instruction in &self.code.instructions {
                let stays = match instruction {
                    Instruction::Compute { operation, operands, .. } => match operation {
                        O::Less | O::LessEqual | O::Equal | O::LessUint | O::LessSint | O::EqualInt => true,
                        O::Select => operands[1..].iter().all(|&operand| truths[operand as usize]),
                        O::Copy | O::Not | O::And | O::AndNot | O::Or | O::Xor => {
                            operands[..operation.operands()].iter().all(|&operand| truths[operand as usize])
                        }
                        _ => false,
                    },
                    _ => false,
                };
                for to in self.code.writes(instruction) {
                    let is_last = |w: &Register| self.code.writes(instruction).last() == Some(w);
                    let tells = waits(instruction) && is_last(&to);
                    changed |= truths[to as usize] && !stays && !tells;
                    truths[to as usize] &= stays || tells;
                }
            }
            if !changed {
                return truths;
            }
        }
    }

    /// Values known at a point that has waited at a call of `trace`: the masks around it.
    fn known_at(&self, trace: usize) -> HashMap<Register, Scalar> {
        let mut known = HashMap::new();
        let Instruction::Host { mask, .. } = self.code.instructions[trace] else { return known };
        let mut open = vec![(mask, true)];
        while let Some((register, truth)) = open.pop() {
            let definition = match self.definitions[register as usize][..] {
                [] if !self.constants.contains_key(&register) => {
                    known.insert(register, Scalar::truth(truth));
                    continue;
                }
                [definition] => definition,
                _ => continue,
            };
            if definition > trace || known.insert(register, Scalar::truth(truth)).is_some() {
                continue;
            }
            let Instruction::Compute { operation, operands: [a, b, _], .. } =
                self.code.instructions[definition]
            else {
                continue;
            };
            match (operation, truth) {
                (Operation::And, true) => open.extend([(a, true), (b, true)]),
                (Operation::AndNot, true) => open.extend([(a, true), (b, false)]),
                (Operation::Or, false) => open.extend([(a, false), (b, false)]),
                (Operation::Not, _) if self.truths[a as usize] => open.push((a, !truth)),
                (Operation::Copy, _) => open.push((a, truth)),
                _ => {}
            }
        }
        known
    }

    fn is_in_loop(&self, at: usize) -> bool {
        self.loops.iter().any(|turns| turns.start <= at && at <= turns.end)
    }

    /// The instructions from one on, given what is known of registers there. `rests` are those of later calls.
    fn rest(&self, start: usize, known: HashMap<Register, Scalar>, rests: &[Rest]) -> Rest {
        let mut code = Code { registers: self.code.registers, ..Code::default() };
        code.constants.clone_from(&self.code.constants);
        let constants = self.code.constants.iter().map(|&(register, word)| (word, register)).collect();
        let inputs = if start == 0 { self.code.inputs.clone() } else { Vec::new() };
        let mut walk = Walk { splitter: self, code, known, constants, regions: Vec::new(), rests };
        let mut places = HashMap::new();
        let mut at = start;
        while at < self.code.instructions.len() {
            walk.close_regions(at);
            places.insert(at, walk.code.instructions.len() as u32);
            for turns in self.loops.iter().filter(|turns| turns.start == at) {
                walk.forget_written(turns.start..turns.end + 1);
            }
            at = walk.step(at, &places);
        }
        walk.close_regions(at);
        let outputs = self.code.outputs.iter().map(|&register| walk.operand(register)).collect();
        let mut code = walk.code;
        (code.outputs, code.inputs) = (outputs, inputs);
        Rest { code: pruned(code), ..Rest::default() }
    }

    /// The code with the call that has this result, and what it depends on, before another instruction. `None` if it
    /// depends on what is computed only later.
    fn moved(&self, result: Register, before: usize) -> Option<Code> {
        let &call = self.definitions[result as usize].first()?;
        // Out of branches around the place that are left before the call.
        let mut place = before;
        for (at, instruction) in self.code.instructions[..before].iter().enumerate() {
            if let Instruction::Skip { to, .. } = instruction
                && (*to as usize) > before
                && (*to as usize) <= call
            {
                place = place.min(at);
            }
        }
        let mut moved = BTreeSet::new();
        let mut open = vec![call];
        while let Some(at) = open.pop() {
            let instruction = &self.code.instructions[at];
            let can_move = match instruction {
                Instruction::Compute { .. } | Instruction::Call { .. } | Instruction::Element { .. } => true,
                Instruction::Host { function, .. } => !function.is_effect(),
                _ => false,
            };
            if !can_move || self.is_in_loop(at) {
                return None;
            }
            if !moved.insert(at) {
                continue;
            }
            // Where the host is asked depends on nothing: it is asked at all points.
            let reads = match instruction {
                Instruction::Host { operands, .. } => self.code.list(operands).to_vec(),
                _ => self.code.reads(instruction),
            };
            for register in reads {
                match self.definitions[register as usize][..] {
                    [definition] if definition >= place => open.push(definition),
                    ref several if several.iter().all(|&definition| definition < place) => {}
                    _ => return None,
                }
            }
        }
        let order: Vec<usize> = (0..place)
            .chain(moved.iter().copied())
            .chain((place..self.code.instructions.len()).filter(|at| !moved.contains(at)))
            .collect();
        let kept_before = |at: usize| (place..at).filter(|other| !moved.contains(other)).count();
        let new_place = |to: u32| match to as usize {
            to if to <= place => to as u32,
            to => (place + moved.len() + kept_before(to)) as u32,
        };
        let mut code = self.code.clone();
        let all = code.constants.iter().find(|(_, word)| *word == u32::MAX).map_or(code.registers, |c| c.0);
        if all == code.registers {
            code.constants.push((all, u32::MAX));
            code.registers += 1;
        }
        code.instructions = order
            .into_iter()
            .map(|at| match self.code.instructions[at].clone() {
                Instruction::Host { function, operands, results, place, .. } if moved.contains(&at) => {
                    Instruction::Host { function, mask: all, operands, results, place }
                }
                Instruction::Skip { mask, to } => Instruction::Skip { mask, to: new_place(to) },
                Instruction::Repeat { mask, to, place } => {
                    Instruction::Repeat { mask, to: new_place(to), place }
                }
                other => other,
            })
            .collect();
        Some(code)
    }
}

/// A walk through instructions that folds what is known.
struct Walk<'a, 's> {
    splitter: &'s Splitter<'a>,
    code: Code,
    known: HashMap<Register, Scalar>,
    /// Registers of constants by their word.
    constants: HashMap<u32, Register>,
    /// Branches that are open: where they began and end in the old code, and the new instruction that skips them.
    regions: Vec<(Range<usize>, usize)>,
    rests: &'s [Rest],
}

impl Walk<'_, '_> {
    fn close_regions(&mut self, at: usize) {
        while let Some((region, skip)) = self.regions.pop_if(|(region, _)| region.end <= at) {
            let end = self.code.instructions.len() as u32;
            if let Instruction::Skip { to, .. } = &mut self.code.instructions[skip] {
                *to = end;
            }
            self.forget_written(region);
        }
    }

    fn forget_written(&mut self, instructions: Range<usize>) {
        let old = self.splitter.code;
        for instruction in &old.instructions[instructions] {
            for register in old.writes(instruction) {
                self.known.remove(&register);
                self.known.retain(|_, scalar| *scalar != Scalar::Column(register));
            }
        }
    }

    fn scalar(&self, register: Register) -> Scalar {
        if let Some(&word) = self.splitter.constants.get(&register) {
            return Scalar::Word(word);
        }
        self.known.get(&register).copied().unwrap_or(Scalar::Column(register))
    }

    fn column(&mut self, scalar: Scalar) -> Register {
        match scalar {
            Scalar::Column(register) => register,
            Scalar::Word(word) => *self.constants.entry(word).or_insert_with(|| {
                let register = self.code.registers;
                self.code.registers += 1;
                self.code.constants.push((register, word));
                register
            }),
        }
    }

    fn operand(&mut self, register: Register) -> Register {
        let scalar = self.scalar(register);
        self.column(scalar)
    }

    fn list(&mut self, registers: &[Register]) -> Range<u32> {
        let start = self.code.lists.len() as u32;
        let registers: Vec<Register> = registers.iter().map(|&register| self.operand(register)).collect();
        self.code.lists.extend(registers);
        start..self.code.lists.len() as u32
    }

    fn results(&mut self, registers: &[Register]) -> Range<u32> {
        let start = self.code.lists.len() as u32;
        self.code.lists.extend(registers);
        for register in registers {
            self.known.remove(register);
        }
        start..self.code.lists.len() as u32
    }

    /// Assigns a register, and remembers what it is then.
    fn assign(&mut self, to: Register, scalar: Scalar, at: usize) {
        let from = self.column(scalar);
        let operands = [from, 0, 0];
        self.code.instructions.push(Instruction::Compute { operation: Operation::Copy, operands, to });
        let is_stable = match scalar {
            Scalar::Word(_) => true,
            Scalar::Column(from) => {
                let is_single = self.splitter.definitions.get(from as usize).is_none_or(|all| all.len() <= 1);
                is_single && !self.splitter.is_in_loop(at)
            }
        };
        match is_stable {
            true => self.known.insert(to, scalar),
            false => self.known.remove(&to),
        };
    }

    /// Takes over one instruction; returns the next one.
    fn step(&mut self, at: usize, places: &HashMap<usize, u32>) -> usize {
        let old = self.splitter.code;
        match &old.instructions[at] {
            Instruction::Skip { mask, to } => match self.scalar(*mask) {
                Scalar::Word(0) => return *to as usize,
                Scalar::Word(_) => {}
                Scalar::Column(mask) => {
                    self.regions.push((at..*to as usize, self.code.instructions.len()));
                    self.code.instructions.push(Instruction::Skip { mask, to: 0 });
                }
            },
            Instruction::Repeat { mask, to, place } => {
                let mask = self.operand(*mask);
                let to = places.get(&(*to as usize)).copied().unwrap_or_default();
                self.code.instructions.push(Instruction::Repeat { mask, to, place: *place });
            }
            Instruction::Compute { operation, operands, to } => {
                let mut scalars = [Scalar::Word(0); 3];
                for (scalar, &operand) in scalars.iter_mut().zip(&operands[..operation.operands()]) {
                    *scalar = self.scalar(operand);
                }
                match simplified(*operation, scalars) {
                    Some(scalar) => self.assign(*to, scalar, at),
                    None => {
                        let mut operands = [0; 3];
                        for (operand, &scalar) in operands.iter_mut().zip(&scalars[..operation.operands()]) {
                            *operand = self.column(scalar);
                        }
                        let (operation, to) = (*operation, *to);
                        self.code.instructions.push(Instruction::Compute { operation, operands, to });
                        self.known.remove(&to);
                    }
                }
            }
            Instruction::Call { native, operands, results } => {
                let operands = self.list(old.list(operands));
                let (native, results) = (*native, self.results(old.list(results)));
                self.code.instructions.push(Instruction::Call { native, operands, results });
            }
            Instruction::LookUp { .. } => unreachable!("an integrator looks up no pictures"),
            Instruction::Finish { .. } => unreachable!("an integrator has no finish"),
            Instruction::Element { columns, index, to } => {
                let columns = self.list(old.list(columns));
                let (index, to) = (self.operand(*index), *to);
                self.code.instructions.push(Instruction::Element { columns, index, to });
                self.known.remove(&to);
            }
            Instruction::Host { function, mask, operands, results, place } => {
                self.host(*function, *mask, operands, results, *place);
            }
        }
        at + 1
    }

    fn host(
        &mut self,
        function: HostFunction,
        mask: Register,
        operands: &Range<u32>,
        results: &Range<u32>,
        place: u32,
    ) {
        let old = self.splitter.code;
        if self.scalar(mask) == Scalar::Word(0) {
            for &result in old.list(results) {
                self.assign(result, Scalar::Word(0), usize::MAX);
            }
            return;
        }
        let mut given = old.list(operands).to_vec();
        if let Some(trace) = function.wait()
            && !self.rests[trace as usize].is_nothing
        {
            given.extend(self.rests[trace as usize].kept());
        }
        let (operands, mask) = (self.list(&given), self.operand(mask));
        let results = self.results(old.list(results));
        self.code.instructions.push(Instruction::Host { function, mask, operands, results, place });
    }
}

/// Code without instructions that nothing needs, and without empty branches.
fn pruned(mut code: Code) -> Code {
    loop {
        code = code.without_dead_instructions();
        let alive: Vec<bool> = code
            .instructions
            .iter()
            .enumerate()
            .map(|(at, instruction)| match instruction {
                Instruction::Skip { to, .. } => *to as usize != at + 1,
                _ => true,
            })
            .collect();
        if alive.iter().all(|&alive| alive) {
            return code;
        }
        let gone: Vec<bool> = alive.into_iter().map(|alive| !alive).collect();
        code = code.without(&gone);
    }
}

/// The registers that code reads before it writes them, constants included.
fn live_in(code: &Code) -> BTreeSet<Register> {
    let mut at_targets: BTreeMap<usize, BTreeSet<Register>> = BTreeMap::new();
    for instruction in &code.instructions {
        if let Instruction::Skip { to, .. } | Instruction::Repeat { to, .. } = instruction {
            at_targets.insert(*to as usize, BTreeSet::new());
        }
    }
    loop {
        let before = at_targets.clone();
        let mut live: BTreeSet<Register> = code.outputs.iter().copied().collect();
        for (at, instruction) in code.instructions.iter().enumerate().rev() {
            if let Some(target) = at_targets.get_mut(&(at + 1)) {
                target.extend(&live);
            }
            if let Instruction::Skip { to, .. } | Instruction::Repeat { to, .. } = instruction {
                live.extend(&at_targets[&(*to as usize)]);
            }
            for register in code.writes(instruction) {
                live.remove(&register);
            }
            live.extend(code.reads(instruction));
        }
        if let Some(target) = at_targets.get_mut(&0) {
            target.extend(&live);
        }
        if at_targets == before {
            return live;
        }
    }
}

impl Rest {
    /// Names what is kept and the answer as inputs, and maps registers to few.
    fn finish(&mut self) {
        let kept = self.words.iter().chain(&self.truths).chain(&self.came);
        if self.code.inputs.is_empty() {
            self.code.inputs = (0..).zip(kept.copied()).collect();
        }
        let inputs = std::mem::take(&mut self.code.inputs);
        let needed: BTreeSet<Register> = self
            .code
            .instructions
            .iter()
            .flat_map(|instruction| self.code.reads(instruction))
            .chain(self.code.outputs.iter().copied())
            .collect();
        self.code.inputs = inputs.into_iter().filter(|(_, register)| needed.contains(register)).collect();
        self.code.constants.sort_unstable();
        self.code = std::mem::take(&mut self.code).with_few_registers();
    }
}
