//! Jobs over HTTP, live views, and workers on many machines: what was accepted is done in spite of any crash.
//!
//! ```text
//! contract <- bus <- coordinator <- http        scenes come in, pictures go out
//!     ^        ^----- worker                    units of a frame -> sums
//!     +-- backend (spec -> open job), live (a moving picture) below coordinator, worker and http
//! plan                                          predicts them with their own decisions
//! ```
//!
//! A job is a [`raystream::picture::RenderSpec`] of an uploaded scene, so it has the bytes of `raystream render`. The
//! ledger of the coordinator is the record, and it knows who has which unit. A bus only carries: what it loses is
//! asked again, what it carries twice is committed once. A worker is a stranger: what it says is checked where it
//! comes in. `docs/guide/service.md` is the user's page; `docs/design/farm.md` has the protocol, its invariants and
//! what each key can do.

pub mod backend;
pub mod bus;
pub mod contract;
pub mod coordinator;
pub mod http;
pub mod live;
pub mod plan;
pub mod worker;
