//! What a NATS server is told: its limits, and for a farm whose keys may do what.
//!
//! Workers have an account of their own, and pass to the coordinator's only what `accounts` names. Permissions to
//! publish would not be enough: they say nothing of the subject to which an answer goes. Within the workers' account a
//! subject of the coordinator's means nothing.

use super::messages::MOST_BYTES;
use super::subjects::{bell, inbox, live, question};
use std::path::Path;

const _: () = assert!(MOST_BYTES == 1_048_576, "LIMITS says the same");

/// How often a worker may answer a request of the coordinator, and how late. Tiles have a deadline far below.
const RESPONSES: &str = "allow_responses: { max: 1, expires: \"2s\" }";

/// What all servers are told. Messages are of the size that servers take unless they are told otherwise; a client that
/// is silent for ten seconds has gone.
const LIMITS: &str = "max_payload: 1048576\nping_interval: \"5s\"\nping_max: 2\nwrite_deadline: \"5s\"\n";

/// The line of the list of workers before which new ones stand.
const END: &str = "    # `raystream farm key` adds workers before this line.";

/// The settings of a server of this machine's own address, for a coordinator and workers of these public keys.
pub(super) fn of_own_server(
    port: u16,
    folder: &Path,
    farm: &str,
    coordinator: &str,
    workers: &[String],
) -> String {
    // A name in quotes, as the server reads them.
    let path = folder.join("pid").display().to_string();
    let process = format!("\"{}\"", path.replace('\\', "\\\\").replace('"', "\\\""));
    let workers: String = workers.iter().map(|key| worker(farm, key)).collect();
    format!(
        "listen: \"127.0.0.1:{port}\"\npid_file: {process}\n{LIMITS}{}",
        accounts(farm, coordinator, &format!("users: [\n{workers}]"))
    )
}

/// The accounts of a farm: that of the coordinator, and that of the workers, which `workers` lists.
fn accounts(farm: &str, coordinator: &str, workers: &str) -> String {
    let (questions, bell, tiles) = (question(farm, "*", "*"), bell(farm), live(farm, "*"));
    format!(
        "accounts {{\n    \
         # The key of the coordinator may do everything in its account.\n    \
         COORDINATOR {{\n        users: [ {{ nkey: {coordinator} }} ]\n        \
         exports: [\n            \
         {{ service: \"{questions}\", accounts: [WORKERS] }}\n            \
         {{ stream: \"{bell}\", accounts: [WORKERS] }}\n        ]\n        \
         imports: [ {{ service: {{ account: WORKERS, subject: \"{tiles}\" }} }} ]\n    }}\n    \
         # Workers reach what is passed on, and nothing else, whatever they name as their inbox.\n    \
         WORKERS {{\n        {workers}\n        \
         imports: [\n            \
         {{ service: {{ account: COORDINATOR, subject: \"{questions}\" }} }}\n            \
         {{ stream: {{ account: COORDINATOR, subject: \"{bell}\" }} }}\n        ]\n        \
         exports: [ {{ service: \"{tiles}\", accounts: [COORDINATOR] }} ]\n    }}\n}}\n"
    )
}

/// A worker of a list: it asks under its own key, and hears what is meant for it.
fn worker(farm: &str, public_key: &str) -> String {
    let (ask, inbox) = (question(farm, "*", public_key), inbox(public_key));
    let (tiles, bell) = (live(farm, public_key), bell(farm));
    format!(
        "    {{ nkey: {public_key}, permissions: {{ publish: {{ allow: [\"{ask}\"] }}, \
         subscribe: {{ allow: [\"{inbox}.>\", \"{tiles}\", \"{bell}\"] }}, {RESPONSES} }} }}\n"
    )
}

/// The settings of a farm's server, `nats.conf`. It reads the files `workers.conf`, `server.pem` and `server.key`
/// beside it, and is started in their folder.
pub fn of_farm(farm: &str, port: u16, coordinator: &str) -> String {
    format!(
        "# The NATS server of the farm {farm}. Start it in this folder: nats-server -c nats.conf\n\
         server_name: \"{farm}\"\nlisten: \"0.0.0.0:{port}\"\n{LIMITS}\
         tls {{ cert_file: \"server.pem\", key_file: \"server.key\", timeout: 5 }}\n{}",
        accounts(farm, coordinator, "include \"workers.conf\"")
    )
}

/// The list of workers without any, `workers.conf`.
pub fn no_workers() -> String {
    format!(
        "# The keys of workers. To revoke a key, delete its line, and have the server read this file again:\n\
         # systemctl reload raystream-nats, or the signal HUP.\nusers: [\n{END}\n]\n"
    )
}

/// A list of workers with one more. None if it has no place for it.
pub fn with_worker(list: &str, farm: &str, name: &str, public_key: &str) -> Option<String> {
    let worker = format!("    # {name}\n{}", worker(farm, public_key));
    let end = list.find(END)?;
    Some(format!("{}{worker}{}", &list[..end], &list[end..]))
}

#[cfg(test)]
mod unit_tests {
    use super::*;

    #[test]
    fn workers_are_added_to_what_is_there() {
        let one = with_worker(&no_workers(), "farm", "one", "UONE").expect("a place");
        let edited = format!("# mine\n{one}");
        let two = with_worker(&edited, "farm", "two", "UTWO").expect("a place");
        assert!(two.starts_with("# mine\n") && two.contains("# one\n") && two.contains("\"_INBOX.UTWO.>\""));
        assert_eq!(two.matches("nkey:").count(), 2);
        assert_eq!(with_worker("users: []", "farm", "one", "UONE"), None);
    }

    #[test]
    fn workers_may_do_what_they_need_and_nothing_else() {
        let list = with_worker(&no_workers(), "f", "one", "UONE").expect("a place");
        let allowed: Vec<&str> = list.split('"').skip(1).step_by(2).collect();
        assert_eq!(allowed, ["f.ask.*.UONE", "_INBOX.UONE.>", "f.live.UONE", "f.bell", "2s",]);
        assert!(list.contains(RESPONSES), "one answer to what it is asked");
    }
}
