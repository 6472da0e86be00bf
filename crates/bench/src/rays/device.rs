//! A GPU as a contender: from rays where streams have them to canonical hits there; and its kernels by themselves, by
//! the device's own clock.

use super::Kind;
use super::contender::{Clock, Contender};
use rayon::prelude::*;
use raystream::stream::{
    Capacity, DeviceError, DeviceTracer, Empty, Full, OnDevice, Ray, RayStream, Ticket, Traced,
};
use std::sync::Arc;
use std::time::Duration;

/// Rays without payloads.
type Stream<State> = RayStream<State, (), ()>;

/// Rays of a stream if the device has not been measured. Each stream is a bundle of its own.
const STREAM_RAYS: usize = 1 << 16;

pub fn contender<'a>(device: &'a dyn DeviceTracer, kind: Kind, clock: Clock<'a>) -> Contender<'a> {
    let mut streams: Vec<Stream<Empty>> = Vec::new();
    let round = move |rays: &Arc<[Ray]>| {
        let most = device.bundle_rays().unwrap_or(STREAM_RAYS).min(rays.len()).max(1);
        streams.resize_with(rays.len().div_ceil(most), RayStream::new);
        let full = streams.drain(..).zip(rays.chunks(most));
        let full: Vec<_> = full.map(|(stream, rays)| fill(stream, rays, most, device, kind)).collect();
        let mut traced = Ok(Vec::new());
        let seconds = clock.seconds(|| traced = trace(full, device));
        streams.extend(traced?.into_iter().map(RayStream::discard));
        Ok(seconds)
    };
    let (name, threads) = (format!("gpu: {}", device.name()), clock.threads());
    Contender { name, threads, simd: None, is_robust: true, is_slow: false, round: Box::new(round) }
}

/// How the name of a device's kernels begins.
pub const KERNELS: &str = "gpu kernels: ";

/// The kernels alone: of each round the seconds that the device itself counts. `None` if it cannot tell.
///
/// # Errors
/// When the device is lost.
pub fn kernels(device: &dyn DeviceTracer, kind: Kind) -> Result<Option<Contender<'_>>, DeviceError> {
    if device.kernel_seconds(&[], kind.is_any_hit())?.is_none() {
        return Ok(None);
    }
    let round = move |rays: &Arc<[Ray]>| {
        let seconds = device.kernel_seconds(rays, kind.is_any_hit())?;
        seconds.ok_or_else(|| DeviceError::Failed("its clock has stopped".to_owned()))
    };
    let (name, round) = (format!("{KERNELS}{}", device.name()), Box::new(round));
    Ok(Some(Contender { name, threads: 1, simd: None, is_robust: true, is_slow: false, round }))
}

/// Submits all streams, then resolves each when it has been traced.
fn trace(full: Vec<Stream<Full>>, device: &dyn DeviceTracer) -> Result<Vec<Stream<Traced>>, DeviceError> {
    let submit = |stream: Stream<Full>| {
        let (stream, share) = stream.give();
        Ok((stream, device.submit(vec![share])?))
    };
    let submitted: Vec<(Stream<OnDevice>, Box<dyn Ticket>)> =
        full.into_iter().map(submit).collect::<Result<_, _>>()?;
    let mut answered = Vec::new();
    for (stream, mut ticket) in submitted {
        let mut resolve = loop {
            if let Some(resolve) = ticket.wait(Duration::MAX)? {
                break resolve;
            }
        };
        drop(ticket);
        answered.push(stream.answered(resolve.pop().expect("an answer for each stream")));
    }
    let resolve = answered.into_par_iter().map(RayStream::resolve);
    resolve
        .map(|done| done.map(|(stream, _)| stream).map_err(|lost| DeviceError::Lost(lost.reason)))
        .collect()
}

/// Puts rays into a stream of at most `most`, in the device's memory.
fn fill(
    stream: Stream<Empty>,
    rays: &[Ray],
    most: usize,
    device: &dyn DeviceTracer,
    kind: Kind,
) -> Stream<Full> {
    let room = |any_hit: bool| if kind.is_any_hit() == any_hit { most } else { 0 };
    let capacity = Capacity { rays: room(false), shadow_rays: room(true) };
    let mut stream = stream.fill();
    stream.append(capacity, Some(device), |mut columns| {
        let (column, payloads) = match kind.is_any_hit() {
            true => (&mut columns.shadow_rays, columns.shadow_payloads),
            false => (&mut columns.rays, columns.payloads),
        };
        rays.iter().for_each(|&ray| column.push(ray));
        payloads.resize(rays.len(), ());
    });
    stream.seal()
}
