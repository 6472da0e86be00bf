//! Habits of GLSL and HLSL, and the WGSL in their place.

use crate::program::token::{Token, TokenKind};

/// Text in another language.
pub(super) struct Habit {
    /// The token to show.
    pub token: usize,
    pub message: String,
    pub remedy: String,
}

/// The type of WGSL for a type of GLSL or HLSL.
pub(super) fn wgsl_type(foreign: &str) -> Option<String> {
    let scalar = |name: &str| match name {
        "float" | "double" | "half" => Some("f32"),
        "int" => Some("i32"),
        "uint" => Some("u32"),
        _ => None,
    };
    if let Some(name) = scalar(foreign) {
        return Some(name.into());
    }
    let last = foreign.chars().last().filter(|c| ('2'..='4').contains(c))?;
    let stem = &foreign[..foreign.len() - 1];
    match stem {
        "vec" | "float" | "half" | "dvec" => Some(format!("vec{last}f")),
        "ivec" | "int" => Some(format!("vec{last}i")),
        "uvec" | "uint" => Some(format!("vec{last}u")),
        "bvec" | "bool" => Some(format!("vec{last}<bool>")),
        "mat" => Some(format!("mat{last}x{last}f")),
        _ => None,
    }
}

/// What to write in place of textures.
const PICTURE: &str = "write `image(picture, uv)`; a picture is `var picture: texture_2d<f32>;`";

/// Functions and words of other languages, and what to write.
const WORDS: [(&str, &str); 39] = [
    ("mod", "write `x - y * floor(x / y)`; `x % y` takes the sign of x"),
    ("fmod", "write `x % y`"),
    ("lerp", "write `mix(a, b, t)`"),
    ("frac", "write `fract(x)`"),
    ("rsqrt", "write `inverseSqrt(x)`"),
    ("inversesqrt", "write `inverseSqrt(x)`"),
    ("mul", "write `a * b`"),
    ("mad", "write `fma(a, b, c)`"),
    ("faceforward", "write `faceForward(n, i, r)`"),
    ("ddx", "use `at.width` and `at.footprint`, the sizes of a pixel"),
    ("ddy", "use `at.width` and `at.footprint`, the sizes of a pixel"),
    ("dFdx", "use `at.width` and `at.footprint`, the sizes of a pixel"),
    ("dFdy", "use `at.width` and `at.footprint`, the sizes of a pixel"),
    ("texture", PICTURE),
    ("texture2D", PICTURE),
    ("tex2D", PICTURE),
    ("sampler2D", PICTURE),
    ("floatBitsToUint", "write `bitcast<u32>(x)`"),
    ("floatBitsToInt", "write `bitcast<i32>(x)`"),
    ("uintBitsToFloat", "write `bitcast<f32>(x)`"),
    ("intBitsToFloat", "write `bitcast<f32>(x)`"),
    ("asuint", "write `bitcast<u32>(x)`"),
    ("asint", "write `bitcast<i32>(x)`"),
    ("asfloat", "write `bitcast<f32>(x)`"),
    ("lessThan", "write `a < b`, which compares vectors component by component"),
    ("greaterThan", "write `a > b`, which compares vectors component by component"),
    ("lessThanEqual", "write `a <= b`, which compares vectors component by component"),
    ("greaterThanEqual", "write `a >= b`, which compares vectors component by component"),
    ("equal", "write `a == b`, which compares vectors component by component"),
    ("notEqual", "write `a != b`, which compares vectors component by component"),
    ("not", "write `!a`"),
    ("roundEven", "write `round(x)`, which rounds ties to even"),
    ("bitCount", "write `countOneBits(x)`"),
    ("findLSB", "write `firstTrailingBit(x)`"),
    ("findMSB", "write `firstLeadingBit(x)`"),
    ("bitfieldReverse", "write `reverseBits(x)`"),
    ("log10", "write `log2(x) * 0.30103`"),
    ("sincos", "call `sin` and `cos`"),
    ("PI", "write `TAU * 0.5`, or define `const PI = 3.14159265;`"),
];

/// Words with which declarations of other languages begin.
const QUALIFIERS: [(&str, &str); 12] = [
    ("void", "a function without a result is `fn name(a: f32) { .. }`"),
    ("uniform", "a parameter is `override name: f32 = 1.0;`"),
    ("in", "what a function is given are its arguments"),
    ("out", "results are returned; several are the members of a `struct`"),
    ("inout", "pass `p: ptr<function, f32>`, and `&x` in the call"),
    ("varying", "what a function is given are its arguments"),
    ("attribute", "what a function is given are its arguments"),
    ("precision", "numbers have 32 bits; leave the line out"),
    ("highp", "numbers have 32 bits; leave the word out"),
    ("static", "a constant is `const NAME = VALUE;`"),
    ("layout", "shaders have no bindings; leave the line out"),
    ("cbuffer", "a parameter is `override name: f32 = 1.0;`"),
];

/// The habit at a token that the parser refused; `None` if there is none.
pub(super) fn at(tokens: &[Token<'_>], here: usize) -> Option<Habit> {
    let text = |token: usize| tokens.get(token).map_or("", |token| token.text);
    let before = |count: usize| here.checked_sub(count).map_or("", text);
    let told = |token: usize, message: &str, remedy: &str| {
        Some(Habit { token, message: message.to_owned(), remedy: remedy.to_owned() })
    };
    if text(here) == "#" || before(1) == "#" {
        let token = if text(here) == "#" { here } else { here - 1 };
        return told(
            token,
            "WGSL has no preprocessor",
            "write `const NAME = VALUE;` or a function for `#define`",
        );
    }
    if text(here) == "?" {
        return told(here, "WGSL has no `? :`", "`a ? b : c` is `select(c, b, a)`");
    }
    if ["+", "-"].contains(&text(here)) && text(here + 1) == text(here) {
        let (sign, remedy) = (text(here), format!("write `x {}= 1;` as a statement of its own", text(here)));
        return told(here, &format!("`{sign}{sign}` is no part of an expression"), &remedy);
    }
    for token in [here.checked_sub(1), Some(here)].into_iter().flatten() {
        if let Some(habit) = declared(tokens, token) {
            return Some(habit);
        }
    }
    let word = text(here);
    if let Some((_, remedy)) = QUALIFIERS.iter().find(|(qualifier, _)| *qualifier == word) {
        return told(here, &format!("`{word}` is no word of WGSL"), remedy);
    }
    if let Some(wgsl) = wgsl_type(word)
        && wgsl != word
        && !(word.starts_with("vec") || word == "bool")
    {
        let message = format!("`{word}` is no type of WGSL");
        return told(here, &message, &format!("write `{wgsl}`"));
    }
    let is_call = text(here + 1) == "(" || word == "PI" || word == "sampler2D";
    let (_, remedy) = WORDS.iter().find(|(foreign, _)| *foreign == word && is_call)?;
    told(here, &format!("`{word}` is not defined"), remedy)
}

/// A declaration that begins with its type: `float x = ..`, `vec3 f(..)`, or an argument `float x`.
fn declared(tokens: &[Token<'_>], first: usize) -> Option<Habit> {
    let text = |token: usize| tokens.get(token).map_or("", |token| token.text);
    let ty = text(first);
    let is_wgsl = ["f32", "i32", "u32", "bool"].contains(&ty) || (ty.starts_with("vec") && ty.len() == 5);
    let wgsl = if is_wgsl { ty.to_owned() } else { wgsl_type(ty)? };
    let name = tokens.get(first + 1).filter(|token| token.kind == TokenKind::Name)?.text;
    let told = |message: String, remedy: String| Some(Habit { token: first, message, remedy });
    let before = first.checked_sub(1).map_or("", text);
    let is_argument = ["(", ","].contains(&before) && [",", ")"].contains(&text(first + 2));
    let message = format!("the type stands behind the name in WGSL: `{ty} {name}`");
    match text(first + 2) {
        "(" => told(message, format!("write `fn {name}(..) -> {wgsl}`, and arguments as `name: type`")),
        _ if is_argument || ["in", "out", "inout"].contains(&before) => {
            told(message, format!("write `{name}: {wgsl}`"))
        }
        ";" if before == "{" || before == ";" => {
            told(message, format!("write `var {name}: {wgsl};`, in a struct `{name}: {wgsl},`"))
        }
        _ => told(message, format!("write `let {name}: {wgsl} = ..`, or `var {name} = ..` if it changes")),
    }
}
