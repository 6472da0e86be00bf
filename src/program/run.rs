//! Runs programs over blocks of points.

use super::code::{Code, Instruction, Register};
use super::native::Native;
use super::operation::{CHUNK, Operation};
use crate::lanes::{Lanes, Num};
use std::cell::Cell;

/// The most points of a block. A program's columns then fit the nearest cache, and the cost of choosing operations is
/// shared by many points.
pub const BLOCK: usize = 128;

/// The most operations that a block may compute. A loop that takes more is taken to be endless.
const BUDGET: u64 = 1 << 24;

/// The registers of a program while it runs.
#[derive(Debug, Default)]
pub(super) struct Columns {
    words: Vec<Cell<u32>>,
    /// The program whose constants they hold.
    program: u64,
}

/// A loop does not end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Endless {
    /// Line of the loop.
    pub line: u32,
}

impl Columns {
    /// Makes room for a program's registers and writes its constants, unless they are there.
    pub fn prepare(&mut self, code: &Code, program: u64) {
        if self.program == program {
            return;
        }
        self.words.clear();
        self.words.resize(code.registers as usize * BLOCK, Cell::new(0));
        for &(register, word) in &code.constants {
            self.column(register, BLOCK).iter().for_each(|cell| cell.set(word));
        }
        self.program = program;
    }

    /// The first points of a register.
    #[inline(always)]
    pub fn column(&self, register: Register, points: usize) -> &[Cell<u32>] {
        &self.words[register as usize * BLOCK..][..points]
    }
}

/// Runs a program at the first points of a block: the least multiple of [`CHUNK`] that is not below `points`.
///
/// # Errors
/// When a loop takes too many turns.
#[inline(always)]
pub(super) fn run<L: Lanes>(l: L, code: &Code, columns: &Columns, points: usize) -> Result<(), Endless> {
    let points = points.next_multiple_of(CHUNK).min(BLOCK);
    let mut at = 0;
    let mut spent = 0u64;
    while let Some(instruction) = code.instructions.get(at) {
        at += 1;
        match instruction {
            Instruction::Compute { operation, operands, to } => {
                let operands = operands.map(|register| columns.column(register, points));
                compute(*operation, operands, columns.column(*to, points));
            }
            Instruction::Call { native, operands, results } => {
                let operands = &code.lists[operands.start as usize..operands.end as usize];
                let to = code.lists[results.start as usize];
                call(l, *native, columns, operands, to, points);
            }
            Instruction::Element { columns: from, index, to } => {
                let from = &code.lists[from.start as usize..from.end as usize];
                element(columns, from, *index, *to, points);
            }
            Instruction::Skip { mask, to } => {
                if is_empty(columns.column(*mask, points)) {
                    at = *to as usize;
                }
            }
            Instruction::Repeat { mask, to, line } => {
                spent += (at - *to as usize) as u64;
                if is_empty(columns.column(*mask, points)) {
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

#[inline(always)]
fn compute(operation: Operation, operands: [&[Cell<u32>]; 3], to: &[Cell<u32>]) {
    operation.chunks(operands, to);
}

/// Whether no point is in a mask.
#[inline(always)]
fn is_empty(mask: &[Cell<u32>]) -> bool {
    let mut any = 0;
    for cell in mask {
        any |= cell.get();
    }
    any == 0
}

#[inline(always)]
fn call<L: Lanes>(
    l: L,
    native: Native,
    columns: &Columns,
    operands: &[Register],
    to: Register,
    points: usize,
) {
    let to = columns.column(to, points);
    for start in (0..points).step_by(L::LANES) {
        let mut numbers = [Num::zero(l); 3];
        for (number, &operand) in numbers.iter_mut().zip(operands) {
            let mut words = L::array(0.0f32);
            let cells = &columns.column(operand, points)[start..start + L::LANES];
            for (word, cell) in words.as_mut().iter_mut().zip(cells) {
                *word = f32::from_bits(cell.get());
            }
            *number = Num::from_array(l, &words);
        }
        let result = native.of(numbers).to_array();
        for (cell, &number) in to[start..start + L::LANES].iter().zip(result.as_ref()) {
            cell.set(number.to_bits());
        }
    }
}

#[inline(always)]
fn element(columns: &Columns, from: &[Register], index: Register, to: Register, points: usize) {
    let last = from.len() - 1;
    let indices = columns.column(index, points);
    for (point, (index, to)) in indices.iter().zip(columns.column(to, points)).enumerate() {
        let from = from[(index.get() as usize).min(last)];
        to.set(columns.column(from, points)[point].get());
    }
}
