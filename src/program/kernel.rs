//! Lowered functions with the columns that they run in.

use super::attribute::FIRST_INPUT;
use super::code::Code;
use super::operation::CHUNK;
use super::run::{Columns, run_alone, run_alone_in};
use super::source::{Fault, ShaderError, Source, SourceText};
use crate::lanes::{Lanes, MAX_LANES, SimdLevel, for_pairs};
use crate::scene::{
    AttributeRequest, BASE, BlockColumns, BoundTexture, FieldType, POINT_FIELDS, PointSink, SurfaceField,
    WantedFields,
};
use crate::stream::stop_job;
use naga::{Function, Handle, Span};
use std::cell::{Cell, RefCell};
use std::sync::Arc;
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
    pub code: Arc<Code>,
    /// Those that it looks up, by number.
    pictures: Arc<[BoundTexture]>,
    /// Differs between all programs of a process, and from 0.
    number: u64,
}

impl Kernel {
    pub fn new(code: Code, pictures: Arc<[BoundTexture]>) -> Self {
        static NUMBERS: AtomicU64 = AtomicU64::new(1);
        Self { code: Arc::new(code), pictures, number: NUMBERS.fetch_add(1, Relaxed) }
    }

    /// The pictures that it looks up, by number.
    pub fn pictures(&self) -> &[BoundTexture] {
        &self.pictures
    }

    /// Columns of `block` points, to be returned by [`Kernel::keep`].
    pub fn columns(&self, block: usize) -> Columns {
        let mut columns = COLUMNS.with_borrow_mut(|all| {
            all.get_mut(self.number as usize % KEPT).map(std::mem::take).unwrap_or_default()
        });
        columns.prepare(&self.code, self.number, block);
        columns
    }

    /// Keeps columns for the next call.
    pub fn keep(&self, columns: Columns) {
        COLUMNS.with_borrow_mut(|all| {
            if all.is_empty() {
                all.resize_with(KEPT, Columns::default);
            }
            all[self.number as usize % KEPT] = columns;
        });
    }

    /// Runs the function at the first points, with this many lanes. Stops the job when a loop takes too many turns.
    pub fn run(&self, lanes: usize, text: &SourceText, columns: &Columns, points: usize) {
        let level = SimdLevel::of_lanes(lanes);
        if let Err(endless) = run_alone(level, &self.code, &self.pictures, columns, points) {
            stop(text.endless_loop(endless));
        }
    }

    /// Runs the function at the points of one vector. Stops the job when a loop takes too many turns.
    #[inline(always)]
    pub fn run_vector<L: Lanes>(&self, l: L, text: &SourceText, columns: &Columns) {
        if let Err(endless) = run_alone_in(l, &self.code, &self.pictures, columns, L::LANES) {
            stop(text.endless_loop(endless));
        }
    }

    /// The fields of points that the function reads, if its first argument is a point, and the registers of the scalars
    /// of all arguments.
    pub fn inputs(&self) -> PointInputs {
        let kinds: Vec<(u64, bool)> = POINT_FIELDS
            .iter()
            .enumerate()
            .flat_map(|(field, row)| {
                (0..row.kind.numbers()).map(move |_| (1 << field, row.kind == FieldType::Bool))
            })
            .collect();
        let (mut fields, mut registers) = (0, vec![None; kinds.len()]);
        for &(scalar, register) in &self.code.inputs {
            let Some(&(field, is_truth)) = kinds.get(scalar as usize) else { continue };
            fields |= field;
            registers[scalar as usize] = Some((register, is_truth));
        }
        PointInputs { fields, attributes: Vec::new(), registers }
    }

    /// [`Kernel::inputs`] of a shader whose inputs behind the point are the finish of its material, then others, and
    /// that may read these vertex attributes.
    pub fn inputs_over_material(&self, attributes: &[AttributeRequest]) -> PointInputs {
        let mut inputs = self.inputs();
        inputs.registers.resize(BlockColumns::ATTRIBUTES, None);
        for &(scalar, register) in &self.code.inputs {
            if scalar as usize >= BlockColumns::POINT
                && let Some(to) = inputs.registers.get_mut(scalar as usize)
            {
                inputs.fields |= BASE;
                *to = Some((register, false));
            }
        }
        let mut first = FIRST_INPUT;
        for attribute in attributes {
            let scalars = first..first + attribute.width;
            first = scalars.end;
            let register = |input: u32| self.code.inputs.iter().find(|(other, _)| *other == input);
            let read: Vec<_> = scalars.map(|input| register(input).map(|&(_, to)| (to, false))).collect();
            if read.iter().any(Option::is_some) {
                inputs.attributes.push(attribute.clone());
                inputs.registers.extend(read);
            }
        }
        inputs
    }
}

impl PointInputs {
    /// Sink of the points of one vector of this many lanes, for a function that runs in `columns`.
    #[inline(always)]
    pub fn sink<'a>(&'a self, columns: &'a Columns, lanes: usize) -> impl PointSink {
        PointWriter { columns, inputs: self, lanes }
    }

    /// The fields of points that are read.
    pub fn wanted(&self) -> WantedFields<'_> {
        WantedFields { fields: self.fields, attributes: &self.attributes }
    }

    /// True if the time or the frame is read.
    pub fn read_moment(&self) -> bool {
        let is_of_moment = |row: &SurfaceField| ["time", "frame"].contains(&row.name);
        POINT_FIELDS.iter().enumerate().any(|(i, row)| is_of_moment(row) && self.fields >> i & 1 == 1)
    }
}

/// Ends the job that runs a shader with an error.
#[cold]
pub(super) fn stop(error: ShaderError) -> ! {
    stop_job(error.to_string())
}

/// Inputs of a function's argument of type `Point`.
#[derive(Clone, Debug)]
pub(super) struct PointInputs {
    /// Bit `i` is set if field `i` of [`POINT_FIELDS`] is read, and [`BASE`] if the finish of the material is.
    pub fields: u64,
    /// The vertex attributes that are read.
    pub attributes: Vec<AttributeRequest>,
    /// The register of each scalar that is read, and whether it is a truth value.
    pub registers: Vec<Option<(u32, bool)>>,
}

/// Writes the scalars of the points of one vector into a program's columns. Points beyond the lanes are copies of those
/// in lanes, so that a loop ends for them too.
struct PointWriter<'a> {
    columns: &'a Columns,
    inputs: &'a PointInputs,
    lanes: usize,
}

impl PointSink for PointWriter<'_> {
    #[inline(always)]
    fn put(&mut self, scalar: usize, column: &[f32; MAX_LANES]) {
        let Some((register, is_truth)) = self.inputs.registers[scalar] else { return };
        let cells = self.columns.column(register, CHUNK);
        for point in 0..CHUNK {
            let number = column[point % self.lanes];
            cells[point].set(match is_truth {
                true if number > 0.0 => u32::MAX,
                true => 0,
                false => number.to_bits(),
            });
        }
    }
}

/// Writes numbers into a column, copies of the first beyond their end. Truth values become words of all bits or none.
#[inline(always)]
pub(super) fn write(to: &[Cell<u32>], from: &[f32], is_truth: bool) {
    let word = |number: f32| match is_truth {
        true if number > 0.0 => u32::MAX,
        true => 0,
        false => number.to_bits(),
    };
    let (to, beyond) = to.split_at(from.len());
    for_pairs(to, from, |cell, &number| cell.set(word(number)));
    beyond.iter().for_each(|cell| cell.set(word(from[0])));
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

/// The first of a field's scalars, counted over all fields; their number if there is no such field.
pub(super) fn first_scalar(fields: &[SurfaceField], name: &str) -> usize {
    fields.iter().take_while(|field| field.name != name).map(|field| field.kind.numbers()).sum()
}
