//! Loops over arrays and slices that are inlined wherever they are called. The `map` of arrays and the `zip` of
//! iterators are compiled once a crate; without optimisation across codegen units each is then a call in a hot loop.

use std::ops::Range;

/// `f` of each index of an array. Unlike `array::from_fn` every codegen unit has a copy, which is inlined. It is not
/// `inline(always)`, since that puts the loop into callers before it is unrolled: the library then takes twice as long
/// to compile.
#[inline]
#[doc(hidden)]
pub fn from_index<T: Copy + Default, const N: usize>(f: impl Fn(usize) -> T) -> [T; N] {
    let mut array = [T::default(); N];
    let mut i = 0;
    while i < N {
        array[i] = f(i);
        i += 1;
    }
    array
}

/// `f` of each of three. Unlike the `map` of arrays it is certain to be inlined, and `f` with it.
#[cfg_attr(not(unoptimised), inline(always))]
#[doc(hidden)]
pub fn each<A: Copy, B>(a: [A; 3], f: impl Fn(A) -> B) -> [B; 3] {
    [f(a[0]), f(a[1]), f(a[2])]
}

/// `f` of both of two; certain to be inlined, as [`each`] is.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn both<A: Copy, B>(a: [A; 2], f: impl Fn(A) -> B) -> [B; 2] {
    [f(a[0]), f(a[1])]
}

/// `f` of each of three pairs; certain to be inlined, as [`each`] is.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn zip<A: Copy, B: Copy, C>(a: [A; 3], b: [B; 3], f: impl Fn(A, B) -> C) -> [C; 3] {
    [f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2])]
}

/// Calls `f` with where each part of `n` elements of a slice of `len` elements lies; the last part may be shorter.
#[cfg_attr(not(unoptimised), inline(always))]
#[doc(hidden)]
pub fn for_parts(len: usize, n: usize, mut f: impl FnMut(Range<usize>)) {
    let mut at = 0;
    while at < len {
        let end = len.min(at + n);
        f(at..end);
        at = end;
    }
}

/// Calls `f` with the elements of two slices, as far as both have some.
#[cfg_attr(not(unoptimised), inline(always))]
#[doc(hidden)]
pub fn for_pairs<A, B>(a: &[A], b: &[B], mut f: impl FnMut(&A, &B)) {
    let len = a.len().min(b.len());
    let (a, b) = (&a[..len], &b[..len]);
    for i in 0..len {
        f(&a[i], &b[i]);
    }
}

/// [`for_pairs`] where `f` may change the elements of the first slice.
#[cfg_attr(not(unoptimised), inline(always))]
#[doc(hidden)]
pub fn for_pairs_mut<A, B>(a: &mut [A], b: &[B], mut f: impl FnMut(&mut A, &B)) {
    let len = a.len().min(b.len());
    let (a, b) = (&mut a[..len], &b[..len]);
    for i in 0..len {
        f(&mut a[i], &b[i]);
    }
}
