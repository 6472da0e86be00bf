//! Writes a program's instructions as a kernel in WGSL.
//!
//! Registers are variables of the kernel, one word each. A skip is an `if` and a repetition a `loop`: the lowerer nests
//! them. Functions that the host computes with kernels in lanes are lowered from the prelude's text.

use super::probe::{Probe, probes};
#[cfg(test)]
use super::program::Given;
use super::program::Program;
use crate::device::{OPERATIONS, WORKGROUP};
use crate::program::code::{Code, Instruction, Register};
use crate::program::lower::{Base, Input, lower};
use crate::program::native::Native;
use crate::program::operation::Operation;
use crate::program::prelude::prelude;
use crate::program::source::Source;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::fmt::Write as _;

/// The most instructions of a kernel. Drivers take a second for some thousands.
const MOST_INSTRUCTIONS: usize = 1 << 14;

/// A shader's kernel. Its entry points are `shade` and `probe`. Both read columns of words, one after the other, and
/// write such columns; the last one is not 0 at points that the host has to compute.
#[derive(Clone, Debug)]
pub(crate) struct Kernel {
    /// WGSL.
    pub source: String,
    /// The scalars of points, and of what is asked there, that it reads, a column each.
    pub inputs: Vec<u32>,
    /// The scalars of the result that it computes, a column each. The others are inputs or the same everywhere.
    pub outputs: Vec<u32>,
    /// The other scalars of the result.
    #[cfg(test)]
    pub given: Vec<(u32, Given)>,
    /// The value that the entry point `probe` computes of three columns, by number of the case.
    pub probes: Vec<Probe>,
}

impl Kernel {
    /// The kernel of a program. With `flushes` points that come near subnormal numbers count as undecided.
    ///
    /// # Errors
    /// When the program is too long for devices.
    pub fn new(program: &Program, flushes: bool) -> Result<Self, String> {
        let code = &*program.code;
        let natives = natives(code);
        let length =
            code.instructions.len() + natives.iter().map(|(_, c)| c.instructions.len()).sum::<usize>();
        if length > MOST_INSTRUCTIONS {
            return Err(format!(
                "{length} operations are too many for a device; at most {MOST_INSTRUCTIONS} are"
            ));
        }
        let (inputs, outputs) = (inputs(code), outputs(code));
        let probes = probes(std::iter::once(code).chain(natives.iter().map(|(_, code)| code)));
        let mut source =
            format!("const FLUSHES: bool = {flushes};\nconst OVERFLOWS: bool = true;\n\n{OPERATIONS}");
        for (native, code) in &natives {
            source += &native_function(*native, code);
        }
        source += &shade_entry(code, &inputs, &outputs);
        source += &probe_entry(&probes);
        Ok(Self {
            source,
            #[cfg(test)]
            given: given(code, &outputs),
            inputs,
            outputs,
            probes,
        })
    }
}

/// The scalars of points, and of what is asked there, that a program reads, ascending.
pub(super) fn inputs(code: &Code) -> Vec<u32> {
    let mut inputs: Vec<u32> = code.inputs.iter().map(|&(scalar, _)| scalar).collect();
    inputs.sort_unstable();
    inputs
}

/// The scalars of the result that a program computes.
pub(super) fn outputs(code: &Code) -> Vec<u32> {
    let written: HashSet<Register> = code
        .instructions
        .iter()
        .flat_map(|instruction| match instruction {
            Instruction::Compute { to, .. } | Instruction::Element { to, .. } => vec![*to],
            Instruction::Call { results, .. }
            | Instruction::LookUp { results, .. }
            | Instruction::Finish { results, .. }
            | Instruction::Host { results, .. } => {
                code.lists[results.start as usize..results.end as usize].to_vec()
            }
            Instruction::Skip { .. } | Instruction::Repeat { .. } => Vec::new(),
        })
        .collect();
    (0..)
        .zip(&code.outputs)
        .filter(|(_, register)| written.contains(register))
        .map(|(scalar, _)| scalar)
        .collect()
}

/// The scalars of the result that a program does not compute.
#[cfg(test)]
fn given(code: &Code, computed: &[u32]) -> Vec<(u32, Given)> {
    let given = |register: &Register| {
        let word = code.constants.iter().find(|(constant, _)| constant == register);
        let input = code.inputs.iter().find(|(_, input)| input == register);
        word.map(|&(_, word)| Given::Word(word)).or(input.map(|&(input, _)| Given::Input(input)))
    };
    let others = (0..).zip(&code.outputs).filter(|(scalar, _)| !computed.contains(scalar));
    others.filter_map(|(scalar, register)| Some((scalar, given(register)?))).collect()
}

/// The native functions that a program calls, lowered from their text.
fn natives(code: &Code) -> Vec<(Native, Code)> {
    let called = |native: &Native| {
        let is_call =
            |i: &Instruction| matches!(i, Instruction::Call { native: other, .. } if other == native);
        code.instructions.iter().any(is_call)
    };
    let wanted: Vec<Native> = Native::ALL.into_iter().filter(called).collect();
    if wanted.is_empty() {
        return Vec::new();
    }
    let source = Source::parse("prelude", "", &prelude()).expect("the prelude is valid");
    let overrides = BTreeMap::new();
    let lowered = |native: Native| {
        let mut functions = source.module.functions.iter();
        let named = functions.find(|(_, function)| function.name.as_deref() == Some(native.name()));
        let (handle, _) = named.expect("the prelude has its functions");
        let Source { module, info, text } = &source;
        let base = Base::Refused;
        let (host, finishes) = (None, None);
        let input = Input { module, info, overrides: &overrides, natives: false, text, host, base, finishes };
        let lowered = lower(input, handle).expect("the prelude can be lowered");
        (native, lowered.code)
    };
    wanted.into_iter().map(lowered).collect()
}

fn native_function(native: Native, code: &Code) -> String {
    let mut writer = Writer::new(code);
    let arguments: Vec<String> = code.inputs.iter().map(|(input, _)| format!("i{input}: u32")).collect();
    for (input, register) in &code.inputs {
        writer.line(&format!("r{register} = i{input};"));
    }
    writer.instructions();
    let results = writer.operands(&code.outputs).join(", ");
    let result = format!("array<u32, {}>", native.results());
    writer.line(&format!("return {result}({results});"));
    let (name, body) = (native.name(), writer.body());
    format!("\nfn native_{name}({}) -> {result} {{\n{body}}}\n", arguments.join(", "))
}

fn shade_entry(code: &Code, inputs: &[u32], outputs: &[u32]) -> String {
    let mut writer = Writer::new(code);
    for (column, scalar) in inputs.iter().enumerate() {
        for (_, register) in code.inputs.iter().filter(|(input, _)| input == scalar) {
            writer.line(&format!("r{register} = inputs[{column}u * points + point];"));
        }
    }
    writer.instructions();
    for (column, &scalar) in outputs.iter().enumerate() {
        let result = writer.operand(code.outputs[scalar as usize]);
        writer.line(&format!("results[{column}u * points + point] = {result};"));
    }
    writer.line(&format!("results[{}u * points + point] = is_undecided();", outputs.len()));
    entry("shade", &writer.body())
}

fn probe_entry(probes: &[Probe]) -> String {
    let mut body = String::from("    let a = inputs[point];\n    let b = inputs[points + point];\n");
    body += "    let c = inputs[2u * points + point];\n    var result = 0u;\n    switch (params.y) {\n";
    for (number, probe) in probes.iter().enumerate() {
        let _ = writeln!(body, "        case {number}u: {{ result = {}; }}", probe.expression());
    }
    body += "        default: {}\n    }\n    results[point] = result;\n    results[points + point] = is_undecided();\n";
    entry("probe", &body)
}

/// An entry point. The bindings are declared once, with the first.
fn entry(name: &str, body: &str) -> String {
    let bindings = "
@group(0) @binding(0) var<storage, read> inputs: array<u32>;
@group(0) @binding(1) var<storage, read_write> results: array<u32>;
@group(0) @binding(2) var<uniform> params: vec4u;
";
    let bindings = if name == "shade" { bindings } else { "" };
    format!(
        "{bindings}
@compute @workgroup_size({WORKGROUP})
fn {name}(@builtin(global_invocation_id) id: vec3u) {{
    let point = id.x;
    let points = params.x;
    if (point >= points) {{
        return;
    }}
{body}}}
"
    )
}

/// Writes the body of a function.
struct Writer<'c> {
    code: &'c Code,
    words: HashMap<Register, u32>,
    text: String,
    depth: usize,
}

impl<'c> Writer<'c> {
    fn new(code: &'c Code) -> Self {
        let words = code.constants.iter().copied().collect();
        Self { code, words, text: String::new(), depth: 1 }
    }

    fn line(&mut self, line: &str) {
        self.depth -= usize::from(line.starts_with('}'));
        let _ = writeln!(self.text, "{:1$}{line}", "", 4 * self.depth);
        self.depth += usize::from(line.ends_with('{'));
    }

    /// The statements, after the registers.
    fn body(&self) -> String {
        let registers = (0..self.code.registers).filter(|register| !self.words.contains_key(register));
        registers.map(|register| format!("    var r{register}: u32;\n")).collect::<String>() + &self.text
    }

    fn operand(&self, register: Register) -> String {
        match self.words.get(&register) {
            // A zero that the driver knows: lavapipe drops sums and products with it, and signs of zero with them.
            Some(0) => "params.z".into(),
            Some(0x8000_0000) => "(params.z ^ SIGN)".into(),
            Some(word) => format!("{word:#x}u"),
            None => format!("r{register}"),
        }
    }

    fn operands(&self, registers: &[Register]) -> Vec<String> {
        registers.iter().map(|&register| self.operand(register)).collect()
    }

    fn instructions(&mut self) {
        let mut loops = vec![0; self.code.instructions.len() + 1];
        for instruction in &self.code.instructions {
            if let Instruction::Repeat { to, .. } = instruction {
                loops[*to as usize] += 1;
            }
        }
        // Where the open branches end, the innermost last.
        let mut ends: Vec<u32> = Vec::new();
        for (index, instruction) in self.code.instructions.iter().enumerate() {
            self.close(&mut ends, index);
            for _ in 0..loops[index] {
                self.line("loop {");
            }
            if let Instruction::Skip { mask, to } = instruction {
                let mask = self.operand(*mask);
                self.line(&format!("if ({mask} != 0u) {{"));
                ends.push(*to);
            } else {
                self.instruction(instruction);
            }
        }
        self.close(&mut ends, self.code.instructions.len());
    }

    fn close(&mut self, ends: &mut Vec<u32>, at: usize) {
        while ends.last().is_some_and(|&end| end as usize == at) {
            ends.pop();
            self.line("}");
        }
    }

    fn instruction(&mut self, instruction: &Instruction) {
        let list = |range: &std::ops::Range<u32>| &self.code.lists[range.start as usize..range.end as usize];
        match instruction {
            Instruction::Compute { operation, operands, to } => {
                let operands = self.operands(&operands[..operation.operands()]);
                self.line(&format!("r{to} = {};", expression(*operation, &operands)));
            }
            Instruction::Call { native, operands, results } => {
                let operands = self.operands(list(operands)).join(", ");
                self.line("{");
                self.line(&format!("let results = native_{}({operands});", native.name()));
                for (number, to) in list(results).iter().enumerate() {
                    self.line(&format!("r{to} = results[{number}];"));
                }
                self.line("}");
            }
            Instruction::Element { columns, index, to } => {
                let (columns, index) = (self.operands(list(columns)), self.operand(*index));
                self.line("{");
                self.line(&format!("let index = min({index}, {}u);", columns.len() - 1));
                self.line(&format!("var element = {};", columns[0]));
                for (number, column) in columns.iter().enumerate().skip(1) {
                    self.line(&format!("element = select(element, {column}, index == {number}u);"));
                }
                self.line(&format!("r{to} = element;"));
                self.line("}");
            }
            Instruction::Repeat { mask, .. } => {
                let mask = self.operand(*mask);
                self.line("turns += 1u;");
                self.line(&format!("if ({mask} == 0u) {{"));
                self.line("break;");
                self.line("}");
                self.line("if (turns >= MOST_TURNS) {");
                self.line("undecided = true;");
                self.line("break;");
                self.line("}");
                self.line("}");
            }
            Instruction::Skip { .. } => {}
            Instruction::Host { function, .. } => unreachable!("`{}` in a surface", function.name()),
            Instruction::LookUp { .. } | Instruction::Finish { .. } => unreachable!("refused before"),
        }
    }
}

/// An operation in WGSL.
pub(super) fn expression(operation: Operation, operands: &[String]) -> String {
    use Operation as O;
    let get = |index: usize| operands.get(index).map_or("", String::as_str);
    let (a, b, c) = (get(0), get(1), get(2));
    let call = |name: &str| format!("{name}({})", operands.join(", "));
    match operation {
        O::Copy => a.to_owned(),
        O::Not => format!("~{a}"),
        O::And => format!("({a} & {b})"),
        O::AndNot => format!("({a} & ~{b})"),
        O::Or => format!("({a} | {b})"),
        O::Xor => format!("({a} ^ {b})"),
        O::Select => format!("(({b} & {a}) | ({c} & ~{a}))"),
        O::Add => call("op_add"),
        O::Sub => call("op_sub"),
        O::Mul => call("op_mul"),
        O::Div => call("op_div"),
        O::Neg => format!("({a} ^ SIGN)"),
        O::Abs => format!("({a} & MAGNITUDE)"),
        O::Sqrt => call("op_sqrt"),
        O::Floor => call("op_floor"),
        O::Ceil => call("op_ceil"),
        O::Trunc => call("op_trunc"),
        O::Round => call("op_round"),
        O::Min => call("op_min"),
        O::Max => call("op_max"),
        O::Less => call("op_less"),
        O::LessEqual => call("op_less_equal"),
        O::Equal => call("op_equal"),
        O::MulAdd => format!("op_add(op_mul({a}, {b}), {c})"),
        O::MulSub => format!("op_sub(op_mul({a}, {b}), {c})"),
        O::SubMul => format!("op_sub({c}, op_mul({a}, {b}))"),
        O::ScaledSum => format!("op_mul(op_add({a}, {b}), {c})"),
        O::ScaledDifference => format!("op_mul(op_sub({a}, {b}), {c})"),
        O::MulMul => format!("op_mul(op_mul({a}, {b}), {c})"),
        O::AddAdd => format!("op_add(op_add({a}, {b}), {c})"),
        O::Lerp => format!("op_add({a}, op_mul(op_sub({b}, {a}), {c}))"),
        O::Clamp => format!("op_min(op_max({a}, {b}), {c})"),
        O::MulXor => format!("(({a} * {b}) ^ {c})"),
        O::XorMul => format!("(({a} ^ {b}) * {c})"),
        O::ShrXor => format!("(({a} >> ({b} & 31u)) ^ {c})"),
        O::AddInt => format!("({a} + {b})"),
        O::SubInt => format!("({a} - {b})"),
        O::MulInt => format!("({a} * {b})"),
        O::DivUint => call("op_div_uint"),
        O::RemUint => call("op_rem_uint"),
        O::DivSint => call("op_div_sint"),
        O::RemSint => call("op_rem_sint"),
        O::Shl => format!("({a} << ({b} & 31u))"),
        O::ShrUint => format!("({a} >> ({b} & 31u))"),
        O::ShrSint => format!("bitcast<u32>(bitcast<i32>({a}) >> ({b} & 31u))"),
        O::LessUint => format!("truth({a} < {b})"),
        O::LessSint => format!("truth(bitcast<i32>({a}) < bitcast<i32>({b}))"),
        O::EqualInt => format!("truth({a} == {b})"),
        O::CountOnes => call("countOneBits"),
        O::LeadingZeros => call("countLeadingZeros"),
        O::TrailingZeros => call("countTrailingZeros"),
        O::ReverseBits => call("reverseBits"),
        O::SintToNumber => call("op_sint_to_number"),
        O::UintToNumber => call("op_uint_to_number"),
        O::NumberToSint => call("op_number_to_sint"),
        O::NumberToUint => call("op_number_to_uint"),
    }
}
