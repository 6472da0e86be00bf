//! The streams of one job that are with a device, bundle by bundle.

use super::device_account::BundleAccount;
use super::flights::{Answers, BundleId};
use super::lists::weight;
#[cfg(test)]
use crate::stream::paths;
use crate::stream::{Answered, OnDevice, RayStream, Resolve};

/// A bundle of the job that a device has.
struct Bundle<P, S> {
    id: BundleId,
    /// `None` for a stream that a host thread has taken back.
    streams: Vec<Option<RayStream<OnDevice, P, S>>>,
    account: BundleAccount,
    /// Rays and shadow rays that the device was given.
    rays: u64,
}

/// What a device has of a job.
pub(super) struct WithDevice<P, S> {
    /// In the order of submission.
    bundles: Vec<Bundle<P, S>>,
    /// Streams of bundles that a device has failed to trace.
    failed: Vec<RayStream<OnDevice, P, S>>,
    /// Rays and shadow rays of all bundles.
    rays: u64,
}

/// A bundle that a device has traced.
pub(super) struct Traced<P, S> {
    pub account: BundleAccount,
    /// Rays and shadow rays that the device was given.
    pub rays: u64,
    /// The streams that no host thread has taken back, and when each became full, if it waited in TRACE.
    pub streams: Vec<(RayStream<Answered, P, S>, Option<u64>)>,
    /// The answers for the others, to be dropped without the lock.
    pub left_over: Vec<Box<dyn Resolve>>,
    /// Why the device failed, if it did.
    pub failed: Option<String>,
}

impl<P, S> WithDevice<P, S> {
    pub fn new() -> Self {
        Self { bundles: Vec::new(), failed: Vec::new(), rays: 0 }
    }

    /// Bundles with a device.
    pub fn bundles(&self) -> usize {
        self.bundles.len()
    }

    /// Rays and shadow rays in these.
    pub fn rays(&self) -> u64 {
        self.rays
    }

    /// Streams that a device has, and no host thread has taken back.
    pub fn streams(&self) -> usize {
        self.bundles.iter().map(|bundle| bundle.streams.iter().flatten().count()).sum()
    }

    /// Streams that a device has failed to trace.
    pub fn failed(&self) -> usize {
        self.failed.len()
    }

    /// Adds a bundle.
    pub fn push(&mut self, id: BundleId, streams: Vec<RayStream<OnDevice, P, S>>, account: BundleAccount) {
        let rays = streams.iter().map(|stream| weight(stream) as u64).sum();
        self.rays += rays;
        self.bundles.push(Bundle { id, streams: streams.into_iter().map(Some).collect(), account, rays });
    }

    /// Takes a bundle out that a device has traced, or failed to trace: its streams are taken back then.
    ///
    /// # Panics
    /// If the job has no such bundle.
    pub fn end(&mut self, id: BundleId, answers: Answers) -> Traced<P, S> {
        let index = self.bundles.iter().position(|bundle| bundle.id == id);
        let Bundle { streams, account, rays, .. } = self.bundles.remove(index.expect("a bundle of the job"));
        self.rays -= rays;
        let mut traced = Traced { account, rays, streams: Vec::new(), left_over: Vec::new(), failed: None };
        match answers {
            Ok(answers) => {
                let full_ns = traced.account.full_ns.iter().copied();
                for ((stream, resolve), full_ns) in streams.into_iter().zip(answers).zip(full_ns) {
                    match stream {
                        Some(stream) => traced.streams.push((stream.answered(resolve), full_ns)),
                        None => traced.left_over.push(resolve),
                    }
                }
            }
            Err(reason) => {
                self.failed.extend(streams.into_iter().flatten());
                traced.failed = Some(reason);
            }
        }
        traced
    }

    /// A stream that a device has failed to trace, or else the last that it was given.
    pub fn take_back(&mut self) -> Option<RayStream<OnDevice, P, S>> {
        let last = |bundle: &mut Bundle<P, S>| bundle.streams.iter_mut().rev().find_map(Option::take);
        self.failed.pop().or_else(|| self.bundles.iter_mut().rev().find_map(last))
    }

    /// Paths of the streams that have not been taken back.
    #[cfg(test)]
    pub fn paths(&self, shadow_rays_per_path: usize) -> usize {
        let streams = self.bundles.iter().flat_map(|bundle| bundle.streams.iter().flatten());
        let count = |s: &RayStream<_, P, S>| paths(s.rays(), s.shadow_rays(), shadow_rays_per_path);
        streams.chain(&self.failed).map(count).sum()
    }
}
