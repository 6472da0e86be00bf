//! Tells the crate at which `opt-level` Cargo compiles it: `cfg(debug_assertions)` does not say.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let level = std::env::var("OPT_LEVEL").expect("Cargo tells build scripts the level");
    println!("cargo::rustc-env=RAYSTREAM_OPT_LEVEL={level}");
    println!("cargo::rustc-check-cfg=cfg(unoptimised)");
    if level == "0" {
        println!("cargo::rustc-cfg=unoptimised");
    }
}
