//! Frames that are watched while they are rendered, and the account of each.

use super::unit::{LOOK, Watch, count};
use super::{Rendering, mean_samples};
use crate::film::Picture;
use crate::render::{Integrator, NoiseReport, PassOptions, Progressive};
use crate::schedule::{Priority, RayCounts, Service};
use anyhow::{Context, Result, bail};
use std::time::{Duration, Instant};

/// A frame that has been rendered.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct RenderedFrame {
    /// The picture, with facts about it.
    pub picture: Picture,
    /// Rays that were traced, by kind.
    pub rays: RayCounts,
    /// Mean number of samples of a pixel.
    pub mean_samples: f64,
    /// Complete passes over the picture.
    pub passes: u64,
    /// Time from the first camera ray to the last splat.
    pub time: Duration,
    /// The noise that is left, if the spec has a target.
    pub noise: Option<NoiseReport>,
    /// A sentence for each material that made splats which were dropped.
    pub warnings: Vec<String>,
}

impl Rendering {
    /// Renders a frame, on the time of the spec if it has one, and tells `watch` how far it is. `None` if `watch`
    /// stopped it; what was rendered is lost then.
    ///
    /// ```
    /// use raystream::engine::Units;
    /// use raystream::picture::{Registry, RenderSpec, Watch, open_scene};
    /// use raystream::scene::recipe::Recipe;
    /// use raystream::schedule::{Priority, Service, ServiceOptions};
    ///
    /// struct Bar;
    ///
    /// impl Watch for Bar {
    ///     fn priority(&self) -> Priority {
    ///         Priority::Normal
    ///     }
    ///     fn is_stopped(&self) -> bool {
    ///         false
    ///     }
    ///     fn traced(&self, _rays: u64, _seconds: f64) {}
    ///     fn progress(&self, share: f64) {
    ///         eprint!("{:.0} %\r", 100.0 * share);
    ///     }
    /// }
    ///
    /// let scene = Recipe::parse(r#"{ "environment": [1, 1, 1], "materials": { "grey": { "colour": [0.5, 0.5, 0.5] } },
    ///     "shapes": [ { "shape": "sphere", "centre": [0, 0, 0], "radius": 1, "cells": 8, "material": "grey" } ] }"#)?;
    /// let spec: RenderSpec = serde_json::from_str(r#"{ "size": [32, 32], "spp": 4 }"#)?;
    /// let rendering = open_scene(&spec, scene.build()?, &Units::cpu(), &Registry::built_in())?;
    /// let frame = rendering.render_watched(&Service::new(ServiceOptions::default())?, 0, &Bar)?;
    /// assert_eq!(frame.expect("nothing stops it").mean_samples, 4.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// If there is no such frame, or the scheduler or the denoiser refuses or fails.
    pub fn render_watched(
        &self,
        service: &Service,
        frame: u32,
        watch: &dyn Watch,
    ) -> Result<Option<RenderedFrame>> {
        if self.moves() {
            return self.of_frame(frame)?.render_watched(service, frame, watch);
        }
        let (stop, began, camera) = (&self.spec().stop, Instant::now(), self.camera(frame)?);
        let options = PassOptions { noise: stop.noise, pass_time: stop.seconds };
        let integrator = self.integrator(&camera)?;
        let samples = integrator.frame().part().count() as f64;
        let number = frame;
        let mut frame = Progressive::new(integrator, options);
        let mut rays = RayCounts::default();
        loop {
            if watch.is_stopped() {
                return Ok(None);
            }
            let spent = stop.seconds.map_or(0.0, |limit| began.elapsed().div_duration_f64(limit));
            if spent >= 1.0 && frame.passes() > 0 {
                frame.stop();
            }
            frame.begin_exposed(|integrator, pass| {
                let (own, exposed) = self.exposed(integrator, number, pass)?;
                let job = own.submit_watched(service, &exposed, watch)?;
                anyhow::Ok((exposed, job))
            })?;
            if !frame.wait_for(LOOK) {
                let begun: u64 = frame.progress().map(|job| job.rays.camera).sum();
                watch.progress(spent.max((rays.camera + begun) as f64 / samples).min(1.0));
                continue;
            }
            let Some(report) = frame.finish_pass().context("the frame failed")? else { break };
            count(&report, watch);
            rays.camera += report.rays.camera;
            rays.continuation += report.rays.continuation;
            rays.shadow += report.rays.shadow;
        }
        watch.progress(1.0);
        let picture = self.developed(&frame, &camera);
        if let Some(why) = &picture.kept_noise {
            bail!("{why}");
        }
        Ok(Some(RenderedFrame {
            picture,
            rays,
            mean_samples: mean_samples(&frame),
            passes: frame.passes(),
            time: began.elapsed(),
            noise: frame.noise(),
            warnings: frame.integrator().frame().dropped_warnings(),
        }))
    }
}

/// No watcher: nothing stops the frame.
pub(super) struct Unwatched;

impl Watch for Unwatched {
    fn priority(&self) -> Priority {
        Priority::Normal
    }

    fn is_stopped(&self) -> bool {
        false
    }

    fn traced(&self, _rays: u64, _seconds: f64) {}

    fn progress(&self, _share: f64) {}
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::Units;
    use crate::picture::{Registry, RenderSpec, open_scene};
    use crate::scene::recipe::Recipe;
    use crate::schedule::ServiceOptions;
    use std::sync::Mutex;

    const SCENE: &str = r#"{ "environment": [1, 1, 1], "materials": { "grey": { "colour": [0.5, 0.5, 0.5] } },
        "shapes": [ { "shape": "sphere", "centre": [0, 0, 0], "radius": 1, "cells": 8, "material": "grey" } ] }"#;

    fn rendering(spec: &str) -> Rendering {
        let scene = Recipe::parse(SCENE).expect("a recipe").build().expect("a scene");
        let spec: RenderSpec = serde_json::from_str(spec).expect("a spec");
        open_scene(&spec, scene, &Units::cpu(), &Registry::built_in()).expect("a rendering")
    }

    fn service() -> Service {
        Service::new(ServiceOptions::default().with_host_threads(2)).expect("threads")
    }

    /// Stops after so many looks.
    struct Shares(Mutex<Vec<f64>>, usize);

    impl Watch for Shares {
        fn priority(&self) -> Priority {
            Priority::Normal
        }

        fn is_stopped(&self) -> bool {
            self.0.lock().expect("no panic").len() >= self.1
        }

        fn traced(&self, _rays: u64, _seconds: f64) {}

        fn progress(&self, share: f64) {
            self.0.lock().expect("no panic").push(share);
        }
    }

    #[test]
    fn a_watched_frame_has_the_same_picture_and_an_account() {
        let rendering = rendering(r#"{ "size": [64, 48], "spp": 64, "noise": 0.02, "aov": "depth" }"#);
        let watch = Shares(Mutex::default(), usize::MAX);
        let frame = rendering.render_watched(&service(), 0, &watch).expect("a frame").expect("not stopped");
        let picture = rendering.render(&service(), 0).expect("a picture");
        assert_eq!(frame.picture.image.hash(), picture.image.hash());
        assert_eq!(frame.picture.layer_hashes(), picture.layer_hashes());
        assert!(frame.mean_samples > 8.0 && frame.mean_samples <= 64.0, "{}", frame.mean_samples);
        // The depth of a pixel is that of a ray through its centre.
        assert_eq!(frame.rays.camera as f64, (frame.mean_samples + 1.0) * 64.0 * 48.0);
        assert!(frame.rays.continuation > 0 && frame.passes > 1 && frame.warnings.is_empty());
        assert!(frame.noise.expect("a target").mean > 0.0);
        let shares = watch.0.into_inner().expect("no panic");
        assert!(shares.is_sorted() && shares.last() == Some(&1.0), "{shares:?}");
    }

    #[test]
    fn a_frame_can_be_stopped_and_can_end_in_time() {
        let endless = rendering(r#"{ "size": [256, 256], "spp": 60000 }"#);
        let began = Instant::now();
        let stopped = endless.render_watched(&service(), 0, &Shares(Mutex::default(), 2)).expect("no error");
        assert!(stopped.is_none() && began.elapsed() < Duration::from_secs(20), "{:?}", began.elapsed());
        let timed = rendering(r#"{ "size": [32, 32], "seconds": 0.2 }"#);
        let frame = timed.render_watched(&service(), 0, &Unwatched).expect("no error").expect("a frame");
        assert!(frame.mean_samples >= 1.0 && frame.time >= Duration::from_millis(200), "{:?}", frame.time);
    }
}
