//! Memory that a stream's rays and answers lie in. Mostly the host's own; where a device lends memory that both can
//! reach, streams are filled, traced and shaded there, and nothing is copied.

use super::{Hit, Ray};
use bytemuck::Zeroable;
use std::any::Any;
use std::fmt::Debug;
use std::ops::{Deref, DerefMut};

/// Memory that a device lends for one column of a stream: rays, or answers.
///
/// It belongs to whoever holds the berth, host or device, and changes hands in [`super::DeviceTracer::trace_in_place`]: a
/// tracer that is lost in there may leave it to the device for good. Then rays can still be read, answers cannot,
/// and nothing is written.
pub trait DeviceMemory<T>: Any + Debug + Send + Sync {
    /// All places.
    ///
    /// # Panics
    /// If the device may be writing to them.
    fn slots(&self) -> &[T];

    /// All places, to be written to.
    ///
    /// # Panics
    /// If the device may be using them.
    fn slots_mut(&mut self) -> &mut [T];

    /// Whether rays may be written here: the device has not gone away with it.
    fn is_sound(&self) -> bool;
}

/// Berths for a whole stream.
#[derive(Debug)]
pub struct DeviceMemorySource {
    /// For rays.
    pub rays: Box<dyn DeviceMemory<Ray>>,
    /// For the hits of these.
    pub hits: Box<dyn DeviceMemory<Hit>>,
    /// For shadow rays.
    pub shadow_rays: Box<dyn DeviceMemory<Ray>>,
    /// For the answers to these.
    pub occluded: Box<dyn DeviceMemory<u32>>,
}

/// Places for rays or answers, the host's or a device's.
#[derive(Debug)]
pub(super) enum Memory<T> {
    Host(Box<[T]>),
    Lent(Box<dyn DeviceMemory<T>>),
}

impl<T: Zeroable> Memory<T> {
    /// The host's own. Zeroes that nobody has touched cost nothing.
    pub fn host(len: usize) -> Self {
        Self::Host(bytemuck::zeroed_slice_box(len))
    }

    /// The berth, if it is lent.
    pub fn device(&self) -> Option<&dyn DeviceMemory<T>> {
        match self {
            Self::Host(_) => None,
            Self::Lent(device) => Some(&**device),
        }
    }

    /// The berth, if it is lent.
    pub fn device_mut(&mut self) -> Option<&mut dyn DeviceMemory<T>> {
        match self {
            Self::Host(_) => None,
            Self::Lent(device) => Some(&mut **device),
        }
    }
}

impl<T> Default for Memory<T> {
    /// None, without an allocation.
    fn default() -> Self {
        Self::Host(Box::default())
    }
}

impl<T: 'static> Deref for Memory<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        match self {
            Self::Host(slots) => slots,
            Self::Lent(device) => device.slots(),
        }
    }
}

impl<T: 'static> DerefMut for Memory<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        match self {
            Self::Host(slots) => slots,
            Self::Lent(device) => device.slots_mut(),
        }
    }
}

/// Rays one after the other, in memory that does not grow.
#[derive(Debug, Default)]
pub struct Column {
    pub(super) memory: Memory<Ray>,
    len: usize,
}

impl Column {
    /// Room for so many rays, in host memory.
    pub fn with_capacity(capacity: usize) -> Self {
        Self { memory: Memory::host(capacity), len: 0 }
    }

    pub(super) fn of(memory: Memory<Ray>) -> Self {
        Self { memory, len: 0 }
    }

    /// How many rays there are.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Drops all rays.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Takes the last ray.
    pub fn pop(&mut self) -> Option<Ray> {
        self.len = self.len.checked_sub(1)?;
        Some(self.memory[self.len])
    }

    /// Where rays are appended.
    pub fn appender(&mut self) -> Appender<'_> {
        Appender { slots: &mut self.memory, len: &mut self.len }
    }
}

impl Deref for Column {
    type Target = [Ray];

    fn deref(&self) -> &[Ray] {
        if self.is_empty() { &[] } else { &self.memory[..self.len] }
    }
}

/// Appends rays to a [`Column`].
#[derive(Debug)]
pub struct Appender<'a> {
    pub(super) slots: &'a mut [Ray],
    len: &'a mut usize,
}

impl Appender<'_> {
    /// Appends a ray.
    ///
    /// # Panics
    /// If there is no room.
    pub fn push(&mut self, ray: Ray) {
        let room = self.slots.len();
        match self.slots.get_mut(*self.len) {
            Some(slot) => *slot = ray,
            None => no_room(room),
        }
        *self.len += 1;
    }

    /// Appends rays.
    ///
    /// # Panics
    /// If there is no room.
    pub fn extend_from_slice(&mut self, rays: &[Ray]) {
        let (room, end) = (self.slots.len(), *self.len + rays.len());
        match self.slots.get_mut(*self.len..end) {
            Some(slots) => slots.copy_from_slice(rays),
            None => no_room(room),
        }
        *self.len = end;
    }

    /// Appends the first `count` rays of a row. The others are written behind them where there is room: it is
    /// cheaper to copy as many as the compiler knows of.
    ///
    /// # Panics
    /// If there is no room for `count`, or they are not in the row.
    #[inline(always)]
    pub fn extend_from_row(&mut self, row: &[Ray], count: usize) {
        match self.slots.get_mut(*self.len..*self.len + row.len()) {
            Some(slots) if count <= row.len() => {
                slots.copy_from_slice(row);
                *self.len += count;
            }
            _ => self.extend_from_slice(&row[..count]),
        }
    }

    /// How many rays there are.
    pub fn len(&self) -> usize {
        *self.len
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        *self.len == 0
    }
}

#[cold]
fn no_room(room: usize) -> ! {
    panic!("a stream that takes {room} rays was given more")
}
