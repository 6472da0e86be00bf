//! Texts, paths, and what its type writes itself.

use super::Form;
use serde_json::{Value, json};
use std::fmt::Display;
use std::marker::PhantomData;
use std::path::PathBuf;
use std::str::FromStr;

/// A text of any kind.
#[derive(Debug)]
pub struct Text;

impl Form for Text {
    type Value = String;

    fn read(text: &str) -> Result<String, String> {
        Ok(text.to_owned())
    }

    fn text(value: &String) -> String {
        value.clone()
    }

    fn schema() -> Value {
        json!({ "type": ["string", "number", "array"] })
    }
}

/// The path of a file.
#[derive(Debug)]
pub struct File;

impl Form for File {
    type Value = PathBuf;

    fn read(text: &str) -> Result<PathBuf, String> {
        Ok(text.into())
    }

    fn text(value: &PathBuf) -> String {
        value.to_string_lossy().into_owned()
    }
}

/// Values whose type reads and writes them.
#[derive(Debug)]
pub struct Own<T>(PhantomData<T>);

impl<T: FromStr<Err: Display> + Display + Clone + PartialEq + std::fmt::Debug> Form for Own<T> {
    type Value = T;

    fn read(text: &str) -> Result<T, String> {
        text.parse().map_err(|error: T::Err| error.to_string())
    }

    fn text(value: &T) -> String {
        value.to_string()
    }

    fn schema() -> Value {
        json!({ "type": ["string", "array"], "items": { "type": ["string", "number"] } })
    }
}
