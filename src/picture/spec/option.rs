//! Options of a picture: declared once, read from and written to text and JSON, listed for documents and doors.

use super::form::Form;
use serde_json::Value;

/// An option of a picture: a key of a render spec, and a long option of `raystream render`.
#[derive(Clone, Debug)]
pub struct SpecOption {
    /// The key.
    pub name: &'static str,
    /// The documentation, one paragraph.
    pub help: String,
    /// The form of its value, as in `WxH`; `None` if the option is true or false.
    pub value: Option<&'static str>,
    /// True if the option takes a list, one value at a time.
    pub is_list: bool,
    /// The value where none is given, as text.
    pub default: Option<String>,
    /// The value that its name alone stands for on a command line, if it may stand alone.
    pub alone: Option<&'static str>,
    /// The only values that it takes, where these are names.
    pub choices: Vec<&'static str>,
    /// Checks one value that is given as text.
    pub check: fn(&str) -> Result<(), String>,
    /// The JSON schema of the value.
    pub schema: fn() -> Value,
}

/// A group of options.
pub trait SpecGroup: Default {
    /// The options, in order.
    fn options() -> Vec<SpecOption>;

    /// Sets the option of a name. `None` if the group has none of this name.
    fn set(&mut self, name: &str, value: &Value) -> Option<Result<(), String>>;

    /// The names and values of all options that differ from their defaults; with `all`, of those that equal them, too.
    fn entries(&self, all: bool) -> Vec<(&'static str, Value)>;
}

/// The text of one value of JSON: a text, a number, or a list of them, whose parts commas separate.
pub(super) fn text(value: &Value) -> Result<String, String> {
    match value {
        Value::String(text) => Ok(text.clone()),
        Value::Number(number) => Ok(number.to_string()),
        Value::Array(values) if !values.is_empty() => {
            Ok(values.iter().map(text).collect::<Result<Vec<_>, _>>()?.join(","))
        }
        other => Err(format!("takes a number or a text, or a list of them, not {other}")),
    }
}

/// Reads one value.
pub(super) fn read_one<F: Form>(value: &Value) -> Result<F::Value, String> {
    F::read_json(value)
}

/// Reads a list: each element of an array is a value.
pub(super) fn read_list<F: Form>(value: &Value) -> Result<Vec<F::Value>, String> {
    match value {
        Value::Array(values) => values.iter().map(read_one::<F>).collect(),
        value => Ok(vec![read_one::<F>(value)?]),
    }
}

/// Reads true or false.
pub(super) fn read_flag(value: &Value) -> Result<bool, String> {
    value.as_bool().ok_or_else(|| format!("is true or false, not {value}"))
}

/// A documentation comment as one paragraph.
pub(super) fn paragraph(lines: &[&str]) -> String {
    lines.iter().map(|line| line.trim()).collect::<Vec<_>>().join(" ")
}

/// Checks one value that is given as text.
pub(super) fn check_text<F: Form>(text: &str) -> Result<(), String> {
    F::read(text).map(drop)
}

/// The schema of true or false.
pub(super) fn flag_schema() -> Value {
    serde_json::json!({ "type": "boolean" })
}

/// The schema of a list.
pub(super) fn list_schema<F: Form>() -> Value {
    serde_json::json!({ "anyOf": [{ "type": "array", "items": F::schema() }, F::schema()] })
}

/// Declares a group of options: a struct, its defaults, and how each option is read, written and described. Each option
/// says how often it may be given (`one` with a default, `maybe`, `flag`, `list`), its key, its field, and the form of
/// its value ([`super::form`]). Groups within a group share its keys.
macro_rules! spec_group {
    (
        $(#[$meta:meta])*
        pub struct $group:ident {
            $( $(#[doc = $doc:literal])+ $kind:ident $name:literal $field:ident $(: $form:ty)? $(= $default:expr)?
                $(, $value:literal)? ; )*
        }
        $( groups { $( $(#[$inner_meta:meta])+ $inner:ident : $inner_group:ty ),* $(,)? } )?
    ) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq)]
        #[non_exhaustive]
        pub struct $group {
            $( $(#[doc = $doc])+ pub $field: $crate::picture::spec::option::field!($kind $($form)?), )*
            $($( $(#[$inner_meta])+ pub $inner: $inner_group, )*)?
        }

        impl Default for $group {
            fn default() -> Self {
                Self {
                    $( $field: $crate::picture::spec::option::default!($kind $($default)?), )*
                    $($( $inner: Default::default(), )*)?
                }
            }
        }

        impl $crate::picture::spec::SpecGroup for $group {
            fn options() -> Vec<$crate::picture::spec::SpecOption> {
                #[allow(unused_mut, reason = "not all groups have groups")]
                let mut all = vec![ $( $crate::picture::spec::SpecOption {
                    name: $name,
                    help: $crate::picture::spec::option::paragraph(&[$($doc),+]),
                    value: $crate::picture::spec::option::value_name!($($value)?),
                    is_list: $crate::picture::spec::option::is_list!($kind),
                    default: $crate::picture::spec::option::default_text!($kind $(($form))? $(($default))?),
                    alone: $crate::picture::spec::option::alone!($($form)?),
                    choices: $crate::picture::spec::option::choices!($($form)?),
                    check: $crate::picture::spec::option::check!($kind $($form)?),
                    schema: $crate::picture::spec::option::schema!($kind $($form)?),
                }, )* ];
                $($( all.extend(<$inner_group as $crate::picture::spec::SpecGroup>::options()); )*)?
                all
            }

            fn set(&mut self, name: &str, value: &serde_json::Value) -> Option<Result<(), String>> {
                match name {
                    $( $name => {
                        let read = $crate::picture::spec::option::read!($kind value $(, $form)?);
                        Some(read.map(|read| self.$field = read))
                    } )*
                    _ => {
                        $($( if let Some(result) =
                            $crate::picture::spec::SpecGroup::set(&mut self.$inner, name, value)
                        {
                            return Some(result);
                        } )*)?
                        None
                    }
                }
            }

            fn entries(&self, all: bool) -> Vec<(&'static str, serde_json::Value)> {
                let usual = Self::default();
                let mut entries = Vec::new();
                $( if all || self.$field != usual.$field {
                    let json = $crate::picture::spec::option::json!($kind self.$field $(, $form)?);
                    entries.extend(json.map(|json| ($name, json)));
                } )*
                $($( entries.extend($crate::picture::spec::SpecGroup::entries(&self.$inner, all)); )*)?
                entries
            }
        }
    };
}

macro_rules! field {
    (one $form:ty) => { <$form as $crate::picture::spec::form::Form>::Value };
    (maybe $form:ty) => { Option<<$form as $crate::picture::spec::form::Form>::Value> };
    (list $form:ty) => { Vec<<$form as $crate::picture::spec::form::Form>::Value> };
    (flag) => { bool };
}

macro_rules! default {
    (one $default:expr) => {
        $default
    };
    (maybe) => {
        None
    };
    (list) => {
        Vec::new()
    };
    (flag) => {
        false
    };
}

macro_rules! value_name {
    () => {
        None
    };
    ($value:literal) => {
        Some($value)
    };
}

macro_rules! is_list {
    (list) => {
        true
    };
    ($kind:ident) => {
        false
    };
}

macro_rules! default_text {
    (one ($form:ty) ($default:expr)) => {
        Some(<$form as $crate::picture::spec::form::Form>::text(&$default))
    };
    ($kind:ident $(($form:ty))?) => {
        None
    };
}

macro_rules! alone {
    () => {
        Some("true")
    };
    ($form:ty) => {
        <$form as $crate::picture::spec::form::Form>::ALONE
    };
}

macro_rules! choices {
    () => {
        Vec::new()
    };
    ($form:ty) => {
        <$form as $crate::picture::spec::form::Form>::choices()
    };
}

macro_rules! check {
    (flag) => {
        |_| Ok(())
    };
    ($kind:ident $form:ty) => {
        $crate::picture::spec::option::check_text::<$form>
    };
}

macro_rules! schema {
    (flag) => {
        $crate::picture::spec::option::flag_schema
    };
    (list $form:ty) => {
        $crate::picture::spec::option::list_schema::<$form>
    };
    ($kind:ident $form:ty) => {
        <$form as $crate::picture::spec::form::Form>::schema
    };
}

macro_rules! read {
    (flag $value:ident) => {
        $crate::picture::spec::option::read_flag($value)
    };
    (list $value:ident, $form:ty) => {
        $crate::picture::spec::option::read_list::<$form>($value)
    };
    (maybe $value:ident, $form:ty) => {
        $crate::picture::spec::option::read_one::<$form>($value).map(Some)
    };
    (one $value:ident, $form:ty) => {
        $crate::picture::spec::option::read_one::<$form>($value)
    };
}

macro_rules! json {
    (flag $field:expr) => {
        Some(serde_json::Value::Bool($field))
    };
    (list $field:expr, $form:ty) => {
        Some(
            $field
                .iter()
                .map(<$form as $crate::picture::spec::form::Form>::json)
                .collect::<serde_json::Value>(),
        )
    };
    (maybe $field:expr, $form:ty) => {
        $field.as_ref().map(<$form as $crate::picture::spec::form::Form>::json)
    };
    (one $field:expr, $form:ty) => {
        Some(<$form as $crate::picture::spec::form::Form>::json(&$field))
    };
}

pub(super) use spec_group;
pub(in crate::picture::spec) use {
    alone, check, choices, default, default_text, field, is_list, json, read, schema, value_name,
};
