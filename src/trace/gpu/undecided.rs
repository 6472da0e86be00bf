//! The list of rays that a device left undecided: the kernels write it, the host reads it.

use super::layout::MASKED_RAY;
use crate::device::CALLBACK_PATIENCE;
use std::sync::mpsc::{Receiver, sync_channel};

/// One ray in this many may be undecided; if there are more, the host looks through all answers.
const ROOM: usize = 16;

/// The fewest rays that a list has room for.
const LEAST: usize = 256;

/// The buffers of a list: the number of rays, then their indices as far as there is room.
#[derive(Debug)]
pub(super) struct UndecidedList {
    /// In rays of a dispatch.
    pub capacity: usize,
    list: wgpu::Buffer,
    readback: wgpu::Buffer,
}

/// The rays of a dispatch that the host has to trace.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Undecided {
    /// Rays by index, and how many of them are undecided because the filter decides about a candidate.
    Listed { rays: Vec<usize>, masked: usize },
    /// More than the list has room for: their answers say so.
    InAnswers,
}

/// Receives when a list can be read.
pub(super) type Mapped = Receiver<Result<(), wgpu::BufferAsyncError>>;

impl UndecidedList {
    /// A list for dispatches of up to `capacity` rays.
    pub fn new(device: &wgpu::Device, capacity: usize) -> Self {
        use wgpu::BufferUsages as U;
        let buffer = |label, usage| {
            let size = ((1 + (capacity / ROOM).max(LEAST)) * size_of::<u32>()) as u64;
            let label = Some(label);
            device.create_buffer(&wgpu::BufferDescriptor { label, size, usage, mapped_at_creation: false })
        };
        Self {
            capacity,
            list: buffer("undecided", U::STORAGE | U::COPY_DST | U::COPY_SRC),
            readback: buffer("undecided readback", U::MAP_READ | U::COPY_DST),
        }
    }

    /// What kernels write to.
    pub fn binding(&self) -> wgpu::BindingResource<'_> {
        self.list.as_entire_binding()
    }

    /// Empties the list, before the kernels.
    pub fn encode_clear(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.clear_buffer(&self.list, 0, Some(size_of::<u32>() as u64));
    }

    /// Copies the list to where the host reads it, after the kernels.
    pub fn encode_copy(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.copy_buffer_to_buffer(&self.list, 0, &self.readback, 0, self.list.size());
    }

    /// Requests that the list be mapped, after the commands have been submitted.
    pub fn map(&self) -> Mapped {
        let (sender, mapped) = sync_channel(1);
        // The receiver is gone if the dispatch has been given up.
        self.readback.map_async(wgpu::MapMode::Read, .., move |result| drop(sender.send(result)));
        mapped
    }

    /// Reads the list of a dispatch of `count` rays, once its submission is done.
    ///
    /// # Errors
    /// When the list cannot be mapped, or names a ray that there is not.
    pub fn read(&self, mapped: &Mapped, count: usize) -> Result<Undecided, String> {
        // The submission is done, but the callback runs on the thread that polled first, perhaps not yet.
        let answered = mapped.recv_timeout(CALLBACK_PATIENCE);
        answered.map_err(|_| "the list of undecided rays was not mapped")?.map_err(|e| e.to_string())?;
        let view = self.readback.get_mapped_range(..).map_err(|e| e.to_string())?;
        let undecided = parse(bytemuck::cast_slice(&view), count);
        drop(view);
        self.readback.unmap();
        undecided
    }
}

/// The rays of a list of a dispatch of `count` rays.
fn parse(words: &[u32], count: usize) -> Result<Undecided, String> {
    let (&listed, words) = words.split_first().ok_or("an empty list")?;
    let Some(words) = words.get(..listed as usize) else { return Ok(Undecided::InAnswers) };
    let rays: Vec<usize> = words.iter().map(|word| (word & !MASKED_RAY) as usize).collect();
    if let Some(wrong) = rays.iter().find(|&&ray| ray >= count) {
        return Err(format!("wrong answers: ray {wrong} of {count} is said to be undecided"));
    }
    let masked = words.iter().filter(|&word| word & MASKED_RAY != 0).count();
    Ok(Undecided::Listed { rays, masked })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_read_as_far_as_they_have_room() {
        let listed = |rays: &[usize], masked| Ok(Undecided::Listed { rays: rays.to_vec(), masked });
        assert_eq!(parse(&[0, 9, 9], 5), listed(&[], 0));
        assert_eq!(parse(&[2, 4, MASKED_RAY | 1], 5), listed(&[4, 1], 1));
        assert_eq!(parse(&[3, 4, 1], 5), Ok(Undecided::InAnswers));
        assert!(parse(&[1, 5, 0], 5).is_err(), "there are five rays");
    }
}
