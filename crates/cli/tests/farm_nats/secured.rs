//! Farms that `raystream farm init` makes: TLS, a key for each process, and the subjects of each.

use crate::machines::{Process, free_port, worker_output};
use crate::service::{PATIENCE, raystream};
use crate::{Nats, Service, Worker, coordinator, folder, shipped, still};
use raystream::picture::Registry;
use serde_json::json;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// A farm, and its server.
pub struct Farm {
    _folder: TempDir,
    pub path: PathBuf,
    pub url: String,
    pub nats: Nats,
}

fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

impl Farm {
    /// A farm with so many workers.
    pub fn new(workers: u32) -> Self {
        Self::at("localhost", workers)
    }

    /// The same, whose server's certificate names this address too.
    pub fn at(host: &str, workers: u32) -> Self {
        let (folder, port) = (folder(), free_port());
        let path = folder.path().join("farm");
        let (workers, number) = (workers.to_string(), port.to_string());
        let options = ["--host", host, "--port", &number, "--workers", &workers];
        let output = raystream(&[&["farm", "init", text(&path)], &options[..]].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let nats = Nats::with_settings(port, &path.join("nats"));
        Self { _folder: folder, path, url: format!("tls://localhost:{port}"), nats }
    }

    /// The folder of a process.
    pub fn of(&self, process: &str) -> PathBuf {
        self.path.join(process)
    }

    /// The options that name key and certificate of a process.
    pub fn options(&self, process: &str) -> Vec<String> {
        let path = |name: &str| text(&self.of(process).join(name)).to_owned();
        vec!["--nats-key".into(), path("nats.key"), "--nats-ca".into(), path("ca.pem")]
    }

    pub fn coordinator(&self, data: &Path) -> Service {
        let options = self.options("coordinator");
        coordinator(data, &self.url, &options.iter().map(String::as_str).collect::<Vec<_>>())
    }

    /// A coordinator that compares a share of the units.
    pub fn comparing(&self, data: &Path, share: &str) -> Service {
        self.coordinator_with(data, &["--lease", "1", "--compared", share, "--most-files", "3"])
    }

    /// A coordinator with further options.
    pub fn coordinator_with(&self, data: &Path, further: &[&str]) -> Service {
        let first = [&["--nats", &self.url][..], further].concat();
        let options = self.options("coordinator");
        let options: Vec<&str> = options.iter().map(String::as_str).collect();
        Service::start(data, &[&first[..], &options].concat())
    }

    pub fn worker(&self, name: &str) -> Worker {
        self.worker_that(name, &[])
    }

    /// A worker with further options.
    pub fn worker_that(&self, name: &str, options: &[&str]) -> Worker {
        let own = self.options(&format!("workers/{name}"));
        let own: Vec<&str> = own.iter().map(String::as_str).collect();
        Worker::start(&self.url, name, &[&own[..], options].concat())
    }
}

/// Waits until so many workers are there.
pub fn wait_for_workers(service: &Service, count: usize) {
    let began = Instant::now();
    while service.get("/api/v1/workers").json()["workers"].as_array().map_or(0, Vec::len) < count {
        assert!(began.elapsed() < PATIENCE, "the workers do not join");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn a_farm_of_init_renders_over_tls_with_keys() {
    let (job, hash) = still();
    let (farm, data) = (Farm::new(2), folder());
    let service = farm.coordinator(data.path());
    let _workers = ["worker-1", "worker-2"].map(|name| farm.worker(name));
    wait_for_workers(&service, 2);
    let scene = service.upload_file(&shipped("cornell.json"));
    let id = service.submit(&scene, &job);
    assert_eq!(service.hashes(&id), [hash.as_str()]);

    // One more worker: its key is made, and the server told.
    let path = text(&farm.path).to_owned();
    let output = raystream(&["farm", "key", "third", "--folder", &path]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    farm.nats.reload();
    let _third = farm.worker("third");
    wait_for_workers(&service, 3);
    let again = service.submit(&scene, &json!({ "size": "24x16", "spp": 16, "seed": 8 }));
    assert_ne!(service.hashes(&again), [hash]);
}

#[test]
fn the_line_that_a_coordinator_prints_starts_a_worker_in_its_folder() {
    let (farm, data, cache) = (Farm::new(1), folder(), folder());
    let log = cache.path().join("log");
    let options = farm.options("coordinator");
    let options: Vec<&str> = options.iter().map(String::as_str).collect();
    let service = Service::start_logging(data.path(), &[&["--nats", &farm.url], &options[..]].concat(), &log);
    let told = fs::read_to_string(&log).expect("a log");
    let words = told.lines().find_map(|line| line.strip_prefix("workers join with: raystream "));
    let child = Command::new(env!("CARGO_BIN_EXE_raystream"))
        .args(words.expect("a command").split_whitespace())
        .arg("--cache")
        .arg(cache.path())
        .current_dir(farm.of("workers/worker-1"))
        .spawn()
        .expect("raystream starts");
    let _worker = Process(child);
    wait_for_workers(&service, 1);
}

#[test]
fn who_has_no_key_or_trusts_another_authority_is_refused_and_told_why() {
    let (farm, other, cache) = (Farm::new(1), Farm::new(1), folder());
    let of = |farm: &Farm, name: &str| text(&farm.of("workers/worker-1").join(name)).to_owned();
    let refused = |url: &str, options: &[&str], says: &str| {
        let (code, told) = worker_output(url, cache.path(), options);
        assert_eq!(code, Some(2), "{told}");
        assert!(told.contains(says), "{options:?} does not say {says:?} but {told}");
    };
    let (key, ca) = (of(&farm, "nats.key"), of(&farm, "ca.pem"));
    refused(&farm.url, &["--nats-ca", &ca, "--insecure"], "name this process's with --nats-key");
    refused(
        &farm.url,
        &["--nats-ca", &ca, "--nats-key", &of(&other, "nats.key")],
        "the server does not know the key",
    );
    refused(&farm.url, &["--nats-ca", &of(&other, "ca.pem"), "--nats-key", &key], "--nats-ca names");
    refused(&farm.url, &["--nats-ca", &ca, "--nats-key", &ca], "it holds no seed");
    refused(&farm.url, &["--nats-ca", "none.pem", "--nats-key", &key], "none.pem: there is no such file");
    // An address that the certificate does not name.
    let by_number = farm.url.replace("localhost", "127.0.0.2");
    refused(
        &by_number,
        &["--nats-ca", &ca, "--nats-key", &key],
        "the address is one that its certificate names",
    );
    let foreign = "nats://192.0.2.1:4222";
    refused(foreign, &[], "use tls:// with --nats-key and --nats-ca, or --insecure");
    refused(foreign, &["--nats-key", &key], "use tls:// with --nats-key and --nats-ca, or --insecure");
}

#[test]
fn a_key_that_is_deleted_is_shut_out() {
    let (mut farm, data, cache) = (Farm::new(2), folder(), folder());
    let service = farm.coordinator(data.path());
    let _workers = ["worker-1", "worker-2"].map(|name| farm.worker(name));
    wait_for_workers(&service, 2);
    let list = farm.of("nats/workers.conf");
    let before = fs::read_to_string(&list).expect("the list");
    let mut lines: Vec<&str> = before.lines().collect();
    let name = lines.iter().position(|line| line.trim() == "# worker-2").expect("worker-2");
    lines.remove(name + 1);
    fs::write(&list, lines.join("\n")).expect("the list is written");
    farm.nats.reload();
    let began = Instant::now();
    let silent = || {
        let shown = service.get("/api/v1/workers").json();
        let workers = shown["workers"].as_array().expect("workers").clone();
        workers
            .iter()
            .any(|worker| worker["name"] == "worker-2" && worker["seen_ms_ago"].as_u64() > Some(1500))
    };
    while !silent() {
        assert!(began.elapsed() < PATIENCE, "it still works");
        std::thread::sleep(Duration::from_millis(50));
    }
    let options = farm.options("workers/worker-2");
    let options: Vec<&str> = options.iter().map(String::as_str).collect();
    let (code, told) = worker_output(&farm.url, cache.path(), &options);
    assert_eq!(code, Some(2));
    assert!(told.contains("the server does not know the key"), "{told}");
    // The other one works on, also after the server has died.
    farm.nats.kill();
    farm.nats.restart();
    let (job, hash) = still();
    let scene = service.upload_file(&shipped("cornell.json"));
    let id = service.submit(&scene, &job);
    assert_eq!(service.hashes(&id), [hash]);
}

/// All files of a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("a folder").flatten() {
            let list = if entry.path().is_dir() { &mut folders } else { &mut files };
            list.push(entry.path());
        }
    }
    files.sort();
    files
}

/// Runs raystream; returns what it says on standard error.
fn run(arguments: &[&str], code: i32) -> String {
    let output = raystream(arguments);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{told}");
    told
}

/// The modes of files, and of the folder that holds all.
const SECRET: u32 = 0o600;
const PUBLIC: u32 = 0o644;
const FOLDER: u32 = 0o700;

fn mode(path: &Path) -> u32 {
    use std::os::unix::fs::PermissionsExt;
    fs::metadata(path).expect("it is there").permissions().mode() & 0o777
}

#[test]
fn init_writes_what_the_guide_explains_and_secrets_are_the_owners() {
    let folder = folder();
    let path = folder.path().join("farm");
    run(&["farm", "init", text(&path), "--host", "farm.example", "--workers", "2"], 0);
    let files = files(&path);
    let names: Vec<&str> = files.iter().map(|file| text(file.strip_prefix(&path).expect("within"))).collect();
    let expected = [
        "coordinator/ca.pem",
        "coordinator/nats.key",
        "coordinator/raystream-serve.service",
        "farm.json",
        "nats/nats.conf",
        "nats/raystream-nats.service",
        "nats/server.key",
        "nats/server.pem",
        "nats/workers.conf",
        "workers/worker-1/ca.pem",
        "workers/worker-1/nats.key",
        "workers/worker-1/raystream-worker.service",
        "workers/worker-2/ca.pem",
        "workers/worker-2/nats.key",
        "workers/worker-2/raystream-worker.service",
    ];
    assert_eq!(names, expected);
    let guide = include_str!("../../../../docs/guide/many-machines.md");
    for (file, name) in files.iter().zip(names) {
        let in_guide = name.replace("worker-1", "NAME").replace("worker-2", "NAME");
        assert!(guide.contains(&format!("`{in_guide}`")), "the guide explains {in_guide}");
        assert_eq!(mode(file), if name.ends_with(".key") { SECRET } else { PUBLIC }, "{name}");
    }
    assert_eq!(mode(&path), FOLDER);
}

#[test]
fn init_and_key_overwrite_nothing() {
    let folder = folder();
    let path = folder.path().join("farm");
    let init = ["farm", "init", text(&path), "--host", "farm.example", "--workers", "2"];
    run(&init, 0);
    let content = || -> Vec<(PathBuf, Vec<u8>)> {
        files(&path).into_iter().map(|file| (file.clone(), fs::read(file).expect("a file"))).collect()
    };
    let before = content();
    assert!(run(&init, 2).contains("it is there already"));
    let key = |name: &str, code| run(&["farm", "key", name, "--folder", text(&path)], code);
    assert!(key("worker-2", 2).contains("it is there already"));
    assert!(key("../evil", 2).contains("letters, digits"));
    let told = run(&["farm", "key", "w", "--folder", text(folder.path())], 2);
    assert!(told.contains("farm.json: it cannot be read"), "{told}");
    for (option, value) in [("--host", "a b"), ("--host", "x\"y"), ("--farm", "a.>")] {
        let new = folder.path().join("new");
        assert!(run(&["farm", "init", text(&new), option, value], 2).contains(option));
        assert!(!new.exists());
    }
    assert!(content() == before, "nothing has changed");

    let list = path.join("nats/workers.conf");
    let whole = fs::read_to_string(&list).expect("the list");
    fs::write(&list, "users: []\n").expect("it is edited");
    assert!(key("w", 2).contains("the line is missing"));
    assert!(!path.join("workers/w").exists());
    fs::write(&list, format!("# mine\n{whole}")).expect("it is edited");
    key("w", 0);
    let longer = fs::read_to_string(&list).expect("the list");
    assert!(longer.starts_with("# mine\n") && longer.contains("    # w\n"), "{longer}");
    assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 1, "no folder is left");
}

#[test]
fn services_of_the_system_start_commands_that_parse() {
    let farm = Farm::new(1);
    let starts = [
        "nats/raystream-nats.service",
        "coordinator/raystream-serve.service",
        "workers/worker-1/raystream-worker.service",
    ];
    for name in starts {
        let service = fs::read_to_string(farm.of(name)).expect("a service");
        let command = service.lines().find_map(|line| line.strip_prefix("ExecStart=")).expect("a command");
        let words: Vec<&str> = command.split_whitespace().collect();
        if words[0] == "raystream" {
            let parsed = raystream_cli::command(&Registry::built_in()).try_get_matches_from(&words);
            assert!(parsed.is_ok(), "{name}: {command}: {}", parsed.expect_err("an error"));
        } else {
            assert_eq!(words, ["nats-server", "-c", "nats.conf"], "{command}");
        }
        assert!(service.contains("\n[Install]\nWantedBy=multi-user.target\n"), "{service}");
        // Others read neither the token nor what is kept.
        let private = [
            "StateDirectory=raystream\nStateDirectoryMode=0700\n",
            "StandardOutput=null\nStandardError=journal\n",
        ];
        let is_coordinator = name.starts_with("coordinator");
        assert!(!is_coordinator || private.iter().all(|line| service.contains(line)), "{service}");
    }
}

#[test]
fn services_of_the_system_are_valid_where_systemd_is() {
    if Command::new("systemd-analyze").arg("--version").output().is_err() {
        return println!("systemd-analyze is not installed: services are not verified");
    }
    let (farm, folder) = (Farm::new(1), folder());
    let program = env!("CARGO_BIN_EXE_raystream");
    for name in ["nats/raystream-nats", "coordinator/raystream-serve", "workers/worker-1/raystream-worker"] {
        let path = farm.of(&format!("{name}.service"));
        let text = fs::read_to_string(&path).expect("a service");
        // The program is where it was built, and not where a machine would have it.
        let text = text.replace("ExecStart=raystream ", &format!("ExecStart={program} "));
        let copy = folder.path().join(path.file_name().expect("a name"));
        fs::write(&copy, text).expect("it is written");
        let verified = Command::new("systemd-analyze").args(["verify", "--man=no"]).arg(&copy).output();
        let verified = verified.expect("systemd-analyze starts");
        let told = String::from_utf8_lossy(&verified.stderr).into_owned();
        let own = copy.file_name().expect("a name").to_str().expect("UTF-8");
        let complaints: Vec<&str> = told.lines().filter(|line| line.contains(own)).collect();
        assert!(complaints.is_empty(), "{name}: {complaints:?}");
    }
}
