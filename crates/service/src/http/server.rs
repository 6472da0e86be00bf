//! Listens, and ends in an orderly way.

use super::auth::{Auth, AuthError};
use super::connections::{Admission, Connections, room_for};
use super::reach::Reach;
use super::state::{Inner, State};
use super::traces::Traces;
use super::{journal, measurements, roots, routes, webhook};
use crate::backend::RenderBackend;
use crate::contract::Limits;
use crate::coordinator::ledger::{Ledger, LedgerError};
use crate::coordinator::storage::{Storage, StorageError, StorageOptions};
use crate::coordinator::store::Store;
use crate::coordinator::{
    AuditLog, DataFolder, FarmOptions, FolderError, KeptScene, OwnScene, Record, Retention, Runner, Secret,
};
use axum_server::Handle;
use axum_server::tls_rustls::{RustlsAcceptor, RustlsConfig};
use metrics_exporter_prometheus::PrometheusHandle;
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use tokio::runtime::Runtime;
use tokio::sync::{Semaphore, watch};

/// Requests that have begun get this long to end.
const GRACE: Duration = Duration::from_secs(5);

/// Requests at the same time on one connection of HTTP/2, and bytes of their headers.
const STREAMS: u32 = 128;
const HEAD_BYTES: u32 = 64 << 10;

/// How often measured times are summed up.
const DIGEST: Duration = Duration::from_secs(5);

/// A certificate chain and its key, as PEM files.
#[derive(Clone, Debug)]
pub struct Tls {
    /// The chain.
    pub certificate: PathBuf,
    /// The key.
    pub key: PathBuf,
}

/// The options with which the service is started.
#[derive(Clone, Debug)]
pub struct Options {
    /// The address; port 0 is any free one.
    pub listen: SocketAddr,
    /// The folder of all that is kept.
    pub data: PathBuf,
    /// Encryption.
    pub tls: Option<Tls>,
    /// True if an address of other machines is allowed without encryption.
    pub insecure: bool,
    /// Certificates of the authorities by which addresses of webhooks are known; `None` for those of the system.
    pub ca: Option<PathBuf>,
    /// Addresses that webhooks may call.
    pub reach: Reach,
    /// Bounds of what is kept.
    pub retention: Retention,
    /// Where finished pictures and uploaded scenes lie; `None` for the data folder alone.
    pub storage: Option<StorageOptions>,
    /// True if programs of this machine may use Drake's route without a token.
    pub open_to_drake: bool,
    /// Names of this service besides `localhost` and addresses.
    pub names: Vec<String>,
    /// The bounds of requests.
    pub limits: Limits,
    /// The scene that the live view shows unless another one is asked for.
    pub scene: Option<OwnScene>,
    /// The way in which units of jobs reach their workers.
    pub farm: FarmOptions,
}

/// The reason why the service cannot run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ServeError {
    /// Others could listen in.
    #[error(
        "{0} can be reached from other machines: add --tls-certificate and --tls-key, or --insecure if the network is \
         trusted"
    )]
    Open(SocketAddr),
    /// The address cannot be listened at.
    #[error("{address}: cannot listen there: {source}")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// The system's error.
        source: io::Error,
    },
    /// The data folder cannot be used.
    #[error(transparent)]
    Folder(#[from] FolderError),
    /// There is no token, and none can be made.
    #[error(transparent)]
    Auth(#[from] AuthError),
    /// A file cannot be used.
    #[error("{path}: {source}")]
    File {
        /// The file or folder.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The ledger cannot be used.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    /// The storage cannot be used.
    #[error(transparent)]
    Storage(#[from] StorageError),
    /// The system refuses threads or sockets.
    #[error("the service cannot run: {0}")]
    System(#[from] io::Error),
}

/// Ends the service from any thread.
#[derive(Clone, Debug)]
pub struct Stop(Arc<watch::Sender<bool>>);

impl Default for Stop {
    fn default() -> Self {
        Self(Arc::new(watch::Sender::new(false)))
    }
}

impl Stop {
    /// Ends the service: requests end, units that are under way are given up or kept, and the process may end.
    pub fn stop(&self) {
        self.0.send_replace(true);
    }
}

/// Runs the service until it is stopped. `listening` gets the address once requests are answered.
///
/// # Errors
/// [`ServeError`] if it cannot begin.
pub fn run(
    options: Options,
    backend: Arc<RenderBackend>,
    stop: &Stop,
    listening: impl FnOnce(SocketAddr) + Send + 'static,
) -> Result<(), ServeError> {
    let Options {
        listen,
        data,
        tls,
        insecure,
        ca,
        reach,
        retention,
        storage,
        open_to_drake,
        names,
        limits,
        scene,
        farm,
    } = options;
    if !listen.ip().is_loopback() && tls.is_none() && !insecure {
        return Err(ServeError::Open(listen));
    }
    let failed = |source| ServeError::File { path: data.clone(), source };
    let _used = DataFolder::open(&data)?;
    let secret = Secret::open(&data).map_err(failed)?;
    let ledger = Arc::new(Ledger::open(&data)?);
    let auth = Auth::open(&data, Arc::clone(&ledger))?;
    let tls_of_calls = roots::tls(ca.as_deref())?;
    let (runtime, metrics) = (runtime()?, measurements::record().map_err(io::Error::other)?);
    let cut = patience(&runtime, stop);
    let storage = Storage::open(storage, &ledger, cut.subscribe())?;
    let store = Arc::new(Store::open(&data, storage).map_err(failed)?);
    let scene = scene.map(|scene| KeptScene::keep(scene, &store, &ledger, &limits));
    let own_scene = scene.as_ref().and_then(KeptScene::upload).map(|(sha256, _)| sha256.clone());
    let record =
        Record { ledger: Arc::clone(&ledger), store: Arc::clone(&store), secret, retention, own_scene };
    let traces = Traces::of_environment(&tls_of_calls)?;
    let runner = Runner::start(record, Arc::clone(&backend), limits, farm)?;
    let state = State::new(Inner {
        auth,
        limits,
        backend,
        ledger,
        store,
        runner: Arc::clone(&runner),
        reach: reach.clone(),
        host_names: names,
        own_scene: scene,
        is_secure: tls.is_some(),
        is_open_to_drake: open_to_drake,
        connections: Arc::new(Connections::new(room_for(limits.connections))),
        metrics,
        audit: AuditLog::new(&data),
        traces,
        uploads: Semaphore::new(limits.uploads),
        ending: stop.0.subscribe(),
    });
    let _calls = webhook::start(state.clone(), tls_of_calls, reach)?;
    let steps = journal::start(state.clone())?;
    runtime.spawn(digest(state.metrics().clone()));
    let served = runtime.block_on(serve(listen, tls, state, stop.0.subscribe(), listening));
    stop.stop();
    cut.send_replace(true);
    runner.stop();
    drop(steps.join());
    runtime.shutdown_timeout(GRACE);
    served
}

/// True, for who waits for the storage, once a service that is to end has waited long enough: requests that need the
/// storage get as long to end as others.
fn patience(runtime: &Runtime, stop: &Stop) -> Arc<watch::Sender<bool>> {
    let (cut, mut ending) = (Arc::new(watch::Sender::new(false)), stop.0.subscribe());
    let late = Arc::clone(&cut);
    runtime.spawn(async move {
        // The sender lives as long as the service.
        let _ = ending.wait_for(|ending| *ending).await;
        tokio::time::sleep(GRACE).await;
        late.send_replace(true);
    });
    cut
}

/// The threads that answer requests.
fn runtime() -> io::Result<Runtime> {
    let mut builder = tokio::runtime::Builder::new_multi_thread();
    builder.worker_threads(2).thread_name("http").enable_io().enable_time().build()
}

async fn serve(
    listen: SocketAddr,
    tls: Option<Tls>,
    state: State,
    mut ending: watch::Receiver<bool>,
    listening: impl FnOnce(SocketAddr) + Send + 'static,
) -> Result<(), ServeError> {
    let cannot = |source| ServeError::Listen { address: listen, source };
    let listener = TcpListener::bind(listen).map_err(cannot)?;
    listener.set_nonblocking(true).map_err(cannot)?;
    let address = listener.local_addr().map_err(cannot)?;
    let handle = Handle::new();
    let stopper = handle.clone();
    tokio::spawn(async move {
        // The sender lives as long as the service.
        let _ = ending.wait_for(|ending| *ending).await;
        stopper.graceful_shutdown(Some(GRACE));
    });
    let (head_time, admission) = (state.limits().head_time, Admission(Arc::clone(state.connections())));
    let app = routes::router(state).into_make_service_with_connect_info::<SocketAddr>();
    let acceptor = match tls {
        None => None,
        Some(Tls { certificate, key }) => {
            let config = RustlsConfig::from_pem_file(&certificate, &key).await;
            let config = config.map_err(|source| ServeError::File { path: certificate, source })?;
            Some(RustlsAcceptor::new(config))
        }
    };
    let mut server = axum_server::from_tcp(listener)?.handle(handle).first_request_timeout(head_time);
    let http = server.http_builder();
    http.http1().header_read_timeout(head_time);
    // Whoever answers no ping in time has gone.
    http.http2().keep_alive_interval(head_time).keep_alive_timeout(head_time);
    http.http2().max_concurrent_streams(STREAMS).max_header_list_size(HEAD_BYTES);
    listening(address);
    match acceptor {
        None => server.acceptor(admission).serve(app).await?,
        Some(tls) => server.acceptor(tls.acceptor(admission)).serve(app).await?,
    }
    Ok(())
}

/// Sums up the times that have been measured. Until then each is kept, and no one may ask for `/metrics`.
async fn digest(metrics: PrometheusHandle) {
    let mut ticks = tokio::time::interval(DIGEST);
    loop {
        ticks.tick().await;
        metrics.run_upkeep();
    }
}
