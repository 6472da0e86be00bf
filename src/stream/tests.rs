use super::*;
use std::fmt::Debug;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed};

/// Answers by the ray's origin, and counts calls.
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

/// Answers some calls and then is lost or panics, leaving rubbish.
struct Frail {
    calls_left: AtomicUsize,
    panics: bool,
}

impl Frail {
    fn new(calls: usize, panics: bool) -> Self {
        Self { calls_left: AtomicUsize::new(calls), panics }
    }
}

impl DeviceTracer for Frail {
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
    stream.append(CAPACITY, device, |mut columns| {
        (0..rays).for_each(|i| columns.rays.push(ray(i)));
        columns.payloads.extend(0..rays as u32);
        (0..shadow_rays).for_each(|i| columns.shadow_rays.push(ray(i)));
        columns.shadow_payloads.extend(0..shadow_rays as u64);
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
    assert!(stream.take_shadows().rays.is_empty(), "they are taken once");
    let mut next = 0;
    loop {
        let left = stream.rays_left();
        let batch = stream.next_batch(3);
        assert_eq!(batch.rays.len(), left.min(3));
        for ((ray, hit), &payload) in batch.rays.iter().zip(batch.hits).zip(batch.payloads) {
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
            let mut scratch = Scratch::default();
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
fn a_device_traces_in_pieces_it_can_take() {
    for (rays, shadow_rays) in [(10, 7), (0, 7), (4, 0), (3, 5)] {
        let device = Frail::new(usize::MAX, false);
        let (stream, report) = filled(rays, shadow_rays).seal().trace_on(&device).unwrap();
        assert_eq!(report.bytes_copied, rays as u64);
        check(stream, rays, shadow_rays);
    }
}

#[test]
fn what_a_dying_device_leaves_is_traced_again() {
    for (calls, panics, reason) in [
        (0, false, "the GPU was lost: gone"),
        (2, false, "the GPU was lost: gone"),
        (1, true, "it panicked: boom"),
    ] {
        let untraced = filled(10, 7).seal().trace_on(&Frail::new(calls, panics)).unwrap_err();
        assert_eq!(untraced.reason, reason);
        let mut stream = untraced.stream.open();
        let chunk = stream.next_chunk(100);
        stream.put_back(chunk.trace(&ByOrigin::default(), &mut Scratch::default()));
        check(stream.close(), 10, 7);
    }
}

/// A device that lends memory, until it is lost; then that may not be written to any more.
struct Lender {
    lost: Arc<AtomicBool>,
    lent: AtomicUsize,
    dies: bool,
}

#[derive(Debug)]
struct Lent<T> {
    slots: Vec<T>,
    /// With the device for ever.
    out: bool,
    lost: Arc<AtomicBool>,
}

impl<T: Debug + Send + Sync + 'static> DeviceMemory<T> for Lent<T> {
    fn slots(&self) -> &[T] {
        assert!(!self.out || size_of::<T>() == size_of::<Ray>(), "answers are the device's");
        &self.slots
    }

    fn slots_mut(&mut self) -> &mut [T] {
        assert!(!self.out, "the device has it");
        &mut self.slots
    }

    fn is_sound(&self) -> bool {
        !self.lost.load(Relaxed)
    }
}

impl Lender {
    fn new(dies: bool) -> Self {
        Self { lost: Arc::default(), lent: AtomicUsize::new(0), dies }
    }

    fn device<T: Clone + Debug + Send + Sync + 'static>(&self, value: T, len: usize) -> Box<Lent<T>> {
        Box::new(Lent { slots: vec![value; len], out: false, lost: self.lost.clone() })
    }
}

fn own<T: 'static>(device: &mut dyn DeviceMemory<T>) -> &mut Lent<T> {
    let device: &mut dyn std::any::Any = device;
    device.downcast_mut().expect("the lender's own")
}

impl DeviceTracer for Lender {
    fn name(&self) -> &str {
        "lender"
    }

    fn max_rays(&self) -> usize {
        100
    }

    fn memory_source(
        &self,
        capacity: Capacity,
        now: Option<&dyn DeviceMemory<Ray>>,
    ) -> Option<DeviceMemorySource> {
        if now.is_some() || self.lost.load(Relaxed) {
            return None;
        }
        self.lent.fetch_add(1, Relaxed);
        Some(DeviceMemorySource {
            rays: self.device(Ray::default(), capacity.rays),
            hits: self.device(Hit::NONE, capacity.rays),
            shadow_rays: self.device(Ray::default(), capacity.shadow_rays),
            occluded: self.device(0, capacity.shadow_rays),
        })
    }

    fn trace_in_place(&self, stream: InPlace<'_>) -> Option<Result<DeviceReport, DeviceError>> {
        let (rays, hits) = (own(stream.rays), own(stream.hits));
        let (shadow_rays, occluded) = (own(stream.shadow_rays), own(stream.occluded));
        if self.dies {
            (rays.out, hits.out, shadow_rays.out, occluded.out) = (true, true, true, true);
            self.lost.store(true, Relaxed);
            return Some(Err(DeviceError::Lost("gone".to_owned())));
        }
        let (n, m) = (stream.ray_count, stream.shadow_ray_count);
        ByOrigin::default().closest(&rays.slots[..n], &mut hits.slots[..n]);
        ByOrigin::default().occluded(&shadow_rays.slots[..m], &mut occluded.slots[..m]);
        Some(Ok(DeviceReport::default()))
    }

    fn trace(&self, _: Queries<'_>) -> Result<DeviceReport, DeviceError> {
        unreachable!("what lies in lent memory is traced there")
    }
}

#[test]
fn a_stream_lies_in_memory_that_its_device_lends() {
    let lender = Lender::new(false);
    let mut empty = RayStream::new();
    for (rays, shadow_rays) in [(10, 7), (0, 3), (5, 0)] {
        let (stream, _) = fill(empty, Some(&lender), rays, shadow_rays).seal().trace_on(&lender).unwrap();
        empty = check(stream, rays, shadow_rays);
    }
    // Host threads trace it there too.
    let mut stream = fill(empty, Some(&lender), 10, 7).seal().open();
    while stream.left() > 0 {
        let chunk = stream.next_chunk(3);
        stream.put_back(chunk.trace(&ByOrigin::default(), &mut Scratch::default()));
    }
    check(stream.close(), 10, 7);
    assert_eq!(lender.lent.load(Relaxed), 1);
}

#[test]
fn rays_outlive_the_device_that_lent_their_memory_which_is_then_let_go_of() {
    let lender = Lender::new(true);
    let untraced = fill(RayStream::new(), Some(&lender), 10, 7).seal().trace_on(&lender).unwrap_err();
    assert_eq!(untraced.reason, "the GPU was lost: gone");
    let mut stream = untraced.stream.open();
    let chunk = stream.next_chunk(5);
    let other = stream.next_chunk(100);
    for chunk in [chunk, other] {
        stream.put_back(chunk.trace(&ByOrigin::default(), &mut Scratch::default()));
    }
    let empty = check(stream.close(), 10, 7);
    // Its places may not be written to: a panic, if they were.
    let stream = fill(empty, Some(&lender), 4, 4).seal();
    assert_eq!((stream.rays(), lender.lent.load(Relaxed)), (4, 1));
}

#[test]
fn storage_is_kept() {
    let mut stream = filled(10, 7).seal().discard().fill();
    let first = stream.append(CAPACITY, None, |columns| columns.rays.slots.as_ptr());
    let mut again = stream.unfill().fill();
    assert_eq!(again.append(CAPACITY, None, |columns| columns.rays.slots.as_ptr()), first);
}

#[test]
fn paths_are_counted_by_the_greater_need() {
    assert_eq!([paths(5, 0, 1), paths(5, 7, 1), paths(5, 7, 2), paths(0, 7, 2)], [5, 7, 5, 4]);
}

#[test]
fn no_call_is_made_for_nothing() {
    let tracer = ByOrigin::default();
    let mut stream = filled(10, 0).seal().open();
    let traced = stream.next_chunk(10).trace(&tracer, &mut Scratch::default());
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
    stream.append(CAPACITY, None, |mut columns| columns.rays.push(Ray::default()));
}

fn traced(rays: usize, shadow_rays: usize) -> RayStream<Traced, u32, u64> {
    filled(rays, shadow_rays).seal().trace_on(&Frail::new(usize::MAX, false)).unwrap().0
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
fn chunks_do_not_stray() {
    let mut streams = [filled(3, 0).seal().open(), filled(3, 0).seal().open()];
    let chunk = streams[0].next_chunk(3).trace(&ByOrigin::default(), &mut Scratch::default());
    streams[1].put_back(chunk);
}

#[test]
fn a_panic_with_any_payload_is_told() {
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
fn of_a_row_as_many_are_appended_as_counted() {
    let ray = |i: usize| Ray::new(glam::Vec3::splat(i as f32), glam::Vec3::X);
    let row: Vec<Ray> = (0..4).map(ray).collect();
    let mut column = Column::with_capacity(6);
    // The whole row fits twice; then only what counts does.
    for (count, len) in [(2, 2), (0, 2), (1, 3), (3, 6), (0, 6)] {
        column.appender().extend_from_row(&row, count);
        assert_eq!(column.len(), len);
    }
    let origins: Vec<f32> = column.iter().map(|ray| ray.origin[0]).collect();
    assert_eq!(origins, [0.0, 1.0, 0.0, 0.0, 1.0, 2.0]);
    let full = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        column.appender().extend_from_row(&row, 1);
    }));
    assert!(full.is_err(), "there is no room");
}
