//! Runs programs at the points of one vector.
//!
//! Few points do not hide what it costs to choose an operation and to find its registers. So a register is one array
//! here, whether it is a constant or not, and an operation finds no more of them than it has.

use super::code::{Code, Instruction, Register};
use super::kernel::PointInputs;
use super::native::Native;
use super::operation::CHUNK;
use super::run::{BUDGET, Endless, is_empty};
use crate::lanes::{Lanes, MAX_LANES, Num, OutlinedTask, for_pairs_mut};
use crate::scene::PointSink;
use std::cell::Cell;

/// A register: one word for each point.
pub(super) type Chunk = [Cell<u32>; CHUNK];

thread_local! {
    /// Registers that no program uses at present.
    static SPARE: Cell<Vec<Chunk>> = const { Cell::new(Vec::new()) };
}

/// The registers of a program while it runs at up to [`CHUNK`] points.
#[derive(Debug)]
pub(super) struct Registers {
    chunks: Vec<Chunk>,
}

impl Drop for Registers {
    fn drop(&mut self) {
        SPARE.set(std::mem::take(&mut self.chunks));
    }
}

impl Registers {
    /// Registers for a program, with any words.
    pub fn of(code: &Code) -> Self {
        let mut chunks = SPARE.take();
        if chunks.len() < code.registers as usize {
            chunks.resize_with(code.registers as usize, Default::default);
        }
        Self { chunks }
    }

    /// Sets the number of each lane. Points beyond the lanes are copies of those in lanes, so that a loop ends for them
    /// too.
    #[inline(always)]
    pub fn set<L: Lanes>(&self, register: Register, number: Num<L>) {
        let numbers = number.to_array();
        let chunk = &self.chunks[register as usize];
        for point in 0..CHUNK {
            chunk[point].set(numbers[point % L::LANES].to_bits());
        }
    }

    /// The number of each lane.
    #[inline(always)]
    pub fn get<L: Lanes>(&self, l: L, register: Register) -> Num<L> {
        let mut numbers = L::array(0.0f32);
        for_pairs_mut(numbers.as_mut(), &self.chunks[register as usize], |number, word| {
            *number = f32::from_bits(word.get());
        });
        Num::from_array(l, &numbers)
    }

    /// The words of a register.
    #[inline(always)]
    pub fn chunk(&self, register: Register) -> &Chunk {
        &self.chunks[register as usize]
    }

    /// Sink that sets the points of a function that takes some, with this many lanes.
    #[inline(always)]
    pub fn sink<'a>(&'a self, inputs: &'a PointInputs, lanes: usize) -> impl PointSink {
        PointWriter { registers: self, inputs, lanes }
    }

    /// Runs a program that calls no host functions.
    ///
    /// # Errors
    /// When a loop takes too many turns.
    #[inline(always)]
    pub fn run<L: Lanes>(&self, l: L, code: &Code) -> Result<(), Endless> {
        l.outlined(Run { code, registers: &self.chunks[..code.registers as usize] })
    }
}

struct PointWriter<'a> {
    registers: &'a Registers,
    inputs: &'a PointInputs,
    lanes: usize,
}

impl PointSink for PointWriter<'_> {
    #[inline(always)]
    fn put(&mut self, scalar: usize, column: &[f32; MAX_LANES]) {
        let Some((register, is_truth)) = self.inputs.registers[scalar] else { return };
        let chunk = &self.registers.chunks[register as usize];
        for point in 0..CHUNK {
            let number = column[point % self.lanes];
            chunk[point].set(match is_truth {
                true if number > 0.0 => u32::MAX,
                true => 0,
                false => number.to_bits(),
            });
        }
    }
}

/// A run of a program. It has code for every operation, so it is out of line, once for each level.
struct Run<'a> {
    code: &'a Code,
    registers: &'a [Chunk],
}

impl<L: Lanes> OutlinedTask<L> for Run<'_> {
    type Output = Result<(), Endless>;

    #[inline(always)]
    fn run(self, l: L) -> Self::Output {
        let Self { code, registers } = self;
        for (register, &(_, word)) in code.constants.iter().enumerate() {
            for cell in &registers[register] {
                cell.set(word);
            }
        }
        let (mut at, mut spent) = (0, 0);
        while let Some(instruction) = code.instructions.get(at) {
            at += 1;
            match instruction {
                Instruction::Compute { operation, operands, to } => {
                    operation.once(registers, *operands, *to);
                }
                Instruction::Call { native, operands, results } => {
                    call(l, *native, registers, code.list(operands), code.list(results));
                }
                Instruction::Host { function, .. } => {
                    unreachable!("`{}` in a shader without a host", function.name())
                }
                Instruction::Element { columns, index, to } => {
                    element(registers, code.list(columns), *index, *to);
                }
                Instruction::Skip { mask, to } => {
                    if is_empty(&registers[*mask as usize]) {
                        at = *to as usize;
                    }
                }
                Instruction::Repeat { mask, to, line } => {
                    spent += (at - *to as usize) as u64;
                    if is_empty(&registers[*mask as usize]) {
                        continue;
                    }
                    if spent > BUDGET {
                        return Err(Endless { line: *line });
                    }
                    at = *to as usize;
                }
            }
        }
        Ok(())
    }
}

#[inline(always)]
fn call<L: Lanes>(l: L, native: Native, registers: &[Chunk], operands: &[Register], to: &[Register]) {
    for start in (0..CHUNK).step_by(L::LANES) {
        let mut numbers = [Num::zero(l); 3];
        for (place, number) in numbers.iter_mut().enumerate().take(operands.len()) {
            let mut words = L::array(0.0f32);
            let operand = &registers[operands[place] as usize][start..start + L::LANES];
            for_pairs_mut(words.as_mut(), operand, |word, cell| *word = f32::from_bits(cell.get()));
            *number = Num::from_array(l, &words);
        }
        for (result, &to) in native.of(numbers).iter().zip(to) {
            let (result, to) = (result.to_array(), &registers[to as usize]);
            for lane in 0..L::LANES {
                to[start + lane].set(result[lane].to_bits());
            }
        }
    }
}

#[inline(always)]
fn element(registers: &[Chunk], from: &[Register], index: Register, to: Register) {
    let last = from.len() - 1;
    let (indices, to) = (&registers[index as usize], &registers[to as usize]);
    for (point, to) in to.iter().enumerate() {
        let from = from[(indices[point].get() as usize).min(last)];
        to.set(registers[from as usize][point].get());
    }
}
