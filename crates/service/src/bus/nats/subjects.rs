//! Names of subjects. `P` is the farm's name, `KEY` a worker's public key.

/// What is asked of the coordinator: the third tokens of the subjects `P.ask.KIND.KEY`.
pub(super) const QUESTIONS: [&str; 9] =
    ["join", "report", "leave", "lease", "back", "files", "file", "result", "failure"];

/// The subject at which a worker is asked for tiles of live views, or that of all (`*`).
pub(super) fn live(farm: &str, key: &str) -> String {
    format!("{farm}.live.{key}")
}

/// The subject at which workers hear that there are units again.
pub(super) fn bell(farm: &str) -> String {
    format!("{farm}.bell")
}

/// What the inboxes of a process with a key begin with: no other process may read them.
pub(super) fn inbox(public_key: &str) -> String {
    format!("_INBOX.{public_key}")
}

/// True if a subject is an inbox. What comes through another account has one of the server's.
pub(super) fn is_inbox(subject: &str) -> bool {
    subject.starts_with("_INBOX.") || subject.starts_with("_R_.")
}

/// The subject of a question of a worker. The server lets its key publish to no other one.
pub(super) fn question(farm: &str, kind: &str, key: &str) -> String {
    format!("{farm}.ask.{kind}.{key}")
}

/// The subject of questions as older raystreams ask them, which have no key in it.
pub(super) fn old_question(farm: &str) -> String {
    format!("{farm}.ask.join")
}

/// What a question is and whose, by its subject.
pub(super) fn asked<'a>(farm: &str, subject: &'a str) -> Option<(&'a str, &'a str)> {
    let (kind, key) = subject.strip_prefix(farm)?.strip_prefix(".ask.")?.split_once('.')?;
    let is_key = !key.is_empty() && key.len() <= 64 && key.bytes().all(|byte| byte.is_ascii_alphanumeric());
    (QUESTIONS.contains(&kind) && is_key).then_some((kind, key))
}

#[cfg(test)]
mod unit_tests {
    use super::*;

    #[test]
    fn a_question_has_a_kind_and_a_key() {
        assert_eq!(asked("f", &question("f", "join", "UONE")), Some(("join", "UONE")));
        for wrong in
            ["f.ask.join", "f.ask.join.", "g.ask.join.U", "f.ask.join.U.V", "f.ask.all.U", "f.ask.join.*"]
        {
            assert_eq!(asked("f", wrong), None, "{wrong}");
        }
    }
}
