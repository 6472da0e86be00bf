//! Ways to a fused multiply-add that is rounded once, as the host's is.

use crate::device::Fma;
use std::fmt;

/// A way to a fused multiply-add. `OpFmaKHR`, which promises one rounding, is none yet: no driver at hand offers it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::trace::gpu) enum Route {
    /// GLSL's `fma`, where the device fuses it.
    Fused,
    /// Sums and products whose rounding errors are computed as well.
    ErrorFree,
    /// Integers of 32 bits.
    Integers,
}

impl Route {
    /// All, the fastest first.
    pub const ALL: [Self; 3] = [Self::Fused, Self::ErrorFree, Self::Integers];

    /// The WGSL of `op_fma`.
    pub fn source(self) -> &'static str {
        match self {
            Self::Fused => include_str!("../../../../shaders/exact/fma_fused.wgsl"),
            Self::ErrorFree => include_str!("../../../../shaders/exact/fma_error_free.wgsl"),
            Self::Integers => include_str!("../../../../shaders/exact/fma_integers.wgsl"),
        }
    }

    /// Whether its kernel has GLSL's `fma`.
    pub fn fma(self) -> Fma {
        if self == Self::Fused { Fma::Probed } else { Fma::Refused }
    }
}

impl fmt::Display for Route {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Fused => "GLSL's fma",
            Self::ErrorFree => "error-free sums",
            Self::Integers => "32-bit integers",
        })
    }
}
