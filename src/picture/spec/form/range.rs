//! Ranges of frames and samples.

use super::Form;
use serde_json::{Value, json};
use std::ops::Range;

/// `A..B`, not empty; `help` says how to write it.
fn range(text: &str, help: &str) -> Result<Range<u32>, String> {
    let (a, b) = text.split_once("..").ok_or(help)?;
    let number = |s: &str| s.trim().parse::<u32>().map_err(|e| format!("{s:?}: {e}"));
    let range = number(a)?..number(b)?;
    if range.is_empty() {
        return Err(format!("the range is empty; its end is not rendered: {help}"));
    }
    Ok(range)
}

/// Ranges with the same text.
macro_rules! ranges {
    ($( $(#[$meta:meta])+ $form:ident: $help:literal; )*) => {
        $(
            $(#[$meta])+
            #[derive(Debug)]
            pub struct $form;

            impl Form for $form {
                type Value = Range<u32>;

                fn read(text: &str) -> Result<Range<u32>, String> {
                    range(text, $help)
                }

                fn text(value: &Range<u32>) -> String {
                    format!("{}..{}", value.start, value.end)
                }

                fn schema() -> Value {
                    json!({ "type": "string", "pattern": r"^[0-9]+\.\.[0-9]+$" })
                }
            }
        )*
    };
}

ranges! {
    /// `A..B`, at least one frame.
    Frames: "write FIRST..END, as in 0..20 for frames 0 to 19";
    /// `A..B`, at least one sample.
    SampleRange: "write FIRST..END, as in 0..16 for samples 0 to 15";
}
