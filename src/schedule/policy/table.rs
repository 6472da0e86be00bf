//! The policies, one row of a table each. A new policy is a variant, a row, and a word on the command line.

use super::{Load, Rule, Unit, View};

/// Which rule a host thread tries first, and which unit gets a full stream that either could trace.
///
/// Policies exist to be measured against each other: the picture is the same under all of them. So is the proof in
/// the README, which rests on what each rule requires and not on the order of the rules. With [`Unit::Cpu`] or
/// [`Unit::Gpu`] alone, only the order matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Policy {
    /// RA's rules in RA's order. Camera rays come first, so that long paths start early. The device gets every full
    /// stream while a dispatch thread is idle.
    RayAccelerator,
    /// RA's variant without a GPU (section 5). Traced rays are shaded at once, while they are in the cache; camera
    /// rays are spawned only when no full stream is left to trace.
    ShadeFirst,
    /// MoonRay's XPU mode. A full stream goes to the device at once, unless [`MOONRAY_WAITING`] threads already wait
    /// there or the stream has no more than [`MOONRAY_SMALL`] rays.
    MoonRay,
    /// Units get streams by how fast they have traced so far, so that both finish together. A unit leaves a stream to
    /// the other if the other would finish it earlier.
    MeasuredRate,
}

/// Dispatch threads that may wait for a device which serves another one.
pub const MOONRAY_WAITING: usize = 3;

/// Streams with no more rays than this are not worth a dispatch.
pub const MOONRAY_SMALL: usize = 1024;

/// What a policy decides.
pub(super) struct Row {
    policy: Policy,
    name: &'static str,
    /// The order in which a host thread tries the rules of a job.
    pub order: [Rule; 4],
    /// Whether host threads may open a full stream. Whenever they may not, the device may, and one of its dispatch
    /// threads is idle or will be: so no full stream waits without a thread that may take it.
    pub hosts_open: fn(&View, Load) -> bool,
    /// Whether an idle dispatch thread may take a full stream.
    pub device_opens: fn(&View, Load) -> bool,
    /// Whether an idle dispatch thread may take a stream of NEEDMORE when no other work is to come.
    pub device_flushes: fn(&View, Load) -> bool,
}

/// In the order of the variants.
const TABLE: &[Row; 4] = &[
    Row {
        policy: Policy::RayAccelerator,
        name: "ra",
        order: [Rule::Spawn, Rule::Shade, Rule::Trace, Rule::Flush],
        hosts_open: |_, load| load.idle_dispatchers == 0,
        device_opens: |_, _| true,
        device_flushes: |_, _| false,
    },
    Row {
        policy: Policy::ShadeFirst,
        name: "shade-first",
        order: [Rule::Shade, Rule::Trace, Rule::Spawn, Rule::Flush],
        hosts_open: |_, load| load.idle_dispatchers == 0,
        device_opens: |_, _| true,
        device_flushes: |_, _| false,
    },
    Row {
        policy: Policy::MoonRay,
        name: "moonray",
        order: [Rule::Shade, Rule::Trace, Rule::Spawn, Rule::Flush],
        hosts_open: |_, load| !load.moonray_queue_has_room(),
        device_opens: |_, load| load.moonray_queue_has_room(),
        device_flushes: |view, load| view.need_more_rays > MOONRAY_SMALL && load.moonray_queue_has_room(),
    },
    Row {
        policy: Policy::MeasuredRate,
        name: "measured",
        order: [Rule::Spawn, Rule::Shade, Rule::Trace, Rule::Flush],
        hosts_open: |view, load| {
            !view.device_is_back_in_time(load) || (load.idle_dispatchers == 0 && view.hosts_are_sooner(load))
        },
        device_opens: |view, load| view.device_is_back_in_time(load),
        device_flushes: |_, _| false,
    },
];

impl Policy {
    /// All policies.
    pub const ALL: [Self; TABLE.len()] = {
        let mut all = [Self::RayAccelerator; TABLE.len()];
        let mut index = 0;
        while index < TABLE.len() {
            all[index] = TABLE[index].policy;
            assert!(all[index] as usize == index, "rows stand in the order of the variants");
            index += 1;
        }
        all
    };

    /// The policy that RA uses with these units.
    pub fn of(unit: Unit) -> Self {
        match unit {
            Unit::Cpu => Self::ShadeFirst,
            Unit::Gpu | Unit::Hybrid => Self::RayAccelerator,
        }
    }

    /// The name that arguments and reports use.
    pub fn name(self) -> &'static str {
        self.row().name
    }

    pub(super) fn row(self) -> &'static Row {
        &TABLE[self as usize]
    }
}

impl Load {
    /// True if one more stream may go to the device: one dispatch thread is served, and at most [`MOONRAY_WAITING`]
    /// wait behind it.
    fn moonray_queue_has_room(self) -> bool {
        let busy = self.dispatchers - self.idle_dispatchers;
        self.idle_dispatchers > 0 && busy.saturating_sub(1) < MOONRAY_WAITING
    }
}

impl View {
    /// True if the device would have traced a stream before host threads had traced all rays that wait. Assumed
    /// until both units have traced.
    fn device_is_back_in_time(&self, load: Load) -> bool {
        let device_ns = self.gpu.ns_for(self.stream_rays());
        let hosts_ns = self.cpu.ns_for(self.waiting_rays).map(|ns| ns / load.hosts.max(1) as u64);
        device_ns.zip(hosts_ns).is_none_or(|(device, hosts)| device <= hosts)
    }

    /// True if host threads would have traced a stream before the device came to it, while all dispatch threads are
    /// busy. Assumed until both units have traced.
    fn hosts_are_sooner(&self, load: Load) -> bool {
        let dispatchers = load.dispatchers.max(1) as u64;
        let hosts_ns = self.cpu.ns_for(self.stream_rays()).map(|ns| ns / load.hosts.max(1) as u64);
        // The streams of TRACE, and those with the device, which are half done on average.
        let ahead = self.trace_rays as u64 + dispatchers * self.stream_rays() / 2;
        let device_ns = self.gpu.ns_for(ahead).map(|ns| ns / dispatchers);
        device_ns.zip(hosts_ns).is_none_or(|(device, hosts)| hosts <= device)
    }

    /// Average rays of a stream of TRACE.
    fn stream_rays(&self) -> u64 {
        self.trace_rays as u64 / self.trace.max(1) as u64
    }
}
