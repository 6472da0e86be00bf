//! The integrators that plug into the scheduler, and what makes a scene ready for them.

mod frame;
mod path;
mod stage;
#[cfg(test)]
mod tests;
mod tree;
mod units;
mod whitted;

pub use frame::{Frame, Settings, SettingsError, TILE};
pub use path::{Contribution, Path, PathState, ROULETTE_BOUNCES};
pub use stage::Stage;
pub use tree::{WORTH_SAVING, build as build_tree};
pub use units::{UnitChoice, Units, UnitsError};
pub use whitted::{DirectLight, WHITTED_BOUNCES, Whitted, WhittedState};
