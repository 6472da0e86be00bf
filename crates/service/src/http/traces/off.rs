//! What there is of traces in a build without them.

use crate::coordinator::ledger::{DueCall, Event, Job, Ledger, LedgerError};
use axum::http::HeaderMap;
use std::io;
use ureq::tls::TlsConfig;

/// No span that a job could be a part of.
pub fn parent(_: &HeaderMap) -> String {
    String::new()
}

/// No traces.
pub struct Traces;

impl Traces {
    /// None, whatever the environment says.
    ///
    /// # Errors
    /// None.
    pub fn of_environment(_: &TlsConfig) -> io::Result<Self> {
        Ok(Self)
    }

    /// Does nothing with a step of a job.
    ///
    /// # Errors
    /// None.
    pub fn step(&self, _: &Ledger, _: &Event, _: &Job) -> Result<(), LedgerError> {
        Ok(())
    }

    /// Does nothing with a call.
    pub fn called(&self, _: &Job, _: &DueCall, _: i64, _: bool) {}

    /// Ends nothing.
    pub fn end(&self) {}
}
