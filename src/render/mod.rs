//! The integrators that plug into the scheduler, and what makes a scene ready for them.

mod frame;
mod integrator;
mod pass;
mod path;
mod sequence;
mod stage;
#[cfg(test)]
mod tests;
mod units;
mod whitted;

pub use frame::{Frame, Settings, SettingsError};
pub use integrator::Integrator;
pub use pass::{BLOCK, Blocks, Pass};
pub use path::{Contribution, Path, PathState, ROULETTE_BOUNCES};
pub use sequence::Sequence;
pub use stage::Stage;
pub use units::{UnitChoice, Units, UnitsError};
pub use whitted::{DirectLight, WHITTED_BOUNCES, Whitted, WhittedState};
