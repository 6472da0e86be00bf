//! The fields of [`super::Points`] and [`super::Finish`]: each is one row of a table. The tables define the structs,
//! their docs, what crosses [`super::erased_lanes`], and the page `docs/guide/surface-fields.md`.

/// The type of a field in a shader. In Rust each is a type in lanes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FieldType {
    /// A truth value: [`crate::lanes::Mask`].
    Bool,
    /// A non-negative integer: [`crate::lanes::Int`].
    U32,
    /// A number: [`crate::lanes::Num`].
    F32,
    /// Two numbers: `[Num; 2]`.
    Vec2f,
    /// Three numbers: [`crate::lanes::Vector`].
    Vec3f,
}

impl FieldType {
    /// Numbers that a value consists of.
    #[inline]
    pub const fn numbers(self) -> usize {
        match self {
            Self::Bool | Self::U32 | Self::F32 => 1,
            Self::Vec2f => 2,
            Self::Vec3f => 3,
        }
    }

    /// The type's name in WGSL.
    pub fn wgsl(self) -> &'static str {
        match self {
            Self::Bool => "bool",
            Self::U32 => "u32",
            Self::F32 => "f32",
            Self::Vec2f => "vec2f",
            Self::Vec3f => "vec3f",
        }
    }
}

/// A field of [`super::Points`] or [`super::Finish`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct SurfaceField {
    /// Name.
    pub name: &'static str,
    /// Type of the value at one point.
    pub kind: FieldType,
    /// Unit, or the space of a direction; empty for a plain number.
    pub unit: &'static str,
    /// Allowed values.
    pub range: &'static str,
    /// The value of a surface that does not set the field. Empty for what a surface is given.
    pub default: &'static str,
    /// True if the value is computed only when a surface asks for it. In Rust it is then a method.
    pub is_computed: bool,
    /// Meaning.
    pub doc: &'static str,
}

#[cfg(test)]
mod tests {
    use crate::scene::{FINISH_FIELDS, POINT_FIELDS, SurfaceField};
    use std::path::Path;

    /// Columns of the page's lines.
    const COLUMNS: usize = 120;

    /// Appends one item of a list for each field.
    fn items(page: &mut String, fields: &[SurfaceField]) {
        for SurfaceField { name, kind, unit, range, default, is_computed, doc } in fields {
            let call = if *is_computed { "()" } else { "" };
            let mut facts = format!("- `{name}{call}`: {}; unit: {unit}; range: {range}", kind.wgsl());
            if !default.is_empty() {
                facts += &format!("; default: {default}");
            }
            let text = format!("{facts}. {doc}");
            let mut columns = 0;
            for word in text.split(' ') {
                let more = word.chars().count();
                if columns > 0 && columns + 1 + more > COLUMNS {
                    page.push_str("\n  ");
                    columns = 2;
                } else if columns > 0 {
                    page.push(' ');
                    columns += 1;
                }
                page.push_str(word);
                columns += more;
            }
            page.push('\n');
        }
    }

    /// The page with the lists between its marks replaced.
    fn written(page: &str) -> String {
        let mut text = String::new();
        let mut inside = false;
        for line in page.lines() {
            if line == "<!-- end -->" {
                inside = false;
            }
            if !inside {
                text.push_str(line);
                text.push('\n');
            }
            let fields = match line {
                "<!-- points -->" => POINT_FIELDS,
                "<!-- finish -->" => FINISH_FIELDS,
                _ => continue,
            };
            inside = true;
            text.push('\n');
            items(&mut text, fields);
            text.push('\n');
        }
        text
    }

    #[test]
    fn the_page_lists_the_fields() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/guide/surface-fields.md");
        let page = std::fs::read_to_string(&path).expect("the page");
        let written = written(&page);
        if std::env::var_os("WRITE_PAGES").is_some() {
            std::fs::write(&path, &written).expect("the page is written");
        } else {
            assert!(page == written, "run this test with WRITE_PAGES=1 to write the lists anew");
        }
        assert!(page.contains("<!-- points -->") && page.contains("<!-- finish -->"));
    }
}
