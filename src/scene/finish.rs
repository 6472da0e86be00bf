//! The finish that a procedural surface computes.

use super::erased_lanes::{LaneColumns, LaneValue};
use super::{BlockColumns, Effects, FieldType, PointSink, Points, SurfaceField};
use crate::lanes::{Lanes, MAX_LANES, Mask, Num, Vector};

/// The default of a field: its value in lanes, or its text.
macro_rules! default {
    (value, zero, $l:expr, $normal:expr) => {
        Num::zero($l)
    };
    (value, shading_normal, $l:expr, $normal:expr) => {
        $normal
    };
    (value, black, $l:expr, $normal:expr) => {
        Vector::zero($l)
    };
    (value, no_direction, $l:expr, $normal:expr) => {
        Vector::zero($l)
    };
    (value, white, $l:expr, $normal:expr) => {
        Vector::grey(Num::splat($l, 1.0))
    };
    (value, $number:tt, $l:expr, $normal:expr) => {
        Num::splat($l, default!(number, $number))
    };
    (number, one) => {
        1.0
    };
    (number, half) => {
        0.5
    };
    (number, of_glass) => {
        0.04
    };
    (number, of_soap) => {
        1.3
    };
    (number, nanometres) => {
        400.0
    };
    (text, zero) => {
        "0"
    };
    (text, no_direction) => {
        "0"
    };
    (text, one) => {
        "1"
    };
    (text, half) => {
        "0.5"
    };
    (text, of_glass) => {
        "0.04"
    };
    (text, of_soap) => {
        "1.3"
    };
    (text, nanometres) => {
        "400"
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
    ($(
        $name:ident: $kind:ident as $type:ty, $unit:literal, $range:literal, $default:ident, $doc:literal
        $(, if $declared:ident)?;
    )*) => {
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

        impl BlockColumns {
            /// The scalars of finishes that surfaces of these effects must compute: those of all fields that are not
            /// declared by a layer, and of the layers that are.
            pub fn computed(effects: &Effects) -> Vec<usize> {
                let (mut computed, mut scalar) = (Vec::new(), 0);
                $(
                    let end = scalar + FieldType::$kind.numbers();
                    if true $(&& effects.$declared)? {
                        computed.extend(scalar..end);
                    }
                    scalar = end;
                )*
                debug_assert!(scalar >= computed.len());
                computed
            }
        }

        /// The fields of [`Finish`] as columns.
        #[derive(Clone, Copy)]
        pub(super) struct FinishColumns {
            $($name: LaneColumns<{ FieldType::$kind.numbers() }>,)*
        }

        impl<L: Lanes> Finish<L> {
            /// All fields at their defaults: an opaque white dielectric of roughness 1 without a coat.
            #[inline(always)]
            pub fn matte(points: &Points<'_, L>) -> Self {
                Self::around(points.normal)
            }

            /// [`Finish::matte`] around a shading normal.
            #[inline(always)]
            pub fn around(normal: Vector<L>) -> Self {
                Self { $($name: default!(value, $default, normal.lanes(), normal),)* }
            }

            #[inline(always)]
            pub(super) fn columns(&self) -> FinishColumns {
                FinishColumns { $($name: self.$name.columns(),)* }
            }

            /// The finish whose scalars a source has. Layers that `effects` do not declare have their defaults.
            #[inline(always)]
            pub(crate) fn read_from(l: L, source: &impl FinishSource, effects: &Effects) -> Self {
                let mut scalar = 0;
                let finish = Self {
                    $($name: if true $(&& effects.$declared)? {
                        let mut columns = [[0.0; MAX_LANES]; FieldType::$kind.numbers()];
                        for column in &mut columns {
                            source.get(scalar, column);
                            scalar += 1;
                        }
                        LaneValue::of_columns(l, &columns)
                    } else {
                        scalar += FieldType::$kind.numbers();
                        default!(value, $default, l, Vector::zero(l))
                    },)*
                };
                debug_assert!(scalar > 0);
                finish
            }

            /// Passes the scalars to a sink, counted from `first` on.
            #[inline(always)]
            pub(super) fn write_to(&self, first: usize, sink: &mut dyn PointSink) {
                let mut scalar = first;
                $(
                    let columns = LaneValue::columns(&self.$name);
                    columns.iter().enumerate().for_each(|(i, column)| sink.put(scalar + i, column));
                    scalar += FieldType::$kind.numbers();
                )*
                debug_assert!(scalar > first);
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
    specular: F32 as Num<L>, "1", "0 to 1", one, "Strength of the reflection of the dielectric share.";
    specular_tint: Vec3f as Vector<L>, "linear Rec. 709", "at least 0", white,
        "Tint of that reflection at normal incidence.";
    reflectance: F32 as Num<L>, "1", "0 to 1", of_glass,
        "That reflection at normal incidence: ((n - 1) / (n + 1))² of an index of refraction n. The boundary of a body \
         has that of its index.";
    clearcoat_roughness: F32 as Num<L>, "perceptual", "0 to 1", zero, "Roughness of the clear coat.";
    anisotropy: F32 as Num<L>, "1", "0 to 1", zero,
        "How much rougher reflection is along one direction. Declared by `Effects::anisotropy`.", if has_anisotropy;
    rough_direction: Vec3f as Vector<L>, "world space", "any length", no_direction,
        "The rougher direction; where it is 0, that of the material itself, or the tangent.", if has_anisotropy;
    sheen: Vec3f as Vector<L>, "linear Rec. 709", "0 to 1", black,
        "Albedo of fibres that reflect at grazing angles. Declared by `Effects::sheen`.", if has_sheen;
    sheen_roughness: F32 as Num<L>, "perceptual", "0 to 1", half, "How far the fibres deviate from the normal.",
        if has_sheen;
    film: F32 as Num<L>, "1", "0 to 1", zero,
        "Weight of a thin film with interference colours. Declared by `Effects::film`.", if has_film;
    film_thickness: F32 as Num<L>, "nanometres", "at least 0", nanometres, "Thickness of the film.", if has_film;
    film_ior: F32 as Num<L>, "1", "at least 1", of_soap, "Index of refraction of the film.", if has_film;
    diffuse_transmission: F32 as Num<L>, "1", "0 to 1", zero,
        "Share of the diffuse reflection that leaves on the other side instead. Declared by \
         `Effects::diffuse_transmission`.", if has_diffuse_transmission;
    diffuse_transmission_colour: Vec3f as Vector<L>, "linear Rec. 709", "0 to 1", white,
        "Share of that light which is not absorbed.", if has_diffuse_transmission;
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
        if !effects.has_anisotropy && !self.anisotropy.is_zero().all() {
            return Some("anisotropy");
        }
        if !effects.has_sheen && !self.sheen.is_zero().all() {
            return Some("sheen");
        }
        if !effects.has_film && !self.film.is_zero().all() {
            return Some("film");
        }
        if !effects.has_diffuse_transmission && !self.diffuse_transmission.is_zero().all() {
            return Some("diffuse_transmission");
        }
        let kept = same(given.x, made.x) & same(given.y, made.y) & same(given.z, made.z);
        if !effects.has_normals && !kept.all() {
            return Some("normals");
        }
        None
    }
}
