//! The finish that a procedural surface computes.

use super::erased_lanes::{LaneColumns, LaneValue};
use super::{Effects, FieldType, Points, SurfaceField};
use crate::lanes::{Lanes, MAX_LANES, Mask, Num, Vector};

/// The default of a field: its value in lanes, or its text.
macro_rules! default {
    (value, zero, $points:ident) => {
        Num::zero($points.lanes())
    };
    (value, one, $points:ident) => {
        Num::splat($points.lanes(), 1.0)
    };
    (value, black, $points:ident) => {
        Vector::zero($points.lanes())
    };
    (value, white, $points:ident) => {
        Vector::grey(Num::splat($points.lanes(), 1.0))
    };
    (value, shading_normal, $points:ident) => {
        $points.normal
    };
    (text, zero) => {
        "0"
    };
    (text, one) => {
        "1"
    };
    (text, black) => {
        "black"
    };
    (text, white) => {
        "white"
    };
    (text, shading_normal) => {
        "the shading normal"
    };
}

/// Source of the scalars of a finish, one column each.
pub(crate) trait FinishSource {
    /// Writes the column of a scalar. Scalars are counted over all fields.
    fn get(&self, scalar: usize, column: &mut [f32; MAX_LANES]);
}

/// Defines [`Finish`] from the table of its fields.
macro_rules! finish {
    ($($name:ident: $kind:ident as $type:ty, $unit:literal, $range:literal, $default:ident, $doc:literal;)*) => {
        /// The finish of a surface at points, one in each lane. Values out of range are clamped, and NaN counts as 0.
        /// `docs/guide/surface-fields.md` lists the fields.
        #[derive(Clone, Copy, Debug)]
        pub struct Finish<L: Lanes> {
            $(
                #[doc = concat!(
                    $doc, " Unit: ", $unit, ". Range: ", $range, ". Default: ", default!(text, $default), "."
                )]
                pub $name: $type,
            )*
        }

        /// The fields of [`Finish`].
        pub const FINISH_FIELDS: &[SurfaceField] = &[$(SurfaceField {
            name: stringify!($name), kind: FieldType::$kind, unit: $unit, range: $range,
            default: default!(text, $default), is_computed: false, doc: $doc,
        },)*];

        /// The fields of [`Finish`] as columns.
        #[derive(Clone, Copy)]
        pub(super) struct FinishColumns {
            $($name: LaneColumns<{ FieldType::$kind.numbers() }>,)*
        }

        impl<L: Lanes> Finish<L> {
            /// All fields at their defaults: an opaque white dielectric of roughness 1 without a coat.
            #[inline(always)]
            pub fn matte(points: &Points<'_, L>) -> Self {
                Self { $($name: default!(value, $default, points),)* }
            }

            #[inline(always)]
            pub(super) fn columns(&self) -> FinishColumns {
                FinishColumns { $($name: self.$name.columns(),)* }
            }

            /// The finish whose scalars a source has.
            #[inline(always)]
            pub(crate) fn read_from(l: L, source: &impl FinishSource) -> Self {
                let mut scalar = 0;
                let finish = Self {
                    $($name: {
                        let mut columns = [[0.0; MAX_LANES]; FieldType::$kind.numbers()];
                        for column in &mut columns {
                            source.get(scalar, column);
                            scalar += 1;
                        }
                        LaneValue::of_columns(l, &columns)
                    },)*
                };
                debug_assert!(scalar > 0);
                finish
            }

            #[inline(always)]
            pub(super) fn of_columns(l: L, columns: &FinishColumns) -> Self {
                Self { $($name: LaneValue::of_columns(l, &columns.$name),)* }
            }
        }
    };
}

finish! {
    colour: Vec3f as Vector<L>, "linear Rec. 709", "0 to 1", white,
        "Diffuse albedo of the dielectric share, reflectance of the metallic share, tint of transmitted light.";
    metallic: F32 as Num<L>, "1", "0 to 1", zero, "Share of metal.";
    roughness: F32 as Num<L>, "perceptual", "0 to 1", one, "Roughness of reflection and transmission.";
    clearcoat: F32 as Num<L>, "1", "0 to 1", zero, "Strength of a smooth clear coat.";
    transmission: F32 as Num<L>, "1", "0 to 1", zero,
        "Share of the diffuse reflection that transmission replaces. Declared by `Effects::thin_transmission` or \
         `Effects::body_transmission`.";
    emission: Vec3f as Vector<L>, "radiance, linear Rec. 709", "0 to the declared bound", black,
        "Light emitted towards the viewer. Declared by `Effects::emission`.";
    opacity: F32 as Num<L>, "1", "0 to 1", one,
        "Probability that a ray meets the surface; otherwise it passes. Declared by `Effects::opacity`.";
    normal: Vec3f as Vector<L>, "world space", "any length but 0", shading_normal,
        "Shading normal. It is turned to the viewer's side. Declared by `Effects::normals`.";
}

/// Lanes in which two numbers have the same bits.
#[inline(always)]
fn same<L: Lanes>(a: Num<L>, b: Num<L>) -> Mask<L> {
    (a.to_bits() ^ b.to_bits()).is(0)
}

impl<L: Lanes> Finish<L> {
    /// Effect that the surface computes without having declared it, if any.
    #[inline(always)]
    pub(super) fn undeclared(&self, points: &Points<'_, L>, effects: &Effects) -> Option<&'static str> {
        let one = Num::splat(points.lanes(), 1.0);
        let [given, made] = [points.normal, self.normal];
        if !effects.emits() && !self.emission.is_zero().all() {
            return Some("emission");
        }
        if !effects.has_opacity && !same(self.opacity, one).all() {
            return Some("opacity");
        }
        if effects.transmission.is_none() && !self.transmission.is_zero().all() {
            return Some("transmission");
        }
        let kept = same(given.x, made.x) & same(given.y, made.y) & same(given.z, made.z);
        if !effects.has_normals && !kept.all() {
            return Some("normals");
        }
        None
    }
}
