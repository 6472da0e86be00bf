//! Macro by which the files of instruction sets list their instructions.
//!
//! Unsafe code for calling instructions. Invariants, stated and kept by the file that lists them:
//! 1. The token proves that the processor has the instructions.
//! 2. Pointers are valid for what the method's contract in the trait asks for.

/// Methods of [`super::Lanes`] that are one expression of instructions each, as `fn name(self, ..) -> T = expression;`.
///
/// The safety note is here once, for all instructions. A list that begins with an attribute is of plain Rust; the
/// attribute says whether its methods are inlined.
macro_rules! ops {
    ($(fn $name:ident($self:ident $(, $arg:ident: $t:ty)*) -> $out:ty = $body:expr;)*) => {$(
        #[cfg_attr(not(unoptimised), inline(always))]
        fn $name($self $(, $arg: $t)*) -> $out {
            // SAFETY: invariant 1 of the file that lists the instruction.
            unsafe { $body }
        }
    )*};
    ($(unsafe fn $name:ident($self:ident $(, $arg:ident: $t:ty)*) $(-> $out:ty)? = $body:expr;)*) => {$(
        #[cfg_attr(not(unoptimised), inline(always))]
        unsafe fn $name($self $(, $arg: $t)*) $(-> $out)? {
            // SAFETY: invariants 1 and 2 of the file that lists the instruction.
            unsafe { $body }
        }
    )*};
    (#[$inline:meta] $(fn $name:ident($($arg:tt)*) -> $out:ty = $body:expr;)*) => {$(
        #[$inline]
        fn $name($($arg)*) -> $out {
            $body
        }
    )*};
    (#[$inline:meta] $(unsafe fn $name:ident($($arg:tt)*) $(-> $out:ty)? = $body:expr;)*) => {$(
        #[$inline]
        unsafe fn $name($($arg)*) $(-> $out)? {
            // SAFETY: invariant 2 of the file that lists the method.
            unsafe { $body }
        }
    )*};
}
