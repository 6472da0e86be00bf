//! Translates each program of the folder `CORPUS` to a module of Rust.

use std::fmt::Write;
use std::path::PathBuf;
use std::{env, fs};

/// How a program is called.
const CALL: &str = "
pub fn call(x: [f32; 4], n: [u32; 3], k: [i32; 2]) -> [f32; 8] {
    let r = Globals::new().test(x[0], x[1], x[2], x[3], n[0], n[1], n[2], k[0], k[1]);
    [r.a, r.b, r.c, r.d, r.e, r.f, r.g, r.h]
}";

fn translated(text: &str) -> Result<String, Box<dyn std::error::Error>> {
    let module = naga::front::wgsl::parse_str(text)?;
    let flags = naga::valid::ValidationFlags::all();
    let info = naga::valid::Validator::new(flags, naga::valid::Capabilities::empty()).validate(&module)?;
    let config = naga_rust_back::Config::new().global_struct("Globals").public_items(true);
    Ok(naga_rust_back::write_string(&module, &info, config)?)
}

fn main() {
    println!("cargo::rerun-if-env-changed=CORPUS");
    let corpus = PathBuf::from(env::var("CORPUS").expect("CORPUS names a folder"));
    println!("cargo::rerun-if-changed={}", corpus.display());
    let (mut code, mut table, mut number) = (String::new(), String::new(), 0);
    while let Ok(text) = fs::read_to_string(corpus.join(format!("{number}.wgsl"))) {
        let rust = translated(&text).unwrap_or_else(|error| panic!("program {number}: {error}"));
        let _ = writeln!(code, "#[allow(warnings)]\nmod p{number} {{\n{rust}\n{CALL}\n}}");
        let _ = writeln!(table, "    p{number}::call,");
        number += 1;
    }
    assert!(number > 0, "no program in {}", corpus.display());
    let _ = writeln!(code, "/// The programs by their numbers.\npub const PROGRAMS: &[Program] = &[\n{table}];");
    let out = PathBuf::from(env::var("OUT_DIR").expect("set by Cargo"));
    fs::write(out.join("programs.rs"), code).expect("the programs are written");
}
