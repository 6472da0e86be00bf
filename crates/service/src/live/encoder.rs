//! The thread that encodes pictures beside rendering.

use super::message::Payload;
use super::outbox::Outbox;
use super::shared_frame::Rows;
use super::tile::jpeg_of;
use super::{Frame, FrameFlags, PictureFile, Reply, saved, strips};
use jpeg_encoder::{ColorType, Encoder as Jpeg, EncodingError};
use raystream::film::{DisplayTable, Exposure, Light, Look, Picture, layer_colours};
use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

/// JPEG qualities of frames while the camera moves, while the picture becomes better, and of the last one.
const QUALITIES: [u8; 3] = [MOVING_QUALITY, 82, 93];

/// JPEG quality of frames while the camera moves.
pub(super) const MOVING_QUALITY: u8 = 65;

/// A picture to encode.
#[derive(Debug)]
pub(super) struct Shown {
    pub content: Content,
    /// Of the last change that it shows.
    pub generation: u32,
    /// The time at which that change came.
    pub since: Instant,
    pub flags: FrameFlags,
    pub spp: u32,
}

/// What a picture is.
#[derive(Debug)]
pub(super) enum Content {
    /// Radiance and the layer that is shown, if it is not radiance.
    Whole(Box<Picture>),
    /// Rows of several machines, which look as they were asked for.
    Shared(SharedPicture),
}

/// A picture in rows of several machines, from top to bottom.
#[derive(Debug)]
pub(super) struct SharedPicture {
    pub size: [u32; 2],
    /// The look of all rows, with an exposure in stops.
    pub look: Look,
    /// The sums from which automatic exposure of the rows follows.
    pub light: Light,
    pub parts: Vec<Rows>,
}

impl Content {
    /// Its picture, if it is one of radiance.
    pub fn picture(&self) -> Option<&Picture> {
        match self {
            Self::Whole(picture) => Some(picture),
            Self::Shared(_) => None,
        }
    }

    fn size(&self) -> [u32; 2] {
        match self {
            Self::Whole(picture) => [picture.image.width, picture.image.height],
            Self::Shared(shared) => shared.size,
        }
    }
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
    /// True if the picture or its look has changed since it was encoded.
    is_new: bool,
    look: Look,
    files: Vec<PictureFile>,
    /// The stops of automatic exposure for the picture that was encoded last, if the look asks for it.
    stops: Option<f32>,
    is_over: bool,
}

impl Encoder {
    /// Starts the thread.
    pub fn start(look: Look, outbox: Arc<Outbox>) -> io::Result<Self> {
        let work =
            Work { picture: None, is_new: false, look, files: Vec::new(), stops: None, is_over: false };
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
        self.change(|work| {
            work.stops = work.stops.filter(|_| work.look.exposure() == look.exposure());
            (work.look, work.is_new) = (look, true);
        });
    }

    /// The look of a frame that is to be encoded before its exposure can be measured: that of the picture before.
    /// `None` if there is none.
    pub fn look_ahead(&self) -> Option<Look> {
        let work = self.shared.lock();
        match work.look.exposure() {
            Exposure::Auto => work.stops.map(|stops| work.look.with_exposure(Exposure::Stops(stops))),
            _ => Some(work.look),
        }
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
            // A file waits for a picture of radiance.
            let has_work = |work: &Work| {
                let has_radiance = |shown: &Arc<Shown>| shown.content.picture().is_some();
                work.picture
                    .as_ref()
                    .is_some_and(|shown| work.is_new || !work.files.is_empty() && has_radiance(shown))
            };
            while !(work.is_over || has_work(&work)) {
                work = self.changed.wait(work).unwrap_or_else(PoisonError::into_inner);
            }
            if work.is_over {
                return;
            }
            let look = work.look;
            let is_new = std::mem::take(&mut work.is_new);
            let shown = work.picture.clone().expect("there is a picture to encode");
            let files = shown.content.picture().map(|_| std::mem::take(&mut work.files));
            drop(work);
            if is_new {
                sequence += 1;
                let stops = self.encode_frame(&shown, look, sequence);
                let mut work = self.lock();
                if work.look == look {
                    work.stops = stops;
                }
            }
            for format in files.into_iter().flatten() {
                sequence += 1;
                self.encode_file(&shown, look, format, sequence);
            }
        }
    }

    /// Encodes a frame. Returns the stops of automatic exposure, if the look asks for it.
    fn encode_frame(&self, shown: &Shown, look: Look, sequence: u32) -> Option<f32> {
        let is_automatic = look.exposure() == Exposure::Auto;
        let (encoded, stops) = match &shown.content {
            Content::Whole(picture) => {
                let stops = look.stops(&picture.image);
                let fixed = look.with_exposure(Exposure::Stops(stops));
                (jpeg(picture, shown.flags, fixed).map_err(|error| error.to_string()), stops)
            }
            Content::Shared(shared) => (shared.jpeg(), shared.light.stops()),
        };
        match encoded {
            Ok(bytes) => self.outbox.put_frame(frame(shown, sequence, Payload::Jpeg, bytes)),
            Err(error) => self.refuse(format!("a frame cannot be encoded: {error}")),
        }
        is_automatic.then_some(stops)
    }

    fn encode_file(&self, shown: &Shown, look: Look, format: PictureFile, sequence: u32) {
        let payload = match format {
            PictureFile::Png => Payload::Png,
            PictureFile::Exr => Payload::Exr,
        };
        let Some(picture) = shown.content.picture() else { return };
        match saved::encode(picture, &look, format) {
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
        size: shown.content.size(),
        spp: shown.spp,
        time_ms: u32::try_from(shown.since.elapsed().as_millis()).unwrap_or(u32::MAX),
        payload,
        bytes,
    }
}

impl SharedPicture {
    /// All rows in one JPEG.
    fn jpeg(&self) -> Result<Vec<u8>, String> {
        let part = |rows: &Rows| match rows {
            Rows::Radiance(image) => jpeg_of(image, &self.look).map(Arc::new),
            Rows::Jpeg(jpeg) => Ok(Arc::clone(jpeg)),
        };
        let parts: Vec<Arc<Vec<u8>>> = self.parts.iter().map(part).collect::<Result<_, _>>()?;
        let whole = strips::join(parts.iter().map(|part| part.as_slice()));
        whole.ok_or_else(|| "its rows do not fit together".into())
    }
}

fn jpeg(picture: &Picture, flags: FrameFlags, look: Look) -> Result<Vec<u8>, EncodingError> {
    let image = &picture.image;
    let colours = match picture.layers.first() {
        Some(layer) => layer_colours(layer),
        None => DisplayTable::of(look.view()).bytes(image, &look),
    };
    let [moving, better, last] = QUALITIES;
    let quality = match flags {
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
