//! Texts of the shaders that the repository ships, for benches and tests.

/// Wood with rings.
pub const WOOD: &str = include_str!("../../scenes/shaders/wood.wgsl");
/// A BSDF of dust.
pub const DUST: &str = include_str!("../../scenes/shaders/dust.wgsl");
/// A Whitted integrator that recurses.
pub const WHITTED: &str = include_str!("../../scenes/shaders/whitted.wgsl");
/// The same with split rays.
pub const WHITTED_SPLIT: &str = include_str!("../../scenes/shaders/whitted_split.wgsl");
