//! Pictures of a frame while it is rendered.

use super::frame_layers::Developer;
use crate::film::{Film, Image, Layer, Picture};
use crate::schedule::JobControl;
use std::fmt;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Shows a frame that [`super::Progressive`] renders, and stops it, from any thread and at any time. A picture is the
/// sum of complete passes, never of a part of one, and takes its mean over the samples of these passes. It is therefore
/// as bright as the finished picture, unlike the film of a job that still runs, in which camera rays count before they
/// are shaded.
///
/// ```no_run
/// # use raystream::render::{Integrator, Progressive};
/// # use raystream::schedule::{JobHandle, LimitsError};
/// # use std::sync::Arc;
/// # fn show(_: raystream::film::Image) {}
/// # fn render<I: Integrator>(
/// #     mut frame: Progressive<I>,
/// #     submit: impl Fn(&Arc<I>) -> Result<JobHandle, LimitsError>,
/// # ) -> Result<(), Box<dyn std::error::Error>> {
/// let preview = frame.preview();
/// std::thread::spawn(move || {
///     let mut passes = 0;
///     while let Some(picture) = preview.wait_beyond(passes) {
///         passes = picture.passes;
///         show(picture.image);
///     }
/// });
/// loop {
///     frame.begin(&submit)?;
///     if frame.finish_pass()?.is_none() {
///         break;
///     }
/// }
/// # Ok(())
/// # }
/// ```
#[derive(Clone)]
pub struct Preview(Arc<Shared>);

/// A picture of complete passes, with the layers that [`super::Frame::develop`] gives.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct PassPicture {
    /// Radiance, of the frame's part if it has one.
    pub image: Image,
    /// As in [`Picture`].
    pub alpha: Option<Vec<f32>>,
    /// The layers that the frame was asked for.
    pub layers: Vec<Layer>,
    /// Number of complete passes.
    pub passes: u64,
    /// Mean number of samples of a pixel.
    pub mean_samples: f64,
    /// Splats that were dropped, because they were negative or not finite.
    pub dropped_splats: u64,
}

impl Preview {
    /// The sum of all complete passes; `None` before the first.
    pub fn picture(&self) -> Option<PassPicture> {
        self.0.picture(&self.0.lock())
    }

    /// Number of complete passes.
    pub fn passes(&self) -> u64 {
        self.0.lock().passes
    }

    /// Waits until more than this many passes are complete. Returns their sum; `None` once the frame's
    /// [`super::Progressive`] is gone and no more passes will come.
    pub fn wait_beyond(&self, passes: u64) -> Option<PassPicture> {
        let mut films = self.0.lock();
        while films.passes <= passes && !films.is_over {
            films = self.0.changed.wait(films).unwrap_or_else(PoisonError::into_inner);
        }
        (films.passes > passes).then(|| self.0.picture(&films)).flatten()
    }

    /// Ends the frame early: no more camera rays; what is in flight is finished. Returns at once.
    pub fn stop(&self) {
        let mut stops = self.0.stops();
        stops.requested = true;
        stops.jobs.drain(..).for_each(|job| job.stop());
    }
}

impl fmt::Debug for Preview {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Preview").field("passes", &self.passes()).finish_non_exhaustive()
    }
}

struct Shared {
    films: Mutex<Films>,
    changed: Condvar,
    stops: Mutex<Stops>,
    developer: Developer,
}

/// Reasons to end a frame early.
#[derive(Default)]
struct Stops {
    requested: bool,
    /// The passes in flight, and perhaps some that have ended.
    jobs: Vec<JobControl>,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Films> {
        self.films.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn stops(&self) -> MutexGuard<'_, Stops> {
        self.stops.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn picture(&self, films: &Films) -> Option<PassPicture> {
        (films.passes > 0).then(|| {
            let Picture { image, alpha, layers, .. } = self.developer.develop(&films.whole);
            PassPicture {
                image,
                alpha,
                layers,
                passes: films.passes,
                mean_samples: films.whole.samples() as f64 / self.developer.region.area() as f64,
                dropped_splats: films.whole.dropped_splats(),
            }
        })
    }
}

/// The films of a frame.
struct Films {
    /// The sum of all complete passes.
    whole: Arc<Film>,
    passes: u64,
    /// No more passes will come.
    is_over: bool,
}

/// Adds complete passes for [`Preview`]s. When it is dropped, they stop waiting.
pub(super) struct PassSum(Preview);

impl PassSum {
    /// A sum of this many passes.
    pub fn new(whole: &Arc<Film>, passes: u64, developer: Developer) -> Self {
        let films = Films { whole: Arc::clone(whole), passes, is_over: false };
        let (films, changed, stops) = (Mutex::new(films), Condvar::new(), Mutex::default());
        Self(Preview(Arc::new(Shared { films, changed, stops, developer })))
    }

    pub fn preview(&self) -> Preview {
        self.0.clone()
    }

    pub fn is_stopped(&self) -> bool {
        self.0.0.stops().requested
    }

    /// Lets previews stop the job of a pass.
    pub fn watch(&self, job: JobControl) {
        let mut stops = self.0.0.stops();
        if stops.requested {
            return job.stop();
        }
        stops.jobs.retain(|job| !job.is_finished());
        stops.jobs.push(job);
    }

    /// Adds a complete pass and returns the sum. No preview sees a part of the addition.
    pub fn add(&self, pass: &Arc<Film>) -> Arc<Film> {
        let shared = &self.0.0;
        let mut films = shared.lock();
        if films.passes == 0 {
            films.whole = Arc::clone(pass);
        } else {
            films.whole.add(pass);
        }
        films.passes += 1;
        shared.changed.notify_all();
        Arc::clone(&films.whole)
    }
}

impl Drop for PassSum {
    fn drop(&mut self) {
        let shared = &self.0.0;
        shared.lock().is_over = true;
        shared.changed.notify_all();
    }
}
