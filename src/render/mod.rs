//! The integrators that plug into the scheduler.

mod frame;
mod path;

pub use frame::{Frame, Settings, SettingsError, TILE};
pub use path::{Contribution, Path, PathState, ROULETTE_BOUNCES};

#[cfg(test)]
mod harness;
