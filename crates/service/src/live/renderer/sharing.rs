//! Moving frames that workers on other machines render, too.

use super::super::decisions::DEADLINE;
use super::super::encoder::{Content, Shown};
use super::super::shared_frame::SharedFrame;
use super::super::tile::{cropped, path_tracer, rows_of};
use super::super::tile_dispatch::{Arrival, Arrived};
use super::{FrameFlags, Renderer, Work};
use crate::contract::TileAsk;
use raystream::film::Exposure;
use raystream::render::{AovSet, Integrator, Settings};
use raystream::schedule::JobReport;
use std::time::Instant;

impl Renderer {
    /// Asks workers for rows of the next moving frame. `None` if this process renders it alone: no worker is ready, or
    /// it is no picture of radiance, or its exposure is not known yet.
    pub(super) fn share(&mut self, began: Instant) -> Option<SharedFrame> {
        let size = self.moving_size();
        let settings = self.moving(size);
        let is_plain = self.layer().is_none() && settings.filter == Settings::new(1, 1).filter;
        let look = self.encoder.look_ahead().filter(|_| is_plain)?;
        let Exposure::Stops(_) = look.exposure() else { return None };
        let tile_dispatch = self.tile_dispatch.as_mut()?;
        let split = tile_dispatch.split(size)?;
        let ask = TileAsk {
            view: 0,
            frame: 0,
            spec: Box::new(self.wanted.spec.tile(&settings, &look)),
            shaders: self.wanted.spec.texts().clone(),
            rows: 0..0,
            is_denoised: self.is_denoised,
            is_metered: self.wanted.spec.spec().look.exposure == Exposure::Auto,
            budget_ms: 0,
        };
        let deadline = began + DEADLINE;
        let number = tile_dispatch.ask(&split, &ask, deadline);
        Some(SharedFrame::new(number, size, look, split, deadline).metered(ask.is_metered))
    }

    /// Takes what a worker has answered.
    pub(super) fn take_arrival(&mut self, arrival: Arrival) {
        let Some(arrived) = self.tile_dispatch.as_mut().and_then(|tile_dispatch| tile_dispatch.take(arrival))
        else {
            return;
        };
        let Some(shared) = self.work.as_mut().and_then(|work| work.shared.as_mut()) else { return };
        match arrived {
            Arrived::Tile(number, tile) if number == shared.number() => shared.put(tile),
            Arrived::Lost(number, rows) if number == shared.number() => shared.lose(&rows),
            // Of an earlier frame.
            _ => {}
        }
    }

    /// Takes the rows of a shared frame that this process has rendered.
    pub(super) fn take_share(&mut self, report: JobReport) {
        let Some(work) = &mut self.work else { return };
        let Some(shared) = &mut work.shared else { return };
        // What is coarse stays as it is: it stands beside rows that are not.
        let rendered = work.frame.integrator().frame();
        let image = rendered.develop_filtered(&work.frame.picture(), self.view_scene.service.host_threads());
        let image = match shared.waits_for_own() {
            true => cropped(image, rendered.part().region.y, &shared.split().own),
            false => image,
        };
        let width = image.width;
        if let Some(rows) = shared.take(image) {
            work.report = Some(report);
            let time = work.began.elapsed();
            self.tile_dispatch
                .iter_mut()
                .for_each(|tile_dispatch| tile_dispatch.count_own(rows, width, time));
        }
    }

    /// Shows the shared frame under way if it is complete, or renders here what has not come in time.
    pub(super) fn advance_shared(&mut self) {
        let Some(work) = &mut self.work else { return };
        let Some(shared) = &mut work.shared else { return };
        if shared.is_complete() {
            return self.show_shared();
        }
        if !shared.is_due() {
            return;
        }
        let late = shared.missing();
        self.tile_dispatch
            .iter_mut()
            .for_each(|tile_dispatch| tile_dispatch.miss(shared.number(), shared.split(), &late));
        let Some((size, rows)) = shared.fill() else { return };
        let settings = self.moving(size);
        let Some(work) = &mut self.work else { return };
        let path = path_tracer(&work.scene, &work.camera, settings, &AovSet::default());
        match path.and_then(|path| rows_of(path, rows)) {
            Ok(frame) => {
                work.frame = frame;
                self.submit();
            }
            Err(reason) => {
                self.work = None;
                self.fail(reason);
            }
        }
    }

    /// Shows the shared frame under way, which is complete, and reports.
    fn show_shared(&mut self) {
        let Some(Work { frame, generation, since, began, shared: Some(shared), report, .. }) =
            self.work.take()
        else {
            return;
        };
        let flags = FrameFlags { moving: true, last: false, coarse: shared.is_coarse() };
        let dropped = frame.picture().dropped_splats();
        let content = Content::Shared(shared.into_picture());
        self.encoder.show(Shown { content, generation, since, flags, spp: 1 });
        self.count_moving(began.elapsed(), Instant::now());
        if let Some(report) = report {
            self.report(flags, (generation, 1.0, dropped), &report);
        }
    }
}
