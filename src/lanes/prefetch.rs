//! Asking for memory before it is needed.
//!
//! Unsafe code for instructions. Invariant 1: a prefetch reads nothing and faults never, whatever the address, and every processor
//! of its architecture has it.
#![allow(unsafe_code, reason = "the invariants above")]

use std::sync::LazyLock;

/// Into which cache memory is asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Prefetch {
    /// The nearest.
    First,
    /// The one behind it. A first cache has room for a few dozen lines under way. Asked for one more, Intel's processors wait for
    /// one to arrive, but AMD's up to Zen 4 drop it (seen there: beyond 24); into the second cache they bring all.
    #[cfg_attr(
        not(target_arch = "x86_64"),
        expect(dead_code, reason = "only x86-64 has instructions for it")
    )]
    Second,
}

/// Bytes that a core may hope to find in the last of the caches, where lines come from so fast that few are under way.
const NEAR: usize = 16 << 20;

impl Prefetch {
    /// What is best on this processor for places all over so many bytes.
    #[inline]
    pub fn all_over(bytes: usize) -> Self {
        static FAR: LazyLock<Prefetch> = LazyLock::new(Prefetch::by_processor);
        if bytes > NEAR { *FAR } else { Self::First }
    }

    /// The same for more bytes than any cache has.
    #[cfg(target_arch = "x86_64")]
    fn by_processor() -> Self {
        use std::arch::x86_64::__cpuid;
        let leaf = __cpuid(0);
        let vendor: [u8; 12] = bytemuck::cast([leaf.ebx, leaf.edx, leaf.ecx].map(u32::to_le_bytes));
        // The basic family and the extended one, which counts where the basic one is 15, as all of Zen's are.
        let version = __cpuid(1).eax;
        let family = (version >> 8 & 0xf) + (version >> 20 & 0xff);
        // Hygon's are AMD's design; 25 is Zen 3 and 4, 26 Zen 5.
        let drops = matches!(&vendor, b"AuthenticAMD" | b"HygonGenuine") && family <= 25;
        if drops { Self::Second } else { Self::First }
    }

    #[cfg(not(target_arch = "x86_64"))]
    fn by_processor() -> Self {
        Self::First
    }

    /// Asks for the cache lines at some addresses, which need not lead anywhere.
    #[inline(always)]
    pub fn each<T, const N: usize>(self, addresses: [*const T; N]) {
        // Decided once for all of them.
        match self {
            Self::First => addresses.into_iter().for_each(into_first),
            Self::Second => addresses.into_iter().for_each(into_second),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn into_first<T>(address: *const T) {
    // SAFETY: invariant 1.
    unsafe { std::arch::x86_64::_mm_prefetch::<{ std::arch::x86_64::_MM_HINT_T0 }>(address.cast()) };
}

#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn into_second<T>(address: *const T) {
    // SAFETY: invariant 1.
    unsafe { std::arch::x86_64::_mm_prefetch::<{ std::arch::x86_64::_MM_HINT_T1 }>(address.cast()) };
}

#[cfg(target_arch = "aarch64")]
#[inline(always)]
fn into_first<T>(address: *const T) {
    // SAFETY: invariant 1.
    unsafe {
        std::arch::asm!("prfm pldl1keep, [{}]", in(reg) address, options(nostack, preserves_flags, readonly));
    }
}

#[cfg(target_arch = "aarch64")]
#[inline(always)]
fn into_second<T>(address: *const T) {
    // SAFETY: invariant 1.
    unsafe {
        std::arch::asm!("prfm pldl2keep, [{}]", in(reg) address, options(nostack, preserves_flags, readonly));
    }
}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
#[inline(always)]
fn into_first<T>(_: *const T) {}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
#[inline(always)]
fn into_second<T>(_: *const T) {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_address_may_be_asked_for() {
        let number = 7u32;
        for prefetch in [Prefetch::First, Prefetch::Second, Prefetch::all_over(usize::MAX)] {
            prefetch.each([&raw const number, std::ptr::null(), std::ptr::without_provenance(!7)]);
        }
        assert_eq!(number, 7);
    }
}
