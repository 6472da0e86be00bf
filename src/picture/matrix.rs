//! Matrices on the command line: as numbers, or in a file.

use anyhow::{Context, Result, bail, ensure};
use glam::DMat4;
use std::path::Path;

/// A matrix of 3 or 4 rows of 4 numbers, row after row: the numbers themselves with commas between them, or the name of
/// a `.json`, `.npy` or `.txt` file. A fourth row that is left out is 0 0 0 1.
pub fn world_to_camera(text: &str) -> Result<DMat4> {
    let name = named(text);
    let path = Path::new(text);
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    let read = || std::fs::read(path).with_context(|| format!("{name}: cannot be read"));
    let numbers = match extension.as_str() {
        "json" => {
            let value = serde_json::from_slice(&read()?).with_context(|| format!("{name}: not JSON"))?;
            let mut numbers = Vec::new();
            ensure!(
                flatten(&value, &mut numbers),
                "{name}: must be an array of numbers, or of rows of numbers"
            );
            numbers
        }
        "npy" => npy(&read()?).with_context(|| name.to_owned())?,
        "txt" => {
            let text = String::from_utf8(read()?).with_context(|| format!("{name}: not a text"))?;
            split(&text).with_context(|| name.to_owned())?
        }
        _ => split(text).with_context(|| {
            format!("--world-to-camera {name}: neither numbers nor a .json, .npy or .txt file")
        })?,
    };
    from_rows(&numbers).with_context(|| format!("--world-to-camera {name}"))
}

/// A matrix from 12 or 16 numbers, row after row.
pub fn from_rows(numbers: &[f64]) -> Result<DMat4> {
    ensure!(
        matches!(numbers.len(), 12 | 16),
        "{} numbers; a matrix has 12 (three rows) or 16",
        numbers.len()
    );
    ensure!(numbers.iter().all(|n| n.is_finite()), "all numbers must be finite");
    let mut rows = [0.0; 16];
    rows[15] = 1.0;
    rows[..numbers.len()].copy_from_slice(numbers);
    Ok(DMat4::from_cols_array(&rows).transpose())
}

/// The argument as messages show it.
pub fn named(text: &str) -> &str {
    match text.char_indices().nth(60) {
        Some((end, _)) => &text[..end],
        None => text,
    }
}

fn split(text: &str) -> Result<Vec<f64>> {
    let parts = text.split([',', ';', ' ', '\t', '\n', '\r']).filter(|part| !part.is_empty());
    parts.map(|part| part.parse().with_context(|| format!("{part:?} is not a number"))).collect()
}

/// Appends the numbers of nested arrays. Returns whether there is nothing else.
fn flatten(value: &serde_json::Value, numbers: &mut Vec<f64>) -> bool {
    match value {
        serde_json::Value::Array(values) => values.iter().all(|value| flatten(value, numbers)),
        value => value.as_f64().map(|number| numbers.push(number)).is_some(),
    }
}

fn npy(bytes: &[u8]) -> Result<Vec<f64>> {
    let open = || npyz::NpyFile::new(bytes).context("not a .npy file");
    let (file, order) = (open()?, open()?.order());
    ensure!(order == npyz::Order::C, "the array is in Fortran order; save it in C order");
    ensure!(file.len() <= 16, "{} numbers; a matrix has 12 (three rows) or 16", file.len());
    if let Ok(numbers) = file.data::<f64>() {
        return Ok(numbers.collect::<Result<_, _>>()?);
    }
    match open()?.data::<f32>() {
        Ok(numbers) => Ok(numbers.map(|number| number.map(f64::from)).collect::<Result<_, _>>()?),
        Err(_) => bail!("the array must be float64 or float32"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use npyz::WriterBuilder;

    #[test]
    fn matrices_come_from_numbers_and_files() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).expect("written");
            path.to_str().expect("a name").to_owned()
        };
        let expected = DMat4::from_cols_array(&[
            1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 2.0, 3.0, 4.0, 1.0,
        ]);
        let nested = file("m.json", b"[[1,0,0,2],[0,1,0,3],[0,0,1,4],[0,0,0,1]]");
        let text = file("m.txt", b"1 0 0 2\n0 1 0 3\n0 0 1 4\n");
        let mut array = Vec::new();
        let options = npyz::WriteOptions::<f32>::new().default_dtype().shape(&[3, 4]);
        let mut writer = options.writer(&mut array).begin_nd().expect("begun");
        writer.extend([1.0_f32, 0.0, 0.0, 2.0, 0.0, 1.0, 0.0, 3.0, 0.0, 0.0, 1.0, 4.0]).expect("written");
        writer.finish().expect("finished");
        let array = file("m.npy", &array);
        for text in ["1,0,0,2, 0,1,0,3, 0,0,1,4", &nested, &text, &array] {
            assert_eq!(world_to_camera(text).expect(text), expected);
        }
    }

    #[test]
    fn what_is_no_matrix_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let object = folder.path().join("m.json");
        std::fs::write(&object, "{}").expect("written");
        let object = object.to_str().expect("a name");
        for bad in ["1,2,3", "", "one", "none.json", object, "1,0,0,nan,0,1,0,0,0,0,1,0"] {
            assert!(world_to_camera(bad).is_err(), "{bad}");
        }
    }
}
