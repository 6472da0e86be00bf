//! The memory that stores a stream's rays and answers: the host's own, or memory that a device allocates and
//! shares with the host. In shared memory streams are filled, traced and shaded without copies.

use super::{Hit, Ray};
use bytemuck::Zeroable;
use std::any::Any;
use std::fmt::Debug;
use std::ops::{Deref, DerefMut};

/// Memory that a device allocates for one array of a stream: its rays, or its answers.
///
/// The stream's state says who owns it. While the stream is [`super::Filling`], [`super::Full`],
/// [`super::Tracing`] or [`super::Traced`], the host owns the memory and may read and write it. While the stream is
/// [`super::OnDevice`] the device owns it, and the slices below are refused, except that rays may be read, which the
/// device only reads. If the device is lost meanwhile, the memory may stay the device's for good: then the host may
/// read rays, but neither read answers nor write anything.
pub trait DeviceMemory<T>: Any + Debug + Send + Sync {
    /// All elements.
    ///
    /// # Panics
    /// If the device may be writing to them.
    fn as_slice(&self) -> &[T];

    /// All elements, to be written.
    ///
    /// # Panics
    /// If the device may be reading or writing them.
    fn as_mut_slice(&mut self) -> &mut [T];

    /// True if the host owns the memory and the device is not lost. A stream replaces other memory before it
    /// is filled again.
    fn is_sound(&self) -> bool;
}

/// Device memory for a whole stream.
#[derive(Debug)]
pub struct StreamMemory {
    /// For rays.
    pub rays: Box<dyn DeviceMemory<Ray>>,
    /// For their hits.
    pub hits: Box<dyn DeviceMemory<Hit>>,
    /// For shadow rays.
    pub shadow_rays: Box<dyn DeviceMemory<Ray>>,
    /// For their answers: 1 for occluded, else 0.
    pub occluded: Box<dyn DeviceMemory<u32>>,
}

/// An array of rays or answers, in host memory or in a device's.
#[derive(Debug)]
pub(super) enum Memory<T> {
    Host(Box<[T]>),
    Device(Box<dyn DeviceMemory<T>>),
}

impl<T: Zeroable> Memory<T> {
    /// Host memory, zeroed. The system provides zeroed pages when they are first touched.
    pub fn host(len: usize) -> Self {
        Self::Host(bytemuck::zeroed_slice_box(len))
    }

    /// The memory, if it is a device's.
    pub fn device(&self) -> Option<&dyn DeviceMemory<T>> {
        match self {
            Self::Host(_) => None,
            Self::Device(memory) => Some(&**memory),
        }
    }

    /// The memory, if it is a device's.
    pub fn device_mut(&mut self) -> Option<&mut dyn DeviceMemory<T>> {
        match self {
            Self::Host(_) => None,
            Self::Device(memory) => Some(&mut **memory),
        }
    }
}

impl<T> Default for Memory<T> {
    /// An empty array, without an allocation.
    fn default() -> Self {
        Self::Host(Box::default())
    }
}

impl<T: 'static> Deref for Memory<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        match self {
            Self::Host(elements) => elements,
            Self::Device(memory) => memory.as_slice(),
        }
    }
}

impl<T: 'static> DerefMut for Memory<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        match self {
            Self::Host(elements) => elements,
            Self::Device(memory) => memory.as_mut_slice(),
        }
    }
}

/// A vector of rays with a fixed capacity.
#[derive(Debug, Default)]
pub struct RayArray {
    pub(super) memory: Memory<Ray>,
    len: usize,
}

impl RayArray {
    /// An empty array in host memory.
    pub fn with_capacity(capacity: usize) -> Self {
        Self { memory: Memory::host(capacity), len: 0 }
    }

    pub(super) fn of(memory: Memory<Ray>) -> Self {
        Self { memory, len: 0 }
    }

    /// A copy in host memory, with the same room.
    pub(super) fn to_host(&self) -> Self {
        let mut copy = Self::with_capacity(self.memory.len());
        copy.appender().extend_from_slice(self);
        copy
    }

    /// Number of rays.
    pub fn len(&self) -> usize {
        self.len
    }

    /// True if there are no rays.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Removes all rays.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Removes the last ray and returns it.
    pub fn pop(&mut self) -> Option<Ray> {
        self.len = self.len.checked_sub(1)?;
        Some(self.memory[self.len])
    }

    /// Appends to the array.
    pub fn appender(&mut self) -> RayAppender<'_> {
        RayAppender { memory: &mut self.memory, len: &mut self.len }
    }
}

impl Deref for RayArray {
    type Target = [Ray];

    fn deref(&self) -> &[Ray] {
        if self.is_empty() { &[] } else { &self.memory[..self.len] }
    }
}

impl DerefMut for RayArray {
    fn deref_mut(&mut self) -> &mut [Ray] {
        if self.is_empty() { &mut [] } else { &mut self.memory[..self.len] }
    }
}

/// Appends rays to a [`RayArray`].
#[derive(Debug)]
pub struct RayAppender<'a> {
    pub(super) memory: &'a mut [Ray],
    len: &'a mut usize,
}

impl RayAppender<'_> {
    /// Appends a ray.
    ///
    /// # Panics
    /// If the capacity is exceeded.
    pub fn push(&mut self, ray: Ray) {
        let capacity = self.memory.len();
        match self.memory.get_mut(*self.len) {
            Some(place) => *place = ray,
            None => capacity_exceeded(capacity),
        }
        *self.len += 1;
    }

    /// Appends rays.
    ///
    /// # Panics
    /// If the capacity is exceeded.
    pub fn extend_from_slice(&mut self, rays: &[Ray]) {
        let (capacity, end) = (self.memory.len(), *self.len + rays.len());
        match self.memory.get_mut(*self.len..end) {
            Some(places) => places.copy_from_slice(rays),
            None => capacity_exceeded(capacity),
        }
        *self.len = end;
    }

    /// Appends the first `count` rays of `row`. Where the capacity suffices, the whole row is copied and the
    /// excess overwritten later: copying a number of rays that the compiler knows is cheaper.
    ///
    /// # Panics
    /// If the capacity is exceeded, or `row` has fewer than `count` rays.
    #[inline(always)]
    #[allow(
        clippy::manual_memcpy,
        reason = "copy_from_slice is a call: it is not inlined across codegen units"
    )]
    pub fn extend_from_row(&mut self, row: &[Ray], count: usize) {
        match self.memory.get_mut(*self.len..*self.len + row.len()) {
            Some(places) if count <= row.len() => {
                for i in 0..row.len() {
                    places[i] = row[i];
                }
                *self.len += count;
            }
            _ => self.extend_from_slice(&row[..count]),
        }
    }

    /// Number of rays.
    pub fn len(&self) -> usize {
        *self.len
    }

    /// True if there are no rays.
    pub fn is_empty(&self) -> bool {
        *self.len == 0
    }
}

#[cold]
fn capacity_exceeded(capacity: usize) -> ! {
    panic!("a stream that takes {capacity} rays was given more")
}
