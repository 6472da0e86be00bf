//! Lanes that record. An operation on them computes nothing: it becomes a step of a tape, which another program
//! replays at any number of points. So what a function over lanes does is known operation by operation, and a function
//! that does anything else cannot be recorded.
//!
//! A branch that some lane wants is always taken, and one for which all lanes must agree never is. This is the hardest
//! test of the rule that a branch changes nothing in the lanes that do not want it. What depends on the numbers of
//! single lanes is refused with a panic: masks as bits, arrays of lanes, loads and stores.
//!
//! Unsafe code, because methods of the trait are. Invariants:
//! 1. No method here reads or writes by pointer: those that would panic.
#![allow(unsafe_code, reason = "the invariants above")]

use super::{Int, LaneBits, Lanes, MaskRepr, Num, OutlinedTask, sealed::Sealed};
use std::cell::RefCell;
use std::collections::HashMap;

/// The index of a step, whose value it stands for.
#[doc(hidden)]
pub type Slot = u32;

/// Function of its operands that a step computes. The names are those of the operations of programs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[doc(hidden)]
pub enum Recorded {
    Not,
    And,
    Or,
    Xor,
    Select,
    Add,
    Sub,
    Mul,
    Div,
    Neg,
    Abs,
    Sqrt,
    Floor,
    Min,
    Max,
    Less,
    LessEqual,
    Equal,
    AddInt,
    MulInt,
    Shl,
    ShrUint,
    LessUint,
    EqualInt,
    ReverseBits,
    UintToNumber,
    NumberToUint,
}

/// One step of a tape. Truth values are words of all bits or none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[doc(hidden)]
pub enum Step {
    /// A word of the caller's, by its number.
    Input(u32),
    /// The same word at all points.
    Word(u32),
    /// A result of steps before; operands beyond the operation's number are 0.
    Compute(Recorded, [Slot; 3]),
    /// Word `first + width * index` of a table.
    Element { table: u32, first: u32, width: u32, index: Slot },
}

/// Steps of a function over lanes.
#[derive(Debug, Default)]
#[doc(hidden)]
pub struct Tape {
    /// In the order in which they were recorded, each once.
    pub steps: Vec<Step>,
    /// The tables that were looked up.
    pub tables: Vec<Vec<u32>>,
    known: HashMap<Step, Slot>,
    /// Tables by address and length.
    places: HashMap<(usize, usize), u32>,
}

thread_local! {
    /// The tape of this thread, while something is recorded.
    static TAPE: RefCell<Option<Tape>> = const { RefCell::new(None) };
}

/// The token of lanes that record onto the tape of the thread.
#[derive(Clone, Copy, Debug)]
#[doc(hidden)]
pub struct Recorder(());

/// Records what a function does. Returns the tape and the function's result.
#[doc(hidden)]
pub fn record<T>(work: impl FnOnce(Recorder) -> T) -> (Tape, T) {
    let before = TAPE.replace(Some(Tape::default()));
    assert!(before.is_none(), "recordings do not nest");
    let result = work(Recorder(()));
    (TAPE.take().expect("the tape of this recording"), result)
}

fn refuse(what: &str) -> ! {
    panic!("{what} depends on the numbers of single lanes: it cannot be recorded");
}

impl Recorder {
    fn step(self, step: Step) -> Slot {
        TAPE.with_borrow_mut(|tape| {
            let tape = tape.as_mut().expect("something is being recorded");
            *tape.known.entry(step).or_insert_with(|| {
                tape.steps.push(step);
                tape.steps.len() as Slot - 1
            })
        })
    }

    fn word(self, word: u32) -> Slot {
        self.step(Step::Word(word))
    }

    fn compute(self, operation: Recorded, [a, b, c]: [Slot; 3]) -> Slot {
        self.step(Step::Compute(operation, [a, b, c]))
    }

    fn unary(self, operation: Recorded, a: Slot) -> Slot {
        self.compute(operation, [a, 0, 0])
    }

    fn binary(self, operation: Recorded, a: Slot, b: Slot) -> Slot {
        self.compute(operation, [a, b, 0])
    }

    /// The number of a table.
    fn table(self, words: &[u32]) -> u32 {
        TAPE.with_borrow_mut(|tape| {
            let tape = tape.as_mut().expect("something is being recorded");
            let place = (words.as_ptr() as usize, words.len());
            let number = *tape.places.entry(place).or_insert_with(|| {
                tape.tables.push(words.to_vec());
                tape.tables.len() as u32 - 1
            });
            assert!(
                tape.tables[number as usize] == words,
                "a table that is looked up outlives the recording"
            );
            number
        })
    }

    /// Numbers of the caller's.
    pub fn number(self, input: u32) -> Num<Self> {
        Num { l: self, f: self.step(Step::Input(input)) }
    }

    /// Integers of the caller's.
    pub fn integer(self, input: u32) -> Int<Self> {
        Int { l: self, i: self.step(Step::Input(input)) }
    }
}

impl Int<Recorder> {
    /// The step that computes it.
    pub fn slot(self) -> Slot {
        self.i
    }
}

/// A truth value at each point.
#[derive(Clone, Copy, Debug)]
#[doc(hidden)]
pub struct Truth(Slot);

impl Sealed for Truth {}
impl Sealed for Recorder {}

impl MaskRepr<Recorder> for Truth {
    fn splat(l: Recorder, value: bool) -> Self {
        Self(l.word(if value { u32::MAX } else { 0 }))
    }
    fn from_bits(_: Recorder, _: LaneBits) -> Self {
        refuse("a mask of given bits")
    }
    fn bits(self, _: Recorder) -> LaneBits {
        refuse("a mask as bits")
    }
    fn any(self, _: Recorder) -> bool {
        true
    }
    fn all(self, _: Recorder) -> bool {
        false
    }
    fn and(self, l: Recorder, other: Self) -> Self {
        Self(l.binary(Recorded::And, self.0, other.0))
    }
    fn or(self, l: Recorder, other: Self) -> Self {
        Self(l.binary(Recorded::Or, self.0, other.0))
    }
    fn xor(self, l: Recorder, other: Self) -> Self {
        Self(l.binary(Recorded::Xor, self.0, other.0))
    }
    fn not(self, l: Recorder) -> Self {
        Self(l.unary(Recorded::Not, self.0))
    }
    fn lt(l: Recorder, a: Slot, b: Slot) -> Self {
        Self(l.binary(Recorded::Less, a, b))
    }
    fn le(l: Recorder, a: Slot, b: Slot) -> Self {
        Self(l.binary(Recorded::LessEqual, a, b))
    }
    fn eq(l: Recorder, a: Slot, b: Slot) -> Self {
        Self(l.binary(Recorded::Equal, a, b))
    }
    fn lt_u32(l: Recorder, a: Slot, b: Slot) -> Self {
        Self(l.binary(Recorded::LessUint, a, b))
    }
    fn eq_u32(l: Recorder, a: Slot, b: Slot) -> Self {
        Self(l.binary(Recorded::EqualInt, a, b))
    }
    fn select(self, l: Recorder, a: Slot, b: Slot) -> Slot {
        l.compute(Recorded::Select, [self.0, a, b])
    }
    fn select_u32(self, l: Recorder, a: Slot, b: Slot) -> Slot {
        l.compute(Recorded::Select, [self.0, a, b])
    }
}

/// Methods that record one operation.
macro_rules! recorded {
    ($($name:ident($($operand:ident),*) $operation:ident;)*) => {$(
        fn $name(self, $($operand: Slot),*) -> Slot {
            let mut operands = [0; 3];
            for (operand, slot) in operands.iter_mut().zip([$($operand),*]) {
                *operand = slot;
            }
            self.compute(Recorded::$operation, operands)
        }
    )*};
}

/// Methods of tracing and of lane-by-lane code.
macro_rules! refused {
    ($(fn $name:ident($($operand:ident: $type:ty),*) -> $out:ty;)*) => {$(
        fn $name(self, $(_: $type),*) -> $out {
            refuse(stringify!($name))
        }
    )*};
    ($(unsafe fn $name:ident($($operand:ident: $type:ty),*) -> $out:ty;)*) => {$(
        unsafe fn $name(self, $(_: $type),*) -> $out {
            refuse(stringify!($name))
        }
    )*};
}

impl Lanes for Recorder {
    /// Points are replayed one by one or many at a time: there is one of each constant.
    const LANES: usize = 1;
    type F = Slot;
    type I = Slot;
    type M = Truth;
    type Array<T: Copy> = [T; 1];

    fn array<T: Copy>(value: T) -> [T; 1] {
        [value]
    }

    recorded! {
        add(a, b) Add;
        sub(a, b) Sub;
        mul(a, b) Mul;
        div(a, b) Div;
        min(a, b) Min;
        max(a, b) Max;
        sqrt(a) Sqrt;
        floor(a) Floor;
        abs(a) Abs;
        neg(a) Neg;
        add_u32(a, b) AddInt;
        mul_u32(a, b) MulInt;
        and_u32(a, b) And;
        or_u32(a, b) Or;
        xor_u32(a, b) Xor;
        reverse_u32(a) ReverseBits;
        f32_to_u32(a) NumberToUint;
        u32_to_f32(a) UintToNumber;
    }

    fn splat(self, x: f32) -> Slot {
        self.word(x.to_bits())
    }
    fn splat_u32(self, x: u32) -> Slot {
        self.word(x)
    }
    fn with_sign_of(self, a: Slot, b: Slot) -> Slot {
        let sign = self.binary(Recorded::And, b, self.word(1 << 31));
        self.binary(Recorded::Or, self.unary(Recorded::Abs, a), sign)
    }
    fn shl_u32(self, a: Slot, count: u32) -> Slot {
        self.binary(Recorded::Shl, a, self.word(count))
    }
    fn shr_u32(self, a: Slot, count: u32) -> Slot {
        self.binary(Recorded::ShrUint, a, self.word(count))
    }
    fn bits(self, a: Slot) -> Slot {
        a
    }
    fn from_bits(self, a: Slot) -> Slot {
        a
    }
    fn outlined<P: OutlinedTask<Self>>(self, task: P) -> P::Output {
        task.run(self)
    }
    fn recorded_rows<const N: usize>(self, index: Slot, table: &[u32]) -> Option<[Slot; N]> {
        let (table, width) = (self.table(&table[..table.len() / N * N]), N as u32);
        Some(std::array::from_fn(|k| self.step(Step::Element { table, first: k as u32, width, index })))
    }

    refused! {
        fn fma(a: Slot, b: Slot, c: Slot) -> Slot;
        fn fms(a: Slot, b: Slot, c: Slot) -> Slot;
        fn max_bits(a: Slot, b: Slot) -> Slot;
        fn min_bits(a: Slot, b: Slot) -> Slot;
        fn lowest(a: Slot) -> f32;
        fn highest(a: Slot) -> f32;
        fn to_fixed(a: Slot, scale: f64) -> [i64; 1];
        fn le(among: LaneBits, a: Slot, b: Slot) -> LaneBits;
        fn eq(among: LaneBits, a: Slot, b: Slot) -> LaneBits;
        fn lt(among: LaneBits, a: Slot, b: Slot) -> LaneBits;
        fn le_bits(among: LaneBits, a: Slot, b: Slot) -> LaneBits;
        fn lt_u32(among: LaneBits, a: Slot, b: Slot) -> LaneBits;
        fn eq_u32(among: LaneBits, a: Slot, b: Slot) -> LaneBits;
        fn signs(a: Slot) -> LaneBits;
        fn select(mask: LaneBits, a: Slot, b: Slot) -> Slot;
        fn select_u32(mask: LaneBits, a: Slot, b: Slot) -> Slot;
        fn pack(mask: LaneBits, a: Slot) -> Slot;
        fn permute_u32(a: Slot, order: Slot) -> Slot;
    }

    refused! {
        unsafe fn load(from: *const f32) -> Slot;
        unsafe fn store(to: *mut f32, a: Slot) -> ();
        unsafe fn load_u32(from: *const u32) -> Slot;
        unsafe fn store_u32(to: *mut u32, a: Slot) -> ();
        unsafe fn gather(from: *const u32, index: Slot) -> Slot;
        unsafe fn append(to: *mut u32, mask: LaneBits, a: Slot) -> ();
        unsafe fn rows(base: *const f32, offsets: *const u32) -> [Slot; 8];
        unsafe fn put_rows(to: *mut f32, columns: [Slot; 8]) -> ();
        unsafe fn put_quads(to: *mut f32, columns: [Slot; 4]) -> ();
        unsafe fn pick(from: [*const f32; 2], index: Slot) -> Slot;
    }
}
