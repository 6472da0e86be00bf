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

/// How work goes to units: the order in which a job's rules are tried, and who gets a full stream that
/// either unit could trace. Siblings to measure against each other; the picture is the same under all of
/// them, and so is the proof in the README: it rests on what each rule requires, not on their order.
/// ([`Unit::Cpu`] and [`Unit::Gpu`] leave nothing to share out.)
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Policy {
    /// RA's rules as numbered: camera rays first, so that long chains of rays start early; the device has
    /// every full stream while a dispatch thread is idle.
    RayAccelerator,
    /// RA's variant without a GPU (section 5): shade at once what has been traced, while it is in the
    /// cache; camera rays only when there is no full stream to trace.
    ShadeFirst,
    /// MoonRay's XPU mode: what a thread has gathered it brings to the device at once, unless
    /// [`MOONRAY_WAITING`] threads wait there already or the rays are no more than [`MOONRAY_SMALL`].
    MoonRay,
    /// Units get streams by how fast they have been so far, so that both end together: the device none
    /// that host threads would be through with earlier, and they none that the device would.
    MeasuredRate,
}

/// Threads that may wait for a device that serves another.
pub const MOONRAY_WAITING: usize = 3;

/// Rays too few to bring to a device.
pub const MOONRAY_SMALL: usize = 1024;

impl Policy {
    /// All policies.
    pub const ALL: [Self; 4] = [Self::RayAccelerator, Self::ShadeFirst, Self::MoonRay, Self::MeasuredRate];

    /// What RA does with that unit.
    pub fn of(unit: Unit) -> Self {
        match unit {
            Unit::Cpu => Self::ShadeFirst,
            Unit::Gpu | Unit::Hybrid => Self::RayAccelerator,
        }
    }

    /// The name that arguments and reports use.
    pub fn name(self) -> &'static str {
        match self {
            Self::RayAccelerator => "ra",
            Self::ShadeFirst => "shade-first",
            Self::MoonRay => "moonray",
            Self::MeasuredRate => "measured",
        }
    }

    fn order(self) -> [Rule; 4] {
        match self {
            Self::RayAccelerator | Self::MeasuredRate => [Rule::Spawn, Rule::Shade, Rule::Trace, Rule::Flush],
            Self::ShadeFirst | Self::MoonRay => [Rule::Shade, Rule::Trace, Rule::Spawn, Rule::Flush],
        }
    }

    /// Whether host threads may open a full stream. While they may not, the device may, and it has a
    /// dispatch thread that is idle or comes back: so nobody waits in vain.
    fn hosts_open(self, view: &View, load: Load) -> bool {
        match self {
            Self::RayAccelerator | Self::ShadeFirst => load.idle_dispatchers == 0,
            Self::MoonRay => !self.device_opens(view, load),
            Self::MeasuredRate => {
                !self.device_opens(view, load) || (load.idle_dispatchers == 0 && view.hosts_are_sooner(load))
            }
        }
    }

    /// Whether an idle dispatch thread may take a full stream.
    fn device_opens(self, view: &View, load: Load) -> bool {
        match self {
            Self::RayAccelerator | Self::ShadeFirst => true,
            // One is served, the others wait.
            Self::MoonRay => {
                let busy = load.dispatchers - load.idle_dispatchers;
                load.idle_dispatchers > 0 && busy.saturating_sub(1) < MOONRAY_WAITING
            }
            Self::MeasuredRate => view.device_is_back_in_time(load),
        }
    }

    /// Whether streams of NEEDMORE may go to the device when nothing else is to come.
    fn device_flushes(self, view: &View, load: Load) -> bool {
        self == Self::MoonRay && view.need_more_rays > MOONRAY_SMALL && self.device_opens(view, load)
    }
}

/// How fast a unit has traced a job's rays so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pace {
    /// Rays and shadow rays traced.
    pub rays: u64,
    /// What its threads needed for them, added up.
    pub ns: u64,
}

impl Pace {
    /// What one thread would need for so many rays; not known before there are any.
    pub fn ns_for(self, rays: u64) -> Option<u64> {
        let ns = u128::from(self.ns) * u128::from(rays) / u128::from(self.rays.max(1));
        (self.rays > 0).then(|| ns.min(u128::from(u64::MAX)) as u64)
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
    /// Rays and shadow rays in the fullest of them.
    pub need_more_rays: usize,
    /// Streams in TRACE.
    pub trace: usize,
    /// Rays and shadow rays in them.
    pub trace_rays: usize,
    /// Rays that wait to be traced (in TRACE and in the slot), and those of tiles not yet spawned.
    pub waiting_rays: u64,
    /// Whether the stream in the job slot has rays to hand out.
    pub slot: bool,
    /// Streams in SHADE.
    pub shade: usize,
    /// Tasks under way.
    pub tasks: usize,
    /// Rays that have been given to threads so far, counted at each task.
    pub served: u64,
    /// How fast host threads trace.
    pub cpu: Pace,
    /// How fast dispatch threads have streams traced; several may be with the device at a time.
    pub gpu: Pace,
}

/// What the policy sees of the threads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Load {
    /// Host threads.
    pub hosts: usize,
    /// Dispatch threads.
    pub dispatchers: usize,
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
    pub(super) fn allows(&self, rule: Rule, load: Load) -> bool {
        match rule {
            Rule::Spawn => self.tiles_left > 0 && self.tile_fits,
            Rule::Shade => self.shade > 0,
            Rule::Trace => match self.unit {
                Unit::Cpu => self.slot || self.trace > 0,
                Unit::Hybrid => self.slot || (self.trace > 0 && self.policy.hosts_open(self, load)),
                Unit::Gpu => false,
            },
            Rule::Flush => {
                self.is_short_of_work()
                    && match self.unit {
                        Unit::Cpu => self.trace == 0,
                        Unit::Hybrid => !self.policy.device_flushes(self, load),
                        Unit::Gpu => false,
                    }
            }
            Rule::Dispatch => match self.unit {
                Unit::Cpu => false,
                Unit::Hybrid => {
                    (self.trace > 0 && self.policy.device_opens(self, load))
                        || (self.nothing_is_to_come(load) && self.policy.device_flushes(self, load))
                }
                // Nobody else would trace the last small streams: take them when no more will come.
                Unit::Gpu => {
                    self.trace > 0
                        || (self.need_more > 0 && self.shade == 0 && !self.allows(Rule::Spawn, load))
                }
            },
        }
    }

    /// There are small streams, nothing to shade and nothing in the slot.
    fn is_short_of_work(&self) -> bool {
        self.need_more > 0 && self.shade == 0 && !self.slot
    }

    /// There are small streams and nothing else, nor a tile to spawn.
    fn nothing_is_to_come(&self, load: Load) -> bool {
        self.is_short_of_work() && self.trace == 0 && !self.allows(Rule::Spawn, load)
    }

    /// Rays of a stream of TRACE, on the average.
    fn stream_rays(&self) -> u64 {
        self.trace_rays as u64 / self.trace.max(1) as u64
    }

    /// Whether the device would have traced a stream before host threads were through with all that
    /// waits; assumed until both have been seen at work.
    fn device_is_back_in_time(&self, load: Load) -> bool {
        let device_ns = self.gpu.ns_for(self.stream_rays());
        let hosts_ns = self.cpu.ns_for(self.waiting_rays).map(|ns| ns / load.hosts.max(1) as u64);
        device_ns.zip(hosts_ns).is_none_or(|(device, hosts)| device <= hosts)
    }

    /// Whether host threads would have traced a stream before the device came round to it, all of its
    /// dispatch threads being busy; assumed until both have been seen at work.
    fn hosts_are_sooner(&self, load: Load) -> bool {
        let dispatchers = load.dispatchers.max(1) as u64;
        let hosts_ns = self.cpu.ns_for(self.stream_rays()).map(|ns| ns / load.hosts.max(1) as u64);
        // Those of TRACE and, half done on the average, those that are with the device.
        let ahead = self.trace_rays as u64 + dispatchers * self.stream_rays() / 2;
        let device_ns = self.gpu.ns_for(ahead).map(|ns| ns / dispatchers);
        device_ns.zip(hosts_ns).is_none_or(|(device, hosts)| hosts <= device)
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
/// limit, and at the tail as few as give every host thread `TAIL_STREAMS` streams. One thread shades
/// a stream, so the last ones had better be small. Never grows while a job goes on. A device is not
/// served with small streams.
pub fn threshold(left: u64, host_threads: usize, device_is_fed: bool, limits: &Limits) -> usize {
    if device_is_fed || !limits.shrink_streams {
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
