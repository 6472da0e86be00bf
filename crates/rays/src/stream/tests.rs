use super::*;
use std::fmt::Debug;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed};
use std::time::Duration;

/// A tracer that answers by the ray's origin and counts calls.
#[derive(Default)]
struct ByOrigin {
    calls: AtomicUsize,
}

impl Tracer for ByOrigin {
    fn closest(&self, rays: &[Ray], hits: &mut [Hit]) {
        self.calls.fetch_add(1, Relaxed);
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = Hit { t: ray.origin[0], u: 0.0, v: 0.0, primitive: 3 };
        }
    }

    fn occluded(&self, rays: &[Ray], occluded: &mut [u32]) {
        self.calls.fetch_add(1, Relaxed);
        for (ray, occluded) in rays.iter().zip(occluded) {
            *occluded = 10 + ray.origin[0] as u32;
        }
    }
}

/// A device that answers some calls and then is lost or panics, leaving wrong answers.
struct Frail {
    calls_left: AtomicUsize,
    panics: bool,
}

impl Frail {
    fn device(calls: usize, panics: bool) -> Blocking<Self> {
        Blocking::new(Self { calls_left: AtomicUsize::new(calls), panics })
    }
}

impl BlockingTracer for Frail {
    fn name(&self) -> &str {
        "frail"
    }

    fn max_rays(&self) -> usize {
        4
    }

    fn trace(&self, queries: Queries<'_>) -> Result<DeviceReport, DeviceError> {
        if self.calls_left.load(Relaxed) == 0 {
            queries.hits.fill(Hit::default());
            queries.occluded.fill(99);
            if self.panics {
                std::panic::resume_unwind(Box::new("boom".to_owned()));
            }
            return Err(DeviceError::Lost("gone".to_owned()));
        }
        self.calls_left.fetch_sub(1, Relaxed);
        assert!(queries.rays.len() <= 4 && queries.shadow_rays.len() <= 4);
        ByOrigin::default().closest(queries.rays, queries.hits);
        ByOrigin::default().occluded(queries.shadow_rays, queries.occluded);
        Ok(DeviceReport { bytes_copied: queries.rays.len() as u64, ..DeviceReport::default() })
    }
}

const CAPACITY: Capacity = Capacity { rays: 10, shadow_rays: 7 };

fn filled(rays: usize, shadow_rays: usize) -> RayStream<Filling, u32, u64> {
    fill(RayStream::new(), None, rays, shadow_rays)
}

fn fill(
    stream: RayStream<Empty, u32, u64>,
    device: Option<&dyn DeviceTracer>,
    rays: usize,
    shadow_rays: usize,
) -> RayStream<Filling, u32, u64> {
    let ray = |i: usize| Ray { origin: [i as f32, 0.0, 0.0], ..Ray::default() };
    let mut stream = stream.fill();
    stream.append(CAPACITY, device, |mut appender| {
        (0..rays).for_each(|i| appender.rays.push(ray(i)));
        appender.payloads.extend(0..rays as u32);
        (0..shadow_rays).for_each(|i| appender.shadow_rays.push(ray(i)));
        appender.shadow_payloads.extend(0..shadow_rays as u64);
    });
    stream
}

fn check(
    mut stream: RayStream<Traced, u32, u64>,
    rays: usize,
    shadow_rays: usize,
) -> RayStream<Empty, u32, u64> {
    let shadows = stream.take_shadows();
    assert_eq!(shadows.rays.len(), shadow_rays);
    assert!(shadows.payloads.iter().copied().eq(0..shadow_rays as u64));
    assert!(shadows.occluded.iter().copied().eq(10..10 + shadow_rays as u32));
    assert!(stream.take_shadows().rays.is_empty(), "shadow rays are taken once");
    let mut next = 0;
    loop {
        let left = stream.rays_left();
        let batch = stream.next_batch(3);
        assert_eq!(batch.rays.len(), left.min(3));
        for ((ray, hit), &payload) in batch.rays.iter().zip(&*batch.hits).zip(&*batch.payloads) {
            assert_eq!((ray.origin[0], hit.t, hit.primitive, payload), (next as f32, next as f32, 3, next));
            next += 1;
        }
        if batch.rays.is_empty() {
            break;
        }
    }
    assert_eq!(next as usize, rays);
    let empty = stream.recycle();
    assert_eq!((empty.rays(), empty.shadow_rays()), (0, 0));
    empty
}

#[test]
fn any_split_into_chunks_gives_the_same_answers() {
    for (rays, shadow_rays) in [(10, 7), (10, 0), (0, 7), (1, 1)] {
        for most in 1..=20 {
            let tracer = ByOrigin::default();
            let mut scratch = ChunkScratch::default();
            let mut stream = filled(rays, shadow_rays).seal().open();
            let mut chunks = Vec::new();
            while stream.left() > 0 {
                chunks.push(stream.next_chunk(most));
            }
            assert!(chunks.iter().all(|chunk| chunk.len() <= most && !chunk.is_empty()));
            for chunk in chunks.into_iter().rev() {
                assert!(!stream.is_traced());
                let len = chunk.len();
                let traced = chunk.trace(&tracer, &mut scratch);
                assert_eq!(traced.rays(), len);
                assert!(stream.owns(&traced));
                stream.put_back(traced);
            }
            check(stream.close(), rays, shadow_rays);
        }
    }
}

#[test]
fn a_device_traces_in_pieces_of_its_size() {
    for (rays, shadow_rays) in [(10, 7), (0, 7), (4, 0), (3, 5)] {
        let device = Frail::device(usize::MAX, false);
        let (stream, report) = filled(rays, shadow_rays).seal().trace_on(&device).unwrap();
        assert_eq!(report.bytes_copied, rays as u64);
        check(stream, rays, shadow_rays);
    }
}

#[test]
fn answers_of_a_lost_device_are_traced_again() {
    for (calls, panics, reason) in [
        (0, false, "the GPU was lost: gone"),
        (2, false, "the GPU was lost: gone"),
        (1, true, "it panicked: boom"),
    ] {
        let untraced = filled(10, 7).seal().trace_on(&Frail::device(calls, panics)).unwrap_err();
        assert_eq!(untraced.reason, reason);
        let mut stream = untraced.stream.open();
        let chunk = stream.next_chunk(100);
        stream.put_back(chunk.trace(&ByOrigin::default(), &mut ChunkScratch::default()));
        check(stream.close(), 10, 7);
    }
}

/// A device that allocates memory for streams until it is lost. From then on that memory may not be written.
struct SharingDevice {
    lost: Arc<AtomicBool>,
    allocated: AtomicUsize,
    dies: bool,
}

#[derive(Debug)]
struct SharedMemory<T> {
    elements: Vec<T>,
    /// True if the device owns it for good.
    is_device_owned: bool,
    lost: Arc<AtomicBool>,
}

impl<T: Debug + Send + Sync + 'static> DeviceMemory<T> for SharedMemory<T> {
    fn as_slice(&self) -> &[T] {
        assert!(!self.is_device_owned || size_of::<T>() == size_of::<Ray>(), "the device writes answers");
        &self.elements
    }

    fn as_mut_slice(&mut self) -> &mut [T] {
        assert!(!self.is_device_owned, "the device owns it");
        &mut self.elements
    }

    fn is_sound(&self) -> bool {
        !self.lost.load(Relaxed)
    }
}

impl SharingDevice {
    fn new(dies: bool) -> Self {
        Self { lost: Arc::default(), allocated: AtomicUsize::new(0), dies }
    }

    fn allocate<T: Clone + Debug + Send + Sync + 'static>(
        &self,
        value: T,
        len: usize,
    ) -> Box<SharedMemory<T>> {
        Box::new(SharedMemory { elements: vec![value; len], is_device_owned: false, lost: self.lost.clone() })
    }
}

fn downcast<T: 'static>(memory: &mut dyn DeviceMemory<T>) -> &mut SharedMemory<T> {
    let memory: &mut dyn std::any::Any = memory;
    memory.downcast_mut().expect("memory of this device")
}

impl DeviceTracer for SharingDevice {
    fn name(&self) -> &str {
        "sharing"
    }

    fn stream_memory(
        &self,
        capacity: Capacity,
        current: Option<&dyn DeviceMemory<Ray>>,
    ) -> Option<StreamMemory> {
        if current.is_some() || self.lost.load(Relaxed) {
            return None;
        }
        self.allocated.fetch_add(1, Relaxed);
        Some(StreamMemory {
            rays: self.allocate(Ray::default(), capacity.rays),
            hits: self.allocate(Hit::NONE, capacity.rays),
            shadow_rays: self.allocate(Ray::default(), capacity.shadow_rays),
            occluded: self.allocate(0, capacity.shadow_rays),
        })
    }

    fn submit(&self, bundle: Vec<DeviceStream>) -> Result<Box<dyn Ticket>, DeviceError> {
        let mut reports = Vec::new();
        for stream in &bundle {
            let [rays, shadow_rays] = stream.ray_memory().expect("memory of this device");
            let mut answers = stream.answers();
            let (hits, occluded) = answers.memory().expect("memory of this device");
            let (hits, occluded) = (downcast(hits), downcast(occluded));
            if self.dies {
                (hits.is_device_owned, occluded.is_device_owned) = (true, true);
                self.lost.store(true, Relaxed);
                return Err(DeviceError::Lost("gone".to_owned()));
            }
            let (n, m) = (stream.rays().len(), stream.shadow_rays().len());
            ByOrigin::default().closest(&rays.as_slice()[..n], &mut hits.elements[..n]);
            ByOrigin::default().occluded(&shadow_rays.as_slice()[..m], &mut occluded.elements[..m]);
            reports.push(DeviceReport::default());
        }
        Ok(Box::new(Later { reports, waits: 1 }))
    }
}

/// Is done at the second look.
struct Later {
    reports: Vec<DeviceReport>,
    waits: usize,
}

impl Ticket for Later {
    fn wait(&mut self, _: Duration) -> Result<Option<Vec<Box<dyn Resolve>>>, DeviceError> {
        if self.waits > 0 {
            self.waits -= 1;
            return Ok(None);
        }
        Ok(Some(self.reports.drain(..).map(|report| Box::new(Sound(report)) as Box<dyn Resolve>).collect()))
    }
}

struct Sound(DeviceReport);

impl Resolve for Sound {
    fn resolve(self: Box<Self>, _: &DeviceStream) -> Result<DeviceReport, DeviceError> {
        Ok(self.0)
    }
}

/// Answers in bad faith.
struct Wrong;

impl Resolve for Wrong {
    fn resolve(self: Box<Self>, stream: &DeviceStream) -> Result<DeviceReport, DeviceError> {
        stream.answers().slices().0.fill(Hit::default());
        Err(DeviceError::Failed("7 of 9 differ".to_owned()))
    }
}

#[test]
fn a_stream_comes_back_whole_whatever_a_device_does_with_its_share() {
    let again = |stream: RayStream<Full, u32, u64>| {
        let mut stream = stream.open();
        let chunk = stream.next_chunk(100);
        stream.put_back(chunk.trace(&ByOrigin::default(), &mut ChunkScratch::default()));
        check(stream.close(), 10, 7);
    };
    let (stream, share) = filled(10, 7).seal().give();
    drop(share);
    again(stream.answered(Box::new(Wrong)).resolve().unwrap_err().stream);
    // A share that the device keeps.
    let (stream, share) = filled(10, 7).seal().give();
    again(stream.take_back());
    assert_eq!(share.rays().len(), 10);
    let (stream, kept) = filled(10, 7).seal().give();
    let untraced = stream.answered(Box::new(Sound(DeviceReport::default()))).resolve().unwrap_err();
    assert_eq!(untraced.reason, "it keeps a stream");
    again(untraced.stream);
    drop(kept);
}

#[test]
fn a_stream_is_stored_in_memory_of_its_device() {
    let device = SharingDevice::new(false);
    let mut empty = RayStream::new();
    for (rays, shadow_rays) in [(10, 7), (0, 3), (5, 0)] {
        let (stream, _) = fill(empty, Some(&device), rays, shadow_rays).seal().trace_on(&device).unwrap();
        empty = check(stream, rays, shadow_rays);
    }
    // Host threads trace it there, too.
    let mut stream = fill(empty, Some(&device), 10, 7).seal().open();
    while stream.left() > 0 {
        let chunk = stream.next_chunk(3);
        stream.put_back(chunk.trace(&ByOrigin::default(), &mut ChunkScratch::default()));
    }
    check(stream.close(), 10, 7);
    assert_eq!(device.allocated.load(Relaxed), 1);
}

#[test]
fn rays_outlive_the_device_that_stores_them_and_its_memory_is_then_replaced() {
    let device = SharingDevice::new(true);
    let untraced = fill(RayStream::new(), Some(&device), 10, 7).seal().trace_on(&device).unwrap_err();
    assert_eq!(untraced.reason, "the GPU was lost: gone");
    let mut stream = untraced.stream.open();
    let chunk = stream.next_chunk(5);
    let other = stream.next_chunk(100);
    for chunk in [chunk, other] {
        stream.put_back(chunk.trace(&ByOrigin::default(), &mut ChunkScratch::default()));
    }
    let empty = check(stream.close(), 10, 7);
    // Writing to the old memory would panic.
    let stream = fill(empty, Some(&device), 4, 4).seal();
    assert_eq!((stream.rays(), device.allocated.load(Relaxed)), (4, 1));
}

#[test]
fn memory_is_kept() {
    let mut stream = filled(10, 7).seal().discard().fill();
    let first = stream.append(CAPACITY, None, |appender| appender.rays.memory.as_ptr());
    let mut again = stream.unfill().fill();
    assert_eq!(again.append(CAPACITY, None, |appender| appender.rays.memory.as_ptr()), first);
}

#[test]
fn paths_are_counted_by_the_larger_need() {
    assert_eq!([paths(5, 0, 1), paths(5, 7, 1), paths(5, 7, 2), paths(0, 7, 2)], [5, 7, 5, 4]);
}

#[test]
fn tracers_are_not_called_without_rays() {
    let tracer = ByOrigin::default();
    let mut stream = filled(10, 0).seal().open();
    let traced = stream.next_chunk(10).trace(&tracer, &mut ChunkScratch::default());
    stream.put_back(traced);
    assert_eq!(tracer.calls.load(Relaxed), 1);
}

#[test]
#[should_panic(expected = "a stream that takes 10 rays was given more")]
fn a_stream_does_not_take_too_many() {
    drop(filled(11, 0));
}

#[test]
#[should_panic(expected = "every ray has a payload")]
fn a_ray_has_a_payload() {
    let mut stream = RayStream::<_, u32, u32>::new().fill();
    stream.append(CAPACITY, None, |mut appender| appender.rays.push(Ray::default()));
}

fn traced(rays: usize, shadow_rays: usize) -> RayStream<Traced, u32, u64> {
    filled(rays, shadow_rays).seal().trace_on(&Frail::device(usize::MAX, false)).unwrap().0
}

#[test]
#[should_panic(expected = "shadow rays are taken before rays are shaded")]
fn shadow_rays_come_first() {
    let mut stream = traced(1, 1);
    stream.next_batch(1);
}

#[test]
#[should_panic(expected = "rays may not be lost")]
fn unshaded_rays_are_not_lost() {
    let mut stream = traced(2, 0);
    stream.take_shadows();
    stream.next_batch(1);
    drop(stream.recycle());
}

#[test]
#[should_panic(expected = "rays may not be lost")]
fn appended_rays_are_not_lost() {
    drop(filled(0, 1).unfill());
}

#[test]
#[should_panic(expected = "every chunk is back")]
fn a_stream_is_traced_when_its_chunks_are_back() {
    let mut stream = filled(3, 0).seal().open();
    let _chunk = stream.next_chunk(3);
    drop(stream.close());
}

#[test]
#[should_panic(expected = "a chunk returns to its stream")]
fn chunks_return_to_their_stream() {
    let mut streams = [filled(3, 0).seal().open(), filled(3, 0).seal().open()];
    let chunk = streams[0].next_chunk(3).trace(&ByOrigin::default(), &mut ChunkScratch::default());
    streams[1].put_back(chunk);
}

#[test]
fn a_panic_with_any_payload_has_a_message() {
    struct Loud;
    impl Drop for Loud {
        fn drop(&mut self) {
            std::panic::resume_unwind(Box::new("again"));
        }
    }
    assert_eq!(panic_message(Box::new("text")), "text");
    assert_eq!(panic_message(Box::new("owned".to_owned())), "owned");
    assert_eq!(panic_message(Box::new(Arc::new(Loud))), "(no message)");
}

#[test]
fn only_the_counted_rays_of_a_row_are_appended() {
    let ray = |i: usize| Ray::new(glam::Vec3::splat(i as f32), glam::Vec3::X);
    let row: Vec<Ray> = (0..4).map(ray).collect();
    let mut rays = RayArray::with_capacity(6);
    // The whole row fits twice, then only the counted rays do.
    for (count, len) in [(2, 2), (0, 2), (1, 3), (3, 6), (0, 6)] {
        rays.appender().extend_from_row(&row, count);
        assert_eq!(rays.len(), len);
    }
    let origins: Vec<f32> = rays.iter().map(|ray| ray.origin[0]).collect();
    assert_eq!(origins, [0.0, 1.0, 0.0, 0.0, 1.0, 2.0]);
    let full = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        rays.appender().extend_from_row(&row, 1);
    }));
    assert!(full.is_err(), "the capacity is exceeded");
}
