//! A frame that is rendered in units: which there are, and their sums.
//!
//! A unit's sums are in a file before the ledger knows of them, and they are added to the frame's in memory. From time
//! to time all are written into one file, which takes the place of the others in one change of the ledger. So whatever
//! ends the process, the files that the ledger knows of hold each sample once.

use super::decisions::{MOST_FILES, PassUnits, Sizes, Speed, is_to_be_folded};
use super::ledger::{Ledger, Rendering, UnitRow, UnitState};
use super::results;
use super::task::Failure;
use crate::backend::OpenJob;
use crate::contract::{self, FinishedUnit, UnitId, failpoint};
use raystream::files::{self, sync_folder};
use raystream::picture::FrameSum;
use raystream::render::Patch;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant, SystemTime};

/// What the names of files of sums begin with.
const UNIT: &str = "unit-";
const SUMS: &str = "sums-";

/// A frame that is worked on.
pub(super) struct OpenFrame {
    pub job: String,
    pub frame: u32,
    /// The number of times that it has begun anew.
    pub round: u32,
    folder: PathBuf,
    /// What its patches must be of.
    identity: String,
    pub open_job: OpenJob,
    most_files: usize,
    pub state: Mutex<FrameState>,
}

/// What changes of it.
pub(super) struct FrameState {
    pub gathering: FrameSum,
    passes: Vec<PassUnits>,
    /// Files of units that the file of sums does not hold yet, and their bytes.
    loose: Vec<PathBuf>,
    loose_bytes: u64,
    /// The number of the file of sums, 0 if there is none.
    sums: u64,
    sums_bytes: u64,
    /// Memory and ledger may differ: the frame is to be opened again.
    pub is_broken: bool,
}

/// What became of a finished unit.
#[derive(Debug, PartialEq)]
pub(super) enum Kept {
    /// It is on the disk and in the ledger. Whether the frame has all of its samples now, and the seconds for which it
    /// was locked.
    New { unit: UnitRow, is_complete: bool, locked_s: f64 },
    /// It was there before, or its pass has ended.
    Before,
    /// It is of another picture: scene, options or program differ.
    Foreign,
    /// It is not what was asked for.
    Wrong(String),
}

/// Who has rendered a unit.
#[derive(Clone, Copy, Debug)]
pub(super) struct By<'a> {
    pub key: &'a str,
    pub name: &'a str,
    /// True if another worker is to render the unit, too.
    pub is_compared: bool,
}

/// What is known of the lease of a unit whose sums come.
#[derive(Clone, Copy, Debug)]
pub(super) struct LeasedFor {
    /// The time at which its worker was told to render it. `None` if an earlier process of the coordinator may have
    /// told it.
    pub began: Option<Instant>,
    /// The number of times that it was leased.
    pub deliveries: u64,
}

impl LeasedFor {
    /// When a unit was begun and when its sums came, in milliseconds since 1970 by this machine's clock.
    fn times(self, came: Instant, seconds: f64) -> (f64, f64) {
        let since_1970 = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let ms_at = |at: Instant| 1e3 * since_1970.saturating_sub(at.elapsed()).as_secs_f64();
        let rendered = Duration::try_from_secs_f64(seconds.max(0.0)).unwrap_or_default();
        let guessed = || came.checked_sub(rendered).unwrap_or(came);
        (ms_at(self.began.unwrap_or_else(guessed)), ms_at(came))
    }
}

impl OpenFrame {
    /// Opens a frame with what the disk has of it.
    pub fn open(
        ledger: &Ledger,
        (job, frame): (&str, u32),
        folder: PathBuf,
        open_job: OpenJob,
        most_files: Option<usize>,
    ) -> Result<Self, Failure> {
        std::fs::create_dir_all(&folder)?;
        let (round, sums, units) = ledger.units_of(job, frame)?;
        let saved = match sums {
            0 => None,
            sums => match std::fs::read(folder.join(format!("{SUMS}{sums}"))) {
                Ok(saved) => Some(saved),
                Err(error) => return begin_anew(ledger, job, frame, &error.to_string()),
            },
        };
        let gathering = match open_job.sum(frame, saved.as_deref()) {
            Ok(gathering) => gathering,
            Err(error) if saved.is_some() => return begin_anew(ledger, job, frame, &error),
            Err(error) => return Err(Failure::Job(error)),
        };
        let state = FrameState {
            gathering,
            passes: Vec::new(),
            loose: Vec::new(),
            loose_bytes: 0,
            sums,
            sums_bytes: saved.map_or(0, |saved| saved.len() as u64),
            is_broken: false,
        };
        let identity = open_job.identity(frame).map_err(Failure::Job)?;
        let most_files = most_files.unwrap_or(MOST_FILES);
        let (job, state) = (job.to_owned(), Mutex::new(state));
        let own = Self { job, frame, round, folder, identity, open_job, most_files, state };
        own.restore(ledger, units)?;
        own.tidy(sums);
        Ok(own)
    }

    /// Adds the sums of units that have files, and takes note of those that have none.
    fn restore(&self, ledger: &Ledger, units: Vec<UnitRow>) -> Result<(), Failure> {
        let state = &mut *self.state();
        state.open_passes();
        for mut unit in units {
            if unit.state == UnitState::Kept {
                let path = self.unit_path(unit.pass, unit.number, unit.digest.as_deref().unwrap_or_default());
                let added = state.restore_unit(&self.id(&unit), &unit, &path);
                if let Err(error) = added {
                    log::warn!("{}: {error}; its samples are rendered again", path.display());
                    ledger.reopen_unit(&self.job, &unit)?;
                    unit.state = UnitState::Open;
                }
            }
            state.note(unit);
        }
        // Where later passes take samples follows from what is missing.
        if let Some(last) = state.passes.last() {
            ledger.remove_later_passes(&self.job, self.frame, last.number)?;
        }
        Ok(())
    }

    /// Removes files that the ledger does not know.
    fn tidy(&self, sums: u64) {
        let state = self.state();
        let known = self.folder.join(format!("{SUMS}{sums}"));
        for entry in std::fs::read_dir(&self.folder).into_iter().flatten().flatten() {
            let (path, name) = (entry.path(), entry.file_name().to_string_lossy().into_owned());
            let is_old = name.starts_with("samples-")
                || (name.starts_with(SUMS) && path != known)
                || (name.starts_with(UNIT) && !state.loose.contains(&path));
            if is_old {
                results::remove(&path);
            }
        }
    }

    /// The file of a unit's sums. Other sums of the unit have another file: what is being written never takes the
    /// place of what the ledger knows of.
    fn unit_path(&self, pass: u64, number: u32, digest: &str) -> PathBuf {
        self.folder.join(format!("{UNIT}{pass}-{number}-{digest}"))
    }

    fn state(&self) -> MutexGuard<'_, FrameState> {
        self.state.lock().expect("no holder panics")
    }

    /// The name of one of its units.
    pub fn id(&self, unit: &UnitRow) -> UnitId {
        let (job, frame, round) = (self.job.clone(), self.frame, self.round);
        UnitId { job, frame, round, pass: unit.pass, number: unit.number, copy: 0 }
    }

    /// Takes a unit that is to be offered: one that was cut before, or a new one, which the ledger must get to know.
    /// `None` if there is none now, or the frame is busy.
    pub fn take(&self, sizes: Sizes, speed: Speed) -> Option<(UnitRow, Vec<u32>, bool)> {
        let mut state = self.state.try_lock().ok().filter(|state| !state.is_broken)?;
        state.passes.iter_mut().find_map(|pass| {
            let (unit, is_new) = pass.take(self.frame, sizes, speed)?;
            let blocks = pass.blocks_of(&unit);
            Some((unit, blocks, is_new))
        })
    }

    /// Lets the frame be opened again: memory and ledger may differ.
    pub fn break_off(&self) {
        self.state.lock().expect("no holder panics").is_broken = true;
    }

    /// True if a worker's frame is the same.
    pub fn is_of(&self, identity: &str) -> bool {
        self.identity == identity
    }

    /// True if it is to be opened again. False while it is busy.
    pub fn is_broken(&self) -> bool {
        self.state.try_lock().is_ok_and(|state| state.is_broken)
    }

    /// True if it has all of its samples. False while it is busy.
    pub fn is_complete(&self) -> bool {
        self.state.try_lock().is_ok_and(|state| !state.is_broken && state.gathering.is_complete())
    }

    /// The unit and its blocks, if it has no sums yet. `Err` if the frame is busy.
    pub fn find(&self, pass: u64, number: u32) -> Result<Option<(UnitRow, Vec<u32>)>, ()> {
        let state = self.state.try_lock().map_err(|_| ())?;
        let pass = state.passes.iter().find(|own| own.number == pass);
        let unit = pass.and_then(|pass| Some((pass, pass.find(number)?)));
        Ok(unit.map(|(pass, unit)| (unit.clone(), pass.blocks_of(unit))))
    }

    /// Keeps the sums of a unit: in a file, in the ledger, and in memory. `lease` says when its worker was told to
    /// render it, if that is known, and how often it was leased.
    ///
    /// Files of several units are written at the same time: the frame is locked before and after, not meanwhile.
    pub fn keep(
        &self,
        ledger: &Ledger,
        finished: FinishedUnit,
        by: By<'_>,
        lease: LeasedFor,
    ) -> Result<Kept, Failure> {
        let came = Instant::now();
        let FinishedUnit { held, identity, blocks: rendered, samples, digest, seconds, opening_s, sums } =
            finished;
        let id = held.unit;
        if id.round != self.round {
            return Ok(Kept::Before);
        }
        let (mut unit, blocks) = match self.state().wanted(&id)? {
            Ok(wanted) => wanted,
            Err(kept) => return Ok(kept),
        };
        if !self.is_of(&identity) {
            return Ok(Kept::Foreign);
        }
        if rendered != blocks || samples != (unit.first..unit.end) {
            return Ok(Kept::Wrong("it has other blocks or samples than the unit".into()));
        }
        if contract::digest(&id, &blocks, &samples, &sums) != digest {
            return Ok(Kept::Wrong("its sums are damaged: their SHA-256 is another".into()));
        }
        let compared = by.is_compared.then(|| blocks.clone());
        let samples = unit.samples();
        let patch = Patch::new(blocks, unit.first..unit.end, std::sync::Arc::unwrap_or_clone(sums));
        let path = self.unit_path(unit.pass, unit.number, &digest);
        write(&path, |file| file.write_all(patch.sums()))?;
        failpoint::pass("film-written");
        let mut state = self.state();
        let locked = Instant::now();
        if let Err(kept) = state.wanted(&id)? {
            // The same sums may have come twice, and this file be the one that is known.
            if !state.loose.contains(&path) {
                results::remove(&path);
            }
            return Ok(kept);
        }
        if let Err(error) = state.gathering.add(unit.pass, &patch) {
            results::remove(&path);
            return Ok(Kept::Wrong(error.to_string()));
        }
        (unit.worker, unit.digest) = (Some(by.key.to_owned()), Some(digest));
        let (began_ms, came_ms) = lease.times(came, seconds);
        let (blocks, bytes, deliveries) = (unit.blocks, patch.sums().len() as u64, lease.deliveries);
        let rendering =
            Rendering { began_ms, came_ms, seconds, opening_s, blocks, samples, bytes, deliveries };
        let is_known = ledger.keep_unit(&self.job, unit.clone(), by.name, rendering, compared);
        if !matches!(is_known, Ok(true)) {
            // The sums in memory have what the ledger does not know of.
            state.is_broken = true;
            return is_known.map(|_| Kept::Before).map_err(Failure::from);
        }
        state.keep(&id, path, bytes);
        let is_complete = state.gathering.is_complete();
        let (files, bytes) = (state.loose.len(), state.loose_bytes);
        if !is_complete && is_to_be_folded(files, self.most_files, bytes, state.sums_bytes) {
            // If the disk refuses, the next unit tries again.
            let folded = self.fold(ledger, &mut state);
            folded.unwrap_or_else(|error| log::warn!("job {}: {error:?}", self.job));
        }
        Ok(Kept::New { unit, is_complete, locked_s: locked.elapsed().as_secs_f64() })
    }

    /// Writes all sums into one file.
    fn fold(&self, ledger: &Ledger, state: &mut FrameState) -> Result<(), Failure> {
        let before = self.folder.join(format!("{SUMS}{}", state.sums));
        let path = self.folder.join(format!("{SUMS}{}", state.sums + 1));
        write(&path, |file| state.gathering.save(file))?;
        failpoint::pass("sums-written");
        let folded = ledger.fold(&self.job, (self.frame, self.round), state.sums + 1);
        if !matches!(folded, Ok(true)) {
            // The frame has begun anew, or whether the ledger has done it is not known.
            state.is_broken = true;
            return folded.map(drop).map_err(Failure::from);
        }
        failpoint::pass("sums-committed");
        state.loose.drain(..).for_each(|path| results::remove(&path));
        if state.sums > 0 {
            results::remove(&before);
        }
        state.sums += 1;
        state.sums_bytes = std::fs::metadata(&path)?.len();
        state.loose_bytes = 0;
        Ok(())
    }

    /// Removes the files of sums, once the frame has its picture.
    pub fn remove_files(&self) {
        let state = self.state();
        state.loose.iter().for_each(|path| results::remove(path));
        results::remove(&self.folder.join(format!("{SUMS}{}", state.sums)));
    }
}

impl FrameState {
    /// Takes note of passes that have begun and have ended.
    fn open_passes(&mut self) {
        let open = self.gathering.passes();
        self.passes.retain(|own| open.iter().any(|(number, _)| *number == own.number));
        for (number, pass) in open {
            if !self.passes.iter().any(|own| own.number == number) {
                self.passes.push(PassUnits::new(number, pass));
            }
        }
    }

    /// Adds the sums of a unit from its file.
    fn restore_unit(&mut self, id: &UnitId, unit: &UnitRow, path: &Path) -> Result<(), String> {
        let pass = self.passes.iter().find(|own| own.number == unit.pass).ok_or("its pass is not open")?;
        let sums = std::fs::read(path).map_err(|error| error.to_string())?;
        if !pass.has_blocks(unit) {
            return Err("its pass has other blocks".into());
        }
        let (blocks, samples) = (pass.blocks_of(unit), unit.first..unit.end);
        if unit.digest.as_deref() != Some(&*contract::digest(id, &blocks, &samples, &sums)) {
            return Err("it is damaged".into());
        }
        let patch = Patch::new(blocks, samples, sums);
        self.gathering.add(unit.pass, &patch).map_err(|error| error.to_string())?;
        self.loose_bytes += patch.sums().len() as u64;
        self.loose.push(path.to_owned());
        self.open_passes();
        Ok(())
    }

    /// A unit that has no sums yet and its blocks, or what becomes of sums that come for it.
    fn wanted(&self, id: &UnitId) -> Result<Result<(UnitRow, Vec<u32>), Kept>, Failure> {
        if self.is_broken {
            // It is opened again, and its units are asked for once more.
            return Err(Failure::Stopped);
        }
        let Some(pass) = self.passes.iter().find(|own| own.number == id.pass) else {
            return Ok(Err(Kept::Before));
        };
        Ok(match pass.find(id.number) {
            Some(unit) => Ok((unit.clone(), pass.blocks_of(unit))),
            None if pass.is_cut(id.number) => Err(Kept::Before),
            None => Err(Kept::Wrong("there is no such unit".into())),
        })
    }

    /// Takes note that the ledger knows of a unit's sums and their file.
    fn keep(&mut self, id: &UnitId, path: PathBuf, bytes: u64) {
        let pass = self.passes.iter_mut().find(|own| own.number == id.pass);
        pass.into_iter().for_each(|pass| pass.keep(id.number));
        self.loose.push(path);
        self.loose_bytes += bytes;
        self.open_passes();
    }

    /// Takes note of a unit of the ledger.
    fn note(&mut self, unit: UnitRow) {
        if let Some(pass) = self.passes.iter_mut().find(|own| own.number == unit.pass) {
            pass.note(unit);
        }
    }
}

/// Forgets what there is of a frame, because a file of it is lost.
fn begin_anew<T>(ledger: &Ledger, job: &str, frame: u32, error: &str) -> Result<T, Failure> {
    log::warn!("job {job}: the sums of frame {frame} are lost: {error}; it begins anew");
    ledger.begin_anew(job, frame)?;
    Err(Failure::Stopped)
}

/// Writes a file. It is on the disk, with its name, when this returns.
fn write(
    path: &Path,
    content: impl FnOnce(&mut std::io::BufWriter<std::fs::File>) -> std::io::Result<()>,
) -> Result<(), Failure> {
    let written = files::write(path, |file| {
        content(&mut *file)?;
        file.flush()?;
        file.get_ref().sync_all()
    });
    written.map_err(|error| Failure::Disk(error.to_string()))?;
    Ok(sync_folder(path.parent().unwrap_or(Path::new(".")))?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::{FrameId, LoadedScenes, RenderBackend, SharedUnits};
    use crate::contract::{Held, UnitWatch};
    use crate::coordinator::ledger::tests::new;
    use raystream::engine::Units;
    use raystream::picture::Registry;
    use raystream::render::Pass;
    use raystream::schedule::{Priority, Service, ServiceOptions};
    use std::sync::Arc;
    use std::sync::mpsc::channel;

    /// Long enough for any machine; nothing waits for it where all is well.
    const PATIENCE: Duration = Duration::from_secs(20);

    const SCENE: &str = r#"{
        "environment": [1, 1, 1],
        "materials": { "grey": { "colour": [0.5, 0.5, 0.5] } },
        "shapes": [ { "shape": "sphere", "centre": [0, 0, 0], "radius": 1, "cells": 8, "material": "grey" } ],
        "camera": { "eye": [0, 0, 4], "target": [0, 0, 0], "fov_degrees": 40 } }"#;

    /// The first unit of a frame, rendered.
    fn rendered(frame: &OpenFrame, ledger: &Ledger) -> FinishedUnit {
        let (unit, blocks, _) = frame.take(Sizes::default(), Speed::default()).expect("a unit");
        ledger.add_units(&frame.job, vec![(frame.round, unit.clone())]).expect("a ledger");
        let (id, samples) = (frame.id(&unit), unit.first..unit.end);
        let piece = Pass::new(blocks.clone().into(), samples.clone());
        let sums = frame
            .open_job
            .patch(frame.frame, piece, &UnitWatch::new(Priority::Normal))
            .expect("a patch")
            .into_sums();
        let digest = contract::digest(&id, &blocks, &samples, &sums);
        let held = Held { unit: id, token: String::new() };
        let (identity, sums) = (frame.identity.clone(), Arc::new(sums));
        FinishedUnit { held, identity, blocks, samples, digest, seconds: 1.0, opening_s: 0.0, sums }
    }

    #[test]
    fn sums_of_several_frames_are_kept_at_the_same_time() {
        let data = tempfile::tempdir().expect("a folder");
        let scene = data.path().join("scene.json");
        std::fs::write(&scene, SCENE).expect("a file");
        let service = Service::new(ServiceOptions::default().with_host_threads(2)).expect("threads");
        let units = SharedUnits { units: Units::cpu(), service: Arc::new(service), policy: None };
        let loaded = LoadedScenes::new(data.path(), 1 << 20);
        let backend = RenderBackend::new(Registry::built_in(), units, Some(1 << 28), loaded);
        let spec = r#"{ "size": "16x16", "spp": 2, "frames": "0..3", "turntable": 3 }"#;
        let spec = serde_json::from_str(spec).expect("a spec");
        let open_job = backend.open(&spec, &scene, data.path()).expect("a job");
        let ledger = Ledger::open(data.path()).expect("a ledger");
        ledger.accept(new("a", None), 2).expect("accepted");
        ledger.plan("a", (0..3).map(|number| FrameId::new(number, "")).collect(), 6).expect("planned");
        let frames: Vec<OpenFrame> = (0..3)
            .map(|number| {
                let folder = data.path().join(number.to_string());
                OpenFrame::open(&ledger, ("a", number), folder, open_job.clone(), None).expect("a frame")
            })
            .collect();
        let finished: Vec<FinishedUnit> = frames.iter().map(|frame| rendered(frame, &ledger)).collect();
        let (by, lease) =
            (By { key: "k", name: "w", is_compared: false }, LeasedFor { began: None, deliveries: 1 });
        let (kept, keeps) = channel();
        std::thread::scope(|scope| {
            // Sums of the first frame are being written into one file.
            let first = frames[0].state();
            for (number, (frame, finished)) in frames.iter().zip(finished).enumerate() {
                let (kept, ledger) = (kept.clone(), &ledger);
                scope.spawn(move || {
                    let new = frame.keep(ledger, finished, by, lease);
                    let is_complete = matches!(new, Ok(Kept::New { is_complete: true, .. }));
                    kept.send((number, is_complete)).expect("the test waits");
                });
            }
            let mut others = [(); 2].map(|()| keeps.recv_timeout(PATIENCE));
            others.sort_by_key(|kept| kept.map_or(0, |(number, _)| number));
            let first_waits = keeps.recv_timeout(Duration::from_millis(50)).is_err();
            drop(first);
            assert_eq!((others, first_waits), ([Ok((1, true)), Ok((2, true))], true));
        });
        assert_eq!(keeps.recv_timeout(PATIENCE), Ok((0, true)));
        assert!(frames.iter().all(OpenFrame::is_complete));
    }
}
