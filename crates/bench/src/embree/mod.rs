//! Embree 4 as a peer, loaded at run time from a shared library that the user names.
//!
//! Unsafe code for calling Embree. Invariants:
//! 1. The library is Embree 4: the caller of [`Embree::load`] vouches for it. It is never unloaded.
//! 2. A device lives no longer than the library and its ledger; a scene no longer than its device, its buffers and
//!    its alpha test.
//! 3. Devices and committed scenes may be used from any thread, as Embree's manual says.
#![allow(unsafe_code, reason = "calls a foreign library; the invariants above")]

mod alpha;
mod api;
mod rays;

pub use alpha::Mask;
pub use api::PACKET;
pub use rays::{EmbreeRays, Mode};

use alpha::{AlphaTest, alpha_test};
use api::{FLAG_ROBUST, FORMAT_FLOAT3, FORMAT_UINT3, Functions, Handle};
use glam::Vec3;
use libloading::Library;
use std::ffi::{c_int, c_uint};
use std::fmt;
use std::mem::ManuallyDrop;
use std::path::{Path, PathBuf};
use std::ptr;
use std::sync::Arc;
use std::sync::atomic::{AtomicIsize, Ordering};
use std::time::Instant;

/// Error of loading or calling Embree.
#[derive(Debug, thiserror::Error)]
pub enum EmbreeError {
    /// The library cannot be loaded or lacks a function.
    #[error("{path}: cannot use this as the Embree 4 library: {source}", path = path.display())]
    Library {
        /// The file.
        path: PathBuf,
        /// The loader's error.
        source: libloading::Error,
    },
    /// An Embree call failed.
    #[error("Embree could not {action}: error {code}")]
    Refused {
        /// Purpose of the call.
        action: &'static str,
        /// Embree's error code.
        code: c_int,
    },
}

/// Embree's build quality.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum Quality {
    /// Morton codes, for scenes that change.
    Low = 0,
    /// Embree's default: binned surface area heuristic.
    #[default]
    Medium = 1,
    /// With spatial splits.
    High = 2,
}

impl Quality {
    /// All qualities.
    pub const ALL: [Self; 3] = [Self::Low, Self::Medium, Self::High];

    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Low => "low",
            Self::Medium => "medium",
            Self::High => "high",
        }
    }
}

/// Options of building a scene.
#[derive(Clone, Copy, Debug, Default)]
pub struct BuildOptions {
    /// True if rays cannot slip through between triangles (Embree's robust flag).
    pub robust: bool,
    /// The tree's quality.
    pub quality: Quality,
}

/// The loaded library.
pub struct Embree {
    functions: Functions,
    /// Never unloaded: the threads that Embree started would lose their code.
    _library: ManuallyDrop<Library>,
}

impl fmt::Debug for Embree {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Embree").finish_non_exhaustive()
    }
}

impl Embree {
    /// Loads the library.
    ///
    /// # Errors
    /// When the file cannot be loaded or lacks one of Embree's functions.
    ///
    /// # Safety
    /// Loading runs the library's initialisers, so the file must be code that the user wants to run. It must be
    /// Embree 4.0 or later: its functions are called with the types of Embree 4's headers.
    pub unsafe fn load(path: &Path) -> Result<Self, EmbreeError> {
        let refused = |source| EmbreeError::Library { path: path.to_owned(), source };
        // SAFETY: the caller vouches for the initialisers.
        let library = unsafe { Library::new(path) }.map_err(refused)?;
        // SAFETY: invariant 1.
        let functions = unsafe { Functions::load(&library) }.map_err(refused)?;
        Ok(Self { functions, _library: ManuallyDrop::new(library) })
    }

    /// Makes a device that builds with `threads` threads.
    ///
    /// # Errors
    /// When Embree reports one.
    pub fn device(&self, threads: usize) -> Result<Device<'_>, EmbreeError> {
        let config = format!("threads={threads},set_affinity=0\0");
        // SAFETY: invariant 1; the string ends in 0.
        let handle = unsafe { (self.functions.new_device)(config.as_ptr().cast()) };
        if handle.is_null() {
            // SAFETY: invariant 1; without a device the call returns the error of making one.
            let code = unsafe { (self.functions.error)(ptr::null_mut()) };
            return Err(EmbreeError::Refused { action: "make a device", code });
        }
        let ledger = Box::<Ledger>::default();
        // SAFETY: invariants 1 and 2.
        unsafe { (self.functions.set_monitor)(handle, monitor, ptr::from_ref(&*ledger).cast_mut().cast()) };
        Ok(Device { embree: self, handle, ledger })
    }
}

/// Bytes in use by a device, as its memory monitor reports them.
#[derive(Default)]
struct Ledger {
    now: AtomicIsize,
    most: AtomicIsize,
}

/// `RTCMemoryMonitorFunction`.
///
/// # Safety
/// Only for Embree to call, with a [`Ledger`].
unsafe extern "C" fn monitor(ledger: Handle, bytes: isize, _post: bool) -> bool {
    // SAFETY: invariant 2.
    let ledger = unsafe { &*ledger.cast::<Ledger>().cast_const() };
    let now = ledger.now.fetch_add(bytes, Ordering::Relaxed) + bytes;
    ledger.most.fetch_max(now, Ordering::Relaxed);
    true
}

/// A device: builds and holds scenes.
pub struct Device<'a> {
    embree: &'a Embree,
    handle: Handle,
    ledger: Box<Ledger>,
}

impl fmt::Debug for Device<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Device").finish_non_exhaustive()
    }
}

// SAFETY: invariant 3.
unsafe impl Send for Device<'_> {}
// SAFETY: invariant 3.
unsafe impl Sync for Device<'_> {}

impl Drop for Device<'_> {
    fn drop(&mut self) {
        // SAFETY: invariant 2.
        unsafe { (self.embree.functions.release_device)(self.handle) };
    }
}

/// Triangles of one geometry, and the scene's number of each where the two differ.
struct Part {
    indices: Vec<[u32; 3]>,
    primitives: Option<Arc<[u32]>>,
    /// Boxed: Embree keeps its address.
    alpha: Option<Box<AlphaTest>>,
}

impl Device<'_> {
    /// Builds a scene. Masked triangles become a geometry of their own, so that only they cost a call of the filter
    /// function.
    ///
    /// # Errors
    /// When Embree reports one.
    pub fn build(
        &self,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        mask: Option<&Mask>,
        options: BuildOptions,
    ) -> Result<EmbreeScene<'_>, EmbreeError> {
        // Embree reads four floats for each vertex.
        let mut vertices: Vec<[f32; 3]> = positions.iter().map(|p| p.to_array()).collect();
        vertices.push([0.0; 3]);
        let parts = parts(triangles, mask);
        let bytes_before = self.ledger.now.load(Ordering::Relaxed);
        self.ledger.most.store(bytes_before, Ordering::Relaxed);
        let start = Instant::now();
        let handle = self.commit(&vertices, positions.len(), &parts, options);
        let since = |bytes: &AtomicIsize| (bytes.load(Ordering::Relaxed) - bytes_before).max(0) as usize;
        let scene = EmbreeScene {
            device: self,
            handle,
            robust: options.robust,
            build_s: start.elapsed().as_secs_f64(),
            bytes: since(&self.ledger.now),
            peak_bytes: since(&self.ledger.most),
            parts,
            _vertices: vertices,
        };
        // SAFETY: invariant 2.
        match unsafe { (self.embree.functions.error)(self.handle) } {
            0 => Ok(scene),
            code => Err(EmbreeError::Refused { action: "build the scene", code }),
        }
    }

    /// Builds a scene of `parts` over the first `count` vertices. The buffers must move into the scene.
    fn commit(&self, vertices: &[[f32; 3]], count: usize, parts: &[Part], options: BuildOptions) -> Handle {
        let f = &self.embree.functions;
        // SAFETY: invariants 1 and 2: buffers and alpha tests move into the scene, their heap memory stays.
        unsafe {
            let scene = (f.new_scene)(self.handle);
            (f.set_flags)(scene, if options.robust { FLAG_ROBUST } else { 0 });
            (f.set_quality)(scene, options.quality as c_uint);
            for part in parts {
                let geometry = (f.new_geometry)(self.handle, 0);
                let (v, i) = (vertices.as_ptr().cast(), part.indices.as_ptr().cast());
                (f.set_buffer)(geometry, 1, 0, FORMAT_FLOAT3, v, 0, 12, count);
                (f.set_buffer)(geometry, 0, 0, FORMAT_UINT3, i, 0, 12, part.indices.len());
                if let Some(alpha) = &part.alpha {
                    (f.set_user_data)(geometry, ptr::from_ref(&**alpha).cast_mut().cast());
                    (f.set_intersect_filter)(geometry, alpha_test);
                    (f.set_occluded_filter)(geometry, alpha_test);
                }
                (f.commit_geometry)(geometry);
                (f.attach)(scene, geometry);
                (f.release_geometry)(geometry);
            }
            (f.commit_scene)(scene);
            scene
        }
    }
}

/// All triangles, or the opaque ones and the masked ones; no part is empty if there are triangles.
fn parts(triangles: &[[u32; 3]], mask: Option<&Mask>) -> Vec<Part> {
    let Some(mask) = mask else {
        return vec![Part { indices: triangles.to_vec(), primitives: None, alpha: None }];
    };
    let part = |masked: bool| {
        let primitives = (0..triangles.len()).filter(|&i| mask.masked[i] == masked).map(|i| i as u32);
        let primitives: Arc<[u32]> = primitives.collect();
        let indices = primitives.iter().map(|&i| triangles[i as usize]).collect();
        let alpha = || AlphaTest { primitives: primitives.clone(), filter: mask.filter.clone() };
        let alpha = masked.then(|| Box::new(alpha()));
        Part { indices, primitives: Some(primitives), alpha }
    };
    [false, true].map(part).into_iter().filter(|part| !part.indices.is_empty()).collect()
}

/// A built scene.
pub struct EmbreeScene<'a> {
    device: &'a Device<'a>,
    handle: Handle,
    robust: bool,
    /// Seconds that the build took.
    pub build_s: f64,
    /// Bytes in use after the build, by the device's memory monitor, without vertices and indices.
    pub bytes: usize,
    /// The most bytes in use during the build.
    pub peak_bytes: usize,
    /// In the order of Embree's geometry ids.
    parts: Vec<Part>,
    _vertices: Vec<[f32; 3]>,
}

impl fmt::Debug for EmbreeScene<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("EmbreeScene").finish_non_exhaustive()
    }
}

// SAFETY: invariant 3.
unsafe impl Send for EmbreeScene<'_> {}
// SAFETY: invariant 3.
unsafe impl Sync for EmbreeScene<'_> {}

impl Drop for EmbreeScene<'_> {
    fn drop(&mut self) {
        // SAFETY: invariant 2.
        unsafe { (self.functions().release_scene)(self.handle) };
    }
}

impl EmbreeScene<'_> {
    /// True if it was built with the robust flag.
    pub fn is_robust(&self) -> bool {
        self.robust
    }

    fn functions(&self) -> &Functions {
        &self.device.embree.functions
    }

    fn handle(&self) -> Handle {
        self.handle
    }

    /// The scene's number of a geometry's triangle.
    fn primitive(&self, geometry: u32, primitive: u32) -> u32 {
        let primitives = self.parts[geometry as usize].primitives.as_ref();
        primitives.map_or(primitive, |primitives| primitives[primitive as usize])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use raystream::bvh::Filter;

    struct Everything;

    impl Filter for Everything {
        fn accepts(&self, _: u32, _: f32, _: f32) -> bool {
            true
        }
    }

    #[test]
    fn masked_triangles_are_a_part_of_their_own() {
        let triangles = [[0, 1, 2], [1, 2, 3], [2, 3, 4]];
        let whole = parts(&triangles, None);
        assert!(whole.len() == 1 && whole[0].indices == triangles && whole[0].alpha.is_none());
        let mask = |masked: [bool; 3]| Mask { masked: masked.into(), filter: Arc::new(Everything) };
        let mixed = parts(&triangles, Some(&mask([false, true, false])));
        assert_eq!(mixed.iter().map(|p| p.indices.len()).collect::<Vec<_>>(), [2, 1]);
        assert_eq!(mixed[0].primitives.as_deref(), Some(&[0, 2][..]));
        assert!(mixed[0].alpha.is_none() && mixed[1].alpha.as_ref().expect("a test").primitives[..] == [1]);
        assert_eq!(parts(&triangles, Some(&mask([true; 3]))).len(), 1);
    }
}
