//! A service in a process of its own, and requests to it.

use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::NamedTempFile;
use ureq::Agent;
use ureq::http::{Request, Response};

/// The longest time that anything may take in these tests.
pub const PATIENCE: Duration = Duration::from_secs(240);

pub fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// A scene that the project ships.
pub fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).expect("the workspace").join("scenes").join(name)
}

pub fn raystream(arguments: &[&str]) -> Output {
    command().args(arguments).output().expect("raystream starts")
}

fn command() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_raystream"));
    command.env("RUST_LOG", "warn");
    command
}

/// The hash of the picture that `raystream render` makes with the same options.
pub fn rendered(scene: &Path, options: &[&str]) -> String {
    let folder = folder();
    let path = |name: &str| folder.path().join(name).to_str().expect("UTF-8").to_owned();
    let (picture, stats) = (path("a.png"), path("a.json"));
    let scene = scene.to_str().expect("UTF-8");
    let first = ["render", scene, "-o", &picture, "--stats", &stats, "--tracer", "cpu"];
    let output = raystream(&[&first[..], options].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let stats: Value = serde_json::from_slice(&std::fs::read(stats).expect("statistics")).expect("JSON");
    stats["image"]["hash"].as_str().expect("a hash").to_owned()
}

/// A service, killed at the end.
pub struct Service {
    child: Child,
    /// What it writes to its standard error, unless the test has a file for that.
    messages: NamedTempFile,
    pub url: String,
    pub token: String,
    agent: Agent,
}

/// The answer to a request.
pub struct Answer {
    pub status: u16,
    pub headers: Vec<(String, String)>,
    pub body: Vec<u8>,
}

impl Answer {
    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|error| {
            panic!("{error}: {} {}", self.status, String::from_utf8_lossy(&self.body))
        })
    }

    pub fn header(&self, name: &str) -> &str {
        self.headers.iter().find(|(own, _)| own == name).map_or("", |(_, value)| value)
    }
}

impl Service {
    /// Starts a service and waits until it listens.
    pub fn start(data: &Path, options: &[&str]) -> Self {
        Self::try_start(data, options).expect("the service listens")
    }

    /// The same; `None` if the service ends before.
    pub fn try_start(data: &Path, options: &[&str]) -> Option<Self> {
        Self::run(&["serve"], data, options)
    }

    /// Starts a service whose first token is not in its folder, and waits until it listens.
    pub fn start_with_token(data: &Path, token: &str) -> Self {
        Self::launch(&["serve"], data, &[], (Some(token), None), &[]).expect("the service listens")
    }

    /// Starts a service whose messages go to a file, and waits until it listens.
    pub fn start_logging(data: &Path, options: &[&str], log: &Path) -> Self {
        Self::launch(&["serve"], data, options, (None, Some(log)), &[]).expect("the service listens")
    }

    /// Starts a service with variables of the environment, and waits until it listens.
    #[cfg(feature = "otel")]
    pub fn start_in(data: &Path, options: &[&str], variables: &[(&str, &str)]) -> Self {
        Self::launch(&["serve"], data, options, (None, None), variables).expect("the service listens")
    }

    /// The same for another command that is a service.
    pub fn run(command: &[&str], data: &Path, options: &[&str]) -> Option<Self> {
        Self::launch(command, data, options, (None, None), &[])
    }

    /// The same with its token if that is not in the folder, a file for its messages, and variables of its environment.
    pub fn launch(
        command: &[&str],
        data: &Path,
        options: &[&str],
        (token, log): (Option<&str>, Option<&Path>),
        variables: &[(&str, &str)],
    ) -> Option<Self> {
        let messages = NamedTempFile::new().expect("a file");
        let errors = match log {
            Some(path) => std::fs::File::create(path).expect("a file"),
            None => messages.reopen().expect("a file"),
        };
        // A file that cannot grow is an error then, not a signal.
        let mut child = Command::new("sh")
            .args(["-c", "trap '' XFSZ; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_raystream")])
            .env("RUST_LOG", if log.is_some() { "info,raystream_service=debug" } else { "warn" })
            .envs(variables.iter().copied())
            .args(command)
            .args(["--listen", "127.0.0.1:0", "--tracer", "cpu", "--unit-samples", "1000", "--data"])
            .arg(data)
            .args(options)
            .stdout(Stdio::piped())
            .stderr(errors)
            .spawn()
            .expect("raystream starts");
        let mut line = String::new();
        let read = BufReader::new(child.stdout.take().expect("a pipe")).read_line(&mut line);
        if read.expect("a line") == 0 {
            let (status, messages) =
                (child.wait().expect("it ended"), std::fs::read_to_string(messages.path()));
            println!("the service ended: {status}: {}", messages.expect("its messages"));
            return None;
        }
        let (url, token) = match token {
            Some(token) => (line.trim().trim_end_matches('/'), token),
            None => line.trim().split_once("/#token=").expect("an address with the token"),
        };
        let config = Agent::config_builder().http_status_as_error(false).timeout_global(Some(PATIENCE));
        let agent = config.build().new_agent();
        Some(Self { child, messages, url: url.into(), token: token.into(), agent })
    }

    /// Ends the process as a power failure would.
    pub fn kill(mut self) {
        self.child.kill().expect("it lives");
        self.child.wait().expect("it ended");
    }

    /// The same, if it has not ended by itself.
    pub fn kill_if_alive(mut self) {
        // It may have ended.
        let _ = self.child.kill();
        self.child.wait().expect("it ended");
    }

    /// Waits for the process to end by itself.
    pub fn wait_for_end(&mut self) -> Option<i32> {
        let began = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().expect("a child") {
                return status.code();
            }
            assert!(began.elapsed() < PATIENCE, "the service goes on");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    pub fn process(&self) -> u32 {
        self.child.id()
    }

    /// Sends a request with the token; `None` if the service does not answer.
    pub fn try_send(
        &self,
        method: &str,
        path: &str,
        headers: &[(&str, &str)],
        body: Vec<u8>,
    ) -> Option<Answer> {
        let mut request = Request::builder().method(method).uri(format!("{}{path}", self.url));
        if !headers.iter().any(|(name, _)| *name == "Authorization") {
            request = request.header("Authorization", format!("Bearer {}", self.token));
        }
        for (name, value) in headers.iter().filter(|(_, value)| !value.is_empty()) {
            request = request.header(*name, *value);
        }
        let answer = match body.is_empty() {
            true => self.agent.run(request.body(()).expect("a request")),
            false => self.agent.run(request.body(body).expect("a request")),
        };
        let mut answer: Response<ureq::Body> = answer.ok()?;
        let text = |value: &ureq::http::HeaderValue| value.to_str().unwrap_or_default().to_owned();
        let headers = answer.headers().iter().map(|(name, value)| (name.to_string(), text(value))).collect();
        let status = answer.status().as_u16();
        Some(Answer { status, headers, body: answer.body_mut().read_to_vec().ok()? })
    }

    pub fn send(&self, method: &str, path: &str, headers: &[(&str, &str)], body: Vec<u8>) -> Answer {
        self.try_send(method, path, headers, body).expect("an answer")
    }

    pub fn get(&self, path: &str) -> Answer {
        self.send("GET", path, &[], Vec::new())
    }

    pub fn post(&self, path: &str, body: &Value) -> Answer {
        let json = [("Content-Type", "application/json")];
        self.send("POST", path, &json, body.to_string().into_bytes())
    }

    /// Uploads bytes; returns their address and the status.
    pub fn upload(&self, bytes: &[u8]) -> (String, Answer) {
        let sha256: String = Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        let answer = self.send("PUT", &format!("/api/v1/scenes/{sha256}"), &[], bytes.to_vec());
        (sha256, answer)
    }

    /// Uploads a file of a scene.
    pub fn upload_file(&self, path: &Path) -> String {
        let (sha256, answer) = self.upload(&std::fs::read(path).expect("a scene"));
        assert!([200, 201].contains(&answer.status), "{}", answer.json());
        sha256
    }

    /// Submits a job; returns its name.
    pub fn submit(&self, scene: &str, spec: &Value) -> String {
        let mut spec = spec.clone();
        spec["scene"] = json!(scene);
        let answer = self.post("/api/v1/jobs", &spec);
        assert!([200, 202].contains(&answer.status), "{}", answer.json());
        answer.json()["id"].as_str().expect("an id").to_owned()
    }

    pub fn job(&self, id: &str) -> Value {
        self.get(&format!("/api/v1/jobs/{id}")).json()
    }

    /// Waits until a job is in one of these states.
    pub fn wait_for(&self, id: &str, states: &[&str]) -> Value {
        let began = Instant::now();
        loop {
            let job = self.job(id);
            if states.iter().any(|state| job["state"] == **state) {
                return job;
            }
            assert!(began.elapsed() < PATIENCE, "{job}");
            std::thread::sleep(Duration::from_millis(30));
        }
    }

    /// The hashes of a job's pictures, once it is done.
    pub fn hashes(&self, id: &str) -> Vec<String> {
        let job = self.wait_for(id, &["done", "failed", "cancelled"]);
        assert_eq!(job["state"], "done", "{job}");
        let pictures = job["pictures"].as_array().expect("pictures").iter();
        pictures.map(|picture| picture["hash"].as_str().expect("a hash").to_owned()).collect()
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        // It may have ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
        if std::thread::panicking() {
            println!("the service: {}", std::fs::read_to_string(self.messages.path()).unwrap_or_default());
        }
    }
}
