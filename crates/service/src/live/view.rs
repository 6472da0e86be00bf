//! A live view: the handle that a client's connection holds.

use super::encoder::Encoder;
use super::inbox::Inbox;
use super::outbox::Outbox;
use super::renderer::Renderer;
use super::{Frame, Reply, Request, TileWorkers};
use raystream::engine::PreparedScene;
use raystream::film::DisplayTable;
use raystream::film::tev::Tev;
use raystream::picture::{RenderSpec, TimedScene};
use raystream::scene::AnimationSpan;
use raystream::schedule::Service;
use std::io;
use std::sync::Arc;
use std::thread::JoinHandle;

/// The scene and the settings that a view shows at first.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct ViewScene {
    /// The scene's name.
    pub name: String,
    /// The scene with its tree.
    pub prepared: Arc<PreparedScene>,
    /// The service that renders.
    pub service: Arc<Service>,
    /// The full picture: its size, samples, bounces, seed, filter, look and first camera. The scene has its surfaces
    /// already, so it has none.
    pub spec: RenderSpec,
    /// The way to the scene at other times, if it has animations.
    pub timed: Option<TimedScene>,
    /// Another viewer that shows the picture while the camera rests.
    pub(crate) viewer: Option<Arc<Tev>>,
    /// Workers that render rows of moving frames.
    pub(crate) tile_workers: Option<TileWorkers>,
}

impl ViewScene {
    /// A scene seen by its own or by one that frames it, at 1280×720 pixels with 256 samples.
    pub fn new(name: impl Into<String>, prepared: Arc<PreparedScene>, service: Arc<Service>) -> Self {
        let mut spec = RenderSpec::default();
        (spec.size, spec.stop.spp) = ((1280, 720), Some(256));
        Self { name: name.into(), spec, prepared, service, timed: None, viewer: None, tile_workers: None }
    }

    /// The same with another full picture.
    pub fn with_spec(self, spec: RenderSpec) -> Self {
        Self { spec, ..self }
    }

    /// The same, at any time of its animations.
    pub fn with_times(self, timed: Option<TimedScene>) -> Self {
        Self { timed, ..self }
    }

    /// The animations that can be played.
    pub fn animations(&self) -> &[AnimationSpan] {
        self.timed.as_ref().map_or(&[], TimedScene::animations)
    }

    /// The same, shown by another viewer, too.
    pub(crate) fn with_viewer(self, viewer: Option<Arc<Tev>>) -> Self {
        Self { viewer, ..self }
    }

    /// The same, with workers that render rows of moving frames. The spec's filter is a box then.
    pub(crate) fn with_workers(self, tile_workers: Option<TileWorkers>) -> Self {
        Self { tile_workers, ..self }
    }
}

/// A picture that follows a client's camera. Any number of views may share a scene and a service; each has its own
/// camera, look and edits. Dropping a view cancels its work.
///
/// ```
/// use raystream::engine::{PreparedScene, Units};
/// use raystream::picture::RenderSpec;
/// use raystream::scene::recipe::Recipe;
/// use raystream::schedule::{Service, ServiceOptions};
/// use raystream_service::live::{LiveView, ViewScene};
/// use std::sync::{Arc, mpsc};
///
/// let recipe = Recipe::parse(r#"{ "environment": [1, 1, 1], "materials": { "grey": { "colour": [0.5, 0.5, 0.5] } },
///     "shapes": [ { "shape": "sphere", "centre": [0, 0, 0], "radius": 1, "cells": 8, "material": "grey" } ] }"#)?;
/// let prepared = Arc::new(PreparedScene::new(recipe.build()?, &Units::cpu())?);
/// let service = Arc::new(Service::new(ServiceOptions::default())?);
/// let spec: RenderSpec = serde_json::from_str(r#"{ "size": [64, 36], "spp": 4 }"#)?;
/// let view_scene = ViewScene::new("sphere", prepared, service).with_spec(spec);
///
/// let (wake, woken) = mpsc::channel();
/// let view = LiveView::new(view_scene, move || {
///     wake.send(()).ok();
/// })?;
/// let last = loop {
///     woken.recv()?;
///     match view.take_frame() {
///         Some(frame) if frame.flags.last => break frame,
///         _ => continue,
///     }
/// };
/// assert_eq!((last.size, last.spp), ([64, 36], 4));
/// assert!(last.bytes.starts_with(&[0xff, 0xd8]), "a JPEG");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct LiveView {
    inbox: Arc<Inbox>,
    outbox: Arc<Outbox>,
    thread: Option<JoinHandle<()>>,
}

impl LiveView {
    /// Starts a view. `wake` is called from its threads whenever there is something to take.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn new(view_scene: ViewScene, wake: impl Fn() + Send + Sync + 'static) -> io::Result<Self> {
        let look = view_scene.spec.look.look();
        DisplayTable::of(look.view());
        let (inbox, outbox) = (Arc::new(Inbox::default()), Arc::new(Outbox::new(wake)));
        let encoder = Encoder::start(look, Arc::clone(&outbox))?;
        let renderer = Renderer::new(view_scene, Arc::clone(&inbox), Arc::clone(&outbox), encoder);
        let thread = std::thread::Builder::new().name("live view".into()).spawn(move || renderer.run())?;
        Ok(Self { inbox, outbox, thread: Some(thread) })
    }

    /// Asks for something. Returns at once.
    pub fn ask(&self, request: Request) {
        self.inbox.put(request);
    }

    /// The newest frame, if it has not been taken.
    pub fn take_frame(&self) -> Option<Frame> {
        self.outbox.take_frame()
    }

    /// The oldest file that was asked for and has not been taken.
    pub fn take_file(&self) -> Option<Frame> {
        self.outbox.take_file()
    }

    /// The oldest message that has not been taken.
    pub fn take_reply(&self) -> Option<Reply> {
        self.outbox.take()
    }
}

impl Drop for LiveView {
    fn drop(&mut self) {
        self.inbox.close();
        if let Some(thread) = self.thread.take() {
            // A panic has been printed, and the view ends with it.
            thread.join().ok();
        }
    }
}
