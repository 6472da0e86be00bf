//! What went otherwise than planned while a command ran, and the exit code that follows.

use super::Outcome;

/// Unplanned events, one sentence each.
#[derive(Debug, Default)]
pub struct Events {
    /// Failures after which the result is right all the same.
    recovered: Vec<String>,
    /// What the result lacks.
    incomplete: Vec<String>,
}

impl Events {
    /// Notes failures after which the result is right all the same, each once.
    pub fn recover(&mut self, events: impl IntoIterator<Item = String>) {
        for event in events {
            if !self.recovered.contains(&event) {
                self.recovered.push(event);
            }
        }
    }

    /// Notes what the result lacks.
    pub fn lack(&mut self, events: impl IntoIterator<Item = String>) {
        self.incomplete.extend(events);
    }

    /// True if the result is what was asked for.
    pub fn is_complete(&self) -> bool {
        self.incomplete.is_empty()
    }

    /// The exit code that follows. With `strict` a failure is told by it even if the result is right.
    pub fn outcome(&self, strict: bool) -> Outcome {
        let is_done = self.is_complete() && (self.recovered.is_empty() || !strict);
        if is_done { Outcome::Done } else { Outcome::Degraded }
    }

    /// All sentences, for statistics.
    pub fn all(&self) -> Vec<String> {
        self.recovered.iter().chain(&self.incomplete).cloned().collect()
    }

    /// Tells them on standard error.
    pub fn print(&self) {
        for event in &self.recovered {
            stderr_line!("recovered: {event}");
        }
        for event in &self.incomplete {
            stderr_line!("incomplete: {event}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_a_result_lacks_makes_it_incomplete() {
        let code = |events: &Events| [false, true].map(|strict| events.outcome(strict).exit_code());
        let mut events = Events::default();
        assert_eq!(code(&events), [0, 0]);
        events.recover(["the GPU was lost".to_owned(), "the GPU was lost".to_owned()]);
        assert_eq!((code(&events), events.all().len()), ([0, 1], 1));
        events.lack(["stopped".to_owned()]);
        assert_eq!((code(&events), events.is_complete()), ([1, 1], false));
    }
}
