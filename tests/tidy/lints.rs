//! An exemption from a lint says why.

use super::breach::Breach;
use super::rust::{Kind, Source};
use super::text::{closing, line_of, regex};
use super::tree::Tree;

fn breaches(tree: &Tree) -> Vec<Breach> {
    let attribute = regex(r"#!?\[");
    let exemption = regex(r"\b(allow|expect)\s*\(");
    let reason = regex(r"\breason\s*=");
    let mut breaches = Vec::new();
    for (path, text) in tree.with_extension("rs") {
        let code = Source::of(text).only(Kind::Code);
        for found in attribute.find_iter(&code) {
            let inside = &code[found.start()..closing(&code, found.end() - 1)];
            if exemption.is_match(inside) && !reason.is_match(inside) {
                let line = line_of(&code, found.start());
                breaches.push(Breach::new(path, line, "an exemption from a lint needs `reason = \"..\"`"));
            }
        }
    }
    breaches
}

#[test]
fn exemptions_from_lints_have_reasons() {
    super::breach::assert_none("exemptions from lints have reasons", breaches(Tree::repository()));
}

#[test]
fn an_exemption_without_a_reason_is_named() {
    let text = "//! #![allow(x)]\n#![allow(unsafe_code, reason = \"the invariants above\")]\n\
                #[allow(\n    dead_code\n)]\nfn f() { g.expect(\"x\") }\n#[cfg_attr(unix, expect(unused))]\nfn g() {}\n\
                #[derive(Debug)]\nstruct S;\n";
    let found = breaches(&Tree::of(&[("src/a.rs", text), ("README.md", "#[allow(x)]")]));
    super::breach::assert_named(&found, &[("src/a.rs:3", "needs `reason"), ("src/a.rs:7", "needs `reason")]);
}
