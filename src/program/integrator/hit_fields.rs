//! Facts that `hit` is told about a surface: the fields of the struct `Hit`.

use crate::scene::FieldType;

/// A field of `Hit`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct HitField {
    /// The fact that it holds.
    pub what: HitFact,
    /// Its name in WGSL.
    pub name: &'static str,
    /// Its type.
    pub kind: FieldType,
    /// Its line of documentation.
    pub doc: &'static str,
}

macro_rules! hit_fields {
    ($($what:ident $name:literal $kind:ident $doc:literal;)*) => {
        /// Fact about a hit that a [`HitField`] holds.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[non_exhaustive]
        pub enum HitFact {
            $(#[doc = $doc] $what,)*
        }

        /// The fields of `Hit`, in order.
        pub const HIT_FIELDS: &[HitField] = &[
            $(HitField { what: HitFact::$what, name: $name, kind: FieldType::$kind, doc: $doc },)*
        ];
    };
}

hit_fields! {
    Position "position" Vec3f "Where the surface is.";
    Normal "normal" Vec3f "Unit shading normal, on the ray's side.";
    GeometricNormal "geometric_normal" Vec3f "Unit normal of the triangle, on the ray's side.";
    Uv "uv" Vec2f "Texture coordinates.";
    Wo "wo" Vec3f "Unit direction back along the ray.";
    T "t" F32 "Distance from the ray's origin in units of its direction.";
    Width "width" F32 "Size of the pixel at the surface.";
    Front "front" Bool "Whether the triangle's front was hit.";
    Colour "colour" Vec3f "Base colour, 0 to 1.";
    Emitted "emitted" Vec3f "Radiance that the surface emits towards the ray's origin.";
    Passed "passed" Vec3f "Share of light that passes the medium between here and the ray's origin.";
    Lights "lights" U32 "Number of lights for light_sample; 0 if the BSDF has mirrored and refracted rays alone.";
}

/// The struct `Hit` in WGSL.
pub(super) fn text() -> String {
    let mut text = String::from("// A surface that a ray has hit.\nstruct Hit {\n");
    for HitField { name, kind, doc, .. } in HIT_FIELDS {
        text += &format!("    // {doc}\n    {name}: {},\n", kind.wgsl());
    }
    text + "}\n\n"
}
