//! Embree 4 as a peer, loaded at run time from a shared library that the user names.
//!
//! Unsafe code, because of a foreign library. Invariants:
//! 1. The types and constants below are those of Embree 4.0 to 4.4's headers; hits include the
//!    instance-primitive id, so that the memory is enough with and without it.
//! 2. A device and its scenes live no longer than the library, the ledger and the buffers that they share.
//! 3. Rays and packets are aligned as Embree asks.
#![allow(unsafe_code, reason = "the invariants above")]

use crate::stream::{Hit, MISS, Ray};
use glam::Vec3;
use libloading::Library;
use std::ffi::{c_char, c_int, c_uint, c_void};
use std::mem::ManuallyDrop;
use std::path::{Path, PathBuf};
use std::ptr;
use std::sync::atomic::{AtomicIsize, Ordering};
use std::time::Instant;

type Handle = *mut c_void;

/// Rays in a packet.
pub const PACKET: usize = 16;

const FLAG_ROBUST: c_uint = 1 << 2;
const QUERY_COHERENT: c_uint = 1 << 16;
const FORMAT_UINT3: c_uint = 0x5003;
const FORMAT_FLOAT3: c_uint = 0x9003;

/// Why Embree is not there.
#[derive(Debug, thiserror::Error)]
pub enum EmbreeError {
    /// The library cannot be loaded or lacks a function.
    #[error("{path}: cannot use this as the Embree 4 library: {source}", path = path.display())]
    Library {
        /// What was asked for.
        path: PathBuf,
        /// The loader's word.
        source: libloading::Error,
    },
    /// Embree refused.
    #[error("Embree could not {action}: error {code}")]
    Refused {
        /// What it was to do.
        action: &'static str,
        /// Its error code.
        code: c_int,
    },
}

/// How rays are handed to Embree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// One at a time.
    Single,
    /// Sixteen at a time.
    Packet,
    /// Sixteen at a time, said to be coherent.
    CoherentPacket,
}

impl Mode {
    /// All modes.
    pub const ALL: [Self; 3] = [Self::Single, Self::Packet, Self::CoherentPacket];

    /// What reports call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Single => "single",
            Self::Packet => "packet",
            Self::CoherentPacket => "coherent packet",
        }
    }
}

/// How much care Embree takes when it builds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Quality {
    /// Morton codes, for scenes that change.
    Low = 0,
    /// Its default: binned surface area heuristic.
    Medium = 1,
    /// With spatial splits.
    High = 2,
}

impl Quality {
    /// All qualities.
    pub const ALL: [Self; 3] = [Self::Low, Self::Medium, Self::High];

    /// What reports call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Low => "low",
            Self::Medium => "medium",
            Self::High => "high",
        }
    }
}

/// Bytes that a device has, as its memory monitor tells.
#[derive(Default)]
struct Ledger {
    now: AtomicIsize,
    most: AtomicIsize,
}

/// `RTCMemoryMonitorFunction`.
extern "C" fn monitor(ledger: *mut c_void, bytes: isize, _post: bool) -> bool {
    // SAFETY: invariant 2.
    let ledger = unsafe { &*ledger.cast::<Ledger>().cast_const() };
    let now = ledger.now.fetch_add(bytes, Ordering::Relaxed) + bytes;
    ledger.most.fetch_max(now, Ordering::Relaxed);
    true
}

/// `RTCRayHit`.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(16))]
struct RayHit {
    origin: [f32; 3],
    t_near: f32,
    direction: [f32; 3],
    time: f32,
    t_far: f32,
    mask: u32,
    id: u32,
    flags: u32,
    normal: [f32; 3],
    u: f32,
    v: f32,
    primitive: u32,
    geometry: u32,
    instance: u32,
    instance_primitive: u32,
}

/// `RTCRayHit16`: the same fields, sixteen each.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct RayHit16 {
    origin: [[f32; PACKET]; 3],
    t_near: [f32; PACKET],
    direction: [[f32; PACKET]; 3],
    time: [f32; PACKET],
    t_far: [f32; PACKET],
    mask: [u32; PACKET],
    id: [u32; PACKET],
    flags: [u32; PACKET],
    normal: [[f32; PACKET]; 3],
    u: [f32; PACKET],
    v: [f32; PACKET],
    primitive: [u32; PACKET],
    geometry: [u32; PACKET],
    instance: [u32; PACKET],
    instance_primitive: [u32; PACKET],
}

/// `RTCIntersectArguments` and `RTCOccludedArguments`, which are alike.
#[repr(C)]
struct Arguments {
    flags: c_uint,
    features: c_uint,
    context: Handle,
    filter: Handle,
    intersect: Handle,
    min_width: f32,
}

type One = unsafe extern "C" fn(Handle, *mut RayHit, *mut Arguments);
type Sixteen = unsafe extern "C" fn(*const c_int, Handle, *mut RayHit16, *mut Arguments);
type Monitor = extern "C" fn(*mut c_void, isize, bool) -> bool;
type SetBuffer = unsafe extern "C" fn(Handle, c_uint, c_uint, c_uint, *const c_void, usize, usize, usize);

macro_rules! functions {
    ($($field:ident: $type:ty = $name:literal,)*) => {
        struct Functions { $($field: $type,)* }

        impl Functions {
            fn load(library: &Library) -> Result<Self, libloading::Error> {
                // SAFETY: invariant 1.
                Ok(Self { $($field: unsafe { *library.get::<$type>($name)? },)* })
            }
        }
    };
}

functions! {
    new_device: unsafe extern "C" fn(*const c_char) -> Handle = b"rtcNewDevice\0",
    release_device: unsafe extern "C" fn(Handle) = b"rtcReleaseDevice\0",
    error: unsafe extern "C" fn(Handle) -> c_int = b"rtcGetDeviceError\0",
    set_monitor: unsafe extern "C" fn(Handle, Monitor, *mut c_void) = b"rtcSetDeviceMemoryMonitorFunction\0",
    set_quality: unsafe extern "C" fn(Handle, c_uint) = b"rtcSetSceneBuildQuality\0",
    new_scene: unsafe extern "C" fn(Handle) -> Handle = b"rtcNewScene\0",
    release_scene: unsafe extern "C" fn(Handle) = b"rtcReleaseScene\0",
    set_flags: unsafe extern "C" fn(Handle, c_uint) = b"rtcSetSceneFlags\0",
    new_geometry: unsafe extern "C" fn(Handle, c_uint) -> Handle = b"rtcNewGeometry\0",
    release_geometry: unsafe extern "C" fn(Handle) = b"rtcReleaseGeometry\0",
    set_buffer: SetBuffer = b"rtcSetSharedGeometryBuffer\0",
    commit_geometry: unsafe extern "C" fn(Handle) = b"rtcCommitGeometry\0",
    attach: unsafe extern "C" fn(Handle, Handle) -> c_uint = b"rtcAttachGeometry\0",
    commit_scene: unsafe extern "C" fn(Handle) = b"rtcCommitScene\0",
    intersect_one: One = b"rtcIntersect1\0",
    occluded_one: One = b"rtcOccluded1\0",
    intersect_sixteen: Sixteen = b"rtcIntersect16\0",
    occluded_sixteen: Sixteen = b"rtcOccluded16\0",
}

/// The library with a device.
pub struct Embree {
    functions: Functions,
    device: Handle,
    ledger: Box<Ledger>,
    /// Never unloaded: the threads that Embree started would lose their code.
    _library: ManuallyDrop<Library>,
}

// SAFETY: Embree's device may be used from any thread.
unsafe impl Send for Embree {}
// SAFETY: as above.
unsafe impl Sync for Embree {}

impl Embree {
    /// Loads the library and makes a device that builds with `threads` threads.
    ///
    /// # Errors
    /// When the file is not Embree 4 or no device can be had.
    pub fn load(path: &Path, threads: usize) -> Result<Self, EmbreeError> {
        let refused = |source| EmbreeError::Library { path: path.to_owned(), source };
        // SAFETY: the user vouches for the library that they name.
        let library = unsafe { Library::new(path) }.map_err(refused)?;
        let functions = Functions::load(&library).map_err(refused)?;
        let config = format!("threads={threads},set_affinity=0\0");
        // SAFETY: invariant 1; the string ends in 0.
        let device = unsafe { (functions.new_device)(config.as_ptr().cast()) };
        if device.is_null() {
            // SAFETY: without a device the call gives the error of making one.
            let code = unsafe { (functions.error)(ptr::null_mut()) };
            return Err(EmbreeError::Refused { action: "make a device", code });
        }
        let ledger = Box::<Ledger>::default();
        // SAFETY: invariants 1 and 2: the ledger lives until the device is released.
        unsafe { (functions.set_monitor)(device, monitor, ptr::from_ref(&*ledger).cast_mut().cast()) };
        Ok(Self { functions, device, ledger, _library: ManuallyDrop::new(library) })
    }

    /// Builds a scene of medium quality.
    ///
    /// # Errors
    /// When Embree reports one.
    pub fn scene(
        &self,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        robust: bool,
    ) -> Result<EmbreeScene<'_>, EmbreeError> {
        self.build(positions, triangles, robust, Quality::Medium)
    }

    /// Builds a scene.
    ///
    /// # Errors
    /// When Embree reports one.
    pub fn build(
        &self,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        robust: bool,
        quality: Quality,
    ) -> Result<EmbreeScene<'_>, EmbreeError> {
        let f = &self.functions;
        // Embree reads four floats for each vertex.
        let mut vertices: Vec<[f32; 3]> = positions.iter().map(|p| p.to_array()).collect();
        vertices.push([0.0; 3]);
        let indices = triangles.to_vec();
        let bytes_before = self.ledger.now.load(Ordering::Relaxed);
        self.ledger.most.store(bytes_before, Ordering::Relaxed);
        let start = Instant::now();
        // SAFETY: invariants 1 and 2: the buffers move into the scene, where they stay as they are.
        let handle = unsafe {
            let scene = (f.new_scene)(self.device);
            (f.set_flags)(scene, if robust { FLAG_ROBUST } else { 0 });
            (f.set_quality)(scene, quality as c_uint);
            let geometry = (f.new_geometry)(self.device, 0);
            let (v, i) = (vertices.as_ptr().cast(), indices.as_ptr().cast());
            (f.set_buffer)(geometry, 1, 0, FORMAT_FLOAT3, v, 0, 12, positions.len());
            (f.set_buffer)(geometry, 0, 0, FORMAT_UINT3, i, 0, 12, indices.len());
            (f.commit_geometry)(geometry);
            (f.attach)(scene, geometry);
            (f.release_geometry)(geometry);
            (f.commit_scene)(scene);
            scene
        };
        let since = |bytes: &AtomicIsize| (bytes.load(Ordering::Relaxed) - bytes_before).max(0) as usize;
        let scene = EmbreeScene {
            embree: self,
            handle,
            robust,
            build_s: start.elapsed().as_secs_f64(),
            bytes: since(&self.ledger.now),
            peak_bytes: since(&self.ledger.most),
            _vertices: vertices,
            _indices: indices,
        };
        // SAFETY: the device lives.
        match unsafe { (f.error)(self.device) } {
            0 => Ok(scene),
            code => Err(EmbreeError::Refused { action: "build the scene", code }),
        }
    }
}

impl Drop for Embree {
    fn drop(&mut self) {
        // SAFETY: invariant 2.
        unsafe { (self.functions.release_device)(self.device) };
    }
}

/// A built scene.
pub struct EmbreeScene<'a> {
    embree: &'a Embree,
    handle: Handle,
    robust: bool,
    /// Seconds that the build took.
    pub build_s: f64,
    /// Bytes that it left, by the device's memory monitor. Vertices and indices are not among them.
    pub bytes: usize,
    /// The most bytes that it had.
    pub peak_bytes: usize,
    _vertices: Vec<[f32; 3]>,
    _indices: Vec<[u32; 3]>,
}

// SAFETY: a committed scene may be queried from any thread.
unsafe impl Send for EmbreeScene<'_> {}
// SAFETY: as above.
unsafe impl Sync for EmbreeScene<'_> {}

impl Drop for EmbreeScene<'_> {
    fn drop(&mut self) {
        // SAFETY: invariant 2.
        unsafe { (self.embree.functions.release_scene)(self.handle) };
    }
}

/// Rays in the form that a mode wants, and after tracing their answers.
#[derive(Clone)]
pub struct EmbreeRays {
    mode: Mode,
    one: Vec<RayHit>,
    sixteen: Vec<RayHit16>,
    len: usize,
}

impl EmbreeRays {
    /// Converts rays; not part of what is timed.
    pub fn new(rays: &[Ray], mode: Mode) -> Self {
        let ones = rays.iter().map(|ray| RayHit {
            origin: ray.origin,
            t_near: ray.t_min.max(0.0),
            direction: ray.direction,
            t_far: ray.t_max,
            mask: u32::MAX,
            primitive: MISS,
            geometry: MISS,
            instance: MISS,
            instance_primitive: MISS,
            ..RayHit::default()
        });
        let mut this = Self { mode, one: Vec::new(), sixteen: Vec::new(), len: rays.len() };
        match mode {
            Mode::Single => this.one = ones.collect(),
            Mode::Packet | Mode::CoherentPacket => {
                let ones: Vec<RayHit> = ones.collect();
                this.sixteen = ones.chunks(PACKET).map(pack).collect();
            }
        }
        this
    }

    /// The hit of a ray, `t` of [`Hit::NONE`] for a miss.
    pub fn hit(&self, ray: usize) -> Hit {
        let (t, u, v, primitive) = match self.mode {
            Mode::Single => {
                let r = &self.one[ray];
                (r.t_far, r.u, r.v, r.primitive)
            }
            _ => {
                let (p, lane) = (&self.sixteen[ray / PACKET], ray % PACKET);
                (p.t_far[lane], p.u[lane], p.v[lane], p.primitive[lane])
            }
        };
        if primitive == MISS { Hit::NONE } else { Hit { t, u, v, primitive } }
    }

    /// Whether an any-hit query found the ray occluded.
    pub fn is_occluded(&self, ray: usize) -> bool {
        let t_far = match self.mode {
            Mode::Single => self.one[ray].t_far,
            _ => self.sixteen[ray / PACKET].t_far[ray % PACKET],
        };
        t_far == f32::NEG_INFINITY
    }

    /// Number of rays.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }
}

/// Sixteen rays or fewer, the last repeated.
fn pack(rays: &[RayHit]) -> RayHit16 {
    let ray = |lane: usize| &rays[lane.min(rays.len() - 1)];
    let vector =
        |get: fn(&RayHit) -> [f32; 3]| [0, 1, 2].map(|axis| std::array::from_fn(|i| get(ray(i))[axis]));
    RayHit16 {
        origin: vector(|r| r.origin),
        t_near: std::array::from_fn(|i| ray(i).t_near),
        direction: vector(|r| r.direction),
        time: [0.0; PACKET],
        t_far: std::array::from_fn(|i| ray(i).t_far),
        mask: [u32::MAX; PACKET],
        id: [0; PACKET],
        flags: [0; PACKET],
        normal: [[0.0; PACKET]; 3],
        u: [0.0; PACKET],
        v: [0.0; PACKET],
        primitive: [MISS; PACKET],
        geometry: [MISS; PACKET],
        instance: [MISS; PACKET],
        instance_primitive: [MISS; PACKET],
    }
}

impl EmbreeScene<'_> {
    /// Whether it was built for robust queries.
    pub fn is_robust(&self) -> bool {
        self.robust
    }

    /// Traces the rays on the calling thread.
    pub fn trace(&self, rays: &mut EmbreeRays, any: bool) {
        let f = &self.embree.functions;
        let coherent = rays.mode == Mode::CoherentPacket;
        let mut arguments = Arguments {
            flags: if coherent { QUERY_COHERENT } else { 0 },
            features: c_uint::MAX,
            context: ptr::null_mut(),
            filter: ptr::null_mut(),
            intersect: ptr::null_mut(),
            min_width: 0.0,
        };
        let (one, sixteen) =
            if any { (f.occluded_one, f.occluded_sixteen) } else { (f.intersect_one, f.intersect_sixteen) };
        let valid = Valid([-1; PACKET]);
        for ray in &mut rays.one {
            // SAFETY: invariants 1 and 3.
            unsafe { one(self.handle, ray, &mut arguments) };
        }
        for packet in &mut rays.sixteen {
            // SAFETY: invariants 1 and 3.
            unsafe { sixteen(valid.0.as_ptr(), self.handle, packet, &mut arguments) };
        }
    }
}

/// The lanes of a packet that count: all.
#[repr(align(64))]
struct Valid([c_int; PACKET]);
