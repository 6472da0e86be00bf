//! A server of this service's own, with keys: not everyone on a machine is a worker.

use super::connection::NatsError;
use super::keys::NatsKey;
use super::settings;
use std::fs;
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The files of keys in its folder.
const COORDINATOR: &str = "coordinator.key";
const WORKERS: &str = "workers";

/// The program, which is looked for in PATH.
const PROGRAM: &str = "nats-server";

/// How long it may take to listen.
const PATIENCE: Duration = Duration::from_secs(10);

/// The pause before a server that has ended is started again.
const RESTART: Duration = Duration::from_millis(500);

/// Keys of workers that are made: as many processes may work at the same time.
const KEYS: u32 = 16;

/// A `nats-server` on this machine's own address, with its keys in the service's data folder. If it ends, it is
/// started again. It ends with this value; after a kill of the service the next one finds it by its port.
#[derive(Debug)]
pub struct NatsServer {
    url: String,
    port: u16,
    folder: PathBuf,
    ending: Arc<AtomicBool>,
    child: Arc<Mutex<Option<Child>>>,
    watcher: Option<JoinHandle<()>>,
}

impl NatsServer {
    /// Starts the server of a farm, or finds the one that an earlier process of the same data folder has left.
    ///
    /// # Errors
    /// If there is no such program in PATH, or it does not listen.
    pub fn start(data: &Path, farm: &str) -> Result<Self, NatsError> {
        let folder = data.join("nats");
        let failed =
            |error: std::io::Error| NatsError::File { path: folder.clone(), error: error.to_string() };
        fs::create_dir_all(folder.join(WORKERS)).map_err(failed)?;
        let coordinator = key(&folder.join(COORDINATOR))?;
        let of_worker = |number| key(&folder.join(WORKERS).join(format!("{number:02}.key")));
        let workers = (1..=KEYS).map(of_worker).collect::<Result<Vec<_>, _>>()?;
        let (port_file, conf) = (folder.join("port"), folder.join("nats.conf"));
        let told = |port| settings::of_own_server(port, &folder, farm, &coordinator, &workers);
        let left = fs::read_to_string(&port_file).ok().and_then(|text| text.trim().parse().ok());
        if let Some(port) = left.filter(|port| answers(*port)) {
            if fs::read_to_string(&conf).is_ok_and(|known| known == told(port)) {
                log::info!("the nats-server of an earlier process goes on");
                return Ok(Self::of(port, None, folder));
            }
            // It has been told something else, perhaps by a raystream that made no keys.
            end_earlier(&folder);
            let began = Instant::now();
            while answers(port) && began.elapsed() < PATIENCE {
                std::thread::sleep(Duration::from_millis(20));
            }
        }
        let free = || TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).and_then(|socket| socket.local_addr());
        // The same port again: workers look there.
        let is_free = |port: &u16| TcpListener::bind((Ipv4Addr::LOCALHOST, *port)).is_ok();
        let port = match left.filter(is_free) {
            Some(port) => port,
            None => free().map_err(failed)?.port(),
        };
        fs::write(&conf, told(port)).map_err(failed)?;
        fs::write(&port_file, port.to_string()).map_err(failed)?;
        let child = spawn(&folder)?;
        let own = Self::of(port, Some(child), folder);
        let began = Instant::now();
        while !answers(port) {
            if began.elapsed() > PATIENCE {
                let error = format!("{PROGRAM} does not listen; see {}", data.join("nats/log").display());
                return Err(NatsError::Refused { url: own.url.clone(), error });
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        Ok(own)
    }

    fn of(port: u16, child: Option<Child>, folder: PathBuf) -> Self {
        let (ending, is_own) = (Arc::new(AtomicBool::new(false)), child.is_some());
        let child = Arc::new(Mutex::new(child));
        let own_folder = folder.clone();
        let watcher = {
            let (ending, child) = (Arc::clone(&ending), Arc::clone(&child));
            let watch = move || {
                let mut is_own = is_own;
                while !ending.load(Relaxed) {
                    std::thread::sleep(RESTART);
                    let mut child = child.lock().expect("no holder panics");
                    let has_ended = match child.as_mut() {
                        Some(child) => child.try_wait().is_ok_and(|status| status.is_some()),
                        None => !is_own && !answers(port),
                    };
                    if has_ended && !ending.load(Relaxed) {
                        log::warn!("{PROGRAM} has ended; it is started again");
                        *child = spawn(&folder).inspect_err(|error| log::warn!("{error}")).ok();
                        is_own = child.is_some();
                    }
                }
            };
            std::thread::Builder::new().name("nats-server".into()).spawn(watch).ok()
        };
        Self { url: format!("nats://127.0.0.1:{port}"), port, folder: own_folder, ending, child, watcher }
    }

    /// Its address.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// The file of the coordinator's key.
    pub fn key(&self) -> PathBuf {
        self.folder.join(COORDINATOR)
    }

    /// The folder of the keys of workers.
    pub fn worker_keys(&self) -> PathBuf {
        self.folder.join(WORKERS)
    }
}

impl Drop for NatsServer {
    fn drop(&mut self) {
        self.ending.store(true, Relaxed);
        match self.child.lock().expect("no holder panics").take() {
            Some(mut child) => {
                // It keeps nothing.
                let _ = child.kill();
                let _ = child.wait();
            }
            None if answers(self.port) => end_earlier(&self.folder),
            None => {}
        }
        if let Some(watcher) = self.watcher.take() {
            // Its panic has been reported.
            let _ = watcher.join();
        }
    }
}

/// Ends the server of an earlier process, which has written its process's number. It listens, so the number is its own.
#[cfg(target_os = "linux")]
fn end_earlier(folder: &Path) {
    use rustix::process::{Pid, Signal, kill_process};
    let written = fs::read_to_string(folder.join("pid")).ok();
    let process = written.and_then(|text| text.trim().parse().ok()).and_then(Pid::from_raw);
    let ended = process.map(|process| kill_process(process, Signal::TERM));
    if !matches!(ended, Some(Ok(()))) {
        log::warn!("{PROGRAM} goes on; its process is not known");
    }
}

/// The server goes on.
#[cfg(not(target_os = "linux"))]
fn end_earlier(_: &Path) {
    log::warn!("{PROGRAM} goes on");
}

/// The public key of a file, which is made if it is not there. Its owner alone may read it.
fn key(path: &Path) -> Result<String, NatsError> {
    let failed = |error: String| NatsError::File { path: path.to_owned(), error };
    if let Ok(seed) = fs::read_to_string(path) {
        return NatsKey::from_seed(&seed).map(|key| key.public).map_err(|error| failed(error.to_string()));
    }
    let key = NatsKey::generate()?;
    crate::contract::write_private(path, &key.seed).map_err(|error| failed(error.to_string()))?;
    Ok(key.public)
}

fn spawn(folder: &Path) -> Result<Child, NatsError> {
    let failed = |error: std::io::Error| NatsError::File {
        path: PROGRAM.into(),
        error: match error.kind() {
            std::io::ErrorKind::NotFound => {
                "it is not in PATH; install it (Debian: apt install nats-server)".into()
            }
            _ => error.to_string(),
        },
    };
    let log = fs::File::create(folder.join("log")).map_err(failed)?;
    let mut command = Command::new(PROGRAM);
    command.arg("-c").arg(folder.join("nats.conf"));
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(log);
    command.spawn().map_err(failed)
}

/// True if a NATS server greets at a port of this machine.
fn answers(port: u16) -> bool {
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
    let Ok(mut stream) = TcpStream::connect_timeout(&address, Duration::from_millis(200)) else {
        return false;
    };
    let greeting = &mut [0; 5];
    let is_read = stream.set_read_timeout(Some(Duration::from_millis(500))).is_ok()
        && stream.read_exact(greeting).is_ok();
    // It ends the connection in good order.
    let _ = stream.write_all(b"PING\r\n");
    is_read && greeting == b"INFO "
}
