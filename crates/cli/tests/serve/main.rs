//! The service as its users meet it: real processes, real requests, real kills.

mod attacks;
mod audit;
mod backups;
mod drake;
mod jobs;
mod kills;
mod loaded;
mod quotas;
mod refusals;
mod retention;
#[cfg(feature = "s3")]
mod s3;
mod service;
#[cfg(feature = "s3")]
mod stalled;
mod tenants;
mod tls;
mod tokens;
#[cfg(feature = "otel")]
mod traces;
#[path = "../cli/viewer.rs"]
mod viewer;
mod webhooks;

use service::{Service, folder, shipped};
