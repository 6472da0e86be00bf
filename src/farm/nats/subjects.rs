//! Names of the queue and of subjects. `P` is the farm's name.

use super::super::bus::Lane;

/// The API of JetStream.
pub(super) const API: &str = "$JS.API";

/// What is asked of the coordinator: the last tokens of the subjects `P.ask.*`.
pub(super) const QUESTIONS: [&str; 8] =
    ["join", "report", "leave", "start", "files", "file", "result", "failure"];

/// The subject at which a worker is asked for tiles of live views, or that of all.
pub(super) fn live(farm: &str, address: &str) -> String {
    format!("{farm}.live.{address}")
}

/// What the inboxes of a process with a key begin with: no other process may read them.
pub(super) fn inbox(public_key: &str) -> String {
    format!("_INBOX.{public_key}")
}

/// Whether a subject is an inbox. What comes through another account has one of the server's.
pub(super) fn is_inbox(subject: &str) -> bool {
    subject.starts_with("_INBOX.") || subject.starts_with("_R_.")
}

/// The stream of units.
pub(super) fn stream(farm: &str) -> String {
    format!("{}_WORK", farm.to_uppercase())
}

/// The subject at which the next unit of a lane is asked for.
pub(super) fn next(farm: &str, lane: Lane) -> String {
    format!("{API}.CONSUMER.MSG.NEXT.{}.{}", stream(farm), lane.name())
}

/// The subjects of what is said about leased units of a lane.
pub(super) fn acknowledgements(farm: &str, lane: Lane) -> String {
    format!("$JS.ACK.{}.{}.>", stream(farm), lane.name())
}

/// The subject of a question.
pub(super) fn question(farm: &str, kind: &str) -> String {
    format!("{farm}.ask.{kind}")
}
