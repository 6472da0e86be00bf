//! Generated programs beside a second oracle that shares no code with this crate: naga-rust, which translates WGSL to
//! Rust when it is compiled.
//!
//! `tests/second_oracle` translates the programs and computes them. What it found is in `second_oracle.txt`, so that
//! these tests need none of it. The programs avoid what WGSL leaves to the implementation and naga-rust defines
//! otherwise; `docs/design/wgsl-arithmetic.md` lists it.

use super::generated::{Writer, executed, inputs, lowered, parsed, same};
use super::oracle::Word;
use crate::lanes::SimdLevel;
use crate::program::run::BLOCK;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::xxh3_64;

/// Programs of the corpus.
const PROGRAMS: u32 = 240;

/// Without results of the second oracle, one of so many programs is computed.
const SHARE: u32 = 3;

/// The points at which each is computed. The results in `second_oracle.txt` are of so many.
const POINTS: u32 = 128;

/// Results of a program.
const RESULTS: usize = 8;

/// A line for each program: the hash of its text, and that of its results.
const FOUND: &str = include_str!("second_oracle.txt");

/// A program of the corpus.
fn program(number: u32) -> String {
    Writer::program(1_000_000 + number, true)
}

/// The inputs at all points.
fn points() -> Vec<Vec<Word>> {
    (0..POINTS).map(|point| inputs(7_000_000 + point)).collect()
}

/// A folder that the environment names.
fn folder(name: &str) -> Option<PathBuf> {
    std::env::var_os(name).map(PathBuf::from)
}

/// Writes programs and points for the second oracle.
fn write(folder: &Path) {
    let mut words = String::new();
    for point in points() {
        let bits: Vec<String> = point.iter().map(|word| word.bits().to_string()).collect();
        let _ = writeln!(words, "{}", bits.join(" "));
    }
    std::fs::write(folder.join("points.txt"), words).expect("points are written");
    for number in 0..PROGRAMS {
        let file = folder.join(format!("{number}.wgsl"));
        std::fs::write(file, program(number)).expect("a program is written");
    }
}

/// The hash of results in which all NaN are the same.
fn hash(results: &[Vec<u32>]) -> u64 {
    let one_nan = |&word: &u32| if f32::from_bits(word).is_nan() { f32::NAN.to_bits() } else { word };
    let bytes: Vec<u8> = results.iter().flatten().map(one_nan).flat_map(u32::to_le_bytes).collect();
    xxh3_64(&bytes)
}

/// Compares results with the words that the second oracle wrote.
fn compare(folder: &Path, number: u32, results: &[Vec<u32>], text: &str) {
    let words = std::fs::read_to_string(folder.join(format!("{number}.txt"))).expect("results");
    let words: Vec<u32> = words.split_whitespace().map(|word| word.parse().expect("a word")).collect();
    assert_eq!(words.len(), RESULTS * results.len());
    for (point, (found, wanted)) in results.iter().zip(words.chunks(RESULTS)).enumerate() {
        for (&found, &wanted) in found.iter().zip(wanted) {
            assert!(
                same(found, wanted),
                "program {number}, point {point} {:?}: {} instead of {}\n{text}",
                points()[point],
                f32::from_bits(found),
                f32::from_bits(wanted)
            );
        }
    }
}

#[test]
fn programs_have_the_bits_of_a_second_oracle() {
    if let Some(folder) = folder("RAYSTREAM_CORPUS_TO") {
        return write(&folder);
    }
    let from = folder("RAYSTREAM_RESULTS_FROM");
    let (points, lines) = (points(), Vec::from_iter(FOUND.lines()));
    assert_eq!(lines.len(), PROGRAMS as usize);
    let (levels, mut varied) = (SimdLevel::available(), 0);
    let share = if from.is_some() { 1 } else { SHARE };
    for number in (0..PROGRAMS).filter(|number| number.is_multiple_of(share)) {
        let text = program(number);
        let code = lowered(&parsed(&text), &text);
        // The levels take turns; `generated` runs each program at all of them.
        let level = levels[(number / share) as usize % levels.len()];
        let results = executed(&code, level, BLOCK, &points);
        varied += usize::from(results[1..].iter().any(|of_point| *of_point != results[0]));
        if let Some(folder) = &from {
            compare(folder, number, &results, &text);
        }
        let line = format!("{:016x} {:016x}", xxh3_64(text.as_bytes()), hash(&results));
        assert_eq!(
            line, lines[number as usize],
            "program {number}, {level}: tests/second_oracle/run tells more\n{text}"
        );
    }
    assert!(varied as u32 * share > 200, "results depend on points");
}
