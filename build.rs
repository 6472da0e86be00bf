//! Tells the engine if Cargo compiles it without optimisation: `cfg(debug_assertions)` does not say.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let level = std::env::var("OPT_LEVEL").expect("Cargo tells build scripts the level");
    println!("cargo::rustc-check-cfg=cfg(unoptimised)");
    if level == "0" {
        println!("cargo::rustc-cfg=unoptimised");
    }
}
