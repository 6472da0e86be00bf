//! Computes the translated programs at the points of the folder `CORPUS`. Writes a program's results beside it, and
//! prints a line for each program: the hash of its text, and that of its results.

use std::fs;
use std::path::Path;
use xxhash_rust::xxh3::xxh3_64;

type Program = fn([f32; 4], [u32; 3], [i32; 2]) -> [f32; 8];

include!(concat!(env!("OUT_DIR"), "/programs.rs"));

/// The words of a point: four numbers, three integers, two signed integers.
fn point(line: &str) -> ([f32; 4], [u32; 3], [i32; 2]) {
    let words: Vec<u32> = line.split(' ').map(|word| word.parse().expect("a word")).collect();
    let x = std::array::from_fn(|i| f32::from_bits(words[i]));
    (x, std::array::from_fn(|i| words[4 + i]), std::array::from_fn(|i| words[7 + i].cast_signed()))
}

fn main() {
    let corpus = Path::new(env!("CORPUS"));
    let points = fs::read_to_string(corpus.join("points.txt")).expect("points");
    for (number, program) in PROGRAMS.iter().enumerate() {
        let text = fs::read(corpus.join(format!("{number}.wgsl"))).expect("a program");
        let (mut bytes, mut words) = (Vec::new(), String::new());
        for (x, n, k) in points.lines().map(point) {
            for result in program(x, n, k) {
                let word = if result.is_nan() { f32::NAN.to_bits() } else { result.to_bits() };
                bytes.extend(word.to_le_bytes());
                words += &format!("{word} ");
            }
            words += "\n";
        }
        fs::write(corpus.join(format!("{number}.txt")), words).expect("results are written");
        println!("{:016x} {:016x}", xxh3_64(&text), xxh3_64(&bytes));
    }
}
