//! Partial films: files of the sums of some of a frame's samples, which add up to the whole frame's in any order.

use super::frame_layers::layer_record::LayerRecord;
use super::summed::Summed;
use super::{Frame, Identity, Part, Settings};
use crate::film::{Film, FilmKind, Image, Oidn, Picture, Region, take};
use crate::lanes::SimdLevel;
use crate::memory::OutOfMemory;
use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::{self, ErrorKind, Read, Seek, SeekFrom, Write};
use std::sync::Arc;
use xxhash_rust::xxh3::Xxh3;

/// The first bytes of a partial film.
const MAGIC: &[u8; 22] = b"raystream partial film";

/// Counts incompatible formats of partial films.
pub const PARTIAL_FILM_VERSION: u32 = 1;

/// The most bytes of a header. Ten thousand parts, or as many objects with names, take about one million.
const MAX_HEADER_BYTES: u64 = 1 << 28;

/// Bytes that are read at a time.
const READ_BYTES: usize = 1 << 16;

/// Header of a partial film: which picture it is of, and which of its samples it has.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartialFilmHeader {
    identity: Identity,
    width: u32,
    height: u32,
    spp: u32,
    kind: FilmKind,
    /// Origin of its layers, if it has any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    layers: Option<LayerRecord>,
    /// Bytes of the film before compression.
    film_bytes: u64,
    parts: Vec<Part>,
    metadata: BTreeMap<String, String>,
}

impl PartialFilmHeader {
    /// The picture.
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// Columns and rows of the whole picture.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Samples per pixel of the whole picture.
    pub fn spp(&self) -> u32 {
        self.spp
    }

    /// The samples, in parts that do not overlap.
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// Facts about the picture, for the files that show it.
    pub fn metadata(&self) -> &BTreeMap<String, String> {
        &self.metadata
    }

    /// Bytes of memory that [`PartialFilm::read`] takes, at most.
    pub fn reading_bytes(&self) -> u64 {
        self.film_bytes.saturating_add(self.kind.bytes(self.width, self.height).saturating_mul(2))
    }

    /// The samples of the picture that it does not have.
    pub fn missing(&self) -> Vec<Part> {
        Part::whole(&self.settings()).without(&self.parts)
    }

    /// Adds the parts of another.
    ///
    /// # Errors
    /// If it is of another picture, or both have a sample in common. Then nothing is changed.
    pub fn join(&mut self, other: &Self) -> Result<(), PartialFilmError> {
        if let Some((what, values)) = self.identity.difference(&other.identity) {
            let [first, second] = values.map(|value| value.unwrap_or("not given").to_owned());
            return Err(PartialFilmError::Mismatch { what: what.to_owned(), first, second });
        }
        if (self.size(), self.spp, &self.kind) != (other.size(), other.spp, &other.kind) {
            // The same identity never gives two kinds of films.
            return Err(PartialFilmError::Damaged);
        }
        for part in &other.parts {
            if let Some(part) = self.parts.iter().find_map(|own| own.overlap(part)) {
                return Err(PartialFilmError::Overlap { part });
            }
        }
        self.parts.extend_from_slice(&other.parts);
        Ok(())
    }

    fn settings(&self) -> Settings {
        Settings::new(self.width, self.height).with_spp(self.spp)
    }

    /// Number of samples of all parts.
    fn samples(&self) -> u64 {
        self.parts.iter().map(Part::count).sum()
    }

    /// True if sizes are in range and the parts are of the picture and do not overlap.
    fn is_sound(&self) -> bool {
        let settings = self.settings();
        let is_disjoint =
            |(i, part): (usize, &Part)| self.parts[..i].iter().all(|other| part.overlap(other).is_none());
        settings.validate(u32::MAX).is_ok()
            && self.kind.is_sound()
            && self
                .layers
                .as_ref()
                .map_or(self.kind.layers().is_empty(), |layers| layers.is_of(self.kind.layers()))
            && self.parts.iter().all(|part| part.is_of(&settings))
            && self.parts.iter().enumerate().all(is_disjoint)
    }

    /// Reads the header of a file and checks the file's sum.
    ///
    /// # Errors
    /// If the file is not a partial film of this version, or is damaged, or cannot be read.
    pub fn read(from: impl Read + Seek) -> Result<Self, PartialFilmError> {
        Ok(Opened::new(from)?.header)
    }
}

/// Exact sums of some samples of a frame, for processes that render a frame together: each renders parts of it
/// ([`Frame::with_part`]), on any machine and any units, and the films are added in any order. Once no sample is
/// missing, the sums are those of the whole frame to the bit.
///
/// ```
/// use raystream::engine::{PreparedScene, Units};
/// use raystream::film::Region;
/// use raystream::render::{Identity, Integrator, Part, PartialFilm, PathTracer, Settings};
/// use raystream::scene::{Camera, recipe::Recipe};
/// use raystream::schedule::{JobOptions, Service, ServiceOptions};
/// use std::io::Cursor;
/// use std::sync::Arc;
///
/// let recipe = Recipe::parse(r#"{ "environment": [1, 1, 1], "materials": { "grey": { "colour": [0.5, 0.5, 0.5] } },
///     "shapes": [ { "shape": "sphere", "centre": [0, 0, 0], "radius": 1, "cells": 8, "material": "grey" } ] }"#)?;
/// let prepared = PreparedScene::new(recipe.build()?, &Units::cpu())?;
/// let service = Service::new(ServiceOptions::default())?;
/// let camera = Camera::framing(&prepared.scene.bounds(), 1.0);
/// let settings = Settings::new(32, 32).with_spp(4).with_max_bounces(2);
/// let whole = PathTracer::new(prepared.scene.clone(), &camera, settings, None)?;
/// let identity = Identity::new([("scene".to_owned(), prepared.scene.fingerprint().to_string())]);
///
/// let region: Region = "0,0,32,32".parse()?;
/// let mut files = Vec::new();
/// for samples in [2..4, 0..2] {
///     let part = Arc::new(whole.with_part(Part { region, samples })?);
///     service.submit(part.clone(), prepared.tracers.clone(), JobOptions::default())?.wait()?;
///     let mut file = Cursor::new(Vec::new());
///     let film = PartialFilm::new(identity.clone(), part.frame(), part.frame().film().clone())?;
///     film.write(&mut file)?;
///     file.set_position(0);
///     files.push(file);
/// }
/// let mut sum = PartialFilm::read(&mut files[0])?;
/// sum.add(&PartialFilm::read(&mut files[1])?)?;
/// assert_eq!(sum.header().missing(), []);
/// assert_eq!(sum.film().mean_samples(), 4.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct PartialFilm {
    header: PartialFilmHeader,
    film: Arc<Film>,
}

/// Error of using partial films.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PartialFilmError {
    /// The file is not a partial film.
    #[error("it is not a partial film of raystream")]
    Foreign,
    /// In another format.
    #[error(
        "it is a partial film of version {0}, and this raystream reads version {PARTIAL_FILM_VERSION} only"
    )]
    Version(u32),
    /// The file is truncated or damaged.
    #[error("it is damaged; render this part again")]
    Damaged,
    /// The file cannot be read.
    #[error("it cannot be read: {0}")]
    Unreadable(#[from] io::Error),
    /// The film has other samples than its part: it was stopped, or some samples were taken twice.
    #[error("the film has {found} samples, but {expected} are wanted; let its frame end first")]
    Samples {
        /// Samples of the film.
        found: u64,
        /// Samples of the part.
        expected: u64,
    },
    /// The films are of two pictures.
    #[error("they are of two pictures: {what} is {first} in the first and {second} in the second")]
    Mismatch {
        /// The name of what differs.
        what: String,
        /// Its value in the first.
        first: String,
        /// Its value in the second.
        second: String,
    },
    /// Both films have these samples.
    #[error("both have {part}")]
    Overlap {
        /// The samples.
        part: Part,
    },
    /// There is too little memory.
    #[error(transparent)]
    Memory(#[from] OutOfMemory),
}

impl PartialFilm {
    /// The finished film of a frame's part.
    ///
    /// # Errors
    /// If it does not have exactly the samples of the part.
    pub fn new(identity: Identity, frame: &Frame, film: Arc<Film>) -> Result<Self, PartialFilmError> {
        let Settings { width, height, spp, .. } = *frame.settings();
        let (parts, kind, metadata) = (vec![frame.part().clone()], film.kind(), BTreeMap::new());
        let layers = LayerRecord::of(frame);
        let header =
            PartialFilmHeader { identity, width, height, spp, kind, layers, film_bytes: 0, parts, metadata };
        Self { header, film }.checked()
    }

    /// The same film with facts about the picture.
    pub fn with_metadata(mut self, metadata: BTreeMap<String, String>) -> Self {
        self.header.metadata = metadata;
        self
    }

    fn checked(self) -> Result<Self, PartialFilmError> {
        let (found, expected) = (self.film.samples(), self.header.samples());
        if found == expected { Ok(self) } else { Err(PartialFilmError::Samples { found, expected }) }
    }

    /// The picture and the samples that the film is of.
    pub fn header(&self) -> &PartialFilmHeader {
        &self.header
    }

    /// The sums.
    pub fn film(&self) -> &Film {
        &self.film
    }

    /// The picture of a region, with the layers that the frame was asked for.
    ///
    /// # Panics
    /// If the picture does not have the region.
    pub fn develop(&self, region: Region) -> Picture {
        match &self.header.layers {
            Some(layers) => layers.developer(region).develop(&self.film),
            None => Picture::new(Image::of(&self.film, region)),
        }
    }

    /// [`PartialFilm::develop`], and the picture denoised as [`super::Frame::develop_denoised`] does it.
    ///
    /// # Panics
    /// If the picture does not have the region.
    pub fn develop_denoised(
        &self,
        region: Region,
        simd: SimdLevel,
        threads: usize,
        oidn: Option<&Oidn>,
    ) -> Picture {
        match &self.header.layers {
            Some(layers) => layers.developer(region).develop_denoised(&self.film, simd, threads, oidn),
            None => self.develop(region),
        }
    }

    /// Adds another film of the same picture.
    ///
    /// # Errors
    /// If it is of another picture, or both have a sample in common. Then nothing is changed.
    pub fn add(&mut self, other: &Self) -> Result<(), PartialFilmError> {
        self.header.join(&other.header)?;
        self.film.add(&other.film);
        Ok(())
    }

    /// Writes the film. The format, all numbers little-endian: the 22 bytes "raystream partial film"; a version (u32);
    /// the length (u64) and the bytes of a JSON header, which is [`PartialFilmHeader`]: the identity of the picture,
    /// its size and samples, the film's precision and layers, the parts, and facts for picture files; a zlib stream of
    /// what [`Film::save`] writes for the whole picture; XXH3 (u64) of all before it.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn write(&self, to: impl Write) -> io::Result<()> {
        let mut length = Length(0);
        self.film.save(&mut length)?;
        let header = PartialFilmHeader { film_bytes: length.0, ..self.header.clone() };
        let header = serde_json::to_vec(&header)?;
        let mut to = Summed::new(to);
        to.write_all(MAGIC)?;
        to.write_all(&PARTIAL_FILM_VERSION.to_le_bytes())?;
        to.write_all(&(header.len() as u64).to_le_bytes())?;
        to.write_all(&header)?;
        let mut film =
            io::BufWriter::with_capacity(READ_BYTES, ZlibEncoder::new(&mut to, Compression::fast()));
        self.film.save(&mut film)?;
        film.into_inner().map_err(io::IntoInnerError::into_error)?.finish()?;
        to.finish()
    }

    /// Reads what [`PartialFilm::write`] wrote. It takes [`PartialFilmHeader::reading_bytes`] of memory.
    ///
    /// # Errors
    /// If the file is not a partial film of this version, or is damaged, or cannot be read, or the system does not give
    /// the memory.
    pub fn read(from: impl Read + Seek) -> Result<Self, PartialFilmError> {
        let Opened { header, compressed_bytes, from } = Opened::new(from)?;
        let mut bytes = Vec::new();
        let length = usize::try_from(header.film_bytes).map_err(|_| PartialFilmError::Damaged)?;
        bytes
            .try_reserve_exact(length)
            .map_err(|_| OutOfMemory::Refused { what: "a partial film".into(), needed: header.film_bytes })?;
        let mut film = ZlibDecoder::new(from.take(compressed_bytes));
        // One byte more shows that there is more.
        (&mut film)
            .take(header.film_bytes.saturating_add(1))
            .read_to_end(&mut bytes)
            .map_err(unless_damaged)?;
        if film.total_in() != compressed_bytes {
            return Err(PartialFilmError::Damaged);
        }
        let mut rest = &bytes[..];
        let film = header.kind.film(header.width, header.height)?;
        let film = film.restored(&mut rest).ok_or(PartialFilmError::Damaged)?;
        if !rest.is_empty() || bytes.len() != length {
            return Err(PartialFilmError::Damaged);
        }
        Self { header, film: film.into() }.checked()
    }
}

/// Counts the bytes that are written.
struct Length(u64);

impl Write for Length {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0 += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A file whose sum is right, up to its film.
struct Opened<R> {
    header: PartialFilmHeader,
    /// Bytes of the compressed film, the next that are read.
    compressed_bytes: u64,
    from: R,
}

impl<R: Read + Seek> Opened<R> {
    fn new(mut from: R) -> Result<Self, PartialFilmError> {
        let start = &mut [0; MAGIC.len() + size_of::<u32>()];
        from.read_exact(start).map_err(|error| match error.kind() {
            ErrorKind::UnexpectedEof => PartialFilmError::Foreign,
            _ => error.into(),
        })?;
        let mut rest = start.strip_prefix(MAGIC).ok_or(PartialFilmError::Foreign)?;
        let version = u32::from_le_bytes(*take(&mut rest).ok_or(PartialFilmError::Damaged)?);
        if version != PARTIAL_FILM_VERSION {
            return Err(PartialFilmError::Version(version));
        }
        let content = check_sum(&mut from)?;
        from.seek(SeekFrom::Start(start.len() as u64))?;
        let mut length = [0; size_of::<u64>()];
        from.read_exact(&mut length).map_err(unless_damaged)?;
        let length = u64::from_le_bytes(length);
        let film_at = (start.len() + size_of::<u64>()) as u64 + length.min(MAX_HEADER_BYTES);
        if length > MAX_HEADER_BYTES || film_at > content {
            return Err(PartialFilmError::Damaged);
        }
        let mut header = vec![0; length as usize];
        from.read_exact(&mut header).map_err(unless_damaged)?;
        let header: PartialFilmHeader =
            serde_json::from_slice(&header).map_err(|_| PartialFilmError::Damaged)?;
        if !header.is_sound() {
            return Err(PartialFilmError::Damaged);
        }
        Ok(Self { header, compressed_bytes: content - film_at, from })
    }
}

/// Compares the sum at the end of a file with its content, whose length is returned.
fn check_sum(from: &mut (impl Read + Seek)) -> Result<u64, PartialFilmError> {
    let sum_bytes = size_of::<u64>() as u64;
    let content = from.seek(SeekFrom::End(0))?.checked_sub(sum_bytes).ok_or(PartialFilmError::Damaged)?;
    from.rewind()?;
    let (mut sum, mut bytes) = (Xxh3::new(), vec![0; READ_BYTES]);
    let mut left = content;
    while left > 0 {
        let some = &mut bytes[..left.min(READ_BYTES as u64) as usize];
        from.read_exact(some).map_err(unless_damaged)?;
        sum.update(some);
        left -= some.len() as u64;
    }
    let mut written = [0; size_of::<u64>()];
    from.read_exact(&mut written).map_err(unless_damaged)?;
    if u64::from_le_bytes(written) == sum.digest() { Ok(content) } else { Err(PartialFilmError::Damaged) }
}

/// An error of reading, or the damage that it shows.
fn unless_damaged(error: io::Error) -> PartialFilmError {
    match error.kind() {
        ErrorKind::UnexpectedEof | ErrorKind::InvalidData | ErrorKind::InvalidInput => {
            PartialFilmError::Damaged
        }
        _ => error.into(),
    }
}
