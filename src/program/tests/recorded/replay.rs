//! Tapes as programs of the executor.

use crate::lanes::SimdLevel;
use crate::lanes::record::{Recorded, Slot, Step, Tape};
use crate::program::code::{Code, Instruction, Register};
use crate::program::operation::Operation;
use crate::program::run::{BLOCK, Columns, run_alone};
use std::collections::{BTreeMap, HashMap};
use std::ops::Range;

/// A tape as two programs: as it was recorded, and with what the lowerer does to every program afterwards.
pub struct Replay {
    plain: Code,
    optimised: Code,
    operations: usize,
}

macro_rules! operations {
    ($($name:ident)*) => {
        /// The operation of a step.
        fn operation(of: Recorded) -> Operation {
            match of {
                $(Recorded::$name => Operation::$name,)*
            }
        }
    };
}

operations! {
    Not And Or Xor Select Add Sub Mul Div Neg Abs Sqrt Floor Min Max Less LessEqual Equal AddInt MulInt Shl ShrUint
    LessUint EqualInt ReverseBits UintToNumber NumberToUint
}

/// Makes a program of a tape.
struct Maker<'t> {
    tape: &'t Tape,
    code: Code,
    constants: BTreeMap<u32, Register>,
    /// The lists of registers that hold a column of a table, by table, first word and width.
    columns: HashMap<(u32, u32, u32), Range<u32>>,
}

impl Maker<'_> {
    fn constant(&mut self, word: u32) -> Register {
        let code = &mut self.code;
        *self.constants.entry(word).or_insert_with(|| {
            code.registers += 1;
            code.registers - 1
        })
    }

    /// The registers of a column of a table.
    fn column(&mut self, table: u32, first: u32, width: u32) -> Range<u32> {
        if let Some(known) = self.columns.get(&(table, first, width)) {
            return known.clone();
        }
        let tape = self.tape;
        let words = tape.tables[table as usize].iter().skip(first as usize).step_by(width as usize);
        let registers: Vec<Register> = words.map(|&word| self.constant(word)).collect();
        let start = self.code.lists.len() as u32;
        self.code.lists.extend(registers);
        let range = start..self.code.lists.len() as u32;
        self.columns.insert((table, first, width), range.clone());
        range
    }

    /// The register of each step: its own, or that of its word.
    fn registers(&mut self) -> Vec<Register> {
        self.code.registers = self.tape.steps.len() as u32;
        let tape = self.tape;
        let register = |(slot, step): (Slot, &Step)| match step {
            Step::Word(word) => self.constant(*word),
            _ => slot,
        };
        (0..).zip(&tape.steps).map(register).collect()
    }

    fn make(mut self, outputs: Vec<Slot>) -> Code {
        let registers = self.registers();
        let of = |slot: Slot| registers[slot as usize];
        for (to, step) in (0..).zip(&self.tape.steps) {
            match *step {
                Step::Word(_) => {}
                Step::Input(number) => self.code.inputs.push((number, to)),
                Step::Compute(recorded, operands) => {
                    let (operation, operands) = (operation(recorded), operands.map(of));
                    self.code.instructions.push(Instruction::Compute { operation, operands, to });
                }
                Step::Element { table, first, width, index } => {
                    let columns = self.column(table, first, width);
                    self.code.instructions.push(Instruction::Element { columns, index: of(index), to });
                }
            }
        }
        self.code.outputs = outputs.into_iter().map(of).collect();
        self.code.constants = self.constants.iter().map(|(&word, &register)| (register, word)).collect();
        self.code
    }
}

impl Replay {
    pub fn new(tape: &Tape, outputs: Vec<Slot>) -> Self {
        let maker =
            Maker { tape, code: Code::default(), constants: BTreeMap::new(), columns: HashMap::new() };
        let code = maker.make(outputs);
        let optimised = code.clone().without_dead_instructions().with_pairs().with_few_registers();
        let operations = code.instructions.len();
        Self { plain: code.with_few_registers(), optimised, operations }
    }

    /// Number of operations that were recorded.
    pub fn operations(&self) -> usize {
        self.operations
    }

    /// A column for each result of points: a column for each input, of a multiple of [`BLOCK`] words. Blocks take
    /// turns among the programs and the SIMD levels.
    pub fn run(&self, points: &[Vec<u32>]) -> Vec<Vec<u32>> {
        let mut results = vec![Vec::with_capacity(points[0].len()); self.plain.outputs.len()];
        let mut columns = [Columns::default(), Columns::default()];
        let levels = SimdLevel::available();
        for (block, start) in (0..points[0].len()).step_by(BLOCK).enumerate() {
            let program = block % 2;
            let code = [&self.plain, &self.optimised][program];
            let columns = &mut columns[program];
            columns.prepare(code, 1, BLOCK);
            for &(input, register) in &code.inputs {
                let words = &points[input as usize][start..start + BLOCK];
                columns.column(register, BLOCK).iter().zip(words).for_each(|(cell, &word)| cell.set(word));
            }
            let level = levels[block / 2 % levels.len()];
            run_alone(level, code, &[], columns, BLOCK).expect("tapes have no loops");
            for (result, &register) in results.iter_mut().zip(&code.outputs) {
                let from = columns.operand(register, BLOCK);
                result.extend((0..BLOCK).map(|point| from.at(point)));
            }
        }
        results
    }
}
