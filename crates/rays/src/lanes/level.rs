//! [`SimdLevel`]: which instruction set to use, and how to run code with it.
//!
//! A [`LaneTask`] is generic over [`Lanes`]. [`SimdLevel::run`] instantiates it for each level inside a function that
//! enables the level's instructions (`#[target_feature]`), and calls the one for the chosen level.
//!
//! The build script leaves levels out where the environment asks for one level alone (`CONTRIBUTING.md`): they are not
//! available then.
//!
//! Unsafe code, because functions that enable instructions are called. Invariants:
//! 1. Such a function is called only where [`SimdLevel::is_available`] has found the instructions.
#![allow(unsafe_code, reason = "the invariants above")]

#[cfg(not(target_arch = "aarch64"))]
use super::Eight;
use super::Lanes;
#[cfg(target_arch = "aarch64")]
use super::Neon;
#[cfg(not(without_scalar))]
use super::SingleLane;
use std::fmt;
use std::str::FromStr;

/// An instruction set for tracing and shading. All levels give the same bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum SimdLevel {
    /// Plain Rust on any processor: no lanes for tracing, one for shading.
    Scalar,
    /// Eight lanes on any 64-bit ARM.
    Neon,
    /// Eight lanes on x86-64 with AVX2, FMA, BMI1, BMI2, LZCNT and POPCNT.
    Avx2,
    /// Sixteen lanes on x86-64 with those of [`SimdLevel::Avx2`] and AVX-512 F, BW, DQ and VL.
    Avx512,
}

/// Work that runs at any level, with its arguments.
pub trait LaneTask {
    /// The result.
    type Output;
    /// Runs the task. Implementations must be `inline(always)`, as must everything they call that handles lanes.
    fn run<L: Lanes>(self, l: L) -> Self::Output;
}

/// Error of choosing a level.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SimdError {
    /// No level has this name.
    #[error("there is no SIMD level {name:?}; choose auto, {}", names(&SimdLevel::ALL))]
    Unknown {
        /// The requested name.
        name: String,
    },
    /// The processor lacks the instructions.
    #[error("this processor has no {level}; it has {}, or choose auto", names(&SimdLevel::available()))]
    Unavailable {
        /// The requested level.
        level: SimdLevel,
    },
}

fn names(levels: &[SimdLevel]) -> String {
    levels.iter().map(|level| level.name()).collect::<Vec<_>>().join(", ")
}

impl SimdLevel {
    /// All levels, best first.
    pub const ALL: [Self; 4] = [Self::Avx512, Self::Avx2, Self::Neon, Self::Scalar];

    /// The best level that this processor has.
    pub fn detect() -> Self {
        Self::available()[0]
    }

    /// The levels that this processor has, best first; never empty.
    pub fn available() -> Vec<Self> {
        Self::ALL.into_iter().filter(|level| level.is_available()).collect()
    }

    /// True if this processor has the level's instructions and this build the level.
    pub fn is_available(self) -> bool {
        match self {
            Self::Scalar => cfg!(not(without_scalar)),
            Self::Neon => cfg!(all(target_arch = "aarch64", not(without_neon))),
            Self::Avx2 => cfg!(not(without_avx2)) && has_avx2(),
            Self::Avx512 => cfg!(not(without_avx512)) && has_avx512(),
        }
    }

    /// The available level with the fewest lanes, for work on single rays.
    pub fn narrowest() -> Self {
        Self::ALL.into_iter().rfind(|level| level.is_available()).expect("each build has a level")
    }

    /// The level of a `--simd` argument; `auto` is the best one that this processor has.
    ///
    /// # Errors
    /// When no level has this name, or the processor lacks the level.
    pub fn choose(argument: &str) -> Result<Self, SimdError> {
        if argument == "auto" { Ok(Self::detect()) } else { argument.parse::<Self>()?.require() }
    }

    /// The level itself.
    ///
    /// # Errors
    /// When the processor lacks it.
    pub fn require(self) -> Result<Self, SimdError> {
        if self.is_available() { Ok(self) } else { Err(SimdError::Unavailable { level: self }) }
    }

    /// Runs a task with the widest lanes of this level; with one lane at [`SimdLevel::Scalar`].
    ///
    /// # Panics
    /// When the processor lacks the level: see [`SimdLevel::require`].
    pub fn run<T: LaneTask>(self, task: T) -> T::Output {
        assert!(self.is_available(), "this processor has no {self}");
        match self {
            #[cfg(not(without_scalar))]
            Self::Scalar => task.one(),
            #[cfg(all(target_arch = "x86_64", not(without_avx2)))]
            // SAFETY: invariant 1.
            Self::Avx2 => unsafe { task.avx2() },
            #[cfg(all(target_arch = "x86_64", not(without_avx512)))]
            // SAFETY: invariant 1.
            Self::Avx512 => unsafe { task.avx512() },
            #[cfg(all(target_arch = "aarch64", not(without_neon)))]
            Self::Neon => task.run(Neon),
            _ => unreachable!("levels that are left out are not available"),
        }
    }

    /// Runs a task with eight lanes and the best instructions for them, in any build.
    pub(crate) fn run_eight<T: LaneTask>(task: T) -> T::Output {
        #[cfg(target_arch = "x86_64")]
        if has_avx2() {
            // SAFETY: invariant 1.
            return unsafe { task.avx2() };
        }
        #[cfg(target_arch = "aarch64")]
        let eight = Neon;
        #[cfg(not(target_arch = "aarch64"))]
        let eight = Eight;
        task.eight(eight)
    }

    /// The level whose tasks have `lanes` lanes; the narrowest if this build leaves it out.
    #[doc(hidden)]
    pub fn of_lanes(lanes: usize) -> Self {
        let level = match lanes {
            16 => Self::Avx512,
            8 if cfg!(target_arch = "aarch64") => Self::Neon,
            8 => Self::Avx2,
            _ => Self::Scalar,
        };
        // All levels that lanes can be of are there, but in a build for one level.
        let leaves_out = cfg!(any(without_avx512, without_avx2, without_neon, without_scalar));
        if leaves_out && !level.is_available() { Self::narrowest() } else { level }
    }

    /// The name that arguments and reports use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Scalar => "scalar",
            Self::Neon => "neon",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }
}

/// True if this processor has the instructions of [`SimdLevel::Avx2`].
fn has_avx2() -> bool {
    #[cfg(target_arch = "x86_64")]
    return is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("fma")
        && is_x86_feature_detected!("bmi1")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("lzcnt")
        && is_x86_feature_detected!("popcnt");
    #[cfg(not(target_arch = "x86_64"))]
    false
}

/// True if this processor has the instructions of [`SimdLevel::Avx512`].
fn has_avx512() -> bool {
    #[cfg(target_arch = "x86_64")]
    return has_avx2()
        && is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512vl");
    #[cfg(not(target_arch = "x86_64"))]
    false
}

/// The instances of a task. They are methods of the task, not functions of this module, because the compiler puts what
/// is generic into the codegen unit of the type it is a method of: so it works on several tasks at the same time, and
/// after an edit only on those that changed.
trait Instances: LaneTask + Sized {
    /// One lane, without any instructions that not all processors have.
    #[cfg(not(without_scalar))]
    #[inline(never)]
    fn one(self) -> Self::Output {
        self.run(SingleLane)
    }

    /// Eight lanes that all processors have.
    #[inline(never)]
    fn eight<L: Lanes>(self, eight: L) -> Self::Output {
        self.run(eight)
    }

    /// The lanes of [`SimdLevel::Avx2`].
    ///
    /// # Safety
    /// The processor has the instructions.
    #[cfg(target_arch = "x86_64")]
    unsafe fn avx2(self) -> Self::Output;

    /// The lanes of [`SimdLevel::Avx512`].
    ///
    /// # Safety
    /// The processor has the instructions.
    #[cfg(all(target_arch = "x86_64", not(without_avx512)))]
    unsafe fn avx512(self) -> Self::Output;
}

impl<T: LaneTask> Instances for T {
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    unsafe fn avx2(self) -> T::Output {
        // SAFETY: this function enables the instructions, so its caller has found them: invariant 1.
        self.run(unsafe { super::Avx2::new() })
    }

    #[cfg(all(target_arch = "x86_64", not(without_avx512)))]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    unsafe fn avx512(self) -> T::Output {
        // SAFETY: this function enables the instructions, so its caller has found them: invariant 1.
        self.run(unsafe { super::Avx512::new() })
    }
}

impl fmt::Display for SimdLevel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for SimdLevel {
    type Err = SimdError;

    fn from_str(name: &str) -> Result<Self, SimdError> {
        Self::ALL
            .into_iter()
            .find(|level| level.name() == name)
            .ok_or_else(|| SimdError::Unknown { name: name.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_back_to_their_levels() {
        for level in SimdLevel::ALL {
            assert_eq!(level.to_string().parse(), Ok(level));
        }
        assert_eq!(SimdLevel::choose("auto"), Ok(SimdLevel::detect()));
        let narrowest = SimdLevel::narrowest();
        assert_eq!(SimdLevel::choose(narrowest.name()), Ok(narrowest));
    }

    #[test]
    fn errors_name_the_choices() {
        let error = SimdLevel::choose("mmx").expect_err("unknown").to_string();
        assert_eq!(error, "there is no SIMD level \"mmx\"; choose auto, avx512, avx2, neon, scalar");
        let error = SimdError::Unavailable { level: SimdLevel::Avx512 }.to_string();
        assert!(error.starts_with("this processor has no avx512; it has ") && error.contains("scalar"));
    }
}
