//! Specs that are opened and rendered: the class `Rendering`, the functions `open` and `render`.

use crate::errors::raised;
use crate::mesh::Mesh;
use crate::picture::Picture;
use crate::scene::Scene;
use crate::spec::{dictionary_of, spec_of};
use crate::threads::Threads;
use pyo3::exceptions::{PyRuntimeError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use raystream::engine::Units;
use raystream::picture::{self, Registry, RenderSpec, Watch};
use raystream::scene;
use raystream::schedule::{Priority, Service, ServiceOptions};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};

/// A scene that is read and prepared, with all that a render spec says: it renders any of its frames or views, and the
/// scene's tree is built once. `raystream.open` makes it.
#[pyclass(module = "raystream", frozen)]
#[derive(Debug)]
pub struct Rendering {
    rendering: picture::Rendering,
}

#[pymethods]
impl Rendering {
    /// Renders a frame, by default the first, and returns its `Picture`. `progress` is called with the share that is
    /// done, 0 to 1, about twenty times a second, on the calling thread; what it raises ends the frame. So does Ctrl-C.
    #[pyo3(signature = (frame=None, *, progress=None, threads=None))]
    fn render(
        &self,
        py: Python<'_>,
        frame: Option<u32>,
        progress: Option<Py<PyAny>>,
        threads: Option<usize>,
    ) -> PyResult<Picture> {
        let frame = frame.unwrap_or(self.rendering.frames().numbers().start);
        self.frame(py, frame, &Threads::new(threads, usize::MAX, 0)?, &Progress { progress, of: 0..1, at: 0 })
    }

    /// The numbers of the frames or views, a range; `range(0, 1)` for a still picture.
    #[getter]
    fn frames<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let Range { start, end } = self.rendering.frames().numbers();
        py.import("builtins")?.call_method1("range", (start, end))
    }

    /// The names of the views, in order; empty texts where one camera moves.
    #[getter]
    fn names(&self) -> Vec<&str> {
        let frames = self.rendering.frames();
        frames.numbers().map(|frame| frames.name(frame)).collect()
    }

    /// The spec as a dictionary, without options that have their defaults: what `raystream render --print-spec` prints.
    #[getter]
    fn spec<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        dictionary_of(py, self.rendering.spec())
    }

    /// What the loader of the scene's file ignored or changed, one sentence each.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.rendering.prepared().scene.warnings.clone()
    }

    /// The hash of the scene's content, 16 hexadecimal digits.
    #[getter]
    fn scene_hash(&self, py: Python<'_>) -> PyResult<String> {
        Ok(Threads::all()?.run(py, || self.rendering.prepared().scene_hash().to_owned()))
    }

    fn __repr__(&self) -> String {
        let (spec, frames) = (self.rendering.spec(), self.rendering.frames().numbers());
        format!("Rendering({}x{}, frames {}..{})", spec.size.0, spec.size.1, frames.start, frames.end)
    }
}

impl Rendering {
    fn frame(&self, py: Python<'_>, frame: u32, threads: &Threads, progress: &Progress) -> PyResult<Picture> {
        let (rendering, share) = (&self.rendering, Share::default());
        let options = threads.service_options(ServiceOptions::default().with_device_thread(false));
        let service = Service::new(options).map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
        let rendered = threads.watched(
            py,
            || rendering.render_watched(&service, frame, &share),
            |py| progress.tell(py, share.done()),
            || share.is_stopped.store(true, Relaxed),
        );
        // Its last tasks may have something to tell.
        py.detach(|| drop(service));
        let rendered = rendered?.map_err(|error| raised(&error))?;
        progress.tell(py, 1.0)?;
        let rendered = rendered.ok_or_else(|| PyRuntimeError::new_err("the frame was stopped"))?;
        Ok(Picture::new(rendered, rendering, frame))
    }
}

/// The caller's function, and which of several frames is rendered.
struct Progress {
    progress: Option<Py<PyAny>>,
    of: Range<u32>,
    at: u32,
}

impl Progress {
    /// Tells what share of a frame is done.
    fn tell(&self, py: Python<'_>, share: f64) -> PyResult<()> {
        let before = f64::from(self.at - self.of.start);
        let share = (before + share) / f64::from(self.of.end - self.of.start);
        self.progress.as_ref().map_or(Ok(()), |function| function.call1(py, (share,)).map(drop))
    }
}

/// How far a frame is, for the thread that called.
#[derive(Default)]
struct Share {
    bits: AtomicU64,
    is_stopped: AtomicBool,
}

impl Share {
    fn done(&self) -> f64 {
        f64::from_bits(self.bits.load(Relaxed))
    }
}

impl Watch for Share {
    fn priority(&self) -> Priority {
        Priority::Normal
    }

    fn is_stopped(&self) -> bool {
        self.is_stopped.load(Relaxed)
    }

    fn traced(&self, _rays: u64, _seconds: f64) {}

    fn progress(&self, share: f64) {
        self.bits.store(share.to_bits(), Relaxed);
    }
}

/// Reads and prepares a scene with all that a render spec says, and returns a `Rendering`. Arguments are those of
/// `render`.
///
/// >>> import raystream as rs
/// >>> mesh = rs.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
/// >>> rendering = rs.open(mesh, size=(16, 16), spp=1, views=3)
/// >>> rendering.frames
/// range(0, 3)
/// >>> rendering.render(2).name
/// 'view 2'
#[pyfunction]
#[pyo3(signature = (scene=None, /, *, options=None, threads=None, **spec))]
pub fn open(
    py: Python<'_>,
    scene: Option<&Bound<'_, PyAny>>,
    options: Option<PathBuf>,
    threads: Option<usize>,
    spec: Option<&Bound<'_, PyDict>>,
) -> PyResult<Rendering> {
    opened(py, scene, options.as_deref(), &Threads::new(threads, usize::MAX, 0)?, spec)
}

/// Renders a scene, and returns a `Picture`, or a list of them if the spec has frames or views.
///
/// `scene` is a path (.obj, .gltf, .glb, .ply, .stl, .off, or a .json recipe), a `Scene` or `Mesh` in memory, or a
/// render spec: a dictionary. `options` is a spec's file, .json or .toml. **Keywords are the keys of a spec, with _ in
/// place of -**: `size=(640, 360)`, `spp=64`, `aov=["depth", "normal"]`, `eye=(0, 1, 5)`, `max_bounces=4`. They win
/// over the dictionary, and that over the file. A key that is no option is refused, and so is a value that an option
/// refuses: ValueError. Files that cannot be read raise OSError, pictures that do not fit in memory MemoryError.
///
/// `progress` is called with the share that is done, 0 to 1, about twenty times a second, on the calling thread; what
/// it raises ends the rendering. So does Ctrl-C, but for reading the scene and building its tree, which it waits for.
/// `threads` limits the threads. The picture depends on neither: the same spec has the same hash here, on the command
/// line, over HTTP and from Rust.
///
/// >>> import raystream as rs
/// >>> mesh = rs.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
/// >>> spec = {"size": [32, 16], "spp": 4, "max-bounces": 2}
/// >>> rs.render(mesh, **{"max_bounces": 2}, size="32x16", spp=4).hash() == rs.render(mesh, threads=1, **spec).hash()
/// True
#[pyfunction]
#[pyo3(signature = (scene=None, /, *, options=None, progress=None, threads=None, **spec))]
pub fn render<'py>(
    py: Python<'py>,
    scene: Option<&Bound<'py, PyAny>>,
    options: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
    threads: Option<usize>,
    spec: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let threads = Threads::new(threads, usize::MAX, 0)?;
    let opened = opened(py, scene, options.as_deref(), &threads, spec)?;
    let of = opened.rendering.frames().numbers();
    let has_several = opened.rendering.spec().has_several();
    let mut progress = Progress { progress, of: of.clone(), at: of.start };
    let mut pictures = Vec::new();
    for frame in of {
        progress.at = frame;
        pictures.push(Py::new(py, opened.frame(py, frame, &threads, &progress)?)?);
    }
    match (has_several, pictures.pop()) {
        (false, Some(picture)) => Ok(picture.into_bound(py).into_any()),
        (_, last) => {
            pictures.extend(last);
            Ok(PyList::new(py, pictures)?.into_any())
        }
    }
}

fn opened(
    py: Python<'_>,
    scene: Option<&Bound<'_, PyAny>>,
    options: Option<&Path>,
    threads: &Threads,
    keywords: Option<&Bound<'_, PyDict>>,
) -> PyResult<Rendering> {
    let dictionary = scene.and_then(|scene| scene.cast::<PyDict>().ok());
    let mut spec = spec_of(options, dictionary, keywords)?;
    let memory = match scene {
        Some(scene) if dictionary.is_none() => given(scene, &mut spec)?,
        _ => None,
    };
    let open = || match memory {
        Some(scene) => picture::open_scene(&spec, scene, &Units::cpu(), &Registry::built_in()),
        None => picture::open(&spec, Path::new(""), &Units::cpu()),
    };
    let rendering = threads.watched(py, open, |_| Ok(()), || ())?.map_err(|error| raised(&error))?;
    Ok(Rendering { rendering })
}

/// A scene in memory, or `None` for a path, which the spec is given.
fn given(given: &Bound<'_, PyAny>, spec: &mut RenderSpec) -> PyResult<Option<scene::Scene>> {
    if spec.scene.is_some() {
        return Err(PyValueError::new_err("the scene is given twice; leave the spec's key scene out"));
    }
    if let Ok(scene) = given.cast::<Scene>() {
        return scene.get().scene(given.py()).map(Some);
    }
    if let Ok(mesh) = given.cast::<Mesh>() {
        return Scene::of_mesh(mesh)?.scene(given.py()).map(Some);
    }
    let path: PathBuf = given.extract().map_err(|_| {
        let kind = given.get_type();
        PyTypeError::new_err(format!(
            "a scene is a path, a Scene, a Mesh, or a spec in a dictionary, not {kind}"
        ))
    })?;
    spec.scene = Some(path);
    Ok(None)
}
