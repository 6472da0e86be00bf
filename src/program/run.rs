//! Runs programs over blocks of points.

use super::code::{Code, Instruction, Register};
use super::finish_call::{FinishCall, OPERANDS};
use super::integrator::{Host, HostCall};
use super::native::Native;
use super::operation::{CHUNK, Operand};
use crate::lanes::{LaneTask, Lanes, Num, OutlinedTask, SimdLevel, each, for_pairs, for_pairs_mut};
use crate::scene::BoundTexture;
use std::cell::Cell;

/// The points of a block, as `raystream bench shaders` finds best: a program's columns then fit the nearest cache, and
/// the cost of choosing operations is shared by many points.
pub const BLOCK: usize = 256;

/// The most operations that a block may compute. A loop that takes more is taken to be endless.
pub(super) const BUDGET: u64 = 1 << 24;

/// The registers of a program while it runs.
#[derive(Debug, Default)]
pub struct Columns {
    /// A chunk for each constant, then a column for each other register.
    words: Vec<Cell<u32>>,
    /// Number of constants.
    constants: usize,
    /// Points of a column.
    block: usize,
    /// The program whose constants they hold.
    program: u64,
}

/// A loop does not end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Endless {
    /// The loop's first byte in the text that was parsed.
    pub place: u32,
}

impl Columns {
    /// Makes room for a program's registers at `block` points, a multiple of [`CHUNK`], and writes its constants,
    /// unless they are there.
    pub(super) fn prepare(&mut self, code: &Code, program: u64, block: usize) {
        debug_assert!(block.is_multiple_of(CHUNK) && block > 0);
        if self.program == program && self.block == block {
            return;
        }
        let constants = code.constants.len();
        self.words.clear();
        self.words.resize(constants * CHUNK + (code.registers as usize - constants) * block, Cell::new(0));
        (self.constants, self.block) = (constants, block);
        for (&(_, word), cells) in code.constants.iter().zip(self.words.chunks_exact(CHUNK)) {
            cells.iter().for_each(|cell| cell.set(word));
        }
        self.program = program;
    }

    /// Start of a register's words, and true if it is a constant.
    #[inline(always)]
    fn place(&self, register: Register) -> (usize, bool) {
        let (register, constants) = (register as usize, self.constants);
        match register < constants {
            true => (register * CHUNK, true),
            false => (constants * CHUNK + (register - constants) * self.block, false),
        }
    }

    /// The first points of a register that is no constant.
    #[inline(always)]
    pub(super) fn column(&self, register: Register, points: usize) -> &[Cell<u32>] {
        &self.words[self.place(register).0..][..points]
    }

    /// Sets the first chunk to the number of each lane. Points beyond the lanes are copies of those in lanes, so that a
    /// loop ends for them too.
    #[inline(always)]
    pub(super) fn set_chunk<L: Lanes>(&self, register: Register, number: Num<L>) {
        let (numbers, cells) = (number.to_array(), self.column(register, CHUNK));
        for point in 0..CHUNK {
            cells[point].set(numbers[point % L::LANES].to_bits());
        }
    }

    /// A register as operations read it, of columns that have one chunk if `CHUNK_ALONE` says so.
    #[inline(always)]
    fn found<const CHUNK_ALONE: bool>(&self, register: Register, points: usize) -> Operand<'_> {
        match CHUNK_ALONE {
            true => Operand { words: &self.words[register as usize * CHUNK..][..CHUNK], mask: 0 },
            false => self.operand(register, points),
        }
    }

    /// A register as operations read it.
    #[inline(always)]
    pub(super) fn operand(&self, register: Register, points: usize) -> Operand<'_> {
        let (start, is_constant) = self.place(register);
        let (length, mask) = match is_constant {
            true => (CHUNK, 0),
            false => (points.next_multiple_of(CHUNK), usize::MAX),
        };
        Operand { words: &self.words[start..][..length], mask }
    }
}

/// [`run_alone_in`] the lanes of a level.
///
/// # Errors
/// When a loop takes too many turns.
pub(super) fn run_alone(
    level: SimdLevel,
    code: &Code,
    pictures: &[BoundTexture],
    columns: &Columns,
    points: usize,
) -> Result<(), Endless> {
    level.run(Alone { code, pictures, columns, points })
}

struct Alone<'a> {
    code: &'a Code,
    pictures: &'a [BoundTexture],
    columns: &'a Columns,
    points: usize,
}

impl LaneTask for Alone<'_> {
    type Output = Result<(), Endless>;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Self::Output {
        run_alone_in(l, self.code, self.pictures, self.columns, self.points)
    }
}

/// Runs a program that calls no host functions and looks up these pictures at the first points of a block: the least
/// multiple of [`CHUNK`] that is not below `points`.
///
/// # Errors
/// When a loop takes too many turns.
#[inline(always)]
pub(super) fn run_alone_in<L: Lanes>(
    l: L,
    code: &Code,
    pictures: &[BoundTexture],
    columns: &Columns,
    points: usize,
) -> Result<(), Endless> {
    let points = points.next_multiple_of(CHUNK).min(columns.block);
    let (at, spent) = (&mut 0, &mut 0);
    let call = match columns.block == CHUNK {
        true => l.outlined(UntilHost::<true> { code, pictures, columns, points, at, spent })?,
        false => l.outlined(UntilHost::<false> { code, pictures, columns, points, at, spent })?,
    };
    match call {
        None => Ok(()),
        Some(call) => unreachable!("`{}` in a shader without a host", call.function.name()),
    }
}

/// [`run_alone_in`] for programs that call functions of a host and look up no pictures.
///
/// # Errors
/// When a loop takes too many turns.
#[inline(always)]
pub(super) fn run<L: Lanes>(
    l: L,
    code: &Code,
    columns: &Columns,
    points: usize,
    host: &mut impl Host<L>,
) -> Result<(), Endless> {
    let points = points.next_multiple_of(CHUNK).min(columns.block);
    let (mut at, mut spent) = (0, 0);
    loop {
        let (at, spent) = (&mut at, &mut spent);
        let until_host = UntilHost::<false> { code, pictures: &[], columns, points, at, spent };
        let Some(call) = l.outlined(until_host)? else { return Ok(()) };
        host.call(l, &call);
    }
}

/// Runs a program up to its next call of the host. All programs run in this one function of each level: it has a loop
/// for every operation, and wherever it were inlined the compiler would take many seconds.
///
/// `CHUNK_ALONE` says that the columns have one chunk: then registers are found without a question, and no loop over
/// chunks is left. Of few points most of the time goes there.
struct UntilHost<'a, const CHUNK_ALONE: bool> {
    code: &'a Code,
    pictures: &'a [BoundTexture],
    columns: &'a Columns,
    points: usize,
    /// The next instruction.
    at: &'a mut usize,
    /// Operations that loops have computed so far.
    spent: &'a mut u64,
}

impl<'a, L: Lanes, const CHUNK_ALONE: bool> OutlinedTask<L> for UntilHost<'a, CHUNK_ALONE> {
    type Output = Result<Option<HostCall<'a>>, Endless>;

    #[inline(always)]
    fn run(self, l: L) -> Self::Output {
        let Self { code, pictures, columns, points, at: at_next, spent } = self;
        let points = if CHUNK_ALONE { CHUNK } else { points };
        let mut at = *at_next;
        while let Some(instruction) = code.instructions.get(at) {
            at += 1;
            match instruction {
                Instruction::Compute { operation, operands, to } => {
                    let operands = each(*operands, |register| columns.found::<CHUNK_ALONE>(register, points));
                    operation.chunks(operands, &columns.found::<CHUNK_ALONE>(*to, points).words[..points]);
                }
                Instruction::Call { native, operands, results } => {
                    call(l, *native, columns, code.list(operands), code.list(results), points);
                }
                Instruction::LookUp { picture, operands, results } => {
                    let picture = &pictures[*picture as usize];
                    look_up(l, picture, columns, code.list(operands), code.list(results), points);
                }
                Instruction::Finish { function, effects, operands, results } => {
                    let (function, to) = (*function, code.list(results));
                    for start in (0..points).step_by(L::LANES) {
                        let operands =
                            &numbers_at::<L, OPERANDS>(l, columns, code.list(operands), start, points);
                        let results = l.outlined(FinishCall { function, effects, operands });
                        write_at(columns, &results, to, start, points);
                    }
                }
                Instruction::Host { function, mask, operands, results, place } => {
                    let (operands, results) = (code.list(operands), code.list(results));
                    let (function, mask, place) = (*function, *mask, *place);
                    *at_next = at;
                    return Ok(Some(HostCall { function, columns, operands, results, mask, points, place }));
                }
                Instruction::Element { columns: from, index, to } => {
                    let from = &code.lists[from.start as usize..from.end as usize];
                    element(columns, from, *index, *to, points);
                }
                Instruction::Skip { mask, to } => {
                    if is_empty(columns.found::<CHUNK_ALONE>(*mask, points).words) {
                        at = *to as usize;
                    }
                }
                Instruction::Repeat { mask, to, place } => {
                    *spent += (at - *to as usize) as u64;
                    if is_empty(columns.found::<CHUNK_ALONE>(*mask, points).words) {
                        continue;
                    }
                    if *spent > BUDGET {
                        return Err(Endless { place: *place });
                    }
                    at = *to as usize;
                }
            }
        }
        *at_next = at;
        Ok(None)
    }
}

/// True if no point is in a mask.
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
    to: &[Register],
    points: usize,
) {
    for start in (0..points).step_by(L::LANES) {
        let numbers = numbers_at::<L, 3>(l, columns, operands, start, points);
        write_at(columns, &native.of(numbers), to, start, points);
    }
}

#[inline(always)]
fn look_up<L: Lanes>(
    l: L,
    picture: &BoundTexture,
    columns: &Columns,
    operands: &[Register],
    to: &[Register],
    points: usize,
) {
    for start in (0..points).step_by(L::LANES) {
        let [u, v, width, second, third] = numbers_at::<L, 5>(l, columns, operands, start, points);
        write_at(columns, &picture.look_up([u, v], width, [second, third]), to, start, points);
    }
}

/// The numbers of registers at the points of a vector; zeros beyond the last register.
#[inline(always)]
fn numbers_at<L: Lanes, const N: usize>(
    l: L,
    columns: &Columns,
    operands: &[Register],
    start: usize,
    points: usize,
) -> [Num<L>; N] {
    let mut numbers = [Num::zero(l); N];
    for (place, number) in numbers.iter_mut().enumerate().take(operands.len()) {
        let mut words = L::array(0.0f32);
        let operand = columns.operand(operands[place], points);
        let cells = operand.some(start, L::LANES);
        for_pairs_mut(words.as_mut(), cells, |word, cell| *word = f32::from_bits(cell.get()));
        *number = Num::from_array(l, &words);
    }
    numbers
}

/// Writes numbers to registers at the points of a vector.
#[inline(always)]
fn write_at<L: Lanes>(columns: &Columns, numbers: &[Num<L>], to: &[Register], start: usize, points: usize) {
    for (result, &to) in numbers.iter().zip(to) {
        let (result, to) = (result.to_array(), columns.column(to, points));
        for_pairs(&to[start..start + L::LANES], result.as_ref(), |cell, number| {
            cell.set(number.to_bits());
        });
    }
}

#[inline(always)]
fn element(columns: &Columns, from: &[Register], index: Register, to: Register, points: usize) {
    let last = from.len() - 1;
    let indices = columns.operand(index, points);
    for (point, to) in columns.column(to, points).iter().enumerate() {
        let from = from[(indices.at(point) as usize).min(last)];
        to.set(columns.operand(from, points).at(point));
    }
}
