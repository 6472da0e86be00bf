//! Damaged and random files: the loader refuses them or loads them, and never panics.

use crate::geom::mix;
use crate::program::SurfaceShader;

const CORPUS: [&str; 5] = [
    include_str!("../../../scenes/shaders/wood.wgsl"),
    include_str!("../../../scenes/shaders/brick.wgsl"),
    include_str!("../../../scenes/shaders/dust.wgsl"),
    include_str!("../../../scenes/shaders/velvet.wgsl"),
    "override a: i32; fn pattern(at: Point) -> Finish { var f = matte(at); var x = array<f32, 4>(); \
     switch a { case 1, 2: { x[a] = 1.0; } \
     default: { loop { if x[a] > 3.0 { break; } continuing { x[a] += 1.0; } } } } \
     f.roughness = x[a]; return f; }",
];

/// Words that turn up where they do not belong.
const WORDS: [&str; 24] = [
    "fn",
    "{",
    "}",
    "(",
    ")",
    ";",
    "vec3f",
    "1e38f",
    "-",
    "/ 0",
    "% 0",
    "let",
    "var",
    "loop",
    "return",
    "<",
    "array<f32,",
    "0u",
    "4294967295u",
    "-2147483648",
    "at.position",
    "ptr<function, f32>",
    "\u{feff}",
    "const x = x;",
];

/// A file of the corpus with some places changed.
fn damaged(seed: u32) -> String {
    let mut at = seed.wrapping_mul(64);
    let mut below = |n: usize| {
        at = at.wrapping_add(1);
        mix(at) as usize % n.max(1)
    };
    let mut text = CORPUS[below(CORPUS.len())].as_bytes().to_vec();
    for _ in 0..1 + below(6) {
        let (from, length) = (below(text.len()), below(40));
        let end = (from + length).min(text.len());
        match below(5) {
            0 => drop(text.drain(from..end)),
            1 => {
                let copy = text[from..end].to_vec();
                let to = below(text.len());
                text.splice(to..to, copy);
            }
            2 => text.get_mut(from).into_iter().for_each(|byte| *byte = below(256) as u8),
            3 => text.truncate(from),
            _ => drop(text.splice(from..from, WORDS[below(WORDS.len())].bytes())),
        }
    }
    String::from_utf8_lossy(&text).into_owned()
}

#[test]
fn damaged_files_are_refused_or_loaded() {
    let inputs = std::env::var("RAYSTREAM_SHADER_INPUTS").map_or(150, |n| n.parse().expect("a number"));
    let mut loaded = 0;
    for seed in 0..inputs {
        let text = damaged(seed);
        match SurfaceShader::check("damaged.wgsl", &text) {
            Ok(_) => loaded += 1,
            Err(error) => assert!(error.to_string().contains("damaged.wgsl"), "{error}"),
        }
    }
    assert!(loaded > 0 && loaded < inputs, "{loaded} of {inputs}: some are valid");
}
