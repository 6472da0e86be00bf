//! `raystream farm init` and `farm key`: a folder for each machine of a farm, with its keys, certificates, settings and
//! its service of the system. Nothing that is there is overwritten.

use super::systemd;
use crate::Outcome;
use crate::service::args::{FarmInitArgs, FarmKeyArgs};
use anyhow::{Context, Result, bail};
use raystream_service::bus::nats::{Certificates, NatsKey, settings};
use serde::{Deserialize, Serialize};
use std::fs::{self, OpenOptions};
use std::io::Write;
use std::net::IpAddr;
use std::path::Path;
use tempfile::TempDir;

/// Folders of a farm, and the files in them.
const SERVER: &str = "nats";
const COORDINATOR: &str = "coordinator";
const WORKERS: &str = "workers";
const RECORD: &str = "farm.json";
const WORKER_LIST: &str = "workers.conf";
const KEY: &str = "nats.key";
const AUTHORITY: &str = "ca.pem";

/// What `farm key` needs to know of a farm.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Record {
    /// Its name.
    pub farm: String,
    /// The address of its server.
    pub url: String,
}

/// `raystream farm init`.
pub fn init(args: &FarmInitArgs) -> Result<Outcome> {
    let FarmInitArgs { folder, host, port, workers, farm } = args;
    check_name(farm, "--farm")?;
    let hosts = if host.is_empty() { vec![super::host()] } else { host.clone() };
    hosts.iter().try_for_each(|host| check_host(host))?;
    if fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some()) || folder.is_file() {
        bail!("{}: it is there already; name a new folder", folder.display());
    }
    let first = &hosts[0];
    let url = match first.parse() {
        Ok(IpAddr::V6(address)) => format!("tls://[{address}]:{port}"),
        _ => format!("tls://{first}:{port}"),
    };
    let record = Record { farm: farm.clone(), url };
    let new = new_folder(folder)?;
    let write = || fill(new.path(), &record, &hosts, *port, *workers);
    write().with_context(|| format!("{}: the farm cannot be written", folder.display()))?;
    publish(new, folder)?;
    let shown = folder.display();
    stdout_line!("{shown}/{SERVER}: for {first}, in /etc/raystream/{SERVER}");
    stdout_line!(
        "{shown}/{COORDINATOR}: for the machine of `raystream serve`, in /etc/raystream/{COORDINATOR}"
    );
    stdout_line!("{shown}/{WORKERS}/NAME: for a worker each, in /etc/raystream/worker");
    Ok(Outcome::Done)
}

/// Writes all files of a farm.
fn fill(folder: &Path, record: &Record, hosts: &[String], port: u16, workers: u32) -> Result<()> {
    let Record { farm, .. } = record;
    for name in [SERVER, COORDINATOR, WORKERS] {
        fs::create_dir(folder.join(name))?;
    }
    write(&folder.join(RECORD), &format!("{}\n", serde_json::to_string_pretty(record)?), Access::All)?;
    let own = ["localhost", "127.0.0.1", "::1"].map(str::to_owned);
    let mut names = hosts.to_vec();
    names.extend(own.into_iter().filter(|name| !hosts.contains(name)));
    let Certificates { authority, server, server_key } = Certificates::generate(farm, &names)?;

    let coordinator = NatsKey::generate()?;
    let of = |name: &str| folder.join(COORDINATOR).join(name);
    write(&of(KEY), &format!("{}\n", coordinator.seed), Access::Owner)?;
    write(&of(AUTHORITY), &authority, Access::All)?;
    write(&of("raystream-serve.service"), &systemd::of_coordinator(record), Access::All)?;

    let of = |name: &str| folder.join(SERVER).join(name);
    write(&of("server.pem"), &server, Access::All)?;
    write(&of("server.key"), &server_key, Access::Owner)?;
    write(&of("nats.conf"), &settings::of_farm(farm, port, &coordinator.public), Access::All)?;
    write(&of("raystream-nats.service"), &systemd::of_server(), Access::All)?;

    let mut list = settings::no_workers();
    for number in 1..=workers {
        let name = format!("worker-{number}");
        let key = NatsKey::generate()?;
        let worker = folder.join(WORKERS).join(&name);
        fs::create_dir(&worker)?;
        fill_worker(&worker, record, &name, &key, &authority)?;
        list = settings::with_worker(&list, farm, &name, &key.public).context("the list is a new one")?;
    }
    write(&of(WORKER_LIST), &list, Access::All)
}

fn fill_worker(folder: &Path, record: &Record, name: &str, key: &NatsKey, authority: &str) -> Result<()> {
    write(&folder.join(KEY), &format!("{}\n", key.seed), Access::Owner)?;
    write(&folder.join(AUTHORITY), authority, Access::All)?;
    write(&folder.join("raystream-worker.service"), &systemd::of_worker(record, name), Access::All)
}

/// `raystream farm key`.
pub fn key(args: &FarmKeyArgs) -> Result<Outcome> {
    let FarmKeyArgs { name, folder } = args;
    check_name(name, "the worker's name")?;
    let read = |path: &Path| {
        let told = || format!("{}: it cannot be read; is {} a farm?", path.display(), folder.display());
        fs::read_to_string(path).with_context(told)
    };
    let record_path = folder.join(RECORD);
    let record: Record = serde_json::from_str(&read(&record_path)?)
        .with_context(|| format!("{}: it is not what `raystream farm init` writes", record_path.display()))?;
    let worker = folder.join(WORKERS).join(name);
    if worker.exists() {
        bail!("{}: it is there already; choose another name", worker.display());
    }
    let authority = read(&folder.join(COORDINATOR).join(AUTHORITY))?;
    let list_path = folder.join(SERVER).join(WORKER_LIST);
    let key = NatsKey::generate()?;
    let list =
        settings::with_worker(&read(&list_path)?, &record.farm, name, &key.public).with_context(|| {
            format!(
                "{}: the line is missing before which `raystream farm key` adds workers",
                list_path.display()
            )
        })?;
    let new = new_folder(&worker)?;
    fill_worker(new.path(), &record, name, &key, &authority)
        .with_context(|| format!("{}: the key cannot be written", worker.display()))?;
    publish(new, &worker)?;
    if let Err(error) = raystream::files::write(&list_path, |file| file.write_all(list.as_bytes())) {
        // No server knows it.
        let _ = fs::remove_dir_all(&worker);
        return Err(error.into());
    }
    stdout_line!("{}: for the worker, in /etc/raystream/worker", worker.display());
    stdout_line!("{}: for the server, which is then reloaded", list_path.display());
    Ok(Outcome::Done)
}

/// Names become names of subjects and folders.
fn check_name(name: &str, what: &str) -> Result<()> {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_';
    if name.is_empty() || name.len() > 64 || name.starts_with('-') || !name.bytes().all(is_plain) {
        bail!("{what} {name:?}: up to 64 letters, digits, - and _ make a name");
    }
    Ok(())
}

fn check_host(host: &str) -> Result<()> {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'.';
    let is_name = !host.is_empty() && !host.starts_with(['-', '.']) && host.bytes().all(is_plain);
    if !is_name && host.parse::<IpAddr>().is_err() {
        bail!("--host {host:?}: write the name or the address of the machine of the NATS server");
    }
    Ok(())
}

/// Who may read a file.
#[derive(Clone, Copy)]
enum Access {
    Owner,
    All,
}

/// Writes a file that is not there.
fn write(path: &Path, text: &str, access: Access) -> Result<()> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(
        &mut options,
        match access {
            Access::Owner => 0o600,
            Access::All => 0o644,
        },
    );
    #[cfg(not(unix))]
    let _ = access;
    let written = options.open(path).and_then(|mut file| {
        file.write_all(text.as_bytes())?;
        file.sync_all()
    });
    written.with_context(|| format!("{}: it cannot be written", path.display()))
}

/// A folder beside another one that is not there yet, which it becomes when all is in it. Only its owner may enter.
fn new_folder(folder: &Path) -> Result<TempDir> {
    let parent = match folder.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    builder.prefix(".raystream-farm-");
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o700));
    let made = fs::create_dir_all(parent).and_then(|()| builder.tempdir_in(parent));
    made.with_context(|| format!("{}: no folder can be made there", parent.display()))
}

/// Gives a folder its name.
fn publish(new: TempDir, folder: &Path) -> Result<()> {
    fs::rename(new.path(), folder).with_context(|| format!("{}: it cannot be made", folder.display()))?;
    // It is not there any more under its first name.
    let _ = new.keep();
    Ok(())
}
