//! Loading of integrators: signatures, refusals, splits.

use super::{IntegratorShader, Piece};

const MISS: &str = "fn miss(direction: vec3f, p: Payload) {}\n";

fn check(text: &str) -> Result<IntegratorShader, String> {
    IntegratorShader::check("test.wgsl", text).map_err(|error| error.to_string())
}

fn refusal(text: &str) -> String {
    check(text).expect_err("must be refused")
}

fn loops(text: &str) -> Vec<(usize, usize)> {
    let shader = check(text).unwrap_or_else(|error| panic!("{error}"));
    shader.loop_shaders().iter().map(|piece: &Piece| (piece.words(), piece.truths())).collect()
}

#[test]
fn missing_and_wrong_signatures_show_the_right_ones() {
    let told = refusal("fn hit(at: Hit, p: Payload) {}");
    assert!(
        told.contains("no function `miss`") && told.contains("fn miss(direction: vec3f, p: Payload)"),
        "{told}"
    );
    let told = refusal(&format!("{MISS}fn hit(at: Hit) {{}}"));
    assert!(told.contains("test.wgsl:2:") && told.contains("fn hit(at: Hit, p: Payload)"), "{told}");
    let told = refusal(&format!("{MISS}fn hit(at: Hit, p: Payload) -> vec3f {{ return vec3f(); }}"));
    assert!(told.contains("-> vec3f"), "{told}");
    let told = refusal(&format!("struct Entry {{ a: f32 }}\n{MISS}fn hit(at: Hit, p: Payload) {{}}"));
    assert!(told.contains("fn resume(e: Entry, came: vec3f, p: Payload)"), "{told}");
    let told =
        refusal(&format!("struct Payload {{ a: array<vec3f, 4> }}\n{MISS}fn hit(at: Hit, p: Payload) {{}}"));
    assert!(told.contains("48 bytes") && told.contains("at most 32"), "{told}");
}

#[test]
fn effects_in_loops_without_a_known_end_are_refused() {
    let hit = |body: &str| format!("{MISS}fn hit(at: Hit, p: Payload) {{ {body} }}");
    let told = refusal(&hit("for (var i = 0u; i < u32(at.t); i++) { splat(vec3f(1.0)); }"));
    assert!(told.contains("`splat` is called in a loop whose number of turns is not known"), "{told}");
    let told =
        refusal(&hit("var x = at.t; loop { trace(leave(at.normal), p); x -= 1.0; if (x < 0.0) { break; } }"));
    assert!(told.contains("`trace`") && told.contains("= help: give the loop a constant end"), "{told}");
    let told =
        refusal(&format!("{}fn hit(at: Hit, p: Payload) {{}}", MISS.replace("{}", "{ bsdf_ways(); }")));
    assert!(told.contains("`bsdf_ways` needs a surface"), "{told}");
}

#[test]
fn what_depends_on_an_answer_cannot_ask_the_surface() {
    let told = refusal(
        "fn miss(direction: vec3f, p: Payload) -> vec3f { return direction; }
         fn hit(at: Hit, p: Payload) -> vec3f {
             let came = trace(leave(at.normal), p);
             return bsdf_evaluate(came).value;
         }",
    );
    assert!(told.contains("`bsdf_evaluate` asks") && told.contains("test.wgsl:4:"), "{told}");
}

#[test]
fn only_what_lives_on_is_kept() {
    let miss = "fn miss(direction: vec3f, p: Payload) -> vec3f { return direction; }\n";
    let hit = |body: &str| format!("{miss}fn hit(at: Hit, p: Payload) -> vec3f {{ {body} }}");
    // Nothing is left to do: no loop shader.
    assert_eq!(loops(&hit("return trace(leave(at.normal), p);")), []);
    // One number.
    assert_eq!(loops(&hit("return at.t * trace(leave(at.normal), p);")), [(1, 0)]);
    // Two branches; behind the first nothing is left of the second.
    let two = "if (at.front) { return at.t * trace(leave(at.normal), p); }
               return at.width * trace(leave(at.normal), p);";
    assert_eq!(loops(&hit(two)), [(1, 0), (1, 0)]);
    // A ray that is traced afterwards, asked for before, and whether it is.
    let after = "if (at.t > 1.0) { trace(leave(at.wo), p); }
                 if (at.front) { trace(leave(at.normal), p); }
                 return vec3f(0.0);";
    let kept = loops(&hit(after));
    assert_eq!(kept.len(), 2, "{kept:?}");
    // The ray, the payload, and whether it is traced; then nothing but that 0 is returned.
    assert!(kept[0].0 <= 9 && kept[0].1 == 0 && kept[1] == (0, 0), "{kept:?}");
    // Turns of a loop.
    let turns = "var sum = vec3f(0.0);
                 for (var i = 0u; i < 4u; i++) { sum += trace(leave(at.normal), p); }
                 return sum;";
    let kept = loops(&hit(turns));
    assert_eq!(kept.len(), 4);
    assert!(kept.iter().all(|&(words, truths)| words <= 11 && truths == 0), "{kept:?}");
}

#[test]
fn hostile_files_end_in_errors() {
    let hit = |body: &str| format!("{MISS}fn hit(at: Hit, p: Payload) {{ {body} }}");
    let deep = hit(&format!("splat(vec3f({}1.0{}));", "(".repeat(99), ")".repeat(99)));
    assert!(refusal(&deep).contains("nested"));
    let many = hit("for (var i = 0u; i < 99u; i++) { trace(leave(at.normal), p); }");
    assert!(refusal(&many).contains("more than 32 times"));
    assert!(!refusal(&hit("hit(at, p);")).is_empty());
    let long = "x".repeat(10 << 20);
    assert!(refusal(&long).contains("bytes"));
    let again = format!(
        "struct Entry {{ a: f32 }}\n{MISS}fn hit(at: Hit, p: Payload) {{ push(Entry(1.0)); }}
         fn resume(e: Entry, came: vec3f, p: Payload) {{ push(e); }}"
    );
    assert!(refusal(&again).contains("max_turns"));
    assert_eq!(check(&format!("const max_turns: u32 = 3;\n{again}")).map(|shader| shader.turns()), Ok(3));
}

/// Counters of loops are known under conditions, and behind points that have returned.
#[test]
fn bounded_loops_may_trace_under_conditions() {
    let miss = "fn miss(direction: vec3f, p: Payload) -> vec3f { return direction; }\n";
    let turns = "for (var i = 0u; i < 3u; i++) { sum += trace(leave(at.normal), p) * f32(i + 1u); }";
    for body in [
        format!("if depth() < 2u {{ {turns} }}"),
        format!("if at.t > 1.0 {{ if depth() < 2u {{ var k = 0u; {turns} }} else {{ sum = vec3f(1.0); }} }}"),
        format!("if depth() >= 2u {{ return at.emitted; }} {turns}"),
        format!("switch depth() {{ case 0u: {{ {turns} }} default: {{ }} }}"),
    ] {
        let text = format!(
            "{miss}fn hit(at: Hit, p: Payload) -> vec3f {{ var sum = vec3f(0.0); {body} return sum; }}"
        );
        let shader = IntegratorShader::load("test.wgsl", &text, []).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(shader.loop_shaders().len(), 3, "{body}");
    }
    let told = refusal(&format!(
        "{miss}fn hit(at: Hit, p: Payload) -> vec3f {{ var sum = vec3f(0.0); var i = 0.0; \
         while i < at.t {{ sum += trace(leave(at.normal), p); i += 1.0; }} return sum; }}"
    ));
    assert!(told.contains("number of turns is not known"), "{told}");
}

#[test]
fn options_for_the_other_kind_of_file_are_told() {
    let pattern = "fn pattern(at: Point) -> Finish { return matte(at); }";
    let told = refusal(pattern);
    assert!(told.contains("--surface MATERIAL=FILE.wgsl"), "{told}");
    let integrator = "fn hit(at: Hit, p: Payload) {}\nfn miss(direction: vec3f, p: Payload) {}";
    let error = crate::program::SurfaceShader::load("test.wgsl", integrator, []).expect_err("an integrator");
    assert!(error.to_string().contains("--integrator FILE.wgsl"), "{error}");
}

#[test]
fn light_that_recursion_does_not_weight_is_told() {
    let miss = "fn miss(direction: vec3f, p: Payload) -> vec3f { return direction; }\n";
    let hit = |body: &str| {
        format!(
            "struct Payload {{ weight: f32 }}\n{miss}fn hit(at: Hit, p: Payload) -> vec3f {{ {body} \
             return 0.5 * trace(leave(at.normal), Payload(0.5 * p.weight)); }}"
        )
    };
    let warnings = |body: &str| {
        let shader = check(&hit(body)).unwrap_or_else(|error| panic!("{error}"));
        shader.warnings().iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    let told = warnings("shadow(leave(at.wo), at.colour); shadow(leave(at.wo), at.emitted);");
    assert_eq!(told.len(), 1, "{told:?}");
    assert!(told[0].starts_with("`shadow` adds to the pixel without the weights"), "{told:?}");
    assert!(told[0].contains("test.wgsl:3:") && told[0].contains("`visible(ray)`"), "{told:?}");
    assert_eq!(warnings("splat(at.emitted);").len(), 1);
    for fine in [
        "splat(p.weight * at.emitted);",
        "if depth() == 0u { splat(at.emitted); }",
        "let w = p.weight; if (at.front) { shadow(leave(at.wo), at.colour * w); }",
    ] {
        assert_eq!(warnings(fine), Vec::<String>::new(), "{fine}");
    }
    let plain =
        format!("{miss}fn hit(at: Hit, p: Payload) -> vec3f {{ splat(at.colour); return at.emitted; }}");
    assert!(check(&plain).expect("valid").warnings().is_empty(), "nothing is weighted without `trace`");
}
