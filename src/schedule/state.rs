//! The scheduler as a state machine: all jobs and all threads, without lock or clock. The service's threads drive it
//! under one mutex (`service.rs`), the simulator drives it from one thread (`tests/simulator.rs`).

use super::flights::Flights;
use super::head_start::HeadStarts;
use super::job::Job;
use super::report::{JobReport, Progress, ThreadKind};
use super::task::Work;
use super::task_times::TaskTimes;
use super::{Choice, JobError, Load, Priority, Rule, ServiceOptions, Sharing, TaskSize, Turn, policy};
use crate::stream::Resolve;
use std::collections::VecDeque;
use std::sync::Arc;

/// Identifies a job for as long as the service lives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct JobId(u64);

/// Where a job's result goes.
pub(super) trait Receiver: Send + Sync {
    /// The job has left the state, with this progress. Called under the lock, so that a job's progress is always in
    /// one of the two places.
    fn leave(&self, last: Progress);
    /// The job has ended, and its renderer has been dropped. Called once, without the lock.
    fn deliver(&self, outcome: Result<JobReport, JobError>);
}

/// A job to be admitted.
pub(super) struct Submission {
    pub job: Box<dyn Job>,
    pub work: Arc<dyn Work>,
    pub receiver: Arc<dyn Receiver>,
    pub priority: Priority,
    /// True if the job is a query, which does not count for the most jobs.
    pub is_query: bool,
}

/// Jobs of a lane are admitted without regard to those of other lanes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lane {
    Jobs,
    Queries,
    Interactive,
}

impl Lane {
    const ALL: [Self; 3] = [Self::Jobs, Self::Queries, Self::Interactive];
}

impl Submission {
    fn lane(&self) -> Lane {
        match self.priority {
            Priority::Interactive => Lane::Interactive,
            _ if self.is_query => Lane::Queries,
            _ => Lane::Jobs,
        }
    }
}

/// What a thread does next.
pub(super) enum Next {
    /// Do the task in the thread's slot ([`Work::work`]), then call [`State::finish`].
    Work(Arc<dyn Work>),
    /// Suspend until [`State::is_asleep`] is false, then call [`State::next`] again.
    Sleep,
    /// Return.
    Exit,
}

/// What the thread that changed the state has to do once it has released the lock.
#[derive(Default)]
pub(super) struct Effects {
    /// Threads to wake: at most one of each kind.
    pub wake: [Option<usize>; 2],
    /// True if to wake all threads.
    pub wake_all: bool,
    /// Jobs that have ended.
    pub ended: Vec<Ended>,
    /// Answers of devices for which no job waits any more.
    pub dropped: Vec<Box<dyn Resolve>>,
}

/// A job that has left the state. Dropping it runs the renderer's own code.
pub(super) struct Ended {
    pub submission: Submission,
    pub outcome: Result<JobReport, JobError>,
}

struct Admitted {
    id: JobId,
    submission: Submission,
    /// [`Turn::served`] where the job's head start ends.
    own_turn: u64,
    submitted_ns: u64,
    /// When the job was admitted, and each thread's idle time up to then.
    begin_ns: u64,
    idle_ns: Vec<u64>,
    /// When the last tile had been spawned, and each thread's idle time up to then.
    tail_ns: Option<u64>,
    tail_idle_ns: Vec<u64>,
}

#[derive(Clone, Default)]
struct Thread {
    task: Option<Running>,
    /// When the thread was suspended, if it is.
    asleep_ns: Option<u64>,
    /// Woken, but has not called [`State::next`] yet.
    waking: bool,
    /// Time suspended so far.
    idle_ns: u64,
}

#[derive(Clone, Copy)]
struct Running {
    job: JobId,
    kind: RunningKind,
    start_ns: u64,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum RunningKind {
    /// A task of the job.
    Task(Rule),
    /// The device thread waits for a bundle of the job, which may have left.
    Wait,
}

/// What a thread does next.
#[derive(Clone, Copy)]
enum Chosen {
    Task(Choice),
    /// Waits for the bundle that was submitted first.
    Wait,
}

pub(super) struct State {
    hosts: usize,
    /// Host threads first.
    threads: Vec<Thread>,
    /// Suspended threads by kind. The last to be suspended is on top, since its cache is warmest.
    sleepers: [Vec<usize>; 2],
    /// Threads of each kind that have been woken and have not called [`State::next`] yet.
    waking: [usize; 2],
    /// The most jobs of each lane.
    most: [usize; Lane::ALL.len()],
    sharing: Sharing,
    head_starts: HeadStarts,
    /// Registered interactive clients.
    clients: usize,
    jobs: Vec<Admitted>,
    /// The turns of `jobs`, in the same order.
    turns: Vec<Turn>,
    flights: Flights,
    /// In the order of submission.
    waiting: VecDeque<Admitted>,
    next_id: u64,
    closing: bool,
    effects: Effects,
}

impl State {
    pub fn new(options: &ServiceOptions) -> Self {
        let &ServiceOptions { host_threads, device_thread, max_jobs, max_queries, sharing, .. } = options;
        let device_threads = usize::from(device_thread);
        assert!(
            host_threads > 0 && max_jobs > 0 && max_queries > 0,
            "a service has a thread and room for a job"
        );
        Self {
            hosts: host_threads,
            threads: vec![Thread::default(); host_threads + device_threads],
            sleepers: [Vec::with_capacity(host_threads), Vec::with_capacity(device_threads)],
            waking: [0; 2],
            most: [max_jobs, max_queries, max_queries],
            sharing,
            head_starts: HeadStarts::default(),
            clients: 0,
            jobs: Vec::with_capacity(max_jobs),
            turns: Vec::with_capacity(max_jobs),
            flights: Flights::default(),
            waiting: VecDeque::new(),
            next_id: 0,
            closing: false,
            effects: Effects::default(),
        }
    }

    /// Admits a job, or queues it while there are as many of its lane as may run.
    pub fn submit(&mut self, submission: Submission, now_ns: u64) -> JobId {
        assert!(!self.closing, "a closed service takes no jobs");
        let id = JobId(self.next_id);
        self.next_id += 1;
        // With room for all threads, so that nothing is allocated while a frame is under way.
        let threads = self.threads.len();
        let job = Admitted {
            id,
            submission,
            own_turn: 0,
            submitted_ns: now_ns,
            begin_ns: now_ns,
            idle_ns: Vec::with_capacity(threads),
            tail_ns: None,
            tail_idle_ns: Vec::with_capacity(threads),
        };
        self.waiting.push_back(job);
        self.admit(now_ns);
        self.wake_for_work(now_ns);
        id
    }

    /// Registers an interactive client, or with `false` takes it off the list.
    pub fn register(&mut self, is_there: bool) {
        self.clients = if is_there { self.clients + 1 } else { self.clients - 1 };
    }

    /// Changes a job's priority, unless it has ended. A job that runs goes on running, whatever its new lane has.
    pub fn set_priority(&mut self, id: JobId, priority: Priority, now_ns: u64) {
        if let Some(job) = self.waiting.iter_mut().find(|job| job.id == id) {
            job.submission.priority = priority;
        } else if let Some(index) = self.index(id).filter(|&index| self.turns[index].priority != priority) {
            self.jobs[index].submission.priority = priority;
            let served = self.turns[index].served.max(self.least_served(priority));
            self.turns[index] = Turn { priority, served, ..self.turns[index] };
        }
        self.admit(now_ns);
        self.wake_for_work(now_ns);
    }

    /// Spawns no more tiles of a job, unless it has ended.
    pub fn stop(&mut self, id: JobId, now_ns: u64) {
        self.change(id, now_ns, |job| job.stop());
    }

    /// Cancels a job, unless it has ended.
    pub fn cancel(&mut self, id: JobId, now_ns: u64) {
        self.change(id, now_ns, |job| job.abandon(JobError::Cancelled));
    }

    fn change(&mut self, id: JobId, now_ns: u64, change: impl Fn(&mut dyn Job)) {
        if let Some(index) = self.waiting.iter().position(|job| job.id == id) {
            let job = &mut self.waiting[index].submission.job;
            change(&mut **job);
            if job.is_over() {
                let mut job = self.waiting.remove(index).expect("the job that was found");
                job.begin(now_ns, &self.threads);
                self.end(job, now_ns);
            }
        } else if let Some(index) = self.index(id) {
            change(&mut *self.jobs[index].submission.job);
            self.after_change(index, now_ns);
        }
        self.wake_for_work(now_ns);
    }

    /// How far a job is; `None` if it has left.
    pub fn progress(&self, id: JobId) -> Option<Progress> {
        let job = self.jobs.iter().chain(&self.waiting).find(|job| job.id == id)?;
        Some(job.submission.job.progress())
    }

    /// Cancels all jobs and has all threads return.
    pub fn close(&mut self, now_ns: u64) {
        self.closing = true;
        let ids: Vec<_> = self.waiting.iter().chain(&self.jobs).map(|job| job.id).collect();
        for id in ids {
            self.cancel(id, now_ns);
        }
        for thread in 0..self.threads.len() {
            self.wake(thread, now_ns);
        }
        self.effects.wake_all = true;
    }

    /// All jobs, for a scheduler that is broken: no thread comes back to them.
    pub fn abandon(&mut self) -> Vec<Submission> {
        let jobs = std::mem::take(&mut self.jobs).into_iter().chain(std::mem::take(&mut self.waiting));
        jobs.map(|job| job.submission).collect()
    }

    /// What a thread without a task does next.
    pub fn next(&mut self, thread: usize, now_ns: u64) -> Next {
        assert!(self.threads[thread].task.is_none(), "a thread has one task at a time");
        let kind = ThreadKind::of(thread, self.hosts) as usize;
        if std::mem::take(&mut self.threads[thread].waking) {
            self.waking[kind] -= 1;
        }
        // The device thread of a service that closes waits for the bundles that are with devices.
        let choice = self.choose(kind).filter(|chosen| !self.closing || matches!(chosen, Chosen::Wait));
        let next = if let Some(chosen) = choice {
            Next::Work(self.start(thread, chosen, now_ns))
        } else if self.closing {
            Next::Exit
        } else {
            self.threads[thread].asleep_ns = Some(now_ns);
            self.sleepers[kind].push(thread);
            Next::Sleep
        };
        self.wake_for_work(now_ns);
        next
    }

    /// A thread that has finished its task does something else before it calls [`State::next`].
    pub fn pause(&mut self, now_ns: u64) {
        self.wake_for_work(now_ns);
    }

    /// As [`State::next`] for a thread that stays awake: `None` if there is no task for it now.
    pub fn try_next(&mut self, thread: usize, now_ns: u64) -> Option<Arc<dyn Work>> {
        let kind = ThreadKind::of(thread, self.hosts) as usize;
        let choice = self.choose(kind).filter(|_| !self.closing)?;
        let work = self.start(thread, choice, now_ns);
        self.wake_for_work(now_ns);
        Some(work)
    }

    /// A thread that has been woken cannot come; another that is awake, and is about to call [`State::next`], will wake
    /// it again if there is work.
    pub fn decline(&mut self, thread: usize, now_ns: u64) {
        let kind = ThreadKind::of(thread, self.hosts) as usize;
        self.waking[kind] -= usize::from(std::mem::take(&mut self.threads[thread].waking));
        self.threads[thread].asleep_ns = Some(now_ns);
        self.sleepers[kind].push(thread);
    }

    /// True if a suspended thread has not been woken yet.
    pub fn is_asleep(&self, thread: usize) -> bool {
        self.threads[thread].asleep_ns.is_some()
    }

    fn start(&mut self, thread: usize, chosen: Chosen, now_ns: u64) -> Arc<dyn Work> {
        let (job, kind, work) = match chosen {
            Chosen::Task(choice) => {
                let (job, work) = self.start_task(thread, choice);
                (job, RunningKind::Task(choice.rule), work)
            }
            Chosen::Wait => {
                let (job, work) = self.flights.start_wait(self.flights.len());
                (job, RunningKind::Wait, work)
            }
        };
        self.threads[thread].task = Some(Running { job, kind, start_ns: now_ns });
        work
    }

    fn start_task(&mut self, thread: usize, choice: Choice) -> (JobId, Arc<dyn Work>) {
        let size = self.task_size();
        let job = &mut self.jobs[choice.job];
        let rays = job.submission.job.start(thread, choice.rule, size);
        let (id, work) = (job.id, Arc::clone(&job.submission.work));
        let served = &mut self.turns[choice.job].served;
        self.head_starts.count(rays, job.own_turn.saturating_sub(*served).min(rays));
        *served += rays;
        self.refresh_view(choice.job);
        (id, work)
    }

    /// A thread has done its task; it calls [`State::next`] before it releases the lock. `cpu_ns` is what
    /// [`Work::work`] returned.
    pub fn finish(&mut self, thread: usize, now_ns: u64, cpu_ns: Option<u64>) {
        let task = self.threads[thread].task.take().expect("a thread finishes what it has started");
        if task.kind == RunningKind::Wait {
            self.finish_wait(thread, (task.start_ns, now_ns));
            return;
        }
        let index = self.index(task.job).expect("a job stays until its tasks are done");
        let job = &mut self.jobs[index].submission.job;
        let times = TaskTimes { start_ns: task.start_ns, end_ns: now_ns, cpu_ns };
        if let Some(bundle) = job.finish(thread, self.flights.next_id(), times) {
            self.flights.push(task.job, bundle);
        }
        self.after_change(index, now_ns);
    }

    fn finish_wait(&mut self, thread: usize, (start_ns, now_ns): (u64, u64)) {
        let (bundle, job, answers) = self.flights.finish_wait();
        let Some(index) = self.index(job) else {
            self.effects.dropped.extend(answers.into_iter().flat_map(Result::unwrap_or_default));
            return;
        };
        let job = &mut self.jobs[index].submission.job;
        job.count_wait(thread, now_ns - start_ns);
        if let Some(answers) = answers {
            self.effects.dropped.extend(job.end_bundle(thread, bundle, answers, now_ns));
            self.after_change(index, now_ns);
        }
    }

    /// What the caller has to do now that the state has changed; to be taken after every call, under the lock.
    pub fn take_effects(&mut self) -> Effects {
        std::mem::take(&mut self.effects)
    }

    fn index(&self, id: JobId) -> Option<usize> {
        self.jobs.iter().position(|job| job.id == id)
    }

    fn load(&self) -> Load {
        let submits =
            |thread: &&Thread| thread.task.is_some_and(|task| task.kind == RunningKind::Task(Rule::Submit));
        let submitting = self.threads[self.hosts..].iter().filter(submits).count();
        Load { hosts: self.hosts, queued: self.flights.len() + submitting }
    }

    /// Tasks are small while an interactive client is registered or an interactive job runs.
    fn task_size(&self) -> TaskSize {
        let interactive = |turn: &Turn| turn.priority == Priority::Interactive;
        let is_small = self.clients > 0 || self.turns.iter().any(interactive);
        if is_small { TaskSize::Small } else { TaskSize::Large }
    }

    fn choose(&self, kind: usize) -> Option<Chosen> {
        if kind == ThreadKind::Host as usize {
            return policy::choose(&self.turns, self.load(), self.sharing).map(Chosen::Task);
        }
        let bundle = policy::choose_bundle(&self.turns, self.load(), self.sharing).map(Chosen::Task);
        bundle.or_else(|| self.flights.may_be_waited_for().then_some(Chosen::Wait))
    }

    /// Wakes one thread of each kind that has work, unless a thread of the kind is waking already. The woken thread
    /// calls this too: so no wake-up is missing, and each finds work unless a running thread was faster.
    fn wake_for_work(&mut self, now_ns: u64) {
        for kind in [ThreadKind::Host as usize, ThreadKind::Device as usize] {
            if self.waking[kind] == 0
                && let Some(&thread) = self.sleepers[kind].last()
                && self.choose(kind).is_some()
            {
                self.wake(thread, now_ns);
                self.effects.wake[kind] = Some(thread);
            }
        }
    }

    fn wake(&mut self, thread: usize, now_ns: u64) {
        let Some(since_ns) = self.threads[thread].asleep_ns.take() else { return };
        let kind = ThreadKind::of(thread, self.hosts) as usize;
        self.threads[thread].idle_ns += now_ns - since_ns;
        self.threads[thread].waking = true;
        self.waking[kind] += 1;
        self.sleepers[kind].retain(|&sleeper| sleeper != thread);
    }

    /// After a change to a job: ends the job if it is over, and admits the next.
    fn after_change(&mut self, index: usize, now_ns: u64) {
        self.refresh_view(index);
        let job = &mut self.jobs[index];
        if job.tail_ns.is_none() && job.submission.job.all_spawned() {
            job.tail_ns = Some(now_ns);
            job.tail_idle_ns.extend(self.threads.iter().map(|thread| thread.idle_ns(now_ns)));
        }
        self.end_if_over(index, now_ns);
        self.admit(now_ns);
    }

    fn refresh_view(&mut self, index: usize) {
        self.turns[index].view = self.jobs[index].submission.job.view();
    }

    fn admit(&mut self, now_ns: u64) {
        for lane in Lane::ALL {
            while let Some(index) = self.next_to_admit(lane) {
                let mut job = self.waiting.remove(index).expect("the job that was found");
                job.begin(now_ns, &self.threads);
                // As if it had had one turn less than the least served job, but for its head start: it is served at
                // once, but with 0 it would get all threads until it had caught up.
                let priority = job.submission.priority;
                let least = self.least_served(priority);
                job.own_turn = least - least % policy::TURN_RAYS;
                let served = job.own_turn - self.head_starts.take();
                self.turns.push(Turn { view: job.submission.job.view(), priority, served });
                self.jobs.push(job);
                // A job without tiles is over at once.
                self.end_if_over(self.jobs.len() - 1, now_ns);
            }
        }
    }

    /// The job of a lane that is admitted next, if there is one and the lane has room: the oldest of those with the
    /// highest priority.
    fn next_to_admit(&self, lane: Lane) -> Option<usize> {
        let running = self.jobs.iter().filter(|job| job.submission.lane() == lane).count();
        let waiting = self.waiting.iter().enumerate().filter(|(_, job)| job.submission.lane() == lane);
        let next = waiting.min_by_key(|(_, job)| job.submission.priority);
        next.map(|(index, _)| index).filter(|_| running < self.most[lane as usize])
    }

    /// Rays given to the job of a priority that has got the fewest. The first job counts as if it had had a turn, so
    /// that others can have had less.
    fn least_served(&self, priority: Priority) -> u64 {
        let turns = self.turns.iter().filter(|turn| turn.priority == priority);
        turns.map(|turn| turn.served).min().map_or(policy::TURN_RAYS, |least| least.max(policy::TURN_RAYS))
    }

    fn end_if_over(&mut self, index: usize, now_ns: u64) {
        if self.jobs[index].submission.job.is_over() {
            let job = self.jobs.remove(index);
            let turn = self.turns.remove(index);
            self.head_starts.give_back(job.own_turn.saturating_sub(turn.served));
            self.end(job, now_ns);
        }
    }

    fn end(&mut self, job: Admitted, now_ns: u64) {
        let Admitted { mut submission, submitted_ns, begin_ns, idle_ns, tail_ns, tail_idle_ns, .. } = job;
        let outcome = submission.job.outcome(begin_ns).map(|mut report| {
            report.wall_s = (now_ns - begin_ns) as f64 * 1e-9;
            report.waited_s = (begin_ns - submitted_ns) as f64 * 1e-9;
            let idle_s = |thread: usize, before: &[u64]| {
                before.get(thread).map_or(0.0, |ns| (self.threads[thread].idle_ns(now_ns) - ns) as f64 * 1e-9)
            };
            for (thread, report) in report.threads.iter_mut().enumerate() {
                report.idle_s = idle_s(thread, &idle_ns);
                report.tail_idle_s = idle_s(thread, &tail_idle_ns);
            }
            if let Some(tail_ns) = tail_ns.filter(|&tail_ns| tail_ns < now_ns) {
                report.tail_s = (now_ns - tail_ns) as f64 * 1e-9;
                let idle_s: f64 = report.threads[..self.hosts].iter().map(|thread| thread.tail_idle_s).sum();
                report.tail_idle_share = (idle_s / (report.tail_s * self.hosts as f64)).min(1.0);
            }
            report
        });
        submission.receiver.leave(submission.job.progress());
        self.effects.ended.push(Ended { submission, outcome });
    }

    #[cfg(test)]
    pub fn check(&self) {
        for job in &self.jobs {
            job.submission.job.check();
        }
        for (job, turn) in self.jobs.iter().zip(&self.turns) {
            assert_eq!(job.submission.job.view(), turn.view, "views are current");
            assert_eq!(job.submission.priority, turn.priority, "and so are priorities");
        }
        for lane in Lane::ALL {
            assert!(self.next_to_admit(lane).is_none(), "no job waits while its lane has room");
        }
        for kind in [0, 1] {
            let work = !self.closing && self.choose(kind).is_some();
            let comes = |(index, thread): (usize, &Thread)| {
                ThreadKind::of(index, self.hosts) as usize == kind
                    && thread.task.is_none()
                    && thread.asleep_ns.is_none()
            };
            let none_comes = !self.threads.iter().enumerate().any(comes);
            let lost = work && none_comes && !self.sleepers[kind].is_empty();
            assert!(!lost, "while there is work and a thread sleeps, one is on its way to it");
            assert!(self.closing || self.waking[kind] <= 1, "and only one");
        }
    }

    #[cfg(test)]
    pub fn is_idle(&self) -> bool {
        self.jobs.is_empty() && self.waiting.is_empty()
    }
}

impl Admitted {
    fn begin(&mut self, now_ns: u64, threads: &[Thread]) {
        self.begin_ns = now_ns;
        self.idle_ns.extend(threads.iter().map(|thread| thread.idle_ns(now_ns)));
    }
}

impl Thread {
    fn idle_ns(&self, now_ns: u64) -> u64 {
        self.idle_ns + self.asleep_ns.map_or(0, |since_ns| now_ns - since_ns)
    }
}
