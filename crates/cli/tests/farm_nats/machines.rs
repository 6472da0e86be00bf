//! A NATS server and workers, each a process that can be stopped, killed and started again.

use crate::links::Links;
use rustix::process::{Pid, Signal, kill_process};
use std::io::Read;
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::time::{Duration, Instant};
use tempfile::TempDir;

const PATIENCE: Duration = Duration::from_secs(60);

/// A process that is killed at the end.
pub struct Process(pub Child);

impl Process {
    fn signal(&self, signal: Signal) {
        let id = Pid::from_raw(self.0.id() as i32).expect("a process");
        kill_process(id, signal).expect("it is there");
    }

    /// Ends it as a power failure would.
    pub fn kill(&mut self) {
        self.0.kill().expect("it is there");
        self.0.wait().expect("it has ended");
    }

    /// Asks it to end.
    pub fn terminate(&self) {
        self.signal(Signal::TERM);
    }

    /// Lets it do nothing for a while.
    pub fn pause(&self, time: Duration) {
        self.signal(Signal::STOP);
        std::thread::sleep(time);
        self.signal(Signal::CONT);
    }

    /// Waits until it has ended.
    pub fn wait(&mut self) -> ExitStatus {
        let began = Instant::now();
        loop {
            if let Some(status) = self.0.try_wait().expect("a child") {
                return status;
            }
            assert!(began.elapsed() < PATIENCE, "it goes on");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// True if it still runs.
    pub fn is_alive(&mut self) -> bool {
        self.0.try_wait().expect("a child").is_none()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended, or be stopped.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A NATS server with a port that outlives it.
pub struct Nats {
    port: u16,
    /// The folder of its settings, if it has some.
    settings: Option<PathBuf>,
    process: Option<Process>,
}

/// A port that no one listens at, another one for each call: below those that systems choose for connections, as one of
/// these could take it before its server listens.
pub fn free_port() -> u16 {
    const FIRST: u32 = 10_000;
    const COUNT: u32 = 20_000;
    static CALLS: AtomicU32 = AtomicU32::new(0);
    // Processes begin at places of their own.
    let begin = std::process::id().wrapping_mul(7919);
    let next = || (FIRST + begin.wrapping_add(CALLS.fetch_add(1, Relaxed)) % COUNT) as u16;
    let is_free = |port: &u16| TcpListener::bind((Ipv4Addr::UNSPECIFIED, *port)).is_ok();
    std::iter::repeat_with(next).take(COUNT as usize).find(is_free).expect("a free port")
}

impl Nats {
    pub fn start() -> Self {
        Self::with(free_port(), None)
    }

    /// One that reads `nats.conf` in this folder, which names the port.
    pub fn with_settings(port: u16, settings: &Path) -> Self {
        Self::with(port, Some(settings.into()))
    }

    fn with(port: u16, settings: Option<PathBuf>) -> Self {
        let mut own = Self { port, settings, process: None };
        own.restart();
        own
    }

    /// Has it read its settings again.
    pub fn reload(&self) {
        self.process.as_ref().expect("it runs").signal(Signal::HUP);
    }

    pub fn port(&self) -> u16 {
        self.port
    }

    pub fn url(&self) -> String {
        format!("nats://127.0.0.1:{}", self.port)
    }

    pub fn kill(&mut self) {
        self.process.take().expect("it runs").kill();
    }

    pub fn pause(&self, time: Duration) {
        self.process.as_ref().expect("it runs").pause(time);
    }

    /// Starts it again.
    pub fn restart(&mut self) {
        let mut command = Command::new("nats-server");
        match &self.settings {
            Some(folder) => command.current_dir(folder).args(["-c", "nats.conf"]),
            None => command.args(["-a", "127.0.0.1", "-p", &self.port.to_string()]),
        };
        let child = command
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("nats-server is installed: tests/run --all, or apt install nats-server");
        self.process = Some(Process(child));
        let began = Instant::now();
        let greets = || {
            let mut stream = TcpStream::connect((Ipv4Addr::LOCALHOST, self.port)).ok()?;
            let mut greeting = [0; 5];
            stream.read_exact(&mut greeting).ok().filter(|()| greeting == *b"INFO ")
        };
        while greets().is_none() {
            assert!(began.elapsed() < PATIENCE, "nats-server does not listen");
            assert!(self.process.as_mut().is_some_and(Process::is_alive), "nats-server has ended");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

/// A worker with a cache of its own.
pub struct Worker {
    pub process: Process,
    pub name: String,
    pub cache: TempDir,
}

impl Worker {
    pub fn start(url: &str, name: &str, options: &[&str]) -> Self {
        Self::with_cache(tempfile::tempdir().expect("a folder"), url, name, options)
    }

    /// One that reaches the server over a link of its own: not at a loopback address.
    pub fn behind(
        links: &Links,
        place: usize,
        cache: TempDir,
        url: &str,
        name: &str,
        options: &[&str],
    ) -> Self {
        let mut command = Command::new("ip");
        command.args(["netns", "exec", &links.space(place), env!("CARGO_BIN_EXE_raystream")]);
        Self::start_with(command, cache, url, name, options)
    }

    /// One whose cache was another's before.
    pub fn with_cache(cache: TempDir, url: &str, name: &str, options: &[&str]) -> Self {
        Self::start_with(Command::new(env!("CARGO_BIN_EXE_raystream")), cache, url, name, options)
    }

    fn start_with(mut command: Command, cache: TempDir, url: &str, name: &str, options: &[&str]) -> Self {
        let child = command
            .env("RUST_LOG", "error")
            .args(["worker", "--nats", url, "--name", name, "--tracer", "cpu", "--threads", "1", "--cache"])
            .arg(cache.path())
            .args(options)
            .stdin(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("raystream starts");
        Self { process: Process(child), name: name.into(), cache }
    }

    /// So many workers.
    pub fn some(url: &str, count: usize) -> Vec<Self> {
        (0..count).map(|number| Self::start(url, &format!("w{number}"), &[])).collect()
    }
}

/// Starts a worker and returns what it says when it ends.
pub fn worker_output(url: &str, cache: &Path, options: &[&str]) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_raystream"))
        .args(["worker", "--nats", url, "--tracer", "cpu", "--threads", "1", "--cache"])
        .arg(cache)
        .args(options)
        .output()
        .expect("raystream starts");
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}
