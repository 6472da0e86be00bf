//! The version of this build: its commit, features and instruction sets.

use raystream::trace::cpu::SimdLevel;

/// Features of this build, with names as Cargo has them.
const FEATURES: [(&str, bool); 3] = [
    ("gpu", cfg!(feature = "gpu")),
    ("nvml", cfg!(feature = "nvml")),
    ("service", cfg!(feature = "service")),
];

/// The version for `--version`, in lines.
pub fn long() -> String {
    let version = env!("CARGO_PKG_VERSION");
    let commit = match env!("RAYSTREAM_COMMIT") {
        "" => "unknown",
        commit => commit,
    };
    let features: Vec<&str> =
        FEATURES.iter().filter(|(_, is_built)| *is_built).map(|(name, _)| *name).collect();
    let levels: Vec<&str> = SimdLevel::available().into_iter().map(SimdLevel::name).collect();
    format!(
        "{version}\ncommit:           {commit}\nfeatures:         {}\ninstruction sets: {} (here, best first)",
        if features.is_empty() { "none".to_owned() } else { features.join(", ") },
        levels.join(", ")
    )
}
