//! Functions and whole shaders as people write them for WGSL elsewhere: each section of `corpus.wgsl` and
//! `published.wgsl` is a file, unchanged but for its entry point.

use super::patterns::finish_at;
use crate::program::PatternShader;

#[test]
fn functions_written_for_wgsl_elsewhere_compile_and_give_numbers() {
    compile_and_give_numbers(include_str!("corpus.wgsl"), 60);
}

#[test]
fn shaders_written_for_wgsl_elsewhere_compile_and_give_numbers() {
    compile_and_give_numbers(include_str!("published.wgsl"), 12);
}

/// Computes the expressions of at least some number of sections.
fn compile_and_give_numbers(text: &str, least: usize) {
    let sections: Vec<&str> = text.split("//> ").skip(1).collect();
    assert!(sections.len() >= least, "{}", sections.len());
    for section in sections {
        let (title, text) = section.split_once('\n').unwrap_or((section, ""));
        let (name, expression) = title.split_once(": ").expect("a name and an expression");
        let text = format!(
            "{text}\nfn pattern(at: Point) -> Finish {{ var f = matte(at); let x = at.position.x; \
             let y = at.position.y; let z = at.position.z; f.roughness = {expression}; return f; }}"
        );
        let load = |natives| {
            PatternShader::load_with("test.wgsl", &text, [], natives)
                .unwrap_or_else(|error| panic!("{name}: {error}"))
        };
        let (native, written) = (load(true), load(false));
        let mut found = Vec::new();
        for i in 0..20u8 {
            let at = f32::from(i) / 20.0 + 0.013;
            let position = [at, 1.0 - at * 0.7, fract(at * 3.7)];
            let [a, b] = [&native, &written].map(|shader| finish_at(shader, position).roughness.get());
            assert!(a.is_finite(), "{name} at {position:?}");
            assert_eq!(a.to_bits(), b.to_bits(), "{name} at {position:?}");
            found.push(a);
        }
        let is_constant = name == "Hammersley points";
        assert!(is_constant || found.iter().any(|&x| x != found[0]), "{name} is {} everywhere", found[0]);
    }
}

fn fract(x: f32) -> f32 {
    x - x.floor()
}
