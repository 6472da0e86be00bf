//! Pieces: the programs of an integrator that run by themselves.

use super::IntegratorShader;
use super::function::Host;
use super::split::Rest;
use crate::lanes::{Lanes, SimdLevel};
use crate::program::code::{Code, Instruction, Register};
use crate::program::kernel::stop;
use crate::program::run::{BLOCK, Columns, Endless, run, run_alone};
use std::cell::Cell;
use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// A hit shader, a miss shader, or a loop shader.
#[derive(Debug)]
pub struct Piece {
    code: Code,
    /// Differs between all pieces of a process.
    number: u64,
    /// Words that an entry keeps for it.
    words: usize,
    /// Truth values that an entry keeps for it.
    truths: usize,
    /// The loop shader behind each `trace`; `None` if nothing is left to do there.
    loops: Vec<Option<u32>>,
}

impl Piece {
    pub(super) fn new(rest: Rest, loops: Vec<Option<u32>>) -> Self {
        static NUMBERS: AtomicU64 = AtomicU64::new(1);
        let number = NUMBERS.fetch_add(1, Relaxed);
        Self { code: rest.code, number, words: rest.words.len(), truths: rest.truths.len(), loops }
    }

    /// The piece as a loop shader whose entries are written out by `push`.
    pub(super) fn with_words(self, words: usize) -> Self {
        Self { words, ..self }
    }

    /// Inputs that the piece reads, as their numbers and registers. Those of a hit shader are the scalars of `Hit`,
    /// then the payload's; of a miss shader the direction's, then the payload's; of a loop shader the kept words, the
    /// kept truth values, and the three numbers of the answer.
    #[inline]
    pub fn inputs(&self) -> &[(u32, Register)] {
        &self.code.inputs
    }

    /// Words that an entry keeps for the piece.
    #[inline]
    pub fn words(&self) -> usize {
        self.words
    }

    /// Truth values that an entry keeps for the piece.
    #[inline]
    pub fn truths(&self) -> usize {
        self.truths
    }

    /// Bytes that an entry keeps for the piece.
    pub fn entry_bytes(&self) -> usize {
        4 * (self.words + self.truths.div_ceil(32))
    }

    /// The loop shader behind a call of `trace`; `None` if nothing is left to do there.
    #[inline]
    pub fn loop_shader(&self, trace: u32) -> Option<u32> {
        self.loops[trace as usize]
    }

    /// Number of operations, loops counted once.
    pub fn operations(&self) -> usize {
        self.code.instructions.len()
    }

    /// True if the piece calls a host function for which a condition holds.
    pub fn asks(&self, condition: impl Fn(super::HostFunction) -> bool) -> bool {
        self.code.instructions.iter().any(
            |instruction| matches!(instruction, Instruction::Host { function, .. } if condition(*function)),
        )
    }

    /// Runs the piece of a shader at the first points of a block. Stops the job when a loop takes too many turns.
    #[inline(always)]
    pub fn run<L: Lanes>(
        &self,
        l: L,
        columns: &Columns,
        points: usize,
        host: &mut impl Host<L>,
        shader: &IntegratorShader,
    ) {
        if let Err(endless) = run(l, &self.code, columns, points, host) {
            stop(shader.text.endless_loop(endless));
        }
    }

    /// Runs a piece that calls no host functions at the first point.
    ///
    /// # Errors
    /// When a loop takes too many turns.
    pub(super) fn run_alone(&self, columns: &Columns) -> Result<(), Endless> {
        run_alone(SimdLevel::narrowest(), &self.code, &[], columns, 1)
    }

    /// The cells of a register from the first point on.
    #[inline(always)]
    pub fn column<'c>(&self, columns: &'c Columns, register: Register) -> &'c [Cell<u32>] {
        columns.column(register, BLOCK)
    }

    /// A word of the result at a point.
    #[inline]
    pub fn result(&self, columns: &Columns, index: usize, point: usize) -> u32 {
        self.code.outputs.get(index).map_or(0, |&register| columns.operand(register, BLOCK).at(point))
    }
}

/// Columns of the pieces that a thread runs.
#[derive(Debug, Default)]
pub struct PieceColumns(HashMap<u64, Columns>);

/// The most pieces whose columns a thread keeps.
const MOST_KEPT: usize = 64;

impl PieceColumns {
    /// Takes the columns of a piece, ready to run.
    pub fn take(&mut self, piece: &Piece) -> Columns {
        if self.0.len() >= MOST_KEPT {
            self.0.clear();
        }
        let mut columns = self.0.remove(&piece.number).unwrap_or_default();
        columns.prepare(&piece.code, piece.number, BLOCK);
        columns
    }

    /// Puts the columns of a piece back.
    pub fn put(&mut self, piece: &Piece, columns: Columns) {
        self.0.insert(piece.number, columns);
    }
}
