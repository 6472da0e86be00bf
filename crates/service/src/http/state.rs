//! What all requests share.

use super::auth::Auth;
use super::connections::Connections;
use super::reach::Reach;
use super::traces::Traces;
use crate::backend::RenderBackend;
use crate::contract::{Limits, Problem};
use crate::coordinator::ledger::Ledger;
use crate::coordinator::store::Store;
use crate::coordinator::{AuditLog, KeptScene, Runner};
use axum::http::StatusCode;
use metrics_exporter_prometheus::PrometheusHandle;
use std::sync::Arc;
use tokio::sync::{Semaphore, watch};

/// The service's state; clones share it.
#[derive(Clone)]
pub struct State(Arc<Inner>);

/// What the state is made of.
pub(super) struct Inner {
    pub auth: Auth,
    pub limits: Limits,
    pub backend: Arc<RenderBackend>,
    pub ledger: Arc<Ledger>,
    pub store: Arc<Store>,
    pub runner: Arc<Runner>,
    pub reach: Reach,
    pub host_names: Vec<String>,
    pub own_scene: Option<KeptScene>,
    pub is_secure: bool,
    pub is_open_to_drake: bool,
    pub connections: Arc<Connections>,
    pub metrics: PrometheusHandle,
    pub audit: AuditLog,
    pub traces: Traces,
    pub uploads: Semaphore,
    /// True once the service is to end.
    pub ending: watch::Receiver<bool>,
}

impl std::fmt::Debug for State {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("State").field("limits", &self.0.limits).finish_non_exhaustive()
    }
}

impl State {
    pub(super) fn new(inner: Inner) -> Self {
        Self(Arc::new(inner))
    }

    /// The check of tokens and cookies.
    pub fn auth(&self) -> &Auth {
        &self.0.auth
    }

    /// The bounds of requests.
    pub fn limits(&self) -> &Limits {
        &self.0.limits
    }

    /// The backend, which checks and renders.
    pub fn backend(&self) -> &Arc<RenderBackend> {
        &self.0.backend
    }

    /// Scenes by hash.
    pub fn store(&self) -> &Arc<Store> {
        &self.0.store
    }

    /// The record of jobs.
    pub(super) fn ledger(&self) -> &Arc<Ledger> {
        &self.0.ledger
    }

    pub(super) fn runner(&self) -> &Arc<Runner> {
        &self.0.runner
    }

    /// Addresses that webhooks may call.
    pub(super) fn reach(&self) -> &Reach {
        &self.0.reach
    }

    pub(super) fn host_names(&self) -> &[String] {
        &self.0.host_names
    }

    /// The scene that the live view shows unless another one is asked for.
    pub(super) fn own_scene(&self) -> Option<&KeptScene> {
        self.0.own_scene.as_ref()
    }

    pub(super) fn is_secure(&self) -> bool {
        self.0.is_secure
    }

    /// True if programs of this machine may use Drake's route without a token.
    pub(super) fn is_open_to_drake(&self) -> bool {
        self.0.is_open_to_drake
    }

    /// The connections that are open.
    pub(super) fn connections(&self) -> &Arc<Connections> {
        &self.0.connections
    }

    pub(super) fn metrics(&self) -> &PrometheusHandle {
        &self.0.metrics
    }

    /// The record of who did what.
    pub(super) fn audit(&self) -> &AuditLog {
        &self.0.audit
    }

    /// Spans of jobs.
    pub(super) fn traces(&self) -> &Traces {
        &self.0.traces
    }

    pub(super) fn uploads(&self) -> &Semaphore {
        &self.0.uploads
    }

    /// Becomes true when the service is to end; open connections then end too.
    pub fn ending(&self) -> watch::Receiver<bool> {
        self.0.ending.clone()
    }

    /// Runs what waits for files or the ledger on a thread that may.
    ///
    /// # Errors
    /// The problem of the work; 500 if it panicked.
    pub async fn blocking<T: Send + 'static>(
        &self,
        work: impl FnOnce(&Self) -> Result<T, Problem> + Send + 'static,
    ) -> Result<T, Problem> {
        let state = self.clone();
        let done = tokio::task::spawn_blocking(move || work(&state)).await;
        let failed = |_| Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "the request failed; see the log");
        done.map_err(failed)?
    }
}
