//! The integrators that plug into the scheduler.

mod frame;
mod path;
#[cfg(test)]
mod tests;
mod whitted;

pub use frame::{Frame, Settings, SettingsError, TILE};
pub use path::{Contribution, Path, PathState, ROULETTE_BOUNCES};
pub use whitted::{DirectLight, WHITTED_BOUNCES, Whitted, WhittedState};
