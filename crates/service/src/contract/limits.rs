//! What one request may ask for.

use std::time::Duration;

/// Bounds of requests. Each refusal names the bound that it met.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Limits {
    /// Bytes of an uploaded scene.
    pub scene_bytes: u64,
    /// Bytes of all files of a pack, decompressed.
    pub unpacked_bytes: u64,
    /// Files of a pack.
    pub pack_files: usize,
    /// Uploads at the same time.
    pub uploads: usize,
    /// Bytes of any other body.
    pub body_bytes: usize,
    /// Pixels of a picture.
    pub pixels: u64,
    /// Pixels × samples × frames of a job.
    pub job_samples: u64,
    /// Frames of a job.
    pub frames: u32,
    /// Triangles of a scene.
    pub triangles: u64,
    /// Jobs of the token that have not ended.
    pub open_jobs: u64,
    /// Rays of a query.
    pub query_rays: u64,
    /// Pixels × samples of a unit, instead of about a second by measured speed.
    pub unit_samples: Option<u64>,
    /// Connections at the same time, as far as the system allows.
    pub connections: usize,
    /// The longest time until a request's headers are whole, and that a connection may be idle.
    pub head_time: Duration,
    /// The longest pause between two pieces of a body.
    pub body_pause: Duration,
    /// The longest time that loading a scene may take.
    pub load_time: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            scene_bytes: 2 << 30,
            unpacked_bytes: 8 << 30,
            pack_files: 10_000,
            uploads: 4,
            body_bytes: 1 << 20,
            pixels: 1 << 26,
            job_samples: 1 << 42,
            frames: 10_000,
            triangles: 100_000_000,
            open_jobs: 10_000,
            query_rays: 1 << 24,
            unit_samples: None,
            connections: 4096,
            head_time: Duration::from_secs(30),
            body_pause: Duration::from_secs(15),
            load_time: Duration::from_secs(600),
        }
    }
}
