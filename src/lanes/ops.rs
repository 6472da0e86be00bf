//! How the files of instruction sets list their instructions.

/// Methods of [`super::Lanes`] that are one expression of instructions each, as `fn name(self, ..) -> T = expression;`.
///
/// The safety note is here once. It cites the invariants at the top of each instruction set's file:
/// 1. the token proves that the processor has the instructions,
/// 2. pointers are valid for what the method's contract in the trait asks for.
macro_rules! ops {
    ($(fn $name:ident($self:ident $(, $arg:ident: $t:ty)*) -> $out:ty = $body:expr;)*) => {$(
        #[inline(always)]
        fn $name($self $(, $arg: $t)*) -> $out {
            // SAFETY: invariant 1 of the file that lists the instruction.
            unsafe { $body }
        }
    )*};
    ($(unsafe fn $name:ident($self:ident $(, $arg:ident: $t:ty)*) $(-> $out:ty)? = $body:expr;)*) => {$(
        #[inline(always)]
        unsafe fn $name($self $(, $arg: $t)*) $(-> $out)? {
            // SAFETY: invariants 1 and 2 of the file that lists the instruction.
            unsafe { $body }
        }
    )*};
}
