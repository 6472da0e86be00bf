//! A GPU as a contender, whole streams at a time: from rays where streams have them to canonical hits there.

use super::Kind;
use super::contender::{Clock, Contender};
use rayon::prelude::*;
use raystream::stream::{Capacity, DeviceError, DeviceTracer, Empty, Full, Ray, RayStream, Traced};
use std::sync::Arc;

/// Rays without payloads.
type Stream<State> = RayStream<State, (), ()>;

pub fn contender<'a>(device: &'a dyn DeviceTracer, kind: Kind, clock: Clock<'a>) -> Contender<'a> {
    let mut streams: Vec<Stream<Empty>> = Vec::new();
    let round = move |rays: &Arc<[Ray]>| {
        let most = device.max_rays().min(rays.len()).max(1);
        streams.resize_with(rays.len().div_ceil(most), RayStream::new);
        let full = streams.drain(..).zip(rays.chunks(most));
        let full: Vec<_> = full.map(|(stream, rays)| fill(stream, rays, most, device, kind)).collect();
        let mut traced = Ok(Vec::new());
        let seconds = clock.seconds(|| {
            traced = full.into_par_iter().map(|stream| stream.trace_on(device)).collect::<Result<_, _>>();
        });
        let traced: Vec<(Stream<Traced>, _)> =
            traced.map_err(|untraced| DeviceError::Lost(untraced.reason))?;
        streams.extend(traced.into_iter().map(|(stream, _)| stream.discard()));
        Ok(seconds)
    };
    let (name, threads) = (format!("gpu: {}", device.name()), clock.threads());
    Contender { name, threads, simd: None, is_robust: true, is_slow: false, round: Box::new(round) }
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
