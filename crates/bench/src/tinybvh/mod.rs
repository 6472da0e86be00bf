//! tinybvh as a peer, loaded at run time from a shared library that `scripts/build_tinybvh` compiles: its header behind
//! the C interface of `shim.cpp`.
//!
//! Unsafe code for calling it. Invariants:
//! 1. The library is one of the script's: the caller of [`TinyBvh::load`] vouches for it. It is never unloaded, since
//!    threads that it starts for builds would lose their code.
//! 2. A tree lives no longer than the library and the corners that it was built over; rays no longer than the library.
//! 3. A tree does not change once it is built, so any thread may read it. Rays belong to one thread at a time.
#![allow(unsafe_code, reason = "calls a foreign library; the invariants above")]

use glam::Vec3;
use libloading::Library;
use raystream::stream::Ray;
use std::ffi::c_void;
use std::fmt;
use std::mem::ManuallyDrop;
use std::path::{Path, PathBuf};
use std::ptr::NonNull;
use std::time::Instant;

/// Error of loading or calling tinybvh.
#[derive(Debug, thiserror::Error)]
pub enum TinyBvhError {
    /// The library cannot be loaded or lacks a function.
    #[error("{path}: cannot use this as tinybvh of scripts/build_tinybvh: {source}", path = path.display())]
    Library {
        /// The file.
        path: PathBuf,
        /// The loader's error.
        source: libloading::Error,
    },
    /// The library has no memory left.
    #[error("tinybvh has no memory left to {action}")]
    Memory {
        /// Purpose of the call.
        action: &'static str,
    },
}

/// A tree's layout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Layout {
    /// Eight children, AVX2.
    Eight = 0,
    /// Four children, SSE.
    Four = 1,
}

/// Options of building a tree.
#[derive(Clone, Copy, Debug)]
pub struct BuildOptions {
    /// The layout.
    pub layout: Layout,
    /// True if triangles may be split between nodes.
    pub spatial: bool,
}

impl BuildOptions {
    /// Those that take part in measurements.
    pub const ALL: [Self; 3] = [
        Self { layout: Layout::Eight, spatial: false },
        Self { layout: Layout::Eight, spatial: true },
        Self { layout: Layout::Four, spatial: false },
    ];
}

type Handle = NonNull<c_void>;

macro_rules! functions {
    ($($field:ident: $type:ty = $name:literal,)*) => {
        struct Functions { $($field: $type,)* }

        impl Functions {
            /// Looks up all of them.
            ///
            /// # Safety
            /// The library must be one of `scripts/build_tinybvh`.
            unsafe fn load(library: &Library) -> Result<Self, libloading::Error> {
                // SAFETY: invariant 1; the caller vouches for the library.
                Ok(Self { $($field: unsafe { *library.get::<$type>($name)? },)* })
            }
        }
    };
}

functions! {
    version: unsafe extern "C" fn() -> u32 = b"raystream_tinybvh_version\0",
    build: unsafe extern "C" fn(u32, u32, *const f32, u32) -> Option<Handle> = b"raystream_tinybvh_build\0",
    bytes: unsafe extern "C" fn(Handle) -> usize = b"raystream_tinybvh_bytes\0",
    release: unsafe extern "C" fn(Handle) = b"raystream_tinybvh_release\0",
    rays: unsafe extern "C" fn(usize) -> Option<Handle> = b"raystream_tinybvh_rays\0",
    set: unsafe extern "C" fn(Handle, *const Ray) = b"raystream_tinybvh_set\0",
    trace: unsafe extern "C" fn(Handle, Handle, u32) = b"raystream_tinybvh_trace\0",
    answers: unsafe extern "C" fn(Handle, u32, *mut f32) = b"raystream_tinybvh_answers\0",
    release_rays: unsafe extern "C" fn(Handle) = b"raystream_tinybvh_release_rays\0",
}

/// The loaded library.
pub struct TinyBvh {
    functions: Functions,
    _library: ManuallyDrop<Library>,
}

impl fmt::Debug for TinyBvh {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("TinyBvh").field("version", &self.version()).finish_non_exhaustive()
    }
}

impl TinyBvh {
    /// Loads the library.
    ///
    /// # Errors
    /// When the file cannot be loaded or lacks a function.
    ///
    /// # Safety
    /// Loading runs the library's initialisers, so the file must be code that the user wants to run. It must be one
    /// that `scripts/build_tinybvh` of this version has compiled.
    pub unsafe fn load(path: &Path) -> Result<Self, TinyBvhError> {
        let refused = |source| TinyBvhError::Library { path: path.to_owned(), source };
        // SAFETY: the caller vouches for the initialisers.
        let library = unsafe { Library::new(path) }.map_err(refused)?;
        // SAFETY: invariant 1.
        let functions = unsafe { Functions::load(&library) }.map_err(refused)?;
        Ok(Self { functions, _library: ManuallyDrop::new(library) })
    }

    /// Its version, as `1.6.8`.
    pub fn version(&self) -> String {
        // SAFETY: invariant 1.
        let version = unsafe { (self.functions.version)() };
        format!("{}.{}.{}", version >> 16, version >> 8 & 0xff, version & 0xff)
    }

    /// The name of a tree in reports.
    pub fn name(&self, options: BuildOptions) -> String {
        let layout = match options.layout {
            Layout::Eight => "BVH8 AVX2",
            Layout::Four => "BVH4 SSE",
        };
        let spatial = if options.spatial { ", spatial splits" } else { "" };
        format!("tinybvh {} {layout}{spatial}", self.version())
    }

    /// Builds a tree, with as many threads as the machine has cores.
    ///
    /// # Errors
    /// When memory ends.
    pub fn build(
        &self,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        options: BuildOptions,
    ) -> Result<TinyBvhTree<'_>, TinyBvhError> {
        let corner = |&vertex: &u32| positions[vertex as usize].extend(0.0).to_array();
        let corners: Vec<[f32; 4]> = triangles.iter().flatten().map(corner).collect();
        let start = Instant::now();
        let (layout, spatial) = (options.layout as u32, u32::from(options.spatial));
        // SAFETY: invariants 1 and 2: the corners move into the tree, their heap memory stays.
        let handle = unsafe {
            (self.functions.build)(layout, spatial, corners.as_ptr().cast(), triangles.len() as u32)
        };
        let build_s = start.elapsed().as_secs_f64();
        let handle = handle.ok_or(TinyBvhError::Memory { action: "build a tree" })?;
        Ok(TinyBvhTree { tinybvh: self, handle, options, build_s, _corners: corners })
    }

    /// Room for rays.
    ///
    /// # Errors
    /// When memory ends.
    pub fn rays(&self, count: usize) -> Result<TinyBvhRays<'_>, TinyBvhError> {
        // SAFETY: invariant 1.
        let handle = unsafe { (self.functions.rays)(count) };
        let handle = handle.ok_or(TinyBvhError::Memory { action: "hold rays" })?;
        Ok(TinyBvhRays { tinybvh: self, handle, count })
    }
}

/// A built tree.
pub struct TinyBvhTree<'a> {
    tinybvh: &'a TinyBvh,
    handle: Handle,
    options: BuildOptions,
    /// Seconds that the build took.
    pub build_s: f64,
    _corners: Vec<[f32; 4]>,
}

impl fmt::Debug for TinyBvhTree<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("TinyBvhTree").field("name", &self.name()).finish_non_exhaustive()
    }
}

// SAFETY: invariant 3.
unsafe impl Send for TinyBvhTree<'_> {}
// SAFETY: invariant 3.
unsafe impl Sync for TinyBvhTree<'_> {}

impl Drop for TinyBvhTree<'_> {
    fn drop(&mut self) {
        // SAFETY: invariant 2.
        unsafe { (self.tinybvh.functions.release)(self.handle) };
    }
}

impl<'a> TinyBvhTree<'a> {
    /// Its name in reports.
    pub fn name(&self) -> String {
        self.tinybvh.name(self.options)
    }

    /// The library that built it.
    pub fn tinybvh(&self) -> &'a TinyBvh {
        self.tinybvh
    }

    /// Bytes of nodes and triangles.
    pub fn bytes(&self) -> usize {
        // SAFETY: invariant 2.
        unsafe { (self.tinybvh.functions.bytes)(self.handle) }
    }

    /// Traces rays on the calling thread: closest hits, or any hit.
    pub fn trace(&self, rays: &mut TinyBvhRays<'_>, any: bool) {
        // SAFETY: invariants 2 and 3.
        unsafe { (self.tinybvh.functions.trace)(self.handle, rays.handle, u32::from(any)) };
    }
}

/// Rays in tinybvh's layout; after tracing, their hits.
#[derive(Debug)]
pub struct TinyBvhRays<'a> {
    tinybvh: &'a TinyBvh,
    handle: Handle,
    count: usize,
}

// SAFETY: invariant 3.
unsafe impl Send for TinyBvhRays<'_> {}

impl Drop for TinyBvhRays<'_> {
    fn drop(&mut self) {
        // SAFETY: invariant 2.
        unsafe { (self.tinybvh.functions.release_rays)(self.handle) };
    }
}

impl TinyBvhRays<'_> {
    /// Number of rays.
    pub fn len(&self) -> usize {
        self.count
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Converts rays into the same memory. Tracing changes rays, so each round needs fresh ones.
    ///
    /// # Panics
    /// If they are not as many as there is room for.
    pub fn set(&mut self, rays: &[Ray]) {
        assert_eq!(rays.len(), self.count, "one ray for each place");
        // SAFETY: invariants 2 and 3; as many rays are read as there is room for.
        unsafe { (self.tinybvh.functions.set)(self.handle, rays.as_ptr()) };
    }

    /// Distances of the nearest hits, or the ends of rays without one; after any-hit queries 1 where something is hit,
    /// else 0.
    pub fn answers(&self, any: bool) -> Vec<f32> {
        let mut answers = vec![0.0; self.count];
        // SAFETY: invariants 2 and 3; as many answers are written as there are rays.
        unsafe { (self.tinybvh.functions.answers)(self.handle, u32::from(any), answers.as_mut_ptr()) };
        answers
    }
}
