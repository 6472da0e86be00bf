//! Generated programs: the executor at every SIMD level beside the oracle, bit by bit.

use super::oracle::{Oracle, Value, Word};
use crate::lanes::SimdLevel;
use crate::program::code::Code;
use crate::program::lower::{Base, Input, lower};
use crate::program::operation::CHUNK;
use crate::program::prelude::prelude;
use crate::program::run::{BLOCK, Columns, run_alone};
use crate::program::source::Source;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Random choices.
struct Dice(u32);

impl Dice {
    fn below(&mut self, n: u32) -> u32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9);
        crate::geom::mix(self.0) % n
    }
}

/// Writes programs over variables `x0..x3` (f32), `n0..n2` (u32), `k0..k1` (i32), `v` (vec3f), `a` (array of f32).
pub(super) struct Writer {
    dice: Dice,
    text: String,
    depth: usize,
    loops: usize,
    counters: usize,
    /// True to write only what [`super::second_oracle`] can check.
    common: bool,
}

impl Writer {
    fn number(&mut self, depth: u32) -> String {
        if depth == 0 {
            return match self.dice.below(8) {
                0 | 3 => format!("q[{}]", self.dice.below(8)),
                1 => "v.y".into(),
                2 => format!("a[{}]", self.index()),
                _ => format!("x{}", self.dice.below(4)),
            };
        }
        if self.common {
            return self.common_number(depth);
        }
        let a = self.number(depth - 1);
        match self.dice.below(16) {
            0..=5 => {
                let op = ["+", "-", "*", "/", "%", "*"][self.dice.below(6) as usize];
                format!("({a} {op} {})", self.number(depth - 1))
            }
            6 => {
                let function =
                    ["abs", "floor", "ceil", "fract", "sqrt", "trunc", "round", "sign", "saturate"];
                format!("{}({a})", function[self.dice.below(9) as usize])
            }
            7 => format!(
                "{}({a}, {})",
                ["min", "max", "step"][self.dice.below(3) as usize],
                self.number(depth - 1)
            ),
            8 => format!("mix({a}, {}, {})", self.number(depth - 1), self.number(depth - 1)),
            9 => format!("clamp({a}, {}, {})", self.number(depth - 1), self.number(depth - 1)),
            10 => format!("select({a}, {}, {})", self.number(depth - 1), self.truth(depth - 1)),
            11 => format!("f32({})", self.integer(depth - 1)),
            12 => format!("f32({})", self.signed(depth - 1)),
            13 => format!("dot(v, vec3f({a}, {}, x1))", self.number(depth - 1)),
            14 => format!("helper({a}, {})", self.integer(depth - 1)),
            _ => format!("length(vec2f({a}, x2)) + cross(v, v.zxy).x"),
        }
    }

    /// A number without functions that WGSL leaves to the implementation, or whose NaN and zeros it does.
    fn common_number(&mut self, depth: u32) -> String {
        let (a, b) = (self.number(depth - 1), self.number(depth - 1));
        match self.dice.below(15) {
            0..=5 => format!("({a} {} {b})", ["+", "-", "*", "/"][self.dice.below(4) as usize]),
            6 => {
                let function = ["abs", "floor", "ceil", "trunc"][self.dice.below(4) as usize];
                format!("{function}({a})")
            }
            7 => format!("select({b}, {a}, {a} < {b})"),
            8 => format!("({a} + ({b} - {a}) * {})", self.number(depth - 1)),
            9 => format!("select({a}, {b}, {})", self.truth(depth - 1)),
            10 => format!("f32({})", self.integer(depth - 1)),
            11 => format!("f32({})", self.signed(depth - 1)),
            12 => format!("(v * vec3f({a}, {b}, x1)).{}", ["x", "y", "z"][self.dice.below(3) as usize]),
            13 => format!("helper({a}, {})", self.integer(depth - 1)),
            _ => format!("length(vec2f({a}, x2)) + cross(v, v.zxy).x"),
        }
    }

    /// An index into `a`, sometimes beyond its end.
    fn index(&mut self) -> String {
        let n = self.dice.below(3);
        if self.common { format!("n{n} % 3u") } else { format!("n{n}") }
    }

    /// An operation on integers with its right operand. Division by zero is for the first oracle alone.
    fn integer_operation(&mut self, b: &str, one: &str) -> String {
        match ["+", "-", "*", "/", "%", "&", "|", "^"][self.dice.below(8) as usize] {
            "%" if self.common => format!("% ({b} | {one})"),
            operator => format!("{operator} {b}"),
        }
    }

    fn integer(&mut self, depth: u32) -> String {
        if depth == 0 {
            return match self.dice.below(3) {
                0 => format!("m[{}]", self.dice.below(5)),
                _ => format!("n{}", self.dice.below(3)),
            };
        }
        let a = self.integer(depth - 1);
        match self.dice.below(8) {
            0..=4 => {
                let b = self.integer(depth - 1);
                format!("({a} {})", self.integer_operation(&b, "1u"))
            }
            5 => format!(
                "({a} {} ({} & 31u))",
                ["<<", ">>"][self.dice.below(2) as usize],
                self.integer(depth - 1)
            ),
            6 => format!("u32({})", self.number(depth - 1)),
            _ if self.common => format!("min(~{a}, {})", self.integer(depth - 1)),
            _ => {
                let function = ["countOneBits", "reverseBits", "countLeadingZeros", "countTrailingZeros"];
                format!("{}({a})", function[self.dice.below(4) as usize])
            }
        }
    }

    fn signed(&mut self, depth: u32) -> String {
        if depth == 0 {
            return format!("k{}", self.dice.below(2));
        }
        let a = self.signed(depth - 1);
        match self.dice.below(7) {
            0..=3 => {
                let b = self.signed(depth - 1);
                format!("({a} {})", self.integer_operation(&b, "1"))
            }
            4 => format!("i32({})", self.number(depth - 1)),
            5 => format!("({a} >> ({} & 31u))", self.integer(depth - 1)),
            _ if self.common => format!("max(-{a}, {})", self.signed(depth - 1)),
            _ => format!("max(abs({a}), {})", self.signed(depth - 1)),
        }
    }

    fn truth(&mut self, depth: u32) -> String {
        let comparison = ["<", "<=", ">", ">=", "==", "!="][self.dice.below(6) as usize];
        let single = match self.dice.below(3) {
            0 => format!("({} {comparison} {})", self.integer(depth), self.integer(depth)),
            1 => format!("({} {comparison} {})", self.signed(depth), self.signed(depth)),
            _ => format!("({} {comparison} {})", self.number(depth), self.number(depth)),
        };
        match self.dice.below(5) {
            0 => format!("({single} && !{})", self.truth(0)),
            1 => format!("({single} || {})", self.truth(0)),
            _ => single,
        }
    }

    fn line(&mut self, line: &str) {
        let _ = writeln!(self.text, "{}{line}", "    ".repeat(self.depth));
    }

    fn block(&mut self, statements: u32, nesting: u32) {
        self.depth += 1;
        for _ in 0..statements {
            self.statement(nesting);
        }
        self.depth -= 1;
    }

    fn statement(&mut self, nesting: u32) {
        let choice = self.dice.below(if nesting == 0 { 7 } else { 12 });
        match choice {
            0..=2 => {
                let (to, value) = (self.dice.below(4), self.number(2));
                self.line(&format!("x{to} = {value};"));
            }
            3 => {
                let (to, value) = (self.dice.below(3), self.integer(2));
                self.line(&format!("n{to} = {value};"));
            }
            4 => {
                let (to, value) = (self.dice.below(2), self.signed(2));
                self.line(&format!("k{to} = {value};"));
            }
            5 => {
                let (index, value) = (self.index(), self.number(1));
                self.line(&format!("a[{index}] = {value};"));
            }
            6 => {
                let line = match self.dice.below(3) {
                    0 => format!("v.{} = {};", ["x", "y", "z"][self.dice.below(3) as usize], self.number(1)),
                    1 if self.common => format!("v = v.zxy * {};", self.number(1)),
                    1 => format!("change(&x{}, {});", self.dice.below(4), self.number(1)),
                    _ => format!("v = vec3f({}, v.x, {}) * 0.5;", self.number(1), self.number(0)),
                };
                self.line(&line);
            }
            7 | 8 => {
                let condition = self.truth(1);
                self.line(&format!("if {condition} {{"));
                self.block(2, nesting - 1);
                self.exit();
                if self.dice.below(2) == 0 {
                    self.line("} else {");
                    self.block(2, nesting - 1);
                    self.exit();
                }
                self.line("}");
            }
            9 => self.switch(nesting),
            _ => self.repeat(nesting),
        }
    }

    /// Sometimes leaves a loop, a turn of it, or the function.
    fn exit(&mut self) {
        let line = match self.dice.below(9) {
            0 if self.loops > 0 => "break;",
            1 if self.loops > 0 => "continue;",
            2 => "return array<f32, 8>(x0, x1, x2, x3, v.x, a[1], f32(n0), f32(k0));",
            _ => return,
        };
        self.depth += 1;
        self.line(line);
        self.depth -= 1;
    }

    fn switch(&mut self, nesting: u32) {
        let selector = self.integer(1);
        // The second oracle takes a `break` of a switch for one of the loop around it.
        let loops = if self.common { std::mem::take(&mut self.loops) } else { self.loops };
        self.line(&format!("switch {selector} % 5u {{"));
        for case in ["case 0u: {", "case 1u, 3u: {", "default: {"] {
            self.line(case);
            self.block(1, nesting - 1);
            if self.dice.below(3) == 0 && !self.common {
                let condition = self.truth(0);
                self.line(&format!("    if {condition} {{ break; }}"));
                self.block(1, 0);
            }
            self.line("}");
        }
        self.line("}");
        self.loops = loops;
    }

    fn repeat(&mut self, nesting: u32) {
        let counter = format!("i{}", self.counters);
        self.counters += 1;
        let bound = match self.dice.below(3) {
            0 => format!("{}u", self.dice.below(6)),
            1 => format!("({} % 7u)", self.integer(1)),
            _ => format!("min(n{}, 5u)", self.dice.below(3)),
        };
        self.line(&format!("for (var {counter} = 0u; {counter} < {bound}; {counter}++) {{"));
        self.loops += 1;
        self.block(2, nesting - 1);
        self.exit();
        self.loops -= 1;
        self.line("}");
    }

    pub fn program(seed: u32, common: bool) -> String {
        let mut writer = Self {
            dice: Dice(seed.wrapping_mul(7919)),
            text: String::new(),
            depth: 0,
            loops: 0,
            counters: 0,
            common,
        };
        // Known numbers are variables of the module, because naga refuses constant expressions that overflow.
        writer.text += "
var<private> q: array<f32, 8> = array<f32, 8>(0.0, 1.0, 1e-40, 3e38, -0.5, 7.25, -13.0, 0.1);
var<private> m: array<u32, 5> = array<u32, 5>(0u, 1u, 7u, 21u, 38u);
fn helper(x: f32, n: u32) -> f32 {
    if (n > 20u) { return x * 0.5; }
    var sum = x;
    for (var i = 0u; i < n; i++) { sum += f32(i); if (sum > 50.0) { return sum; } }
    return sum - 1.0;
}
fn change(x: ptr<function, f32>, by: f32) { if (by > 0.0) { *x += by; return; } *x = -*x; }
fn test(x: array<f32, 4>, n: array<u32, 3>, k: array<i32, 2>) -> array<f32, 8> {
    var x0 = x[0]; var x1 = x[1]; var x2 = x[2]; var x3 = x[3];
    var n0 = n[0]; var n1 = n[1]; var n2 = n[2]; var k0 = k[0]; var k1 = k[1];
    var v = vec3f(x0, x1, 2.0); var a = array<f32, 3>(x1, x2, x3);
";
        writer.block(6, 3);
        writer.line(
            "    return array<f32, 8>(x0, x1 + f32(n1), x2 + f32(k1), x3, v.y, a[0], a[2], f32(n2));\n}",
        );
        if !common {
            return writer.text;
        }
        // The second oracle has no functions of arrays that Rust could call.
        let members: Vec<String> = ('a'..='h').map(|name| format!("{name}: f32")).collect();
        let arrays = "x: array<f32, 4>, n: array<u32, 3>, k: array<i32, 2>) -> array<f32, 8> {";
        let scalars =
            "y0: f32, y1: f32, y2: f32, y3: f32, o0: u32, o1: u32, o2: u32, l0: i32, l1: i32) -> Results {
    let x = array<f32, 4>(y0, y1, y2, y3); let n = array<u32, 3>(o0, o1, o2); let k = array<i32, 2>(l0, l1);";
        let text = writer.text.replace(arrays, scalars).replace("array<f32, 8>(x0", "Results(x0");
        format!("struct Results {{ {} }}{text}", members.join(", "))
    }
}

/// The inputs of a point.
pub(super) fn inputs(point: u32) -> Vec<Word> {
    let random = |k: u32| crate::geom::mix(point.wrapping_mul(16) + k);
    let number = |k: u32| match random(k) % 9 {
        0 => Word::F(0.0),
        1 => Word::F(f32::from_bits(random(k + 100))),
        2 => Word::F((random(k + 100) % 100) as f32),
        _ => Word::F((random(k + 100) as f32 / u32::MAX as f32 - 0.5) * 40.0),
    };
    let mut words: Vec<Word> = (0..4).map(number).collect();
    words.extend(
        (4..7).map(|k| Word::U(if random(k) % 4 == 0 { random(k + 50) } else { random(k + 50) % 30 })),
    );
    words.extend((7..9).map(|k| {
        Word::I(if random(k) % 4 == 0 { random(k + 50) as i32 } else { -3 + (random(k + 50) % 9) as i32 })
    }));
    words
}

/// True if two results are the same: any NaN is as good as another.
pub(super) fn same(a: u32, b: u32) -> bool {
    a == b || (f32::from_bits(a).is_nan() && f32::from_bits(b).is_nan())
}

/// The module of a program and its function.
pub(super) fn parsed(text: &str) -> Source {
    Source::parse("generated.wgsl", text, &prelude()).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

fn test_function(source: &Source) -> (naga::Handle<naga::Function>, &naga::Function) {
    let named = |(_, function): &(_, &naga::Function)| function.name.as_deref() == Some("test");
    source.module.functions.iter().find(named).expect("test")
}

/// Lowers a program.
pub(super) fn lowered(source: &Source, text: &str) -> Code {
    let input = Input {
        module: &source.module,
        info: &source.info,
        overrides: &BTreeMap::new(),
        natives: true,
        text: &source.text,
        host: None,
        base: Base::Refused,
        finishes: None,
    };
    lower(input, test_function(source).0).unwrap_or_else(|fault| panic!("{fault:?}\n{text}")).code
}

/// The results at points, at most as many as a block has.
pub(super) fn executed(code: &Code, level: SimdLevel, block: usize, points: &[Vec<Word>]) -> Vec<Vec<u32>> {
    let mut columns = Columns::default();
    columns.prepare(code, 1, block);
    for &(scalar, register) in &code.inputs {
        for (cell, words) in columns.column(register, block).iter().zip(points) {
            cell.set(words[scalar as usize].bits());
        }
    }
    run_alone(level, code, &[], &columns, points.len()).expect("loops end");
    let results = |point| code.outputs.iter().map(|&from| columns.operand(from, block).at(point)).collect();
    (0..points.len()).map(results).collect()
}

fn compare(seed: u32) -> usize {
    let text = Writer::program(seed, false);
    let source = parsed(&text);
    let code = lowered(&source, &text);
    let (_, function) = test_function(&source);
    let points: Vec<Vec<Word>> =
        (0..BLOCK as u32).map(|point| inputs(seed.wrapping_mul(999) + point)).collect();
    let expected = |words: &Vec<Word>| -> Vec<u32> {
        let list = |range: std::ops::Range<usize>| {
            Value::List(words[range].iter().map(|&w| Value::Word(w)).collect())
        };
        let result = Oracle::new(&source.module).call(function, vec![list(0..4), list(4..7), list(7..9)]);
        result.expect("a result").words().into_iter().map(Word::bits).collect()
    };
    let expected: Vec<Vec<u32>> = points.iter().map(expected).collect();
    let blocks = [CHUNK, 2 * CHUNK, 64, BLOCK, 2 * BLOCK];
    for (level, k) in SimdLevel::available().into_iter().zip(seed as usize..) {
        let block = blocks[k % blocks.len()];
        let in_blocks = executed(&code, level, block, &points[..block.min(BLOCK)]);
        let alone = points.chunks(CHUNK).flat_map(|points| executed(&code, level, CHUNK, points));
        let expected = expected.iter().enumerate().cycle();
        for (found, (point, expected)) in alone.chain(in_blocks).zip(expected) {
            let off = found.iter().zip(expected).find(|&(&found, &wanted)| !same(found, wanted));
            assert!(
                off.is_none(),
                "{level}, seed {seed}, point {point} {:?}: {:?} instead of {:?}\n{text}",
                points[point],
                off.map(|off| f32::from_bits(*off.0)),
                off.map(|off| f32::from_bits(*off.1)),
            );
        }
    }
    code.instructions.len()
}

#[test]
fn generated_programs_have_the_bits_of_the_oracle() {
    let programs = std::env::var("RAYSTREAM_SHADER_PROGRAMS").map_or(60, |n| n.parse().expect("a number"));
    let instructions: usize = (0..programs).map(compare).sum();
    assert!(instructions > 20 * programs as usize, "the programs compute something");
}
