//! Fuses pairs of operations into single ones, so that programs choose fewer operations and keep fewer columns. Each
//! operation of a pair still rounds by itself.

use super::code::{Code, Instruction, Register};
use super::operation::Operation;

/// Uses of a register.
#[derive(Clone, Copy, Debug, Default)]
struct Use {
    reads: u32,
    writes: u32,
    /// The instruction that writes it.
    by: usize,
}

impl Code {
    /// Replaces each operation and its only user by one operation that computes both.
    pub fn with_pairs(mut self) -> Self {
        let mut uses = self.uses();
        // Where straight code ends: instructions with the same number run together.
        let sections = self.sections();
        let mut gone = vec![false; self.instructions.len()];
        for index in 0..self.instructions.len() {
            // A pair may become the first half of another pair.
            while let Some((first, fused)) = self.pair(index, &uses, &sections) {
                for register in self.reads(&self.instructions[first]) {
                    uses[register as usize].reads -= 1;
                }
                for register in self.reads(&self.instructions[index]) {
                    uses[register as usize].reads -= 1;
                }
                gone[first] = true;
                self.instructions[index] = fused;
                for register in self.reads(&self.instructions[index]) {
                    uses[register as usize].reads += 1;
                }
            }
        }
        self.without(&gone)
    }

    fn uses(&self) -> Vec<Use> {
        let mut uses = vec![Use::default(); self.registers as usize];
        for (index, instruction) in self.instructions.iter().enumerate() {
            for register in self.reads(instruction) {
                uses[register as usize].reads += 1;
            }
            for register in self.writes(instruction) {
                let written = &mut uses[register as usize];
                (written.writes, written.by) = (written.writes + 1, index);
            }
        }
        for &register in &self.outputs {
            uses[register as usize].reads += 1;
        }
        uses
    }

    /// The number of the straight section that each instruction is in.
    fn sections(&self) -> Vec<u32> {
        let mut starts = vec![false; self.instructions.len() + 1];
        for (index, instruction) in self.instructions.iter().enumerate() {
            if let Instruction::Skip { to, .. } | Instruction::Repeat { to, .. } = instruction {
                starts[*to as usize] = true;
                starts[index + 1] = true;
            }
        }
        let mut section = 0;
        starts
            .into_iter()
            .map(|starts| {
                section += u32::from(starts);
                section
            })
            .collect()
    }

    /// The operation that an operation can be fused with, before it, and what becomes of both.
    fn pair(&self, index: usize, uses: &[Use], sections: &[u32]) -> Option<(usize, Instruction)> {
        let Instruction::Compute { operation: second, operands: of_second, to } = self.instructions[index]
        else {
            return None;
        };
        (0..second.operands()).find_map(|place| {
            let middle = of_second[place];
            let Use { reads: 1, writes: 1, by } = uses[middle as usize] else { return None };
            let Instruction::Compute { operation: first, operands: of_first, .. } = self.instructions[by]
            else {
                return None;
            };
            if by >= index || sections[by] != sections[index] {
                return None;
            }
            let (operation, operands) = fused(first, of_first, second, of_second, place)?;
            // The first half moves to the second: what it reads must still be there.
            let moves = of_first[..first.operands()].iter().all(|&register| match uses[register as usize] {
                Use { writes: 0, .. } => true,
                Use { writes: 1, by: written, .. } => written < by,
                Use { .. } => false,
            });
            moves.then_some((by, Instruction::Compute { operation, operands, to }))
        })
    }
}

/// The operation of a pair whose second half reads the result of the first as operand `place`.
fn fused(
    first: Operation,
    [a, b, c]: [Register; 3],
    second: Operation,
    of_second: [Register; 3],
    place: usize,
) -> Option<(Operation, [Register; 3])> {
    use Operation as O;
    let other = of_second[1 - place.min(1)];
    let is_left = place == 0;
    Some(match (first, second) {
        (O::Mul, O::Add) => (O::MulAdd, [a, b, other]),
        (O::Mul, O::Sub) if is_left => (O::MulSub, [a, b, other]),
        (O::Mul, O::Sub) => (O::SubMul, [a, b, other]),
        (O::Mul, O::Mul) => (O::MulMul, [a, b, other]),
        (O::Add, O::Mul) => (O::ScaledSum, [a, b, other]),
        (O::Sub, O::Mul) => (O::ScaledDifference, [a, b, other]),
        (O::Add, O::Add) => (O::AddAdd, [a, b, other]),
        // (b - a) * c, then + a.
        (O::ScaledDifference, O::Add) if b == other => (O::Lerp, [b, a, c]),
        (O::Max, O::Min) if is_left => (O::Clamp, [a, b, other]),
        (O::MulInt, O::Xor) => (O::MulXor, [a, b, other]),
        (O::Xor, O::MulInt) => (O::XorMul, [a, b, other]),
        (O::ShrUint, O::Xor) => (O::ShrXor, [a, b, other]),
        _ => return None,
    })
}
