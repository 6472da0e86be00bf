//! Bundles of streams: encoded into one submission, waited for, resolved stream by stream.

use super::cross_check::{LEAST, Sampling};
use super::dispatch::{InFlight, Request};
use super::scene::DeviceScene;
use super::shared_buffer::SharedBuffer;
use super::tracer::{SceneDevice, Shared};
use super::undecided::Undecided;
use super::{corruption, cross_check};
use crate::device::Fault;
use crate::stream::{DeviceAnswers, DeviceError, DeviceReport, DeviceStream, Hit, Ray, Resolve, Ticket};
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// A bundle with a device.
pub(super) struct Bundle {
    shared: Arc<Shared>,
    device: Arc<SceneDevice>,
    streams: Vec<DeviceStream>,
    /// The dispatches of each stream.
    pieces: Vec<Vec<Piece>>,
    /// Of the bundle, from 1.
    number: u64,
    fault: Option<Fault>,
    submission: Option<wgpu::SubmissionIndex>,
    submitted: Instant,
    is_done: Arc<AtomicBool>,
}

/// Rays and shadow rays of a stream, as many as one dispatch takes.
struct Piece {
    rays: Range<usize>,
    shadow_rays: Range<usize>,
    closest: Option<InFlight>,
    any: Option<InFlight>,
}

/// The requests of a piece, in the memory that the stream has.
fn requests<'a>(
    device: &SceneDevice,
    stream: &'a DeviceStream,
    answers: &'a mut DeviceAnswers<'_>,
    (rays, shadow_rays): (Range<usize>, Range<usize>),
) -> (Request<'a, Hit>, Request<'a, u32>) {
    let gpu = &device.gpu;
    let shared = stream.ray_memory().and_then(|[rays, shadow_rays]| {
        Some((SharedBuffer::<Ray>::of(rays, gpu)?, SharedBuffer::<Ray>::of(shadow_rays, gpu)?))
    });
    let is_shared = shared.is_some()
        && answers.memory().is_some_and(|(hits, occluded)| {
            SharedBuffer::<Hit>::of(hits, gpu).is_some() && SharedBuffer::<u32>::of(occluded, gpu).is_some()
        });
    match shared.filter(|_| is_shared) {
        Some((ray_memory, shadow_memory)) => {
            let (hits, occluded) = answers.memory().expect("it is this device's");
            let hits = SharedBuffer::of_mut(hits, gpu).expect("it is this device's");
            let occluded = SharedBuffer::of_mut(occluded, gpu).expect("it is this device's");
            (
                Request::InDeviceMemory { rays: ray_memory, answers: hits, range: rays },
                Request::InDeviceMemory { rays: shadow_memory, answers: occluded, range: shadow_rays },
            )
        }
        None => {
            let (hits, occluded) = answers.slices();
            let (hits, occluded) = (&mut hits[rays.clone()], &mut occluded[shadow_rays.clone()]);
            (
                Request::InHostMemory { rays: &stream.rays()[rays], answers: hits },
                Request::InHostMemory { rays: &stream.shadow_rays()[shadow_rays], answers: occluded },
            )
        }
    }
}

impl Bundle {
    /// Encodes and submits all dispatches of a bundle at once.
    ///
    /// # Errors
    /// Why the device is lost.
    pub fn submit(
        shared: &Arc<Shared>,
        device: &Arc<SceneDevice>,
        streams: Vec<DeviceStream>,
    ) -> Result<Self, String> {
        let (number, fault) = device.gpu.next_dispatch();
        let is_done = Arc::new(AtomicBool::new(false));
        let (mut pieces, mut submission) = (Vec::new(), None);
        if !matches!(fault, Some(Fault::Hang(_))) {
            (pieces, submission) = device.gpu.guard(|wgpu_device, queue| {
                let mut encoder =
                    wgpu_device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
                let encoded: Vec<_> = streams
                    .iter()
                    .map(|stream| {
                        encode(device, (wgpu_device, queue), &mut encoder, stream, shared.scene_max_abs())
                    })
                    .collect();
                let submission = queue.submit([encoder.finish()]);
                let done = Arc::clone(&is_done);
                queue.on_submitted_work_done(move || done.store(true, Ordering::Release));
                if let Some(Fault::Lost(_)) = fault {
                    wgpu_device.destroy();
                }
                let map = |(pieces, stream)| map(device, pieces, stream);
                Ok((encoded.into_iter().zip(&streams).map(map).collect(), Some(submission)))
            })?;
        }
        let (shared, device, submitted) = (Arc::clone(shared), Arc::clone(device), Instant::now());
        Ok(Self { shared, device, streams, pieces, number, fault, submission, submitted, is_done })
    }

    /// True if the device has traced the bundle, within about `timeout`.
    fn is_done_within(&self, timeout: Duration) -> Result<bool, String> {
        let gpu = &self.device.gpu;
        gpu.guard(|_, _| match &self.submission {
            Some(submission) => gpu.look(submission, &self.is_done, self.submitted, timeout),
            None => Err(gpu.simulate_hang()),
        })
    }

    /// What the device has written, with the lists of undecided rays. Other buffers are free for the next bundle.
    fn read_back(&mut self) -> Result<Vec<Box<dyn Resolve>>, String> {
        let (device, shared) = (Arc::clone(&self.device), Arc::clone(&self.shared));
        let pieces = std::mem::take(&mut self.pieces);
        let least = LEAST.div_ceil(pieces.len().max(1));
        device.gpu.guard(|_, _| {
            let mut answered: Vec<Box<dyn Resolve>> = Vec::new();
            for (index, (pieces, stream)) in pieces.into_iter().zip(&self.streams).enumerate() {
                let read = |piece| read_piece(&device, piece, stream);
                let pieces = pieces.into_iter().map(read).collect::<Result<_, _>>()?;
                answered.push(Box::new(Answer {
                    shared: Arc::clone(&shared),
                    device: Arc::clone(&device),
                    pieces,
                    sampling: Sampling { number: self.number << 8 | index as u64, least },
                    is_corrupt: matches!(self.fault, Some(Fault::Corrupt(_))),
                }));
            }
            Ok(answered)
        })
    }
}

type Encoded = (Range<usize>, Range<usize>, [Option<super::dispatch::Encoded>; 2]);

/// Encodes the dispatches of a stream.
fn encode(
    device: &SceneDevice,
    both: (&wgpu::Device, &wgpu::Queue),
    encoder: &mut wgpu::CommandEncoder,
    stream: &DeviceStream,
    scene_max_abs: f32,
) -> Vec<Encoded> {
    let DeviceScene { group, trace_closest, trace_any, .. } = &device.scene;
    let mut answers = stream.answers();
    let ranges = device.ranges(stream.rays().len(), stream.shadow_rays().len());
    let encode = |(rays, shadow_rays): (Range<usize>, Range<usize>)| {
        let ranges = (rays.clone(), shadow_rays.clone());
        let (mut closest, mut any) = requests(device, stream, &mut answers, ranges);
        let closest = trace_closest.encode(both, encoder, group, scene_max_abs, &mut closest, None);
        let any = trace_any.encode(both, encoder, group, scene_max_abs, &mut any, None);
        (rays, shadow_rays, [closest, any])
    };
    ranges.map(encode).collect()
}

/// Requests that what the host reads be mapped.
fn map(device: &SceneDevice, encoded: Vec<Encoded>, stream: &DeviceStream) -> Vec<Piece> {
    let DeviceScene { trace_closest, trace_any, .. } = &device.scene;
    let mut answers = stream.answers();
    let map = |(rays, shadow_rays, [closest, any]): Encoded| {
        let ranges = (rays.clone(), shadow_rays.clone());
        let is_mapped =
            matches!(requests(device, stream, &mut answers, ranges).0, Request::InHostMemory { .. });
        let closest = closest.map(|encoded| encoded.map(is_mapped, trace_closest.is_exact()));
        let any = any.map(|encoded| encoded.map(is_mapped, trace_any.is_exact()));
        Piece { rays, shadow_rays, closest, any }
    };
    encoded.into_iter().map(map).collect()
}

/// Reads back what a dispatch has answered.
fn read_piece(device: &SceneDevice, piece: Piece, stream: &DeviceStream) -> Result<AnsweredPiece, String> {
    let DeviceScene { trace_closest, trace_any, .. } = &device.scene;
    let Piece { rays, shadow_rays, closest, any } = piece;
    let mut answers = stream.answers();
    let (mut hits, mut occluded) =
        requests(device, stream, &mut answers, (rays.clone(), shadow_rays.clone()));
    let bytes_copied = trace_closest.bytes_copied(&hits) + trace_any.bytes_copied(&occluded);
    let closest = closest.map_or(Ok(None), |in_flight| trace_closest.read_back(&mut hits, in_flight))?;
    let any = any.map_or(Ok(None), |in_flight| trace_any.read_back(&mut occluded, in_flight))?;
    Ok(AnsweredPiece { rays, shadow_rays, closest, any, bytes_copied })
}

impl Ticket for Bundle {
    fn wait(&mut self, timeout: Duration) -> Result<Option<Vec<Box<dyn Resolve>>>, DeviceError> {
        let read = self.is_done_within(timeout).and_then(|is_done| match is_done {
            false => Ok(None),
            true => {
                self.device.gpu.watchdog.record(self.submitted.elapsed());
                self.read_back().map(Some)
            }
        });
        read.map_err(|reason| {
            Shared::replace(&self.shared, &self.device.gpu);
            DeviceError::Lost(reason)
        })
    }
}

/// What a dispatch has answered besides what is in the stream's memory.
struct AnsweredPiece {
    rays: Range<usize>,
    shadow_rays: Range<usize>,
    /// The rays, and the shadow rays, that the device left undecided, if it has made hits of its candidates.
    closest: Option<Undecided>,
    any: Option<Undecided>,
    bytes_copied: u64,
}

/// What a device has answered for a stream.
struct Answer {
    shared: Arc<Shared>,
    device: Arc<SceneDevice>,
    pieces: Vec<AnsweredPiece>,
    /// Of the cross-check: all streams of a bundle together have the sample of a dispatch.
    sampling: Sampling,
    is_corrupt: bool,
}

impl Resolve for Answer {
    fn resolve(self: Box<Self>, stream: &DeviceStream) -> Result<DeviceReport, DeviceError> {
        let Self { shared, device, pieces, sampling, is_corrupt } = *self;
        let resolver = &shared.resolver;
        let mut answers = stream.answers();
        let (hits, occluded) = answers.slices();
        let mut report = DeviceReport::default();
        for AnsweredPiece { rays, shadow_rays, closest, any, bytes_copied } in pieces {
            let (hits, occluded) = (&mut hits[rays.clone()], &mut occluded[shadow_rays.clone()]);
            let (rays, shadow_rays) = (&stream.rays()[rays], &stream.shadow_rays()[shadow_rays]);
            report += resolver.resolve((rays, hits, closest), (shadow_rays, occluded, any));
            report.bytes_copied += bytes_copied;
            if is_corrupt {
                corruption::corrupt(hits, occluded);
            }
            let cpu = &*resolver.cpu;
            let checked = cross_check::closest(cpu, rays, hits, sampling)
                .and_then(|n| Ok(n + cross_check::occluded(cpu, shadow_rays, occluded, sampling)?));
            report.checked += checked.map_err(|reason| {
                let reason = device.gpu.mark_untrusted(reason);
                Shared::replace(&shared, &device.gpu);
                DeviceError::Lost(reason)
            })?;
        }
        Ok(report)
    }
}
