//! Lowered programs: instructions over columns of words.

use super::finish_call::FinishFunction;
use super::integrator::HostFunction;
use super::native::Native;
use super::operation::Operation;
use crate::scene::Effects;
use std::collections::BTreeSet;
use std::ops::Range;

/// A column of words, one for each point of a block.
pub(super) type Register = u32;

/// One step of a program. Masks are registers of truth values.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Instruction {
    /// Computes an operation at all points.
    Compute { operation: Operation, operands: [Register; 3], to: Register },
    /// Calls a native function at all points: operands and results are ranges of [`Code::lists`].
    Call { native: Native, operands: Range<u32>, results: Range<u32> },
    /// Asks the caller for something at the points of a mask: results mean nothing at others. `place` is the call's
    /// first byte in the text that was parsed.
    Host { function: HostFunction, mask: Register, operands: Range<u32>, results: Range<u32>, place: u32 },
    /// Looks up a picture, by number, at all points: `operands` are the coordinates, the side of the square that is
    /// averaged, and the barycentrics of the hit; `results` are red, green, blue and alpha. Both are ranges of
    /// [`Code::lists`].
    LookUp { picture: u32, operands: Range<u32>, results: Range<u32> },
    /// Calls the native BSDF of a finish with these effects at all points: `operands` are those of
    /// [`super::finish_call::FinishCall`], and both are ranges of [`Code::lists`].
    Finish { function: FinishFunction, effects: Effects, operands: Range<u32>, results: Range<u32> },
    /// Copies from the register of `lists[columns]` that the index names at each point, the last one for greater
    /// indices.
    Element { columns: Range<u32>, index: Register, to: Register },
    /// Continues at another instruction unless the mask has a point.
    Skip { mask: Register, to: u32 },
    /// Continues at another instruction, before this one, if the mask has a point. `place` is the loop's first
    /// byte in the text that was parsed.
    Repeat { mask: Register, to: u32, place: u32 },
}

/// A program as instructions.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Code {
    pub instructions: Vec<Instruction>,
    /// Registers of calls and elements.
    pub lists: Vec<Register>,
    /// Registers that hold the same word at all points, and never anything else. In a finished program they are the
    /// first registers, in this order.
    pub constants: Vec<(Register, u32)>,
    /// Registers that the caller fills, by number of the input.
    pub inputs: Vec<(u32, Register)>,
    /// Registers that hold the results.
    pub outputs: Vec<Register>,
    /// Number of registers.
    pub registers: u32,
}

impl Code {
    pub fn list(&self, range: &Range<u32>) -> &[Register] {
        &self.lists[range.start as usize..range.end as usize]
    }

    /// True if it looks up pictures.
    #[cfg(feature = "gpu")]
    pub fn reads_pictures(&self) -> bool {
        self.instructions.iter().any(|instruction| matches!(instruction, Instruction::LookUp { .. }))
    }

    /// True if it calls native BSDFs.
    #[cfg(feature = "gpu")]
    pub fn calls_finishes(&self) -> bool {
        self.instructions.iter().any(|instruction| matches!(instruction, Instruction::Finish { .. }))
    }

    /// The registers that an instruction reads.
    pub fn reads(&self, instruction: &Instruction) -> Vec<Register> {
        match instruction {
            Instruction::Compute { operation, operands, .. } => operands[..operation.operands()].to_vec(),
            Instruction::Call { operands, .. }
            | Instruction::LookUp { operands, .. }
            | Instruction::Finish { operands, .. } => self.list(operands).to_vec(),
            Instruction::Host { mask, operands, .. } => {
                [self.list(operands), std::slice::from_ref(mask)].concat()
            }
            Instruction::Element { columns, index, .. } => {
                [self.list(columns), std::slice::from_ref(index)].concat()
            }
            Instruction::Skip { mask, .. } | Instruction::Repeat { mask, .. } => vec![*mask],
        }
    }

    /// The registers that an instruction writes.
    pub fn writes(&self, instruction: &Instruction) -> Vec<Register> {
        match instruction {
            Instruction::Compute { to, .. } | Instruction::Element { to, .. } => vec![*to],
            Instruction::Call { results, .. }
            | Instruction::LookUp { results, .. }
            | Instruction::Finish { results, .. }
            | Instruction::Host { results, .. } => self.list(results).to_vec(),
            Instruction::Skip { .. } | Instruction::Repeat { .. } => Vec::new(),
        }
    }

    /// Removes instructions whose results nothing needs.
    pub fn without_dead_instructions(self) -> Self {
        let mut needed: BTreeSet<Register> = self.outputs.iter().copied().collect();
        let mut alive = vec![false; self.instructions.len()];
        loop {
            let before = needed.len();
            for (index, instruction) in self.instructions.iter().enumerate().rev() {
                let writes = self.writes(instruction);
                let is_effect =
                    matches!(instruction, Instruction::Host { function, .. } if function.is_effect());
                if is_effect || writes.is_empty() || writes.iter().any(|register| needed.contains(register)) {
                    alive[index] = true;
                    needed.extend(self.reads(instruction));
                }
            }
            if needed.len() == before {
                break;
            }
        }
        let gone: Vec<bool> = alive.into_iter().map(|alive| !alive).collect();
        let mut code = self.without(&gone);
        code.constants.retain(|(register, _)| needed.contains(register));
        code.inputs.retain(|(_, register)| needed.contains(register));
        code
    }

    /// The program without some of its instructions.
    pub(super) fn without(mut self, gone: &[bool]) -> Self {
        // The new index of each instruction, and of the end.
        let mut moved = Vec::with_capacity(gone.len() + 1);
        let mut kept = 0;
        for &gone in gone {
            moved.push(kept);
            kept += u32::from(!gone);
        }
        moved.push(kept);
        let instructions = std::mem::take(&mut self.instructions).into_iter().zip(gone);
        self.instructions = instructions
            .filter_map(|(instruction, gone)| (!gone).then_some(instruction))
            .map(|instruction| match instruction {
                Instruction::Skip { mask, to } => Instruction::Skip { mask, to: moved[to as usize] },
                Instruction::Repeat { mask, to, place } => {
                    Instruction::Repeat { mask, to: moved[to as usize], place }
                }
                other => other,
            })
            .collect();
        self
    }

    /// Maps registers that are never needed at the same time to the same one, so that the columns of a program stay in
    /// the nearest cache.
    pub fn with_few_registers(mut self) -> Self {
        let lives = self.lives();
        let mut starts: Vec<(usize, Register)> =
            lives.iter().enumerate().filter_map(|(r, life)| Some((life.as_ref()?.start, r as u32))).collect();
        starts.sort_unstable();
        let mut names = vec![u32::MAX; self.registers as usize];
        let (mut free, mut count) = (Vec::new(), self.constants.len() as u32);
        for (name, &(register, _)) in (0..).zip(&self.constants) {
            names[register as usize] = name;
        }
        // Registers in use, by the end of their lives.
        let mut used: BTreeSet<(usize, Register)> = BTreeSet::new();
        for (start, register) in starts {
            if names[register as usize] != u32::MAX {
                continue;
            }
            while let Some(&(end, name)) = used.first()
                && end < start
            {
                used.pop_first();
                free.push(name);
            }
            let name = free.pop().unwrap_or_else(|| {
                count += 1;
                count - 1
            });
            names[register as usize] = name;
            used.insert((lives[register as usize].as_ref().map_or(0, |life| life.end), name));
        }
        let named = |register: &mut Register| *register = names[*register as usize];
        self.lists.iter_mut().for_each(named);
        self.outputs.iter_mut().for_each(named);
        self.constants.iter_mut().for_each(|(register, _)| named(register));
        self.inputs.iter_mut().for_each(|(_, register)| named(register));
        for instruction in &mut self.instructions {
            match instruction {
                Instruction::Compute { operation, operands, to } => {
                    operands[..operation.operands()].iter_mut().for_each(named);
                    operands[operation.operands()..].fill(0);
                    named(to);
                }
                Instruction::Element { index, to, .. } => {
                    named(index);
                    named(to);
                }
                Instruction::Skip { mask, .. }
                | Instruction::Repeat { mask, .. }
                | Instruction::Host { mask, .. } => named(mask),
                Instruction::Call { .. } | Instruction::LookUp { .. } | Instruction::Finish { .. } => {}
            }
        }
        self.registers = count;
        self
    }

    /// From the first to the last instruction that needs each register; constants always, inputs from the start,
    /// outputs to the end. Positions count from 1.
    fn lives(&self) -> Vec<Option<Range<usize>>> {
        let end = self.instructions.len() + 1;
        let mut lives: Vec<Option<Range<usize>>> = vec![None; self.registers as usize];
        let mut seen = |register: Register, at: usize| {
            let life = lives[register as usize].get_or_insert(at..at);
            *life = life.start.min(at)..life.end.max(at);
        };
        for &(register, _) in &self.constants {
            seen(register, 0);
            seen(register, end);
        }
        self.inputs.iter().for_each(|&(_, register)| seen(register, 0));
        for (index, instruction) in self.instructions.iter().enumerate() {
            for register in self.reads(instruction).into_iter().chain(self.writes(instruction)) {
                seen(register, index + 1);
            }
        }
        self.outputs.iter().for_each(|&register| seen(register, end));
        // What a loop reads from before it is needed until its last turn. Inner loops end first.
        for (index, instruction) in self.instructions.iter().enumerate() {
            let Instruction::Repeat { to, .. } = instruction else { continue };
            let (start, end) = (*to as usize + 1, index + 1);
            for life in lives.iter_mut().flatten() {
                if life.start < start && life.end >= start {
                    life.end = life.end.max(end);
                }
            }
        }
        lives
    }
}
