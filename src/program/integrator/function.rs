//! Host functions: what the shaders of an integrator ask of the renderer.

use crate::lanes::{Int, Lanes, Mask, Num, Vector, for_pairs, for_pairs_mut};
use crate::program::code::Register;
use crate::program::run::Columns;

macro_rules! host_functions {
    ($($name:ident $text:literal $doc:literal;)*) => {
        /// A function of `shaders/integrator.wgsl` that the renderer computes.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[non_exhaustive]
        pub enum HostFunction {
            $(#[doc = $doc] $name,)*
            /// `trace`: emits a ray and waits for its answer. The number is that of the loop shader that goes on.
            Trace(u32),
            /// `visible`: emits a ray and waits to learn whether it hits nothing. The number is as for `trace`.
            Visible(u32),
        }

        impl HostFunction {
            /// The function's name.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$name => $text,)*
                    Self::Trace(_) => "trace",
                    Self::Visible(_) => "visible",
                }
            }

            /// The host function of this name.
            pub(in crate::program) fn named(name: &str) -> Option<Self> {
                match name {
                    $($text => Some(Self::$name),)*
                    "trace" => Some(Self::Trace(0)),
                    "visible" => Some(Self::Visible(0)),
                    _ => None,
                }
            }
        }
    };
}

host_functions! {
    Splat "splat" "Adds radiance to the pixel.";
    Shadow "shadow" "Emits a shadow ray with the radiance that it adds unless it is occluded.";
    Spawn "spawn" "Emits a ray.";
    Push "push" "Pushes an entry on the loop stack.";
    Depth "depth" "Rays before this one on its path.";
    Last "is_last" "Whether a ray from here is no longer traced.";
    Random "random_at" "A random number.";
    Random2 "random2_at" "Two random numbers.";
    Sky "sky" "Radiance of the environment.";
    Hemisphere "cosine_hemisphere" "A direction around +z.";
    World "to_world" "From the shading basis to the world.";
    Leave "leave" "A ray that leaves the surface.";
    Above "is_above" "Whether a direction points away from the surface.";
    Light "light_sample" "A sample of a light.";
    Evaluate "bsdf_evaluate" "The value of the BSDF.";
    Sample "bsdf_sample" "A sample of the BSDF.";
    Ways "bsdf_ways" "The mirrored and the refracted ray.";
}

impl HostFunction {
    /// True if it does something beside returning a value.
    pub fn is_effect(self) -> bool {
        matches!(self, Self::Splat | Self::Shadow | Self::Spawn | Self::Push) || self.wait().is_some()
    }

    /// The number of a call that waits for a ray: of `trace` or `visible`.
    #[inline]
    pub(in crate::program) fn wait(self) -> Option<u32> {
        match self {
            Self::Trace(number) | Self::Visible(number) => Some(number),
            _ => None,
        }
    }

    /// The function as the call of a number that waits.
    pub(in crate::program) fn numbered(self, number: u32) -> Self {
        match self {
            Self::Trace(_) => Self::Trace(number),
            Self::Visible(_) => Self::Visible(number),
            other => other,
        }
    }

    /// True if it needs the surface that a ray has hit.
    #[inline]
    pub fn needs_hit(self) -> bool {
        matches!(
            self,
            Self::World
                | Self::Leave
                | Self::Above
                | Self::Light
                | Self::Evaluate
                | Self::Sample
                | Self::Ways
        )
    }
}

/// Calls that a program makes to its caller while it runs.
pub trait Host<L: Lanes> {
    /// Computes a function at the points of a call's mask, or records its effect, in the order of the points.
    fn call(&mut self, l: L, call: &HostCall<'_>);
}

/// A call of a host function for a block of points.
#[derive(Debug)]
pub struct HostCall<'a> {
    /// The function.
    pub function: HostFunction,
    pub(in crate::program) columns: &'a Columns,
    pub(in crate::program) operands: &'a [Register],
    pub(in crate::program) results: &'a [Register],
    pub(in crate::program) mask: Register,
    /// Points of the block, a multiple of the lanes.
    pub points: usize,
    /// The call's first byte in the text that was parsed.
    pub place: u32,
}

impl HostCall<'_> {
    /// Number of scalars that the call is given.
    #[inline]
    pub fn operands(&self) -> usize {
        self.operands.len()
    }

    /// An operand's word at a point.
    #[inline(always)]
    pub fn word(&self, operand: usize, point: usize) -> u32 {
        self.columns.operand(self.operands[operand], point + 1).at(point)
    }

    /// True if a point is in the call's mask.
    #[inline(always)]
    pub fn holds(&self, point: usize) -> bool {
        self.columns.operand(self.mask, point + 1).at(point) != 0
    }

    /// Sets a result's word at a point.
    #[inline(always)]
    pub fn set_word(&self, result: usize, point: usize, word: u32) {
        self.columns.column(self.results[result], point + 1)[point].set(word);
    }

    /// An operand's words in the lanes from a point on.
    #[inline(always)]
    pub fn int<L: Lanes>(&self, l: L, operand: usize, start: usize) -> Int<L> {
        self.columns.int(l, self.operands[operand], start)
    }

    /// An operand's numbers in the lanes from a point on.
    #[inline(always)]
    pub fn number<L: Lanes>(&self, l: L, operand: usize, start: usize) -> Num<L> {
        self.int(l, operand, start).to_num_bits()
    }

    /// Three operands in the lanes from a point on.
    #[inline(always)]
    pub fn vector<L: Lanes>(&self, l: L, operand: usize, start: usize) -> Vector<L> {
        let x = self.number(l, operand, start);
        Vector::new(x, self.number(l, operand + 1, start), self.number(l, operand + 2, start))
    }

    /// The lanes from a point on that are in the call's mask.
    #[inline(always)]
    pub fn lanes<L: Lanes>(&self, l: L, start: usize) -> Mask<L> {
        !self.columns.int(l, self.mask, start).is(0)
    }

    /// Sets a result in the lanes from a point on.
    #[inline(always)]
    pub fn set_number<L: Lanes>(&self, result: usize, start: usize, number: Num<L>) {
        self.columns.set(self.results[result], start, number.to_bits());
    }

    /// Sets three results in the lanes from a point on.
    #[inline(always)]
    pub fn set_vector<L: Lanes>(&self, result: usize, start: usize, vector: Vector<L>) {
        self.set_number(result, start, vector.x);
        self.set_number(result + 1, start, vector.y);
        self.set_number(result + 2, start, vector.z);
    }
}

impl Columns {
    /// The words of the lanes from a point on.
    #[inline(always)]
    pub(in crate::program) fn int<L: Lanes>(&self, l: L, register: Register, start: usize) -> Int<L> {
        let mut words = L::array(0u32);
        let operand = self.operand(register, start + L::LANES);
        let cells = operand.some(start, L::LANES);
        for_pairs_mut(words.as_mut(), cells, |word, cell| *word = cell.get());
        Int::from_array(l, &words)
    }

    #[inline(always)]
    fn set<L: Lanes>(&self, register: Register, start: usize, words: Int<L>) {
        let words = words.to_array();
        let cells = &self.column(register, start + L::LANES)[start..];
        for_pairs(cells, words.as_ref(), |cell, &word| cell.set(word));
    }
}
