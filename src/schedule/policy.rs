//! Who does what next: a pure function of list lengths, load and limits (RA section 3). No lock, no
//! clock, no job's types.

use super::Limits;

/// Which units trace a job's rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Host threads alone.
    Cpu,
    /// The device alone, for as long as it lives; then the host threads.
    Gpu,
    /// The device, helped by host threads that have nothing better to do.
    Hybrid,
}

/// What a thread may be asked to do for a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// RA 1: add a tile's camera rays to a stream of NEEDMORE or EMPTY.
    Spawn,
    /// RA 2: shade a stream of SHADE into one of NEEDMORE or EMPTY.
    Shade,
    /// RA 3: trace a chunk of the stream in the job slot, or of one from TRACE.
    Trace,
    /// RA 4: trace a stream of NEEDMORE, small as it is.
    Flush,
    /// A dispatch thread's only task: feed a stream to the device.
    Dispatch,
}

/// The order in which a job's rules are tried. Siblings to measure against each other; the picture is
/// the same under all of them, and so is the proof in the README: it rests on what each rule
/// requires, not on their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Policy {
    /// RA's rules as numbered: camera rays first, so that long chains of rays start early.
    RayAccelerator,
    /// RA's variant without a GPU (section 5): shade at once what has been traced, while it is in the
    /// cache; camera rays only when there is no full stream to trace.
    ShadeFirst,
}

impl Policy {
    /// What RA does with that unit.
    pub fn of(unit: Unit) -> Self {
        match unit {
            Unit::Cpu => Self::ShadeFirst,
            Unit::Gpu | Unit::Hybrid => Self::RayAccelerator,
        }
    }

    fn order(self) -> [Rule; 4] {
        match self {
            Self::RayAccelerator => [Rule::Spawn, Rule::Shade, Rule::Trace, Rule::Flush],
            Self::ShadeFirst => [Rule::Shade, Rule::Trace, Rule::Spawn, Rule::Flush],
        }
    }
}

/// How threads are shared between jobs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sharing {
    /// Every job gets the same share: the one that has been served the fewest rays is next.
    #[default]
    Fair,
    /// The oldest job gets all it can use, later ones fill its gaps: for frames that are wanted in
    /// the order of their submission.
    FirstIn,
}

/// What the policy sees of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct View {
    /// Who traces; [`Unit::Cpu`] when the device has been lost.
    pub unit: Unit,
    /// The order of rules.
    pub policy: Policy,
    /// Whether the job is over but for tasks under way: it gets no more.
    pub ended: bool,
    /// Tiles not yet spawned.
    pub tiles_left: u64,
    /// Whether one more tile fits into N.
    pub tile_fits: bool,
    /// Streams in NEEDMORE.
    pub need_more: usize,
    /// Streams in TRACE.
    pub trace: usize,
    /// Whether the stream in the job slot has rays to hand out.
    pub slot: bool,
    /// Streams in SHADE.
    pub shade: usize,
    /// Tasks under way.
    pub tasks: usize,
    /// Rays that have been given to threads so far, counted at each task.
    pub served: u64,
}

/// What the policy sees of the threads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Load {
    /// Dispatch threads without a task.
    pub idle_dispatchers: usize,
}

/// What to do for which job (an index into the views).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choice {
    /// The job.
    pub job: usize,
    /// The task.
    pub rule: Rule,
}

impl View {
    /// Whether the rule's condition holds. That of `Flush` includes that there is nothing to shade
    /// and nothing in the slot; the bound on small streams rests on it.
    fn allows(&self, rule: Rule, load: Load) -> bool {
        match rule {
            Rule::Spawn => self.tiles_left > 0 && self.tile_fits,
            Rule::Shade => self.shade > 0,
            Rule::Trace => match self.unit {
                Unit::Cpu => self.slot || self.trace > 0,
                Unit::Hybrid => self.slot || (self.trace > 0 && load.idle_dispatchers == 0),
                Unit::Gpu => false,
            },
            Rule::Flush => {
                self.need_more > 0
                    && self.shade == 0
                    && !self.slot
                    && match self.unit {
                        Unit::Cpu => self.trace == 0,
                        Unit::Hybrid => true,
                        Unit::Gpu => false,
                    }
            }
            Rule::Dispatch => match self.unit {
                Unit::Cpu => false,
                Unit::Hybrid => self.trace > 0,
                // Nobody else would trace the last small streams: take them when no more will come.
                Unit::Gpu => {
                    self.trace > 0
                        || (self.need_more > 0 && self.shade == 0 && !self.allows(Rule::Spawn, load))
                }
            },
        }
    }

    fn host_rule(&self, load: Load, flush: bool) -> Option<Rule> {
        let mut order = self.policy.order().into_iter();
        order.find(|&rule| (flush || rule != Rule::Flush) && self.allows(rule, load))
    }
}

/// A host thread's next task. A job's small streams wait for other jobs' better work while tasks
/// under way may still add to them, and no longer: so none starves.
pub fn choose(views: &[View], load: Load, sharing: Sharing) -> Option<Choice> {
    pick(views, sharing, |view| view.host_rule(load, view.tasks == 0))
        .or_else(|| pick(views, sharing, |view| view.host_rule(load, true)))
}

/// A dispatch thread's next task.
pub fn choose_dispatch(views: &[View], load: Load, sharing: Sharing) -> Option<Choice> {
    pick(views, sharing, |view| view.allows(Rule::Dispatch, load).then_some(Rule::Dispatch))
}

/// Asks the jobs in the order of their turn; `views` stand in the order of submission.
fn pick(views: &[View], sharing: Sharing, rule: impl Fn(&View) -> Option<Rule>) -> Option<Choice> {
    let mut choice: Option<(u64, Choice)> = None;
    for (job, view) in views.iter().enumerate().filter(|(_, view)| !view.ended) {
        if choice.is_some_and(|(served, _)| sharing == Sharing::FirstIn || served <= view.served) {
            continue;
        }
        if let Some(rule) = rule(view) {
            choice = Some((view.served, Choice { job, rule }));
        }
    }
    choice.map(|(_, choice)| choice)
}

/// Streams for each host thread into which what is left of a job is divided at its tail.
pub(super) const TAIL_STREAMS: usize = 4;

/// Paths from which a stream counts as full when `left` paths of its job have not ended or not begun: the
/// limit, and at the tail as few as give every host thread [`TAIL_STREAMS`] streams. One thread shades
/// a stream, so the last ones had better be small. Never grows while a job goes on. A device is not
/// served with small streams.
pub fn threshold(left: u64, host_threads: usize, device_is_fed: bool, limits: &Limits) -> usize {
    if device_is_fed {
        return limits.threshold;
    }
    let share = left.div_ceil((TAIL_STREAMS * host_threads) as u64);
    share.max(limits.chunk_rays as u64).min(limits.threshold as u64) as usize
}

/// How many rays a host thread takes at once when `waiting` rays of its job wait to be traced or
/// spawned. While a device is fed, RA's small chunks, lest a host thread be away for long when the
/// device needs it. Without one, as much as leaves every thread two more chunks of the same size:
/// large while there is much to do (a tracer of streams likes them large), small at the tail.
pub fn chunk_rays(waiting: u64, host_threads: usize, device_is_fed: bool, limits: &Limits) -> usize {
    if device_is_fed {
        return limits.chunk_rays;
    }
    let share = waiting / (2 * host_threads as u64);
    let share = share.clamp(limits.chunk_rays as u64, limits.chunk_rays_most as u64) as usize;
    share.next_multiple_of(limits.chunk_rays).min(limits.chunk_rays_most)
}

#[cfg(test)]
mod tests {
    use super::*;

    const IDLE: View = View {
        unit: Unit::Hybrid,
        policy: Policy::RayAccelerator,
        ended: false,
        tiles_left: 0,
        tile_fits: true,
        need_more: 0,
        trace: 0,
        slot: false,
        shade: 0,
        tasks: 0,
        served: 0,
    };
    const ALL: View = View { tiles_left: 1, need_more: 1, trace: 1, slot: true, shade: 1, ..IDLE };
    const BUSY: Load = Load { idle_dispatchers: 0 };
    const HUNGRY: Load = Load { idle_dispatchers: 1 };

    fn rule(view: View, load: Load) -> Option<Rule> {
        choose(&[view], load, Sharing::Fair).map(|choice| choice.rule)
    }

    #[test]
    fn rules_come_in_the_order_of_the_paper() {
        assert_eq!(rule(ALL, BUSY), Some(Rule::Spawn));
        assert_eq!(rule(View { tile_fits: false, ..ALL }, BUSY), Some(Rule::Shade));
        let traced = View { tiles_left: 0, shade: 0, ..ALL };
        assert_eq!(rule(traced, BUSY), Some(Rule::Trace));
        let small = View { slot: false, trace: 0, ..traced };
        assert_eq!(rule(small, BUSY), Some(Rule::Flush));
        assert_eq!(rule(IDLE, BUSY), None);
        assert_eq!(rule(View { ended: true, ..ALL }, BUSY), None);
    }

    #[test]
    fn host_threads_leave_full_streams_to_a_hungry_device() {
        let full = View { trace: 1, ..IDLE };
        assert_eq!(rule(full, HUNGRY), None);
        assert_eq!(rule(full, BUSY), Some(Rule::Trace));
        // What one host thread has opened others help to finish.
        assert_eq!(rule(View { slot: true, ..IDLE }, HUNGRY), Some(Rule::Trace));
        assert_eq!(rule(View { need_more: 1, ..full }, HUNGRY), Some(Rule::Flush));
    }

    #[test]
    fn the_device_alone_traces_unless_lost() {
        let view = View { unit: Unit::Gpu, trace: 1, need_more: 1, ..IDLE };
        assert_eq!(rule(view, BUSY), None);
        assert_eq!(rule(View { unit: Unit::Cpu, ..view }, BUSY), Some(Rule::Trace));
        let dispatch = |view| choose_dispatch(&[view], HUNGRY, Sharing::Fair).is_some();
        let small = View { trace: 0, ..view };
        assert!(dispatch(view) && dispatch(small));
        assert!(!dispatch(View { tiles_left: 1, ..small }) && !dispatch(View { shade: 1, ..small }));
        assert!(!dispatch(View { unit: Unit::Hybrid, ..small }), "a host thread flushes it");
        assert!(!dispatch(View { unit: Unit::Cpu, ..view }));
    }

    #[test]
    fn small_streams_are_flushed_only_when_nothing_else_is_there() {
        // The README's bound on small streams rests on this, whatever the order of rules.
        for unit in [Unit::Cpu, Unit::Hybrid] {
            let small = View { unit, need_more: 1, ..IDLE };
            assert!(small.allows(Rule::Flush, BUSY));
            assert!(!View { shade: 1, ..small }.allows(Rule::Flush, BUSY));
            assert!(!View { slot: true, ..small }.allows(Rule::Flush, BUSY));
            let full = View { trace: 1, ..small };
            assert_eq!(full.allows(Rule::Flush, BUSY), unit == Unit::Hybrid);
        }
    }

    #[test]
    fn without_a_device_shading_follows_tracing() {
        let view = View { unit: Unit::Cpu, policy: Policy::of(Unit::Cpu), ..ALL };
        assert_eq!(rule(view, BUSY), Some(Rule::Shade));
        assert_eq!(rule(View { shade: 0, ..view }, BUSY), Some(Rule::Trace));
        assert_eq!(rule(View { shade: 0, slot: false, trace: 0, ..view }, BUSY), Some(Rule::Spawn));
    }

    #[test]
    fn the_job_served_least_is_next() {
        let views = [View { served: 5, ..ALL }, View { served: 3, ..ALL }, View { served: 3, ..ALL }];
        assert_eq!(choose(&views, BUSY, Sharing::Fair).map(|c| c.job), Some(1));
        assert_eq!(choose(&views, BUSY, Sharing::FirstIn).map(|c| c.job), Some(0));
        assert_eq!(choose_dispatch(&views, BUSY, Sharing::Fair).map(|c| c.job), Some(1));
    }

    #[test]
    fn a_small_stream_waits_only_while_it_may_grow() {
        let small = View { need_more: 1, ..IDLE };
        let other = View { served: 9, ..ALL };
        let first = |tasks| {
            let choice = choose(&[View { tasks, ..small }, other], BUSY, Sharing::Fair);
            choice.map(|choice| choice.job)
        };
        assert_eq!(first(1), Some(1));
        assert_eq!(first(0), Some(0));
        assert_eq!(rule(View { tasks: 1, ..small }, BUSY), Some(Rule::Flush));
    }

    #[test]
    fn streams_are_large_until_the_tail() {
        let limits = Limits::for_tests();
        let full = |left| threshold(left, 2, false, &limits);
        assert_eq!((full(u64::MAX), full(0)), (limits.threshold, limits.chunk_rays));
        assert_eq!(full(8 * 3000 - 1), 3000);
        assert_eq!(threshold(0, 2, true, &limits), limits.threshold);
        // Those that were full earlier are so now: what is left makes no more than these.
        for left in (1..300_000).step_by(37) {
            assert!(full(left) <= full(left + 37));
            assert!(left / full(left) as u64 <= (limits.in_flight / limits.threshold).max(8) as u64 + 4);
        }
    }

    #[test]
    fn chunks_are_large_until_the_tail() {
        let limits = Limits::for_tests();
        let chunk = |waiting| chunk_rays(waiting, 4, false, &limits);
        assert_eq!(chunk(u64::MAX), limits.chunk_rays_most);
        assert_eq!(chunk(0), limits.chunk_rays);
        assert_eq!(chunk(8 * 3 * limits.chunk_rays as u64 - 1), 3 * limits.chunk_rays);
        assert_eq!(chunk_rays(u64::MAX, 4, true, &limits), limits.chunk_rays);
        let sizes: Vec<_> = (0..100_000).step_by(997).map(chunk).collect();
        assert!(sizes.is_sorted() && sizes.iter().all(|size| size % limits.chunk_rays == 0));
    }
}
