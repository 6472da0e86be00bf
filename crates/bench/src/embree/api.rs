//! Embree 4's C interface: the structures and functions that the benchmarks use.
//!
//! Unsafe code for looking up functions by name. Invariant:
//! 1. The types below are those of the headers of Embree 4.0 to 4.4. Hits have room for the instance-primitive id
//!    that later versions add, so that versions with and without it write within them.
#![allow(unsafe_code, reason = "calls a foreign library; the invariant above")]

use libloading::Library;
use raystream::stream::{MISS, Ray};
use std::ffi::{c_char, c_int, c_uint, c_void};

/// Any of Embree's opaque pointers.
pub type Handle = *mut c_void;

/// Rays in a packet.
pub const PACKET: usize = 16;

pub const FLAG_ROBUST: c_uint = 1 << 2;
pub const QUERY_COHERENT: c_uint = 1 << 16;
pub const FORMAT_UINT3: c_uint = 0x5003;
pub const FORMAT_FLOAT3: c_uint = 0x9003;

/// `RTCRayHit`.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(16))]
pub struct RayHit {
    pub origin: [f32; 3],
    pub t_near: f32,
    pub direction: [f32; 3],
    pub time: f32,
    pub t_far: f32,
    pub mask: u32,
    pub id: u32,
    pub flags: u32,
    pub normal: [f32; 3],
    pub u: f32,
    pub v: f32,
    pub primitive: u32,
    pub geometry: u32,
    pub instance: u32,
    pub instance_primitive: u32,
}

/// `RTCRayHit16`: the same fields, sixteen each.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct RayHit16 {
    pub origin: [[f32; PACKET]; 3],
    pub t_near: [f32; PACKET],
    pub direction: [[f32; PACKET]; 3],
    pub time: [f32; PACKET],
    pub t_far: [f32; PACKET],
    pub mask: [u32; PACKET],
    pub id: [u32; PACKET],
    pub flags: [u32; PACKET],
    pub normal: [[f32; PACKET]; 3],
    pub u: [f32; PACKET],
    pub v: [f32; PACKET],
    pub primitive: [u32; PACKET],
    pub geometry: [u32; PACKET],
    pub instance: [u32; PACKET],
    pub instance_primitive: [u32; PACKET],
}

impl RayHit {
    /// A ray that has hit nothing yet.
    pub fn new(ray: &Ray) -> Self {
        Self {
            origin: ray.origin,
            t_near: ray.t_min.max(0.0),
            direction: ray.direction,
            t_far: ray.t_max,
            mask: u32::MAX,
            primitive: MISS,
            geometry: MISS,
            instance: MISS,
            instance_primitive: MISS,
            ..Self::default()
        }
    }
}

impl RayHit16 {
    /// One to sixteen rays that have hit nothing yet; the last one fills the lanes that are left.
    pub fn new(rays: &[Ray]) -> Self {
        let ray = |lane: usize| &rays[lane.min(rays.len() - 1)];
        let vector =
            |get: fn(&Ray) -> [f32; 3]| [0, 1, 2].map(|axis| std::array::from_fn(|i| get(ray(i))[axis]));
        Self {
            origin: vector(|r| r.origin),
            t_near: std::array::from_fn(|i| ray(i).t_min.max(0.0)),
            direction: vector(|r| r.direction),
            time: [0.0; PACKET],
            t_far: std::array::from_fn(|i| ray(i).t_max),
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
}

/// The lanes of a packet in use: all of them.
#[repr(align(64))]
pub struct Valid(pub [c_int; PACKET]);

/// `RTCIntersectArguments` and `RTCOccludedArguments`, which have the same fields.
#[repr(C)]
pub struct Arguments {
    pub flags: c_uint,
    pub features: c_uint,
    pub context: Handle,
    pub filter: Handle,
    pub intersect: Handle,
    pub min_width: f32,
}

/// `RTCFilterFunctionNArguments`.
#[repr(C)]
pub struct FilterArguments {
    /// One number a ray: −1 for a candidate, 0 for none; the filter writes 0 to refuse one.
    pub valid: *mut c_int,
    pub user_data: Handle,
    pub context: Handle,
    pub ray: Handle,
    /// The candidates' hits, field by field, `count` of each.
    pub hit: Handle,
    pub count: c_uint,
}

type One = unsafe extern "C" fn(Handle, *mut RayHit, *mut Arguments);
type Sixteen = unsafe extern "C" fn(*const c_int, Handle, *mut RayHit16, *mut Arguments);
type Monitor = unsafe extern "C" fn(Handle, isize, bool) -> bool;
type Filter = unsafe extern "C" fn(*const FilterArguments);
type SetFilter = unsafe extern "C" fn(Handle, Filter);
type SetBuffer = unsafe extern "C" fn(Handle, c_uint, c_uint, c_uint, *const c_void, usize, usize, usize);

macro_rules! functions {
    ($($field:ident: $type:ty = $name:literal,)*) => {
        /// Embree's functions.
        pub struct Functions { $(pub $field: $type,)* }

        impl Functions {
            /// Looks up all of them.
            ///
            /// # Safety
            /// The library must be Embree 4.
            pub unsafe fn load(library: &Library) -> Result<Self, libloading::Error> {
                // SAFETY: invariant 1; the caller vouches for the library.
                Ok(Self { $($field: unsafe { *library.get::<$type>($name)? },)* })
            }
        }
    };
}

functions! {
    new_device: unsafe extern "C" fn(*const c_char) -> Handle = b"rtcNewDevice\0",
    release_device: unsafe extern "C" fn(Handle) = b"rtcReleaseDevice\0",
    error: unsafe extern "C" fn(Handle) -> c_int = b"rtcGetDeviceError\0",
    set_monitor: unsafe extern "C" fn(Handle, Monitor, Handle) = b"rtcSetDeviceMemoryMonitorFunction\0",
    set_quality: unsafe extern "C" fn(Handle, c_uint) = b"rtcSetSceneBuildQuality\0",
    new_scene: unsafe extern "C" fn(Handle) -> Handle = b"rtcNewScene\0",
    release_scene: unsafe extern "C" fn(Handle) = b"rtcReleaseScene\0",
    set_flags: unsafe extern "C" fn(Handle, c_uint) = b"rtcSetSceneFlags\0",
    new_geometry: unsafe extern "C" fn(Handle, c_uint) -> Handle = b"rtcNewGeometry\0",
    release_geometry: unsafe extern "C" fn(Handle) = b"rtcReleaseGeometry\0",
    set_buffer: SetBuffer = b"rtcSetSharedGeometryBuffer\0",
    set_user_data: unsafe extern "C" fn(Handle, Handle) = b"rtcSetGeometryUserData\0",
    set_intersect_filter: SetFilter = b"rtcSetGeometryIntersectFilterFunction\0",
    set_occluded_filter: SetFilter = b"rtcSetGeometryOccludedFilterFunction\0",
    commit_geometry: unsafe extern "C" fn(Handle) = b"rtcCommitGeometry\0",
    attach: unsafe extern "C" fn(Handle, Handle) -> c_uint = b"rtcAttachGeometry\0",
    commit_scene: unsafe extern "C" fn(Handle) = b"rtcCommitScene\0",
    intersect_one: One = b"rtcIntersect1\0",
    occluded_one: One = b"rtcOccluded1\0",
    intersect_sixteen: Sixteen = b"rtcIntersect16\0",
    occluded_sixteen: Sixteen = b"rtcOccluded16\0",
}
