//! The thread that encodes pictures beside rendering.

use super::display::DisplayTable;
use super::layer_colours::layer_colours;
use super::message::Payload;
use super::outbox::Outbox;
use super::{Frame, FrameFlags, PictureFile, Reply, saved};
use crate::film::{Look, Picture, View};
use jpeg_encoder::{ColorType, Encoder as Jpeg, EncodingError};
use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

/// JPEG qualities of frames while the camera moves, while the picture becomes better, and of the last one.
const QUALITIES: [u8; 3] = [65, 82, 93];

/// A picture to encode.
#[derive(Debug)]
pub(super) struct Shown {
    /// Radiance and the layer that is shown, if it is not radiance.
    pub picture: Picture,
    /// Of the last change that it shows.
    pub generation: u32,
    /// When that change came.
    pub since: Instant,
    pub flags: FrameFlags,
    pub spp: u32,
}

/// Encodes the newest picture. Dropping it ends the thread.
#[derive(Debug)]
pub(super) struct Encoder {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug)]
struct Shared {
    work: Mutex<Work>,
    changed: Condvar,
    outbox: Arc<Outbox>,
}

#[derive(Debug)]
struct Work {
    picture: Option<Arc<Shown>>,
    /// Whether the picture or its look has changed since it was encoded.
    is_new: bool,
    look: Look,
    files: Vec<PictureFile>,
    is_over: bool,
}

impl Encoder {
    /// Starts the thread.
    pub fn start(look: Look, outbox: Arc<Outbox>) -> io::Result<Self> {
        let work = Work { picture: None, is_new: false, look, files: Vec::new(), is_over: false };
        let shared = Arc::new(Shared { work: Mutex::new(work), changed: Condvar::new(), outbox });
        let encoding = Arc::clone(&shared);
        let thread = std::thread::Builder::new().name("live encoder".into()).spawn(move || encoding.run())?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// Replaces the picture that waits to be encoded.
    pub fn show(&self, shown: Shown) {
        self.change(|work| (work.picture, work.is_new) = (Some(Arc::new(shown)), true));
    }

    /// Shows the picture in another look.
    pub fn set_look(&self, look: Look) {
        self.change(|work| (work.look, work.is_new) = (look, true));
    }

    /// Encodes the picture as a file.
    pub fn save(&self, format: PictureFile) {
        self.change(|work| work.files.push(format));
    }

    /// The picture that is shown.
    pub fn shown(&self) -> Option<Arc<Shown>> {
        self.shared.lock().picture.clone()
    }

    fn change(&self, change: impl FnOnce(&mut Work)) {
        change(&mut self.shared.lock());
        self.shared.changed.notify_one();
    }
}

impl Drop for Encoder {
    fn drop(&mut self) {
        self.change(|work| work.is_over = true);
        if let Some(thread) = self.thread.take() {
            // A panic has been printed, and no one waits for its frame.
            thread.join().ok();
        }
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Work> {
        self.work.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn run(&self) {
        let mut sequence = 0;
        loop {
            let mut work = self.lock();
            while !(work.is_over || work.picture.is_some() && (work.is_new || !work.files.is_empty())) {
                work = self.changed.wait(work).unwrap_or_else(PoisonError::into_inner);
            }
            if work.is_over {
                return;
            }
            let (look, files) = (work.look, std::mem::take(&mut work.files));
            let is_new = std::mem::take(&mut work.is_new);
            let shown = work.picture.clone().expect("there is a picture to encode");
            drop(work);
            if is_new {
                sequence += 1;
                self.encode_frame(&shown, look, sequence);
            }
            for format in files {
                sequence += 1;
                self.encode_file(&shown, look, format, sequence);
            }
        }
    }

    fn encode_frame(&self, shown: &Shown, look: Look, sequence: u32) {
        match jpeg(shown, look) {
            Ok(bytes) => self.outbox.put_frame(frame(shown, sequence, Payload::Jpeg, bytes)),
            Err(error) => self.refuse(format!("a frame cannot be encoded: {error}")),
        }
    }

    fn encode_file(&self, shown: &Shown, look: Look, format: PictureFile, sequence: u32) {
        let payload = match format {
            PictureFile::Png => Payload::Png,
            PictureFile::Exr => Payload::Exr,
        };
        match saved::encode(&shown.picture, &look, format) {
            Ok(bytes) => self.outbox.put_file(frame(shown, sequence, payload, bytes)),
            Err(error) => self.refuse(error.to_string()),
        }
    }

    fn refuse(&self, reason: String) {
        self.outbox.put(Reply::Refused { reason });
    }
}

fn frame(shown: &Shown, sequence: u32, payload: Payload, bytes: Vec<u8>) -> Frame {
    Frame {
        generation: shown.generation,
        sequence,
        flags: shown.flags,
        size: [shown.picture.image.width, shown.picture.image.height],
        spp: shown.spp,
        time_ms: u32::try_from(shown.since.elapsed().as_millis()).unwrap_or(u32::MAX),
        payload,
        bytes,
    }
}

fn jpeg(shown: &Shown, look: Look) -> Result<Vec<u8>, EncodingError> {
    let image = &shown.picture.image;
    let colours = match shown.picture.layers.first() {
        Some(layer) => layer_colours(layer, image.pixels.len()),
        None => table(look.view()).bytes(image, &look),
    };
    let [moving, better, last] = QUALITIES;
    let quality = match shown.flags {
        FrameFlags { moving: true, .. } => moving,
        FrameFlags { last: true, .. } => last,
        _ => better,
    };
    let mut bytes = Vec::new();
    Jpeg::new(&mut bytes, quality).encode(
        &colours,
        image.width as u16,
        image.height as u16,
        ColorType::Rgb,
    )?;
    Ok(bytes)
}

/// The table of a view, which is made by the first call.
pub(super) fn table(view: View) -> &'static DisplayTable {
    static TABLES: [OnceLock<DisplayTable>; View::ALL.len()] = [const { OnceLock::new() }; View::ALL.len()];
    let index = View::ALL.iter().position(|&other| other == view).expect("all views are listed");
    TABLES[index].get_or_init(|| DisplayTable::new(view))
}
