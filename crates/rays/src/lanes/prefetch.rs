//! [`Prefetch`]: loading cache lines before they are needed.
//!
//! Unsafe code, because of instructions. Invariants:
//! 1. A prefetch instruction never faults and changes nothing that a program can read, whatever the address, and every
//!    processor of its architecture has it.
#![allow(unsafe_code, reason = "the invariants above")]

use std::sync::LazyLock;

/// The cache that lines are prefetched into.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[doc(hidden)]
pub enum Prefetch {
    /// The first-level cache.
    First,
    /// The second-level cache. A first-level cache can wait for a few dozen lines at once. At one more, Intel's
    /// processors stall until a line arrives, but AMD's up to Zen 4 drop the prefetch (measured: beyond 24 lines).
    /// Prefetches into the second-level cache are not dropped.
    Second,
}

/// Bytes that probably fit a core's share of the last-level cache. Lines from there arrive so fast that few are waited
/// for at once.
const NEAR: usize = 16 << 20;

impl Prefetch {
    /// The best choice on this processor for addresses scattered over `bytes` bytes.
    #[inline]
    pub fn all_over(bytes: usize) -> Self {
        static FAR: LazyLock<Prefetch> = LazyLock::new(Prefetch::by_processor);
        if bytes > NEAR { *FAR } else { Self::First }
    }

    /// The best choice for more bytes than any cache holds.
    #[cfg(target_arch = "x86_64")]
    fn by_processor() -> Self {
        use std::arch::x86_64::__cpuid;
        let leaf = __cpuid(0);
        let vendor: [u8; 12] = bytemuck::cast([leaf.ebx, leaf.edx, leaf.ecx].map(u32::to_le_bytes));
        // The basic family plus the extended family, which is valid where the basic one is 15, as on every Zen.
        let version = __cpuid(1).eax;
        let family = (version >> 8 & 0xf) + (version >> 20 & 0xff);
        // Hygon's processors are AMD's design. Family 25 is Zen 3 and 4, family 26 is Zen 5.
        let drops = matches!(&vendor, b"AuthenticAMD" | b"HygonGenuine") && family <= 25;
        if drops { Self::Second } else { Self::First }
    }

    #[cfg(not(target_arch = "x86_64"))]
    fn by_processor() -> Self {
        Self::First
    }

    /// Prefetches the cache lines at some addresses, which need not be valid.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn each<T, const N: usize>(self, addresses: [*const T; N]) {
        // One branch for all addresses.
        match self {
            Self::First => {
                for address in addresses {
                    into_first(address);
                }
            }
            Self::Second => {
                for address in addresses {
                    into_second(address);
                }
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[cfg_attr(not(unoptimised), inline(always))]
fn into_first<T>(address: *const T) {
    // SAFETY: invariant 1.
    unsafe { std::arch::x86_64::_mm_prefetch::<{ std::arch::x86_64::_MM_HINT_T0 }>(address.cast()) };
}

#[cfg(target_arch = "x86_64")]
#[cfg_attr(not(unoptimised), inline(always))]
fn into_second<T>(address: *const T) {
    // SAFETY: invariant 1.
    unsafe { std::arch::x86_64::_mm_prefetch::<{ std::arch::x86_64::_MM_HINT_T1 }>(address.cast()) };
}

#[cfg(target_arch = "aarch64")]
#[cfg_attr(not(unoptimised), inline(always))]
fn into_first<T>(address: *const T) {
    // SAFETY: invariant 1.
    unsafe {
        std::arch::asm!("prfm pldl1keep, [{}]", in(reg) address, options(nostack, preserves_flags, readonly));
    }
}

#[cfg(target_arch = "aarch64")]
#[cfg_attr(not(unoptimised), inline(always))]
fn into_second<T>(address: *const T) {
    // SAFETY: invariant 1.
    unsafe {
        std::arch::asm!("prfm pldl2keep, [{}]", in(reg) address, options(nostack, preserves_flags, readonly));
    }
}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
#[cfg_attr(not(unoptimised), inline(always))]
fn into_first<T>(_: *const T) {}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
#[cfg_attr(not(unoptimised), inline(always))]
fn into_second<T>(_: *const T) {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_address_may_be_prefetched() {
        let number = 7u32;
        for prefetch in [Prefetch::First, Prefetch::Second, Prefetch::all_over(usize::MAX)] {
            prefetch.each([&raw const number, std::ptr::null(), std::ptr::without_provenance(!7)]);
        }
        assert_eq!(number, 7);
    }
}
