//! The policies, one row of a table each. A new policy is a variant, a row, and a word on the command line.

use super::{Load, QUEUED, Rule, Unit, View};

/// An order of the rules that host threads try, and of the units for a full stream that either could trace.
///
/// Policies exist to be measured against each other: the picture is the same under all of them. So is the proof in
/// the README, which rests on what each rule requires and not on the order of the rules. With [`Unit::Cpu`] or
/// [`Unit::Gpu`] alone, only the order matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Policy {
    /// RA's rules in RA's order. Camera rays come first, so that long paths start early. The device gets every full
    /// stream while there is room for a bundle.
    RayAccelerator,
    /// RA's variant without a GPU (section 5). Traced rays are shaded at once, while they are in the cache; camera
    /// rays are spawned only when no full stream is left to trace.
    ShadeFirst,
    /// MoonRay's XPU mode. A full stream goes to the device at once, unless bundles already wait there or the stream
    /// has no more than [`MOONRAY_SMALL`] rays.
    MoonRay,
    /// The device gets bundles while a ray of its costs host threads less than one of their own, and while it answers
    /// before the job would end without it.
    MeasuredRate,
}

/// Streams with no more rays than this are not worth a submission.
pub const MOONRAY_SMALL: usize = 1024;

/// What a policy decides.
pub(super) struct Row {
    policy: Policy,
    name: &'static str,
    /// The order in which a host thread tries the rules of a job.
    pub order: [Rule; 4],
    /// The rule that a host thread tries before that order.
    pub before: fn(&View, Load) -> Option<Rule>,
    /// Whether host threads may open a full stream. Whenever they may not, the device may take it, or will when it
    /// is done with a bundle: so no full stream waits without a thread that may take it.
    pub hosts_open: fn(&View, Load) -> bool,
    /// Whether the device may take full streams where there is room for a bundle.
    pub device_opens: fn(&View, Load) -> bool,
    /// Whether the device may take streams of NEEDMORE when no other work is to come.
    pub device_flushes: fn(&View, Load) -> bool,
}

const RA_ORDER: [Rule; 4] = [Rule::Spawn, Rule::Shade, Rule::Trace, Rule::Flush];
const SHADE_ORDER: [Rule; 4] = [Rule::Shade, Rule::Trace, Rule::Spawn, Rule::Flush];

/// In the order of the variants.
const TABLE: &[Row; 4] = &[
    Row {
        policy: Policy::RayAccelerator,
        name: "ra",
        order: RA_ORDER,
        before: |_, _| None,
        hosts_open: |view, load| view.exceeds_the_device(load),
        device_opens: |_, _| true,
        device_flushes: |_, _| false,
    },
    Row {
        policy: Policy::ShadeFirst,
        name: "shade-first",
        order: SHADE_ORDER,
        before: |_, _| None,
        hosts_open: |view, load| view.exceeds_the_device(load),
        device_opens: |_, _| true,
        device_flushes: |_, _| false,
    },
    Row {
        policy: Policy::MoonRay,
        name: "moonray",
        order: SHADE_ORDER,
        before: |_, _| None,
        hosts_open: |view, load| !view.has_room(load),
        device_opens: |_, _| true,
        device_flushes: |view, load| view.need_more_rays > MOONRAY_SMALL && load.queued < QUEUED,
    },
    Row {
        policy: Policy::MeasuredRate,
        name: "measured",
        order: SHADE_ORDER,
        before: |view, load| view.before_measured(load),
        hosts_open: |view, load| {
            !view.device_pays(load) || view.exceeds_the_device(load) && view.hosts_are_sooner(load)
        },
        device_opens: |view, load| view.device_pays(load),
        device_flushes: |view, load| view.device_pays(load),
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

    /// The policy that is used with these units unless another is chosen: RA's for a unit alone, and measured costs for
    /// both.
    pub fn of(unit: Unit) -> Self {
        match unit {
            Unit::Cpu => Self::ShadeFirst,
            Unit::Gpu => Self::RayAccelerator,
            Unit::Hybrid => Self::MeasuredRate,
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
