//! The live view: a picture that follows a camera at once and becomes better while the camera rests.
//!
//! [`LiveView`] knows no network. A thread renders: while the camera moves, small frames of one path a pixel, whose
//! size [`Resolution`] chooses; 150 ms after the last change the full picture, pass after pass. A second thread encodes
//! beside it. `http::live` joins a view to a WebSocket.
//!
//! ```text
//! requests -> inbox -> render thread -- pictures of passes --> encoder -- newest frame -> outbox -> socket
//!                          |  ^ ends of jobs                                              ^
//!                          v  |                                 replies, statistics ------+
//!                       schedule::Service
//! ```

pub mod decisions;
mod encoder;
mod inbox;
mod live_spec;
mod message;
mod outbox;
mod pick;
mod renderer;
mod reply;
mod request;
mod resolution;
mod saved;
mod session;
mod shared_frame;
pub mod speed;
mod statistics;
mod strips;
#[cfg(test)]
mod tests;
mod tile;
mod tile_dispatch;
#[cfg(test)]
mod tile_dispatch_tests;
#[cfg(test)]
mod time_tests;
mod view;

pub use message::{Frame, FrameFlags, HEADER_BYTES, MAGIC};
pub use pick::{MaterialFacts, Picked};
pub use reply::Reply;
pub use request::{PictureFile, Request};
pub use resolution::Resolution;
pub use session::{CountedView, LiveLimits, LiveViews, TooManyViews};
pub use statistics::{Lists, RaysPerSecond, State, Statistics, Timeline, WorkerShare};
pub use strips::STRIP_ROWS;
pub use tile::TileScene;
pub(crate) use tile_dispatch::TileWorkers;
pub use view::{LiveView, ViewScene};
