//! What a NATS server is told: its limits, and for a farm whose keys may do what.
//!
//! Workers have an account of their own, and pass to the coordinator's only what `passed` names. Permissions to publish
//! would not be enough: they say nothing of the subject to which an answer goes, and an acknowledgement whose answer
//! goes to `$JS.API.STREAM.DELETE.P_WORK` deletes the queue. Within the workers' account that subject means nothing.

use super::super::bus::Lane;
use super::messages::MOST_BYTES;
use super::subjects::{QUESTIONS, acknowledgements, inbox, live, next, question};
use std::fmt::Write;
use std::path::Path;

const _: () = assert!(MOST_BYTES == 1_048_576, "LIMITS says the same");

/// How often a worker may answer a request of the coordinator, and how late. Tiles have a deadline far below.
const RESPONSES: &str = "allow_responses: { max: 1, expires: \"2s\" }";

/// What all servers are told. Messages are of the size that servers take unless they are told otherwise; a client that
/// is silent for ten seconds has gone.
const LIMITS: &str = "max_payload: 1048576\nping_interval: \"5s\"\nping_max: 2\nwrite_deadline: \"5s\"\n";

/// The line of the list of workers before which new ones stand.
const END: &str = "    # `raystream farm key` adds workers before this line.";

/// The settings of a server of this machine's own address.
pub(super) fn of_own_server(port: u16, folder: &Path) -> String {
    // A name in quotes, as the server reads them.
    let quoted = |name: &str| {
        let path = folder.join(name).display().to_string();
        format!("\"{}\"", path.replace('\\', "\\\\").replace('"', "\\\""))
    };
    let (store, process) = (quoted("store"), quoted("pid"));
    format!(
        "listen: \"127.0.0.1:{port}\"\npid_file: {process}\n{LIMITS}\
         jetstream {{ store_dir: {store}, max_mem: 64MB, max_file: 1GB }}\n"
    )
}

/// The subjects that workers pass to the coordinator's account, and whether there may be several answers.
fn passed(farm: &str) -> Vec<(String, bool)> {
    let questions = QUESTIONS.iter().map(|kind| (question(farm, kind), false));
    let next = Lane::ALL.into_iter().map(|lane| (next(farm, lane), true));
    let acknowledgements = Lane::ALL.into_iter().map(|lane| (acknowledgements(farm, lane), false));
    questions.chain(next).chain(acknowledgements).collect()
}

/// The settings of a farm's server, `nats.conf`. It reads the files `workers.conf`, `server.pem` and `server.key`
/// beside it, and is started in their folder.
pub fn of_farm(farm: &str, port: u16, coordinator: &str) -> String {
    let (mut exports, mut imports) = (String::new(), String::new());
    for (subject, is_stream) in passed(farm) {
        let response = if is_stream { ", response_type: stream" } else { "" };
        let _ = writeln!(exports, "            {{ service: \"{subject}\"{response}, accounts: [WORKERS] }}");
        let _ = writeln!(
            imports,
            "            {{ service: {{ account: COORDINATOR, subject: \"{subject}\" }} }}"
        );
    }
    let tiles = live(farm, "*");
    format!(
        "# The NATS server of the farm {farm}. Start it in this folder, and name one that keeps the queue:\n\
         # STATE_DIRECTORY=FOLDER nats-server -c nats.conf (with -sd it would not read settings again).\n\
         server_name: \"{farm}\"\nlisten: \"0.0.0.0:{port}\"\n{LIMITS}\
         tls {{ cert_file: \"server.pem\", key_file: \"server.key\", timeout: 5 }}\n\
         jetstream {{ store_dir: $STATE_DIRECTORY, max_mem: 64MB, max_file: 1GB }}\n\
         accounts {{\n    \
         # The key of the coordinator may do everything in its account, which holds the queue.\n    \
         COORDINATOR {{\n        jetstream: enabled\n        users: [ {{ nkey: {coordinator} }} ]\n        \
         exports: [\n{exports}        ]\n        \
         imports: [ {{ service: {{ account: WORKERS, subject: \"{tiles}\" }} }} ]\n    }}\n    \
         # Workers reach what is passed on, and nothing else, whatever they name as their inbox.\n    \
         WORKERS {{\n        include \"workers.conf\"\n        imports: [\n{imports}        ]\n        \
         exports: [ {{ service: \"{tiles}\", accounts: [COORDINATOR] }} ]\n    }}\n}}\n"
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
    let quoted = |subject: String| format!("\"{subject}\"");
    let publish: Vec<String> = passed(farm).into_iter().map(|(subject, _)| quoted(subject)).collect();
    let worker = format!(
        "    # {name}\n    {{ nkey: {public_key}, permissions: {{ publish: {{ allow: [{}] }}, \
         subscribe: {{ allow: [{}, {}] }}, {RESPONSES} }} }}\n",
        publish.join(", "),
        quoted(format!("{}.>", inbox(public_key))),
        quoted(live(farm, public_key)),
    );
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
        assert_eq!(
            allowed,
            [
                "f.ask.join",
                "f.ask.report",
                "f.ask.leave",
                "f.ask.start",
                "f.ask.files",
                "f.ask.file",
                "f.ask.result",
                "f.ask.failure",
                "$JS.API.CONSUMER.MSG.NEXT.F_WORK.hi",
                "$JS.API.CONSUMER.MSG.NEXT.F_WORK.lo",
                "$JS.ACK.F_WORK.hi.>",
                "$JS.ACK.F_WORK.lo.>",
                "_INBOX.UONE.>",
                "f.live.UONE",
                "2s",
            ]
        );
        assert!(list.contains(RESPONSES), "one answer to what it is asked");
    }
}
