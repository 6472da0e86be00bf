//! The class `Queries`: what meshes and worlds answer.

use crate::answers::Hits;
use crate::calls::{self, Arguments};
use crate::interim::Target;
use crate::rays::Rays;
use pyo3::exceptions::PyRuntimeError;
use pyo3::intern;
use pyo3::prelude::*;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Questions about rays and points, which meshes and worlds answer.
///
/// **A miss** has `t` = +inf, `primitive` and `instance` = -1, `position` NaN, and 0 in other columns. Arrays may have any
/// leading shape, which the answer has, too; float32 arrays that are contiguous are not copied, others are converted;
/// everything that speaks DLPack is taken. `threads` is the number of threads, by default one for each processor; small
/// calls stay on the calling thread. Answers are the same bytes for any number of threads. The interpreter's lock is
/// released, and Ctrl-C ends a long call.
#[pyclass(module = "raystream", frozen, subclass, weakref)]
#[derive(Debug)]
pub struct Queries {
    /// `None` while a thread changes it.
    target: Mutex<Option<Target>>,
}

/// Error of a call while another thread changes what it asks.
fn changing() -> PyErr {
    PyRuntimeError::new_err("another thread is changing this object")
}

impl Queries {
    /// Of a mesh or a world.
    pub fn of(target: Target) -> Self {
        Self { target: Mutex::new(Some(target)) }
    }

    fn locked(&self) -> MutexGuard<'_, Option<Target>> {
        self.target.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The mesh or world as it is now. Shares memory with it.
    ///
    /// # Errors
    /// While another thread changes it.
    pub fn target(&self) -> PyResult<Target> {
        self.locked().clone().ok_or_else(changing)
    }

    /// Changes it. Meanwhile other threads get an error; the lock is not held, so that no fork finds it so.
    ///
    /// # Errors
    /// While another thread changes it.
    pub fn change<T>(&self, change: impl FnOnce(&mut Target) -> T) -> PyResult<T> {
        let mut target = self.locked().take().ok_or_else(changing)?;
        let result = change(&mut target);
        *self.locked() = Some(target);
        Ok(result)
    }
}

#[pymethods]
impl Queries {
    /// The first hits of rays.
    ///
    /// `rays` are `(.., 6)`, origins and directions side by side, or origins `(.., 3)` with `directions` of a shape that
    /// broadcasts with theirs. Directions need not have length 1: **t counts lengths of the direction**. Hits count from
    /// `t_min` to `t_max`, both included, numbers or an array for the rays. `want` names the columns to compute: t,
    /// primitive, instance, uv, normal, position. `out` has arrays to write to, by column. A ray with NaN misses; with
    /// `check=True` such rays are an error that counts them.
    #[pyo3(signature = (rays, directions=None, *, t_min=None, t_max=None, want=None, out=None, threads=None, check=false))]
    #[expect(clippy::too_many_arguments, reason = "Python has keywords")]
    fn cast<'py>(
        &self,
        py: Python<'py>,
        rays: &Bound<'py, PyAny>,
        directions: Option<&Bound<'py, PyAny>>,
        t_min: Option<&Bound<'py, PyAny>>,
        t_max: Option<&Bound<'py, PyAny>>,
        want: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
        threads: Option<usize>,
        check: bool,
    ) -> PyResult<Hits> {
        let rays = Rays::new(rays, directions, t_min, t_max, check)?;
        let want = want.cloned().unwrap_or_else(|| intern!(py, "t primitive").clone().into_any());
        calls::cast(py, &self.target()?, &Arguments { rays, out, threads }, &want)
    }

    /// For each ray, True if it hits anything: a bool array in the shape of the rays. Faster than `cast`.
    #[pyo3(signature = (rays, directions=None, *, t_min=None, t_max=None, out=None, threads=None, check=false))]
    #[expect(clippy::too_many_arguments, reason = "Python has keywords")]
    fn occluded<'py>(
        &self,
        py: Python<'py>,
        rays: &Bound<'py, PyAny>,
        directions: Option<&Bound<'py, PyAny>>,
        t_min: Option<&Bound<'py, PyAny>>,
        t_max: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
        threads: Option<usize>,
        check: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let rays = Rays::new(rays, directions, t_min, t_max, check)?;
        calls::occluded(py, &self.target()?, &Arguments { rays, out, threads }, false)
    }

    /// For each pair of points, True if nothing lies between them: `a` and `b` are `(.., 3)`, of shapes that broadcast.
    /// The points themselves do not count, so points on a surface see each other unless something else is between.
    #[pyo3(signature = (a, b, *, out=None, threads=None))]
    fn visible<'py>(
        &self,
        py: Python<'py>,
        a: &Bound<'py, PyAny>,
        b: &Bound<'py, PyAny>,
        out: Option<&Bound<'py, PyAny>>,
        threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        calls::occluded(py, &self.target()?, &Arguments { rays: Rays::between(a, b)?, out, threads }, true)
    }

    /// The number of hits of each ray: an int32 array in the shape of the rays.
    #[pyo3(signature = (rays, directions=None, *, t_min=None, t_max=None, out=None, threads=None, check=false))]
    #[expect(clippy::too_many_arguments, reason = "Python has keywords")]
    fn count<'py>(
        &self,
        py: Python<'py>,
        rays: &Bound<'py, PyAny>,
        directions: Option<&Bound<'py, PyAny>>,
        t_min: Option<&Bound<'py, PyAny>>,
        t_max: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
        threads: Option<usize>,
        check: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let rays = Rays::new(rays, directions, t_min, t_max, check)?;
        calls::count(py, &self.target()?, &Arguments { rays, out, threads })
    }

    /// All hits of rays, those of a ray beside each other, nearest first.
    ///
    /// The answer has the columns of `want`, one row a hit, and two more: `offsets`, int64, one longer than the rays:
    /// those of ray i (in C order) are rows `offsets[i]` to `offsets[i + 1]`; and `ray`, the ray of each row. `max_hits`
    /// keeps the nearest so many of each ray.
    #[pyo3(signature = (rays, directions=None, *, t_min=None, t_max=None, want=None, max_hits=None, threads=None, check=false))]
    #[expect(clippy::too_many_arguments, reason = "Python has keywords")]
    fn all_hits<'py>(
        &self,
        py: Python<'py>,
        rays: &Bound<'py, PyAny>,
        directions: Option<&Bound<'py, PyAny>>,
        t_min: Option<&Bound<'py, PyAny>>,
        t_max: Option<&Bound<'py, PyAny>>,
        want: Option<&Bound<'py, PyAny>>,
        max_hits: Option<usize>,
        threads: Option<usize>,
        check: bool,
    ) -> PyResult<Hits> {
        let rays = Rays::new(rays, directions, t_min, t_max, check)?;
        let want = want.cloned().unwrap_or_else(|| intern!(py, "t primitive").clone().into_any());
        calls::all_hits(py, &self.target()?, &Arguments { rays, out: None, threads }, &want, max_hits)
    }

    /// The point of the surface nearest to each point, `(.., 3)`: an answer with the columns of `want` among distance,
    /// position, primitive, uv, normal. Points farther than `max_distance` are misses; their distance is +inf.
    #[pyo3(signature = (points, *, max_distance=f32::INFINITY, want=None, out=None, threads=None))]
    fn nearest<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'py, PyAny>,
        max_distance: f32,
        want: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
        threads: Option<usize>,
    ) -> PyResult<Hits> {
        let want = want.cloned().unwrap_or_else(|| intern!(py, "distance position primitive uv").clone().into_any());
        calls::nearest(py, &self.target()?, points, max_distance, &want, out, threads)
    }

    /// The distance of each point, `(.., 3)`, from the surface.
    #[pyo3(signature = (points, *, out=None, threads=None))]
    fn distance<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'py, PyAny>,
        out: Option<&Bound<'py, PyAny>>,
        threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        calls::distance(py, &self.target()?, points, out, threads)
    }
}
