//! The prelude: what every shader file can use.

use crate::scene::{FINISH_FIELDS, FieldType, POINT_FIELDS, SurfaceField};
use std::fmt::Write;

/// The functions of the prelude.
const FUNCTIONS: &str = include_str!("../../shaders/prelude.wgsl");

/// Noises and random numbers.
const NOISES: &str = include_str!("../../shaders/noises.wgsl");

/// WGSL's own functions, as far as they are not single operations.
const BUILT_INS: &str = include_str!("../../shaders/built_ins.wgsl");

/// The text of the prelude: the structs `Point` and `Finish` with the fields of `docs/guide/surface-fields.md`, the
/// function `matte`, and the functions of `shaders/prelude.wgsl`, `shaders/noises.wgsl` and
/// `shaders/built_ins.wgsl`. It follows the text of a file, so that lines keep their numbers.
pub fn prelude() -> String {
    let mut text = String::from("// A point on a surface.\nstruct Point {\n");
    for field in POINT_FIELDS {
        let _ = writeln!(text, "    // {}\n    {}: {},", field.doc, field.name, field.kind.wgsl());
    }
    text += "}\n\n// What a pattern returns.\nstruct Finish {\n";
    for field in FINISH_FIELDS {
        let _ = writeln!(text, "    // {}\n    {}: {},", field.doc, field.name, field.kind.wgsl());
    }
    text += "}\n\n// What `evaluate` of a BSDF returns: BSDF times |cosine|, and the density of `sample`.\n\
             struct Lobe {\n    value: vec3f,\n    pdf: f32,\n}\n\n\
             // What `sample` of a BSDF returns: a direction, BSDF times |cosine| / density, and the density.\n\
             struct Scattered {\n    wi: vec3f,\n    weight: vec3f,\n    pdf: f32,\n}\n\n\
             // What `clear_coat` of a BSDF returns: the coated share of the surface, the perceptual roughness of the\n\
             // coat, and the share of white light that remains after it has passed the coat down and up.\n\
             struct ClearCoat {\n    weight: f32,\n    roughness: f32,\n    colour: vec3f,\n";
    text += "}\n\n// A white, rough, opaque dielectric: all fields at their defaults.\n";
    text += "fn matte(at: Point) -> Finish {\n    return Finish(";
    let defaults: Vec<String> = FINISH_FIELDS.iter().map(default_value).collect();
    text += &defaults.join(", ");
    text += ");\n}\n\n\
             // The finish of the material itself, with its textures, in a pattern; `at` is the pattern's argument.\n\
             fn base(at: Point) -> Finish {\n    return matte(at);\n}\n\n\
             // From a to b, field by field, as a weight grows from 0 to 1.\n\
             fn mix_finish(a: Finish, b: Finish, weight: f32) -> Finish {\n    \
             let share = clamp(weight, 0.0, 1.0);\n    return Finish(";
    let mixed = |field: &SurfaceField| {
        let (name, vector) = (field.name, if field.kind == FieldType::Vec3f { "3" } else { "" });
        format!("mixed{vector}(a.{name}, b.{name}, share)")
    };
    text += &FINISH_FIELDS.iter().map(mixed).collect::<Vec<_>>().join(", ");
    text += ");\n}\n\n";
    [&text, FUNCTIONS, "\n", NOISES, "\n", BUILT_INS].concat()
}

/// A field's default in WGSL.
fn default_value(field: &SurfaceField) -> String {
    let number = match field.default {
        "black" => 0.0,
        "white" => 1.0,
        number => match number.parse::<f32>() {
            Ok(number) => number,
            Err(_) => return "at.normal".into(),
        },
    };
    match field.kind {
        FieldType::Vec3f => format!("vec3f({number:?})"),
        _ => format!("{number:?}"),
    }
}
