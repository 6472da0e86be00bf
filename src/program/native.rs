//! Functions of the prelude that the executor computes with kernels in lanes. `shaders/prelude.wgsl` and
//! `shaders/built_ins.wgsl` hold the same functions in WGSL; a test compares their bits.

use crate::geom::warp::lanes as warp;
use crate::lanes::{Int, Lanes, Num, Vector, exponential, trigonometry};

/// A native function.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Native {
    Sin,
    Cos,
    Atan2,
    Exp2,
    Log2,
    Noise,
    Disk,
    CosineHemisphere,
}

impl Native {
    /// All native functions.
    pub const ALL: [Self; 8] = [
        Self::Sin,
        Self::Cos,
        Self::Atan2,
        Self::Exp2,
        Self::Log2,
        Self::Noise,
        Self::Disk,
        Self::CosineHemisphere,
    ];

    /// The function of the prelude.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sin => "sin_of",
            Self::Cos => "cos_of",
            Self::Atan2 => "atan2_of",
            Self::Exp2 => "exp2_of",
            Self::Log2 => "log2_of",
            Self::Noise => "noise",
            Self::Disk => "disk",
            Self::CosineHemisphere => "cosine_hemisphere",
        }
    }

    /// Number of results.
    pub fn results(self) -> usize {
        match self {
            Self::Disk => 2,
            Self::CosineHemisphere => 3,
            _ => 1,
        }
    }

    /// The native function of this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|native| native.name() == name)
    }

    /// The results, then zeros; operands beyond the function's number are ignored.
    #[inline(always)]
    pub fn of<L: Lanes>(self, [a, b, c]: [Num<L>; 3]) -> [Num<L>; 3] {
        let zero = Num::zero(a.lanes());
        let result = match self {
            Self::Sin => trigonometry::sin_cos(a).0,
            Self::Cos => trigonometry::sin_cos(a).1,
            Self::Atan2 => trigonometry::atan2_turns(a, b) * std::f32::consts::TAU,
            Self::Exp2 => exponential::exp2(a),
            Self::Log2 => exponential::log2(a),
            Self::Noise => noise(Vector::new(a, b, c)),
            Self::Disk => {
                let [x, y] = warp::disk([a, b]);
                return [x, y, zero];
            }
            Self::CosineHemisphere => {
                let direction = warp::cosine_hemisphere([a, b]);
                return [direction.x, direction.y, direction.z];
            }
        };
        [result, zero, zero]
    }
}

/// The lattice coordinate of the origin. Coordinates are counted from there, to be positive.
const MIDDLE: f32 = 65_536.0;

/// A random number of 0 to 1 for each point of the lattice.
#[inline(always)]
fn lattice<L: Lanes>(x: Int<L>, y: Int<L>, z: Int<L>) -> Num<L> {
    let mixed = (x * 0x8da6_b343) ^ (y * 0xd816_3841) ^ (z * 0xcb1a_b31f);
    let mixed = (mixed ^ (mixed >> 15)) * 0x2c1b_3c6d;
    let mixed = (mixed ^ (mixed >> 12)) * 0x297a_2d39;
    ((mixed ^ (mixed >> 15)) >> 8).to_num() * (1.0 / (1 << 24) as f32)
}

/// From 0 to 1 with a slope of 0 at either end (Perlin 2002).
#[inline(always)]
pub fn ease<L: Lanes>(x: Num<L>) -> Num<L> {
    x * x * x * (x * (x * 6.0 - 15.0) + 10.0)
}

/// The lattice coordinate of a whole number; the lattice ends at ±[`MIDDLE`].
#[inline(always)]
fn place<L: Lanes>(whole: Num<L>) -> Int<L> {
    (whole + MIDDLE).clamp(0.0, 2.0 * MIDDLE).to_int()
}

/// Smooth noise of 0 to 1 with features of unit size.
#[inline(always)]
pub fn noise<L: Lanes>(p: Vector<L>) -> Num<L> {
    let (fx, fy, fz) = (p.x.floor(), p.y.floor(), p.z.floor());
    let [x, y, z] = [place(fx), place(fy), place(fz)];
    let [x1, y1, z1] = [x + 1, y + 1, z + 1];
    let (u, v, w) = (ease(p.x - fx), ease(p.y - fy), ease(p.z - fz));
    let near =
        lattice(x, y, z).lerp(lattice(x1, y, z), u).lerp(lattice(x, y1, z).lerp(lattice(x1, y1, z), u), v);
    let far = lattice(x, y, z1)
        .lerp(lattice(x1, y, z1), u)
        .lerp(lattice(x, y1, z1).lerp(lattice(x1, y1, z1), u), v);
    near.lerp(far, w)
}
