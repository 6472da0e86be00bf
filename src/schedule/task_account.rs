//! Accounts of tasks under way.

use super::Rule;
use super::lists::Waits;
use super::report::TaskKind;

/// The share of a task under way in its job.
#[derive(Clone, Copy)]
pub(super) struct TaskAccount {
    pub rule: Rule,
    /// The task in the timeline. What the device thread does is seen there as what the device does.
    pub kind: Option<TaskKind>,
    /// Paths in flight in the task's streams, and those that it may spawn. 0 for a chunk, whose paths are counted with
    /// its stream.
    pub paths: usize,
    /// Rays and shadow rays in the task, for its record; 0 for a spawn task, whose rays are known at its end.
    pub rays: u64,
    /// Of a stream to be resolved.
    pub waits: Waits,
}

impl TaskAccount {
    pub fn new(rule: Rule, paths: usize, rays: u64) -> Self {
        let kind = match rule {
            Rule::Spawn => Some(TaskKind::Spawn),
            Rule::Shade => Some(TaskKind::Shade),
            Rule::Trace | Rule::Flush => Some(TaskKind::Trace),
            Rule::Resolve => Some(TaskKind::Resolve),
            Rule::Submit | Rule::Reclaim => None,
        };
        Self { rule, kind, paths, rays, waits: [0; 2] }
    }

    /// Of a tile whose rays are traced where they are.
    pub fn in_place(paths: usize) -> Self {
        Self { kind: Some(TaskKind::Trace), ..Self::new(Rule::Spawn, paths, 0) }
    }

    /// Streams that the task has, besides those of a bundle.
    #[cfg(test)]
    pub fn streams(&self) -> usize {
        match self.rule {
            Rule::Shade => 2,
            Rule::Spawn => usize::from(self.kind == Some(TaskKind::Spawn)),
            Rule::Resolve | Rule::Reclaim => 1,
            Rule::Trace | Rule::Flush | Rule::Submit => 0,
        }
    }
}
