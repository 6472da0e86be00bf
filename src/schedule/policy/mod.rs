//! Which task a free thread takes next: a pure function of list lengths, load and limits (RA section 3). It has no
//! lock and no clock, and knows no job's types.
//!
//! `table.rs` holds what the policies differ in; this file holds what is common to them: the conditions of the rules,
//! the choice between jobs, and the sizes of streams and chunks.

mod device;
mod table;

use super::{Limits, Priority};
pub use device::{DevicePace, Line, PathLengths, QUEUED};
use std::time::Duration;
pub use table::{MOONRAY_SMALL, Policy};

/// The units that trace a job's rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Unit {
    /// Host threads alone.
    Cpu,
    /// The device alone until it is lost, then host threads.
    Gpu,
    /// The device, and host threads that have nothing better to do.
    Hybrid,
}

/// A kind of task that a thread takes from a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// RA 1: add a tile's camera rays to a stream of NEEDMORE or EMPTY.
    Spawn,
    /// RA 2: shade a stream of SHADE into a stream of NEEDMORE or EMPTY.
    Shade,
    /// RA 3: trace a chunk of the stream in the job slot, or of one from TRACE.
    Trace,
    /// RA 4: trace a chunk of a stream of NEEDMORE, although the stream is not full.
    Flush,
    /// Before the others: make the answers of a stream that a device has traced.
    Resolve,
    /// After the others: take a stream back that a device has not traced, so that host threads trace it.
    Reclaim,
    /// The device thread: submit a bundle of streams.
    Submit,
}

/// The pace at which a unit has traced or shaded a job's rays so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pace {
    /// Rays and shadow rays.
    pub rays: u64,
    /// Nanoseconds that they took, added up over the unit's threads.
    pub ns: u64,
}

impl Pace {
    /// Nanoseconds that one thread would take for `rays`; `None` before the unit has traced any.
    pub fn ns_for(self, rays: u64) -> Option<u64> {
        let ns = u128::from(self.ns) * u128::from(rays) / u128::from(self.rays.max(1));
        (self.rays > 0).then(|| ns.min(u128::from(u64::MAX)) as u64)
    }

    /// Rays that one thread would take `ns` for; `None` before the unit has traced any.
    pub fn rays_in(self, ns: u64) -> Option<u64> {
        let rays = u128::from(self.rays) * u128::from(ns) / u128::from(self.ns.max(1));
        (self.rays > 0).then(|| rays.min(u128::from(u64::MAX)) as u64)
    }
}

impl std::ops::AddAssign for Pace {
    fn add_assign(&mut self, other: Self) {
        self.rays += other.rays;
        self.ns += other.ns;
    }
}

/// A rule that shares threads between jobs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Sharing {
    /// Every job gets the same share: the job that has been served the fewest rays is next, counted in turns of
    /// [`TURN_RAYS`].
    #[default]
    Fair,
    /// The oldest job gets all threads that it can use, later ones fill the gaps. For frames that are wanted in the
    /// order of their submission.
    FirstIn,
}

/// Rays that threads take from a job before they turn to one that has been served less, if jobs share fairly. A task
/// finds its job's streams in the caches only if the tasks before it were of the same job. Counted at each task, so a
/// ray that is spawned, traced and shaded counts three times.
pub const TURN_RAYS: u64 = 1 << 22;

/// A job as the policy sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct View {
    /// The units that trace; [`Unit::Cpu`] once the device is lost.
    pub unit: Unit,
    /// The job's policy.
    pub policy: Policy,
    /// True if the job has been cancelled or has failed: it gets no more tasks.
    pub ended: bool,
    /// Tiles not yet spawned.
    pub tiles_left: u64,
    /// True if the paths of one more tile fit into N.
    pub tile_fits: bool,
    /// Streams in NEEDMORE.
    pub need_more: usize,
    /// Rays and shadow rays in the fullest stream of NEEDMORE.
    pub need_more_rays: usize,
    /// Streams in TRACE.
    pub trace: usize,
    /// Rays and shadow rays in TRACE.
    pub trace_rays: usize,
    /// Rays in TRACE and in the job slot, and those of tiles not yet spawned.
    pub waiting_rays: u64,
    /// True if the stream in the job slot has rays to hand out.
    pub slot: bool,
    /// Streams that a device has traced and that are not resolved.
    pub answered: usize,
    /// Streams in SHADE.
    pub shade: usize,
    /// Tasks under way.
    pub tasks: usize,
    /// The pace at which host threads trace.
    pub cpu: Pace,
    /// The pace at which host threads shade.
    pub shading: Pace,
    /// The pace of the device, and the host's cost of its rays.
    pub device: DevicePace,
    /// Rays and shadow rays of a bundle.
    pub bundle_rays: usize,
    /// Bundles with the device.
    pub on_device: usize,
    /// Rays and shadow rays in these.
    pub on_device_rays: u64,
    /// Streams in these that no host thread has taken back.
    pub with_device: usize,
    /// Streams that a device has failed to trace.
    pub failed: usize,
    /// Paths that have not ended or not begun.
    pub paths_left: u64,
    /// Lengths of paths so far.
    pub lengths: PathLengths,
}

/// A job as the choice between jobs sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Turn {
    /// The job as the policy sees it.
    pub view: View,
    /// The job's urgency now.
    pub priority: Priority,
    /// Rays given to threads so far, counted at each task.
    pub served: u64,
}

impl Turn {
    /// Turns that the job has had.
    fn turns(&self) -> u64 {
        self.served / TURN_RAYS
    }
}

/// The threads as the policy sees them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Load {
    /// Host threads.
    pub hosts: usize,
    /// Bundles with devices, of all jobs.
    pub queued: usize,
}

/// Size of host threads' tasks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum TaskSize {
    /// As is fastest for the job.
    Large,
    /// Short enough that an interactive client, which waits for the end of one, does not notice.
    Small,
}

/// A task, and the job that it is taken from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choice {
    /// Index of the job's turn.
    pub job: usize,
    /// The kind of task.
    pub rule: Rule,
}

impl View {
    /// True if the rule's condition holds. The condition of [`Rule::Flush`] includes that SHADE and the job slot are
    /// empty; the README's bound on small streams rests on this.
    pub(super) fn allows(&self, rule: Rule, load: Load) -> bool {
        let policy = self.policy.row();
        match rule {
            Rule::Spawn => self.tiles_left > 0 && self.tile_fits,
            Rule::Shade => self.shade > 0,
            Rule::Trace => match self.unit {
                Unit::Cpu => self.slot || self.trace > 0,
                Unit::Hybrid => self.slot || (self.trace > 0 && (policy.hosts_open)(self, load)),
                // Opened before the device was ready.
                Unit::Gpu => self.slot,
            },
            Rule::Flush => {
                self.is_short_of_work()
                    && match self.unit {
                        Unit::Cpu => self.trace == 0,
                        Unit::Hybrid => !(policy.device_flushes)(self, load),
                        Unit::Gpu => false,
                    }
            }
            Rule::Resolve => self.answered > 0,
            Rule::Submit => match self.unit {
                Unit::Cpu => false,
                Unit::Hybrid => {
                    (self.trace > 0 && self.has_room(load) && (policy.device_opens)(self, load))
                        || (self.may_be_flushed_to_device(load) && (policy.device_flushes)(self, load))
                }
                // Host threads do not trace here, so the device takes the last small streams once no more will come.
                Unit::Gpu => (self.trace > 0 && self.has_room(load)) || self.may_be_flushed_to_device(load),
            },
            Rule::Reclaim => self.failed > 0 || self.unit == Unit::Hybrid && self.may_be_reclaimed(load),
        }
    }

    /// NEEDMORE has streams; SHADE, what waits to be resolved and the job slot are empty.
    fn is_short_of_work(&self) -> bool {
        self.need_more > 0 && self.shade == 0 && self.answered == 0 && !self.slot
    }

    /// NEEDMORE has streams; all other lists are empty, the device has none, and no tile can be spawned.
    fn may_be_flushed_to_device(&self, load: Load) -> bool {
        self.is_short_of_work() && self.trace == 0 && self.on_device == 0 && !self.allows(Rule::Spawn, load)
    }

    fn host_rule(&self, load: Load, flush: bool) -> Option<Rule> {
        let row = self.policy.row();
        let before = if self.unit == Unit::Hybrid { (row.before)(self, load) } else { None };
        if self.failed > 0 {
            return Some(Rule::Reclaim);
        }
        let order = std::iter::once(Rule::Resolve).chain(before).chain(row.order);
        let mut order = order.chain([Rule::Reclaim]);
        let waits = |rule| matches!(rule, Rule::Flush | Rule::Reclaim);
        order.find(|&rule| (flush || !waits(rule)) && self.allows(rule, load))
    }
}

/// A host thread's next task. `turns` stand in the order of admission.
///
/// Among jobs of the same priority, a job that has tasks under way flushes its small streams only if no job has better
/// work, because those tasks may still fill the streams. A job without tasks under way need not wait for that, so no
/// job starves among its equals.
pub fn choose(turns: &[Turn], load: Load, sharing: Sharing) -> Option<Choice> {
    Priority::ALL.into_iter().find_map(|priority| {
        pick(turns, priority, sharing, |view| view.host_rule(load, view.tasks == 0))
            .or_else(|| pick(turns, priority, sharing, |view| view.host_rule(load, true)))
    })
}

/// The job whose bundle the device thread submits next, if there is room for any. `turns` stand in the order of
/// admission.
pub fn choose_bundle(turns: &[Turn], load: Load, sharing: Sharing) -> Option<Choice> {
    let bundle = |view: &View| view.allows(Rule::Submit, load).then_some(Rule::Submit);
    Priority::ALL.into_iter().find_map(|priority| pick(turns, priority, sharing, bundle))
}

/// How long the device thread waits for a bundle before it looks whether there is one to submit: hardly at all while
/// there is room for one. `queued` bundles are with devices.
pub fn wait_time(queued: usize) -> Duration {
    if queued < QUEUED { Duration::from_micros(200) } else { Duration::from_secs(1) }
}

/// The first job of a priority, in the order that `sharing` gives, for which `rule` finds a task.
fn pick(
    turns: &[Turn],
    priority: Priority,
    sharing: Sharing,
    rule: impl Fn(&View) -> Option<Rule>,
) -> Option<Choice> {
    let mut choice: Option<(&Turn, Choice)> = None;
    let able = |turn: &Turn| turn.priority == priority && !turn.view.ended;
    for (job, turn) in turns.iter().enumerate().filter(|(_, turn)| able(turn)) {
        let is_before = |other: &Turn| sharing == Sharing::FirstIn || other.turns() <= turn.turns();
        if choice.is_some_and(|(other, _)| is_before(other)) {
            continue;
        }
        if let Some(rule) = rule(&turn.view) {
            choice = Some((turn, Choice { job, rule }));
        }
    }
    choice.map(|(_, choice)| choice)
}

/// How long a small task takes.
pub(super) const SMALL_TASK_NS: u64 = 500_000;

/// The most rays of a host thread's task, for a job whose threads trace or shade at this pace. Never fewer than the
/// smallest chunk, which would be much slower; as many until the pace is known.
pub fn most_rays(size: TaskSize, pace: Pace, limits: &Limits) -> usize {
    match size {
        TaskSize::Large => usize::MAX,
        TaskSize::Small => (pace.rays_in(SMALL_TASK_NS).unwrap_or(0) as usize).max(limits.chunk_rays),
    }
}

/// Streams for each host thread into which the rest of a job is divided at its tail.
pub(super) const TAIL_STREAMS: usize = 4;

/// Paths from which a stream counts as full when `left` paths of its job have not ended or not begun.
///
/// This is the limit, and at the tail as few paths as give every host thread `TAIL_STREAMS` streams: one thread shades
/// a stream, so a large last stream would leave the other threads idle. Never grows while a job goes on.
pub fn threshold(left: u64, host_threads: usize, limits: &Limits) -> usize {
    if !limits.shrink_streams {
        return limits.threshold;
    }
    let share = left.div_ceil((TAIL_STREAMS * host_threads) as u64);
    share.max(limits.chunk_rays as u64).min(limits.threshold as u64) as usize
}

/// Rays that a host thread traces at once when `waiting` rays of its job wait to be traced or spawned.
///
/// They are as many rays as leave every thread two more chunks of the same size: large while much is left to do, since
/// large sub-streams trace faster, and small at the tail.
pub fn chunk_rays(waiting: u64, host_threads: usize, limits: &Limits) -> usize {
    let share = waiting / (2 * host_threads as u64);
    let share = share.clamp(limits.chunk_rays as u64, limits.chunk_rays_most as u64) as usize;
    share.next_multiple_of(limits.chunk_rays).min(limits.chunk_rays_most)
}
