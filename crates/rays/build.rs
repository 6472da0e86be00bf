//! Tells the crate at which `opt-level` Cargo compiles it (`cfg(debug_assertions)` does not say), and which SIMD levels
//! it leaves out.

use std::env;

/// The SIMD levels, as `SimdLevel::name` writes them.
const LEVELS: [&str; 4] = ["avx512", "avx2", "neon", "scalar"];

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let level = env::var("OPT_LEVEL").expect("Cargo tells build scripts the level");
    println!("cargo::rustc-env=RAYSTREAM_OPT_LEVEL={level}");
    println!("cargo::rustc-check-cfg=cfg(unoptimised)");
    if level == "0" {
        println!("cargo::rustc-cfg=unoptimised");
    }
    leave_levels_out();
}

/// Leaves all SIMD levels out but the one that `RAYSTREAM_ONLY_SIMD` names: a build for this machine alone, for
/// development.
fn leave_levels_out() {
    println!("cargo::rerun-if-env-changed=RAYSTREAM_ONLY_SIMD");
    for level in LEVELS {
        println!("cargo::rustc-check-cfg=cfg(without_{level})");
    }
    let Ok(only) = env::var("RAYSTREAM_ONLY_SIMD") else { return };
    let arm = env::var("CARGO_CFG_TARGET_ARCH").is_ok_and(|architecture| architecture == "aarch64");
    let has = |level: &str| level == "scalar" || (level == "neon") == arm;
    if !LEVELS.contains(&only.as_str()) || !has(&only) {
        println!("cargo::error=RAYSTREAM_ONLY_SIMD names no SIMD level of this target: {only:?}");
    }
    for level in LEVELS.into_iter().filter(|&level| level != only) {
        println!("cargo::rustc-cfg=without_{level}");
    }
}
