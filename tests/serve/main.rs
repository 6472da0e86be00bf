//! The service as its users meet it: real processes, real requests, real kills.

mod jobs;
mod kills;
mod refusals;
mod service;

use service::{Service, folder, shipped};
