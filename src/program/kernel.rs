//! Lowered functions with the columns that they run in.

use super::code::Code;
use super::operation::CHUNK;
use super::run::{Columns, run_alone};
use super::source::{Fault, Source};
use crate::lanes::{Lanes, MAX_LANES, Num, SimdLevel, for_pairs, for_pairs_mut};
use crate::scene::{FieldType, POINT_FIELDS, PointSink};
use naga::{Function, Handle, Span};
use std::cell::{Cell, RefCell};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// The programs whose columns a thread keeps.
const KEPT: usize = 64;

thread_local! {
    /// Columns by number of the program, modulo [`KEPT`].
    static COLUMNS: RefCell<Vec<Columns>> = const { RefCell::new(Vec::new()) };
}

/// A lowered function.
#[derive(Debug)]
pub(super) struct Kernel {
    pub code: Code,
    /// Differs between all programs of a process. Columns of other sizes have the next number.
    number: u64,
}

impl Kernel {
    pub fn new(code: Code) -> Self {
        static NUMBERS: AtomicU64 = AtomicU64::new(2);
        Self { code, number: NUMBERS.fetch_add(2, Relaxed) }
    }

    /// Columns of `block` points, to be returned by [`Kernel::keep`].
    #[inline(always)]
    pub fn columns(&self, block: usize) -> Columns {
        let number = self.number(block);
        let mut columns = COLUMNS.with_borrow_mut(|all| {
            all.get_mut(number as usize % KEPT).map(std::mem::take).unwrap_or_default()
        });
        columns.prepare(&self.code, number, block);
        columns
    }

    /// Keeps columns for the next call.
    #[inline(always)]
    pub fn keep(&self, columns: Columns, block: usize) {
        COLUMNS.with_borrow_mut(|all| {
            if all.is_empty() {
                all.resize_with(KEPT, Columns::default);
            }
            all[self.number(block) as usize % KEPT] = columns;
        });
    }

    #[inline(always)]
    fn number(&self, block: usize) -> u64 {
        self.number + u64::from(block > CHUNK)
    }

    /// Runs the function at the first points, with this many lanes.
    ///
    /// # Panics
    /// When a loop takes too many turns.
    pub fn run(&self, lanes: usize, file: &str, columns: &Columns, points: usize) {
        if let Err(endless) = run_alone(SimdLevel::of_lanes(lanes), &self.code, columns, points) {
            endless_loop(file, endless.line);
        }
    }

    /// The fields of points that the function reads, if its first argument is a point, and the registers of the scalars
    /// of all arguments.
    pub fn inputs(&self) -> PointInputs {
        let kinds: Vec<(usize, bool)> = POINT_FIELDS
            .iter()
            .enumerate()
            .flat_map(|(field, row)| {
                (0..row.kind.numbers()).map(move |_| (field, row.kind == FieldType::Bool))
            })
            .collect();
        let (mut wanted, mut registers) = (0, vec![None; kinds.len()]);
        for &(scalar, register) in &self.code.inputs {
            let Some(&(field, is_truth)) = kinds.get(scalar as usize) else { continue };
            wanted |= 1 << field;
            registers[scalar as usize] = Some((register, is_truth));
        }
        PointInputs { wanted, registers }
    }
}

#[cold]
pub(super) fn endless_loop(file: &str, line: u32) -> ! {
    panic!("{file}:{line}: this loop takes too many turns; does it end at every point?");
}

/// Where a function's argument of type `Point` is.
#[derive(Clone, Debug)]
pub(super) struct PointInputs {
    /// Bit `i` is set if field `i` of [`POINT_FIELDS`] is read.
    pub wanted: u64,
    /// The register of each scalar that is read, and whether it is a truth value.
    pub registers: Vec<Option<(u32, bool)>>,
}

impl PointInputs {
    /// What writes points into the columns of the function.
    #[inline(always)]
    pub fn sink<'a>(&'a self, columns: &'a Columns) -> impl PointSink {
        PointWriter { inputs: self, columns }
    }
}

struct PointWriter<'a> {
    inputs: &'a PointInputs,
    columns: &'a Columns,
}

impl PointSink for PointWriter<'_> {
    #[inline(always)]
    fn put(&mut self, scalar: usize, column: &[f32; MAX_LANES]) {
        let Some((register, is_truth)) = self.inputs.registers[scalar] else { return };
        write(self.columns.column(register, MAX_LANES), column, is_truth);
    }
}

/// Writes numbers into a column. Truth values become words of all bits or none.
#[inline(always)]
pub(super) fn write(to: &[Cell<u32>], from: &[f32], is_truth: bool) {
    for_pairs(to, from, |cell, &number| {
        cell.set(match is_truth {
            true if number > 0.0 => u32::MAX,
            true => 0,
            false => number.to_bits(),
        });
    });
}

/// Writes a number in each lane into a column.
#[inline(always)]
pub(super) fn write_lanes<L: Lanes>(to: &[Cell<u32>], from: Num<L>) {
    for_pairs(to, from.to_array().as_ref(), |cell, number| cell.set(number.to_bits()));
}

/// Reads a register's numbers, one in each lane.
#[inline(always)]
pub(super) fn read_lanes<L: Lanes>(l: L, columns: &Columns, register: u32) -> Num<L> {
    let mut words = L::array(0.0f32);
    let from = columns.operand(register, CHUNK);
    for_pairs_mut(words.as_mut(), from.some(0, L::LANES), |word, cell| *word = f32::from_bits(cell.get()));
    Num::from_array(l, &words)
}

/// A function that a shader must define.
#[derive(Clone, Copy, Debug)]
pub(super) struct Signature {
    pub name: &'static str,
    /// Names of the arguments' types.
    pub arguments: &'static [&'static str],
    /// Name of the result's type.
    pub result: &'static str,
    /// The text to write.
    pub text: &'static str,
}

impl Signature {
    /// The function.
    ///
    /// # Errors
    /// When the shader has no such function.
    pub fn find(&self, source: &Source) -> Result<Handle<Function>, Fault> {
        let module = &source.module;
        let Self { name, arguments, result, text } = *self;
        let Some((handle, function)) = module.functions.iter().find(|(_, f)| f.name.as_deref() == Some(name))
        else {
            return Err(Fault::new(
                Span::UNDEFINED,
                format!("the shader has no function `{name}`"),
                format!("define `{text}`"),
            ));
        };
        let type_name = |ty| source.type_name(ty);
        let found: Vec<String> = function.arguments.iter().map(|argument| type_name(argument.ty)).collect();
        let returned = function.result.as_ref().map(|result| type_name(result.ty));
        if found != arguments || returned.as_deref() != Some(result) {
            let span = module.functions.get_span(handle);
            return Err(Fault::new(
                span,
                format!("`{name}` has another signature"),
                format!("write `{text}`"),
            ));
        }
        Ok(handle)
    }
}
