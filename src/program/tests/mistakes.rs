//! Mistakes, and what is said about them: `mistakes.txt` has the texts.
//!
//! `RAYSTREAM_BLESS=1` writes them anew, to be read before they are committed.

use crate::program::SurfaceShader;
use crate::program::integrator::IntegratorShader;
use std::fmt::Write;

const GOLDEN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/src/program/tests/mistakes.txt");

/// What is said about a file.
fn told(text: &str) -> String {
    let error = match IntegratorShader::is_integrator(text) {
        true => IntegratorShader::check("test.wgsl", text).map(|_| ()),
        false => SurfaceShader::check("test.wgsl", text).map(|_| ()),
    };
    error.map_or_else(|error| error.to_string(), |()| "no error".to_owned())
}

#[test]
fn mistakes_are_told_in_the_words_of_the_file() {
    let golden = std::fs::read_to_string(GOLDEN).expect("the texts");
    let mut blessed = String::new();
    let mut count = 0;
    for case in golden.split("=== ").skip(1) {
        let (name, rest) = case.split_once('\n').expect("a name");
        let (text, expected) = rest.split_once("\n---\n").expect("a file and what is said about it");
        let found = told(text);
        let _ = write!(blessed, "=== {name}\n{text}\n---\n{found}\n\n");
        count += 1;
        if std::env::var_os("RAYSTREAM_BLESS").is_some() {
            continue;
        }
        assert!(found != "no error", "{name}");
        assert!(found.contains("= help: "), "{name}: no remedy\n{found}");
        assert!(found.contains("test.wgsl"), "{name}: no place\n{found}");
        let has_number = found.split('[').skip(1).any(|rest| rest.starts_with(|c: char| c.is_ascii_digit()));
        assert!(!has_number || text.contains('['), "{name}: a number of a table\n{found}");
        assert_eq!(found.trim_end(), expected.trim_end(), "{name}");
    }
    assert!(count >= 58, "{count}");
    if std::env::var_os("RAYSTREAM_BLESS").is_some() {
        std::fs::write(GOLDEN, blessed.trim_end().to_owned() + "\n").expect("written");
    }
}

#[test]
fn errors_of_several_declarations_are_told_at_once() {
    let text = "fn a() -> f32 { return nose(1.0); }\n\
                fn b() -> f32 { return a() + vec2f(1.0); }\n\
                const c = d;\n\
                fn e(x: undefined) -> f32 { return c; }\n\
                fn pattern(at: Point) -> Finish { var f = matte(at); f.color = vec3f(e(1.0)); return f; }";
    let told = told(text);
    for place in ["test.wgsl:1:24", "test.wgsl:2:24", "test.wgsl:3:11", "test.wgsl:4:9", "test.wgsl:5:"] {
        assert!(told.contains(place), "{place} is missing:\n{told}");
    }
    assert_eq!(told.matches("-->").count(), 5, "{told}");
}
