//! The lists of a job and the bundles with devices: the engine's files, and as much of their neighbours as they name.

#[path = "../../../src/schedule/flights.rs"]
mod flights;
#[path = "../../../src/schedule/lists.rs"]
mod lists;
#[path = "../../../src/schedule/on_device.rs"]
mod on_device;
mod tickets;

mod device_account {
    pub struct BundleAccount {
        pub full_ns: Vec<Option<u64>>,
    }
}

mod limits {
    /// One stream a bundle, so that two bundles are few streams.
    pub const BUNDLE_STREAMS: usize = 1;

    #[derive(Clone, Copy)]
    pub struct Limits {
        pub shadow_rays_per_path: usize,
        pub bundle_rays: usize,
        pub streams: usize,
    }
}

mod policy {
    /// The devices of the models look at no clock.
    pub fn wait_time(_: usize) -> std::time::Duration {
        std::time::Duration::ZERO
    }
}

mod state {
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct JobId(pub u64);
}

mod task {
    use crate::stream::ChunkScratch;

    pub trait Work: Send + Sync {
        fn work(&self, thread: usize, scratch: &mut ChunkScratch) -> Option<u64>;
        fn warnings(&self) -> Vec<String>;
    }
}

use limits::Limits;
