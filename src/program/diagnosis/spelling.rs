//! Names that are written almost like one that exists.

use super::habit::wgsl_type;
use crate::program::token::{Token, TokenKind, declarations, tokens};
use std::collections::BTreeSet;

/// The most letters in which a name may differ from one that is offered.
const MOST_LETTERS: usize = 2;

/// Functions of WGSL.
const FUNCTIONS: &str = "abs acos acosh all any asin asinh atan atan2 atanh bitcast ceil clamp cos cosh \
    countLeadingZeros countOneBits countTrailingZeros cross degrees determinant distance dot dot4I8Packed \
    dot4U8Packed exp exp2 extractBits faceForward firstLeadingBit firstTrailingBit floor fma fract frexp insertBits \
    inverseSqrt ldexp length log log2 max min mix modf normalize pack2x16float pack2x16snorm pack2x16unorm \
    pack4x8snorm pack4x8unorm pow quantizeToF16 radians reflect refract reverseBits round saturate select sign sin \
    sinh smoothstep sqrt step tan tanh transpose trunc unpack2x16float unpack2x16snorm unpack2x16unorm \
    unpack4x8snorm unpack4x8unorm";

/// Types of WGSL.
const TYPES: &str = "array bool f32 i32 mat2x2f mat2x3f mat2x4f mat3x2f mat3x3f mat3x4f mat4x2f mat4x3f mat4x4f u32 \
    vec2f vec2i vec2u vec3f vec3i vec3u vec4f vec4i vec4u";

/// Types of GLSL and HLSL.
const FOREIGN: &str = "float int uint double half";

/// A remedy for a name that is not defined.
pub(super) fn of_name(name: &str, own: &[Token<'_>], here: usize, prelude: &str) -> String {
    let of_prelude = tokens(prelude);
    let mut known: BTreeSet<&str> =
        [FUNCTIONS, TYPES, FOREIGN].into_iter().flat_map(str::split_whitespace).collect();
    for tokens in [own, &of_prelude] {
        known.extend(declarations(tokens).iter().filter_map(|one| Some(tokens[one.name?].text)));
    }
    // Names of the same function.
    let inside = declarations(own).into_iter().find(|one| one.tokens.contains(&here));
    for token in inside.map_or(0..0, |one| one.tokens) {
        let is_declared = token > 0 && ["let", "var", "const"].contains(&own[token - 1].text);
        let is_argument = own.get(token + 1).is_some_and(|next| next.text == ":");
        if own[token].kind == TokenKind::Name && (is_declared || is_argument) {
            known.insert(own[token].text);
        }
    }
    nearest(name, known).map_or_else(
        || "`raystream shaders prelude` prints what every shader can use".into(),
        |nearest| match FOREIGN.split_whitespace().any(|foreign| foreign == nearest) {
            true => wgsl_type(nearest).map_or(String::new(), |wgsl| format!("write `{wgsl}`")),
            false => format!("`{nearest}` is near"),
        },
    )
}

/// A remedy for a member that does not exist.
pub(super) fn of_member(name: &str, own: &[Token<'_>], prelude: &str) -> String {
    let of_prelude = tokens(prelude);
    let mut known = BTreeSet::new();
    for tokens in [own, &of_prelude] {
        for one in declarations(tokens).iter().filter(|one| one.keyword == "struct") {
            let is_member = |&token: &usize| tokens.get(token + 1).is_some_and(|next| next.text == ":");
            known.extend(one.tokens.clone().filter(is_member).map(|token| tokens[token].text));
        }
    }
    if name.len() > 1 && name.chars().all(|c| "xyzwrgba".contains(c)) {
        return "the vector has fewer components".into();
    }
    let british = name.replace("color", "colour").replace("gray", "grey");
    if known.contains(british.as_str()) && british != name {
        return format!("`{british}` is near");
    }
    nearest(name, known).map_or_else(
        || "`raystream shaders prelude` prints `Point`, `Finish` and the other structs".into(),
        |nearest| format!("`{nearest}` is near"),
    )
}

/// The name that differs in the fewest letters, at most two and fewer than half of them.
fn nearest<'n>(name: &str, known: BTreeSet<&'n str>) -> Option<&'n str> {
    let most = MOST_LETTERS.min(name.chars().count() / 2);
    let distances =
        known.into_iter().filter(|other| *other != name).map(|other| (difference(name, other), other));
    distances.filter(|&(distance, _)| distance <= most).min().map(|(_, other)| other)
}

/// The fewest letters to change, insert, remove or swap with a neighbour, not regarding case (Damerau 1964).
fn difference(a: &str, b: &str) -> usize {
    let letters = |text: &str| text.chars().flat_map(char::to_lowercase).collect::<Vec<_>>();
    let (a, b) = (letters(a), letters(b));
    if a.len().abs_diff(b.len()) > MOST_LETTERS || a.len() > 64 {
        return usize::MAX;
    }
    let mut rows = vec![(0..=b.len()).collect::<Vec<_>>()];
    for i in 1..=a.len() {
        let mut row = vec![i];
        for j in 1..=b.len() {
            let replaced = rows[i - 1][j - 1] + usize::from(a[i - 1] != b[j - 1]);
            let mut least = replaced.min(rows[i - 1][j] + 1).min(row[j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                least = least.min(rows[i - 2][j - 2] + 1);
            }
            row.push(least);
        }
        rows.push(row);
    }
    rows[a.len()][b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_names_are_offered() {
        let known = || BTreeSet::from(["noise", "smoothstep", "saturate", "mix", "max", "at"]);
        for (name, expected) in [
            ("nose", Some("noise")),
            ("niose", Some("noise")),
            ("smoothStep2", Some("smoothstep")),
            ("saturte", Some("saturate")),
            ("mx", Some("max")),
            ("b", None),
            ("palette", None),
        ] {
            assert_eq!(nearest(name, known()), expected, "{name}");
        }
    }
}
