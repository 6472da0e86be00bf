//! Open Image Denoise, version 2, loaded at run time where the system or a user has it.
//!
//! Its pictures are outside what raystream promises of its own: the same noisy picture may give other bytes with
//! another version, processor or number of threads.
//!
//! Unsafe code for loading and calling it. Invariants:
//! 1. The library is OIDN: the user names it, or the system's loader finds it by OIDN's name. It is never unloaded,
//!    since its threads would lose their code.
//! 2. Functions have the types that the header of OIDN 2 declares. [`Oidn::open`] refuses libraries that lack one of
//!    them, and versions whose functions may differ.
//! 3. A device is made, used and released by one call of [`Oidn::denoise`], and so are its filters, which are released
//!    before it.
//! 4. Images outlive the filters that read and write them, have as many numbers as they are said to have, and are
//!    touched by nothing else while a filter runs.
//! 5. OIDN runs on a thread that ends with the call, so modes of floating point that it may set there change no
//!    picture of raystream.
#![allow(unsafe_code, reason = "loads and calls a foreign library; the invariants above")]

use super::oidn_error::OidnError;
use super::{FEATURES, NoisyPicture};
use crate::film::Image;
use libloading::Library;
use std::ffi::{CStr, OsString, c_char, c_int, c_void};
use std::fmt;
use std::mem::ManuallyDrop;
use std::path::Path;
use std::ptr::{self, NonNull};

/// The least and the first too great version, as OIDN counts them.
const VERSIONS: std::ops::Range<c_int> = 20_000..30_000;

/// The most megabytes of a filter. Larger pictures are filtered in tiles, which overlap by as much as a filter sees.
const FILTER_MEGABYTES: c_int = 1024;

const MEGABYTE: u64 = 1 << 20;

/// Bytes of a filter for each pixel at most, as measured; of the library with its weights; of the planes and images of
/// a pixel, and the layer that files have then.
const FILTER_BYTES: u64 = 800;
const LIBRARY_BYTES: u64 = 256 * MEGABYTE;
const IMAGE_BYTES: u64 = 4 * (24 + 12 + 16);

/// `OIDN_DEVICE_TYPE_CPU`.
const CPU: c_int = 1;

/// `OIDN_FORMAT_FLOAT3`.
const FLOAT3: c_int = 3;

type Handle = NonNull<c_void>;

/// Three numbers of each pixel.
type Pixels = Vec<[f32; 3]>;

macro_rules! functions {
    ($($field:ident: $type:ty = $name:literal,)*) => {
        struct Functions { $($field: $type,)* }

        impl Functions {
            /// Looks up all of them.
            ///
            /// # Safety
            /// The library must be OIDN.
            unsafe fn load(library: &Library) -> Result<Self, libloading::Error> {
                // SAFETY: invariant 2.
                Ok(Self { $($field: unsafe { *library.get::<$type>($name)? },)* })
            }
        }
    };
}

functions! {
    new_device: unsafe extern "C" fn(c_int) -> Option<Handle> = b"oidnNewDevice\0",
    device_int: unsafe extern "C" fn(Handle, *const c_char) -> c_int = b"oidnGetDeviceInt\0",
    set_device_int: unsafe extern "C" fn(Handle, *const c_char, c_int) = b"oidnSetDeviceInt\0",
    set_device_bool: unsafe extern "C" fn(Handle, *const c_char, bool) = b"oidnSetDeviceBool\0",
    commit_device: unsafe extern "C" fn(Handle) = b"oidnCommitDevice\0",
    device_error: unsafe extern "C" fn(Option<Handle>, *mut *const c_char) -> c_int = b"oidnGetDeviceError\0",
    release_device: unsafe extern "C" fn(Handle) = b"oidnReleaseDevice\0",
    new_filter: unsafe extern "C" fn(Handle, *const c_char) -> Option<Handle> = b"oidnNewFilter\0",
    set_image: unsafe extern "C" fn(
        Handle, *const c_char, *mut c_void, c_int, usize, usize, usize, usize, usize
    ) = b"oidnSetSharedFilterImage\0",
    set_filter_bool: unsafe extern "C" fn(Handle, *const c_char, bool) = b"oidnSetFilterBool\0",
    set_filter_int: unsafe extern "C" fn(Handle, *const c_char, c_int) = b"oidnSetFilterInt\0",
    commit_filter: unsafe extern "C" fn(Handle) = b"oidnCommitFilter\0",
    execute_filter: unsafe extern "C" fn(Handle) = b"oidnExecuteFilter\0",
    release_filter: unsafe extern "C" fn(Handle) = b"oidnReleaseFilter\0",
}

/// The loaded library.
pub struct Oidn {
    functions: Functions,
    version: c_int,
    _library: ManuallyDrop<Library>,
}

impl fmt::Debug for Oidn {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Oidn").field("version", &self.version()).finish_non_exhaustive()
    }
}

impl Oidn {
    /// The names by which the system's loader is asked for the library.
    pub const NAMES: &[&str] = match () {
        () if cfg!(windows) => &["OpenImageDenoise.dll"],
        () if cfg!(target_os = "macos") => &["libOpenImageDenoise.2.dylib", "libOpenImageDenoise.dylib"],
        () => &["libOpenImageDenoise.so.2", "libOpenImageDenoise.so"],
    };

    /// Loads a file, or else what the system has under [`Oidn::NAMES`], and makes a device to see that it works. A
    /// library runs code of its own when it is loaded, so the file must be one that the user wants to run.
    ///
    /// # Errors
    /// Why there is no library, or none that can be used.
    pub fn open(file: Option<&Path>) -> Result<Self, OidnError> {
        let names: Vec<OsString> = match file {
            // A bare name would be searched for where the system has its libraries.
            Some(file) => vec![std::path::absolute(file).unwrap_or_else(|_| file.to_owned()).into()],
            None => Self::NAMES.iter().map(OsString::from).collect(),
        };
        let (mut tried, mut why) = (Vec::new(), String::new());
        for name in names {
            // SAFETY: invariant 1.
            match unsafe { Library::new(&name) } {
                Ok(library) => return Self::of(library, name.to_string_lossy().into_owned()),
                Err(error) => {
                    tried.push(name.to_string_lossy().into_owned());
                    why = error.to_string();
                }
            }
        }
        Err(OidnError::NotFound { tried, why })
    }

    fn of(library: Library, name: String) -> Result<Self, OidnError> {
        let library = ManuallyDrop::new(library);
        // SAFETY: invariant 1; a function is looked up and not called.
        let is_oidn = unsafe { library.get::<unsafe extern "C" fn()>(b"oidnNewDevice\0").is_ok() };
        // SAFETY: invariants 1 and 2.
        let functions = match unsafe { Functions::load(&library) } {
            Ok(functions) => functions,
            Err(_) if is_oidn => return Err(OidnError::Version { name, version: "1".into() }),
            Err(source) => return Err(OidnError::Foreign { name, why: source.to_string() }),
        };
        let mut oidn = Self { functions, version: 0, _library: library };
        oidn.version = oidn.on_a_thread(|| {
            let device = Device::new(&oidn, 1)?;
            // SAFETY: invariants 2 and 3.
            Ok(unsafe { (oidn.functions.device_int)(device.handle, c"version".as_ptr()) })
        })?;
        match VERSIONS.contains(&oidn.version) {
            true => Ok(oidn),
            false => Err(OidnError::Version { name, version: oidn.version() }),
        }
    }

    /// Its version, as `2.5.1`.
    pub fn version(&self) -> String {
        format!("{}.{}.{}", self.version / 10_000, self.version / 100 % 100, self.version % 100)
    }

    /// Bytes that denoising a picture of this many pixels takes at most, besides the picture and its film.
    pub fn denoising_bytes(pixels: u64) -> u64 {
        let filter = (FILTER_MEGABYTES as u64 * MEGABYTE).min(pixels.saturating_mul(FILTER_BYTES));
        (filter + LIBRARY_BYTES).saturating_add(pixels.saturating_mul(IMAGE_BYTES))
    }

    /// The picture without noise, computed by `threads` threads of the library.
    ///
    /// # Errors
    /// What the library reports.
    pub fn denoise(&self, noisy: &NoisyPicture, threads: usize) -> Result<Image, OidnError> {
        let (width, height) = (noisy.width, noisy.height);
        let [red, green, blue, x, y, z] = &noisy.features;
        let [mut colour, mut albedo, mut normal] =
            [interleaved(noisy.mean.each_ref()), interleaved([red, green, blue]), interleaved([x, y, z])];
        let mut pixels = vec![[0.0; 3]; colour.len()];
        self.on_a_thread(|| {
            let device = Device::new(self, threads)?;
            let size = (width, height);
            let images = [(c"color", &mut colour), (c"albedo", &mut albedo), (c"normal", &mut normal)];
            device.run(size, images, &mut pixels)
        })?;
        for (pixel, noisy) in pixels.iter_mut().zip(&colour) {
            for (value, noisy) in pixel.iter_mut().zip(noisy) {
                *value = if value.is_finite() { value.max(0.0) } else { *noisy };
            }
        }
        Ok(Image { width: width as u32, height: height as u32, pixels })
    }

    /// Runs something on a thread of its own: invariant 5.
    fn on_a_thread<T: Send>(
        &self,
        run: impl FnOnce() -> Result<T, OidnError> + Send,
    ) -> Result<T, OidnError> {
        std::thread::scope(|scope| {
            let thread = std::thread::Builder::new().name("oidn".into()).spawn_scoped(scope, run);
            let thread = thread.map_err(|error| OidnError::Device(error.to_string()))?;
            thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        })
    }
}

/// Planes as pixels.
fn interleaved(planes: [&Vec<f32>; FEATURES / 2]) -> Pixels {
    let [a, b, c] = planes;
    a.iter().zip(b).zip(c).map(|((a, b), c)| [*a, *b, *c]).collect()
}

/// A device on the CPU.
struct Device<'a> {
    oidn: &'a Oidn,
    handle: Handle,
}

impl Drop for Device<'_> {
    fn drop(&mut self) {
        // SAFETY: invariants 2 and 3.
        unsafe { (self.oidn.functions.release_device)(self.handle) };
    }
}

impl<'a> Device<'a> {
    fn new(oidn: &'a Oidn, threads: usize) -> Result<Self, OidnError> {
        let functions = &oidn.functions;
        // SAFETY: invariants 2 and 3.
        let handle = unsafe { (functions.new_device)(CPU) };
        let Some(handle) = handle else {
            return Err(error(functions, None).unwrap_or_else(|| OidnError::Device("no device".into())));
        };
        let device = Self { oidn, handle };
        let threads = c_int::try_from(threads.max(1)).unwrap_or(c_int::MAX);
        // SAFETY: invariants 2 and 3; names end with a zero.
        unsafe {
            (functions.set_device_int)(handle, c"numThreads".as_ptr(), threads);
            // Its threads would be bound to cores on which others render.
            (functions.set_device_bool)(handle, c"setAffinity".as_ptr(), false);
            (functions.commit_device)(handle);
        }
        device.check()?;
        Ok(device)
    }

    /// The error since the last check, if there was one.
    fn check(&self) -> Result<(), OidnError> {
        error(&self.oidn.functions, Some(self.handle)).map_or(Ok(()), Err)
    }

    /// Filters the first image with the help of the others.
    fn run(
        &self,
        (width, height): (usize, usize),
        images: [(&CStr, &mut Pixels); 3],
        output: &mut Pixels,
    ) -> Result<(), OidnError> {
        let functions = &self.oidn.functions;
        // SAFETY: invariants 2 and 3.
        let filter = unsafe { (functions.new_filter)(self.handle, c"RT".as_ptr()) };
        let Some(filter) = filter else {
            return self.check().and(Err(OidnError::Device("no filter".into())));
        };
        for (name, image) in images.into_iter().chain([(c"output", output)]) {
            assert_eq!(image.len(), width * height, "invariant 4");
            // SAFETY: invariants 2, 3 and 4.
            unsafe {
                let pixels = image.as_mut_ptr().cast();
                (functions.set_image)(filter, name.as_ptr(), pixels, FLOAT3, width, height, 0, 0, 0);
            }
        }
        // SAFETY: invariants 2, 3 and 4; names end with a zero.
        unsafe {
            (functions.set_filter_bool)(filter, c"hdr".as_ptr(), true);
            (functions.set_filter_int)(filter, c"maxMemoryMB".as_ptr(), FILTER_MEGABYTES);
            (functions.commit_filter)(filter);
            (functions.execute_filter)(filter);
            (functions.release_filter)(filter);
        }
        self.check()
    }
}

/// The last error of a device, or of this thread where there is none.
fn error(functions: &Functions, device: Option<Handle>) -> Option<OidnError> {
    let mut message = ptr::null();
    // SAFETY: invariants 2 and 3.
    let code = unsafe { (functions.device_error)(device, &raw mut message) };
    if code == 0 {
        return None;
    }
    if message.is_null() {
        return Some(OidnError::Device(format!("error {code}")));
    }
    // SAFETY: invariant 2: a text that ends with a zero and stays until the next call.
    Some(OidnError::Device(unsafe { CStr::from_ptr(message) }.to_string_lossy().into_owned()))
}
