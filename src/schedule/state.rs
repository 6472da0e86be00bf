//! The scheduler as a state machine: all jobs, all threads, no lock and no clock. Threads drive it
//! under one mutex (`service`), the simulator in one thread.

use super::job::Job;
use super::report::{JobReport, Progress, ThreadKind};
use super::task::Work;
use super::{Choice, JobError, Load, Rule, Sharing, View, policy};
use std::collections::VecDeque;
use std::sync::Arc;

/// Names a job for as long as the service lives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct JobId(u64);

/// Where a job's result goes.
pub(super) trait Receiver: Send + Sync {
    fn receive(&self, last: Progress, outcome: Result<JobReport, JobError>);
}

/// A job on its way in.
pub(super) struct Submission {
    pub job: Box<dyn Job>,
    pub work: Arc<dyn Work>,
    pub receiver: Arc<dyn Receiver>,
}

/// What a thread is to do.
pub(super) enum Next {
    /// `work` on the thread's desk, then [`State::finish`].
    Work(Arc<dyn Work>),
    /// Suspend until [`State::is_asleep`] is false, then ask again.
    Sleep,
    /// Return.
    Exit,
}

/// What a change of state asks of the thread that made it, once the lock is released.
#[derive(Default)]
pub(super) struct Aftermath {
    /// Threads to wake: at most one of each kind.
    pub wake: [Option<usize>; 2],
    /// Whether all threads are to be woken.
    pub wake_all: bool,
    /// Jobs that have ended.
    pub ended: Vec<Ended>,
}

/// A job that has ended, out of the state. Dropping it runs the renderer's own code.
pub(super) struct Ended {
    pub submission: Submission,
    pub last: Progress,
    pub outcome: Result<JobReport, JobError>,
}

struct Admitted {
    id: JobId,
    submission: Submission,
    submitted_ns: u64,
    /// When its turn came, and each thread's idle time up to then.
    begin_ns: u64,
    idle_ns: Vec<u64>,
    /// When its last tile was spawned, and each thread's idle time up to then.
    tail_ns: Option<u64>,
    tail_idle_ns: Vec<u64>,
}

#[derive(Clone, Default)]
struct Thread {
    task: Option<Running>,
    /// Since when the thread is suspended.
    asleep_ns: Option<u64>,
    /// Woken, but not yet here.
    stirring: bool,
    /// Time suspended so far.
    idle_ns: u64,
}

#[derive(Clone, Copy)]
struct Running {
    job: JobId,
    start_ns: u64,
}

pub(super) struct State {
    hosts: usize,
    /// Host threads first.
    threads: Vec<Thread>,
    /// Suspended threads by kind, the last to be suspended on top: its cache is warmest.
    sleepers: [Vec<usize>; 2],
    /// Threads of each kind that have been woken and have not yet come.
    stirring: [usize; 2],
    /// Dispatch threads with a task.
    dispatching: usize,
    max_jobs: usize,
    sharing: Sharing,
    jobs: Vec<Admitted>,
    /// Of the same jobs.
    views: Vec<View>,
    waiting: VecDeque<Admitted>,
    next_id: u64,
    closing: bool,
    aftermath: Aftermath,
}

/// Host threads come first.
pub(super) fn kind(thread: usize, hosts: usize) -> ThreadKind {
    if thread < hosts { ThreadKind::Host } else { ThreadKind::Dispatch }
}

impl State {
    pub fn new(hosts: usize, dispatchers: usize, max_jobs: usize, sharing: Sharing) -> Self {
        assert!(hosts > 0 && max_jobs > 0, "somebody works for at least one job");
        Self {
            hosts,
            threads: vec![Thread::default(); hosts + dispatchers],
            sleepers: [Vec::with_capacity(hosts), Vec::with_capacity(dispatchers)],
            stirring: [0; 2],
            dispatching: 0,
            max_jobs,
            sharing,
            jobs: Vec::with_capacity(max_jobs),
            views: Vec::with_capacity(max_jobs),
            waiting: VecDeque::new(),
            next_id: 0,
            closing: false,
            aftermath: Aftermath::default(),
        }
    }

    /// Takes a job in; it waits its turn when there are `max_jobs`.
    pub fn submit(&mut self, submission: Submission, now_ns: u64) -> JobId {
        assert!(!self.closing, "a closed service takes no jobs");
        let id = JobId(self.next_id);
        self.next_id += 1;
        // With room for all threads: nothing is allocated while a frame is under way.
        let threads = self.threads.len();
        let job = Admitted {
            id,
            submission,
            submitted_ns: now_ns,
            begin_ns: now_ns,
            idle_ns: Vec::with_capacity(threads),
            tail_ns: None,
            tail_idle_ns: Vec::with_capacity(threads),
        };
        self.waiting.push_back(job);
        self.admit(now_ns);
        self.ring(now_ns);
        id
    }

    /// Stops a job if there still is one of that name: no more tiles.
    pub fn stop(&mut self, id: JobId, now_ns: u64) {
        self.change(id, now_ns, |job| job.stop());
    }

    /// Cancels a job if there still is one of that name.
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
            self.settle(index, now_ns);
        }
        self.ring(now_ns);
    }

    /// How far a job is, if there still is one of that name.
    pub fn progress(&self, id: JobId) -> Option<Progress> {
        let job = self.jobs.iter().chain(&self.waiting).find(|job| job.id == id)?;
        Some(job.submission.job.progress())
    }

    /// Cancels all jobs and sends all threads home.
    pub fn close(&mut self, now_ns: u64) {
        self.closing = true;
        let ids: Vec<_> = self.waiting.iter().chain(&self.jobs).map(|job| job.id).collect();
        for id in ids {
            self.cancel(id, now_ns);
        }
        for thread in 0..self.threads.len() {
            self.wake(thread, now_ns);
        }
        self.aftermath.wake_all = true;
    }

    /// A thread without a task asks what to do.
    pub fn next(&mut self, thread: usize, now_ns: u64) -> Next {
        assert!(self.threads[thread].task.is_none(), "a thread has one task at a time");
        let kind = kind(thread, self.hosts) as usize;
        if std::mem::take(&mut self.threads[thread].stirring) {
            self.stirring[kind] -= 1;
        }
        let next = if self.closing {
            Next::Exit
        } else if let Some(choice) = self.choose(kind) {
            Next::Work(self.start(thread, choice, now_ns))
        } else {
            self.threads[thread].asleep_ns = Some(now_ns);
            self.sleepers[kind].push(thread);
            Next::Sleep
        };
        self.ring(now_ns);
        next
    }

    /// Whether a suspended thread has not been woken yet.
    pub fn is_asleep(&self, thread: usize) -> bool {
        self.threads[thread].asleep_ns.is_some()
    }

    fn start(&mut self, thread: usize, choice: Choice, now_ns: u64) -> Arc<dyn Work> {
        let job = &mut self.jobs[choice.job];
        let rays = job.submission.job.start(thread, choice.rule);
        let (id, work) = (job.id, Arc::clone(&job.submission.work));
        self.dispatching += usize::from(choice.rule == Rule::Dispatch);
        self.threads[thread].task = Some(Running { job: id, start_ns: now_ns });
        self.views[choice.job].served += rays;
        self.look(choice.job);
        work
    }

    /// A thread has done its task; it asks for the [`State::next`] at once.
    pub fn finish(&mut self, thread: usize, now_ns: u64) {
        let task = self.threads[thread].task.take().expect("a thread finishes what it has started");
        self.dispatching -= usize::from(kind(thread, self.hosts) == ThreadKind::Dispatch);
        let index = self.index(task.job).expect("a job stays until its tasks are done");
        self.jobs[index].submission.job.finish(thread, task.start_ns, now_ns);
        self.settle(index, now_ns);
    }

    /// What is to be done now that the state has changed; ask after every call, before or after the
    /// lock is released.
    pub fn take_aftermath(&mut self) -> Aftermath {
        std::mem::take(&mut self.aftermath)
    }

    fn index(&self, id: JobId) -> Option<usize> {
        self.jobs.iter().position(|job| job.id == id)
    }

    fn load(&self) -> Load {
        let dispatchers = self.threads.len() - self.hosts;
        Load { hosts: self.hosts, dispatchers, idle_dispatchers: dispatchers - self.dispatching }
    }

    fn choose(&self, kind: usize) -> Option<Choice> {
        if kind == ThreadKind::Host as usize {
            policy::choose(&self.views, self.load(), self.sharing)
        } else {
            policy::choose_dispatch(&self.views, self.load(), self.sharing)
        }
    }

    /// Wakes a thread of each kind for which there is something to do, unless one is on its way. The
    /// woken thread does the same in its turn: so each wake-up finds work unless somebody was faster,
    /// and none is missing.
    fn ring(&mut self, now_ns: u64) {
        for kind in [ThreadKind::Host as usize, ThreadKind::Dispatch as usize] {
            if self.stirring[kind] == 0
                && let Some(&thread) = self.sleepers[kind].last()
                && self.choose(kind).is_some()
            {
                self.wake(thread, now_ns);
                self.aftermath.wake[kind] = Some(thread);
            }
        }
    }

    fn wake(&mut self, thread: usize, now_ns: u64) {
        let Some(since_ns) = self.threads[thread].asleep_ns.take() else { return };
        let kind = kind(thread, self.hosts) as usize;
        self.threads[thread].idle_ns += now_ns - since_ns;
        self.threads[thread].stirring = true;
        self.stirring[kind] += 1;
        self.sleepers[kind].retain(|&sleeper| sleeper != thread);
    }

    /// After a change to a job: ends it if it is over, which may let another in.
    fn settle(&mut self, index: usize, now_ns: u64) {
        self.look(index);
        let job = &mut self.jobs[index];
        if job.tail_ns.is_none() && job.submission.job.all_spawned() {
            job.tail_ns = Some(now_ns);
            job.tail_idle_ns.extend(self.threads.iter().map(|thread| thread.idle_ns(now_ns)));
        }
        self.end_if_over(index, now_ns);
        self.admit(now_ns);
    }

    fn look(&mut self, index: usize) {
        let served = self.views[index].served;
        self.views[index] = View { served, ..self.jobs[index].submission.job.view() };
    }

    fn admit(&mut self, now_ns: u64) {
        while self.jobs.len() < self.max_jobs
            && let Some(mut job) = self.waiting.pop_front()
        {
            job.begin(now_ns, &self.threads);
            // Not served less than the others, lest it have all threads until it has caught up.
            let served = self.views.iter().map(|view| view.served).min().unwrap_or(0);
            self.views.push(View { served, ..job.submission.job.view() });
            self.jobs.push(job);
            // A job without tiles is.
            self.end_if_over(self.jobs.len() - 1, now_ns);
        }
    }

    fn end_if_over(&mut self, index: usize, now_ns: u64) {
        if self.jobs[index].submission.job.is_over() {
            let job = self.jobs.remove(index);
            self.views.remove(index);
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
        let last = submission.job.progress();
        self.aftermath.ended.push(Ended { submission, last, outcome });
    }

    #[cfg(test)]
    pub fn check(&self) {
        for job in &self.jobs {
            job.submission.job.check();
        }
        for (job, view) in self.jobs.iter().zip(&self.views) {
            assert_eq!(View { served: view.served, ..job.submission.job.view() }, *view, "views are current");
        }
        for kind in [0, 1] {
            let work = !self.closing && self.choose(kind).is_some();
            let lost = work && self.stirring[kind] == 0 && !self.sleepers[kind].is_empty();
            assert!(!lost, "while there is work and a thread asleep, one is on its way");
            assert!(self.closing || self.stirring[kind] <= 1, "and only one");
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
