//! The class `Queries`: what meshes and worlds answer.

use crate::answers::Hits;
use crate::arrays::numbers;
use crate::calls::{self, Given, PointCall, RayCall};
use crate::guarded::Guarded;
use crate::rays::Rays;
use crate::target::Target;
use crate::threads::Threads;
use pyo3::prelude::*;
use raystream_rays::query::NearestColumns;
use std::sync::Arc;

/// Questions about rays and points, which meshes and worlds answer.
///
/// **A miss** has `t` = +inf, `primitive` and `instance` = -1, NaN in `position` and `attribute`, and 0 in other
/// columns. Arrays may have any leading shape, which the answer has, too. float32 arrays that are contiguous are not
/// copied; float64 ones are traced relative to the mesh's middle; whatever speaks DLPack is taken. `threads` is the
/// number of threads, by default one for each processor; small calls stay on the calling thread. Answers are the same
/// bytes for any number of threads. The interpreter's lock is released, and Ctrl-C ends a long call.
#[pyclass(module = "raystream", frozen, subclass, weakref)]
#[derive(Debug)]
pub struct Queries {
    target: Guarded<Target>,
}

impl Queries {
    /// Of a mesh or a world.
    pub fn of(target: Target) -> Self {
        Self { target: Guarded::new(target) }
    }

    /// The mesh or world as it is now. Shares memory with it.
    ///
    /// # Errors
    /// While another thread changes it.
    pub fn target(&self) -> PyResult<Target> {
        self.target.now()
    }

    /// [`Queries::target`], ready for questions: a world that has changed gets its tree.
    ///
    /// # Errors
    /// While another thread changes it.
    fn ready(&self, py: Python<'_>) -> PyResult<Target> {
        let target = self.target()?;
        let Target::World(mut world) = target else { return Ok(target) };
        if !world.is_built {
            // Not under the lock, which no fork must find held.
            Threads::all()?.run(py, || Arc::make_mut(&mut world).build());
            self.target.try_change(|now| match now {
                Target::World(now) if now.changes == world.changes => *now = world.clone(),
                _ => {}
            });
        }
        Ok(Target::World(world))
    }

    /// Changes it. Meanwhile other threads get an error; the lock is not held, so that no fork finds it so.
    ///
    /// # Errors
    /// While another thread changes it.
    pub fn change<T>(&self, change: impl FnOnce(&mut Target) -> T) -> PyResult<T> {
        self.target.change(change)
    }
}

#[pymethods]
impl Queries {
    /// The first hits of rays: an answer with the columns of `want`, by default "t primitive".
    ///
    /// `rays` are `(.., 6)`, origins and directions side by side, or origins `(.., 3)` with `directions`, whose shapes
    /// broadcast. **t counts lengths of the direction**, which need not be 1. Hits count from `t_min` to `t_max`, both
    /// included: numbers, or an array for the rays.
    ///
    /// `want` names what is computed, and nothing else is: t, primitive (the row of `faces`), instance, uv (weights
    /// of the second and third corner), normal (geometric, of length 1, on the side from which corners are seen
    /// counterclockwise), shading_normal (interpolated between the mesh's `normals`, and turned as its instance is),
    /// position, position64, attribute (of the triangle). `out` has arrays to write to by the names of columns, or is
    /// an earlier answer.
    ///
    /// With `rule="closed"` edges and corners belong to all their triangles: no ray slips through, of equally near
    /// triangles the first is hit. With "half-open" it is the one that a ray moved by an infinitesimal amount would
    /// hit, so its side is right at silhouettes, too. **A ray that touches a mesh may hit by "closed" where `count`
    /// says 0.**
    ///
    /// A ray with NaN or a direction of zero misses; with `check=True` ValueError counts such rays.
    #[pyo3(signature = (
        rays, directions=None, *, t_min=None, t_max=None, want=None, rule="closed", out=None, threads=None,
        check=false
    ))]
    #[expect(clippy::too_many_arguments, reason = "Python has keywords")]
    fn cast<'py>(
        &self,
        py: Python<'py>,
        rays: &Bound<'py, PyAny>,
        directions: Given<'_, 'py>,
        t_min: Given<'_, 'py>,
        t_max: Given<'_, 'py>,
        want: Given<'_, 'py>,
        rule: &str,
        out: Given<'_, 'py>,
        threads: Option<usize>,
        check: bool,
    ) -> PyResult<Hits> {
        let rays = Rays::new(rays, directions, t_min, t_max, check)?;
        let call = RayCall { rays, rule: calls::rule(rule)?, out, threads };
        let (want, target) = (calls::of_hits(want)?, self.ready(py)?);
        call.cast(py, target.asked(), want, &target.of_instances(&want)?)
    }

    /// For each ray, True if it hits anything: a bool array in the shape of the rays. Faster than `cast`, whose
    /// arguments it has. `out` is a bool array to write to.
    #[pyo3(signature = (
        rays, directions=None, *, t_min=None, t_max=None, rule="closed", out=None, threads=None, check=false
    ))]
    #[expect(clippy::too_many_arguments, reason = "Python has keywords")]
    fn occluded<'py>(
        &self,
        py: Python<'py>,
        rays: &Bound<'py, PyAny>,
        directions: Given<'_, 'py>,
        t_min: Given<'_, 'py>,
        t_max: Given<'_, 'py>,
        rule: &str,
        out: Given<'_, 'py>,
        threads: Option<usize>,
        check: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let rays = Rays::new(rays, directions, t_min, t_max, check)?;
        let call = RayCall { rays, rule: calls::rule(rule)?, out, threads };
        call.occluded(py, self.ready(py)?.asked())
    }

    /// For each pair of points, True if nothing lies between them: `a` and `b` are `(.., 3)`, of shapes that broadcast.
    /// **The ends do not count**, so points on a surface see each other unless something else is between.
    #[pyo3(signature = (a, b, *, rule="closed", out=None, threads=None))]
    fn visible<'py>(
        &self,
        py: Python<'py>,
        a: &Bound<'py, PyAny>,
        b: &Bound<'py, PyAny>,
        rule: &str,
        out: Given<'_, 'py>,
        threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let call = RayCall { rays: Rays::between(a, b)?, rule: calls::rule(rule)?, out, threads };
        call.free(py, self.ready(py)?.asked())
    }

    /// The number of hits of each ray: an int32 array in the shape of the rays.
    ///
    /// **A ray through an edge or a corner crosses the surface once there, or never and twice where it only touches
    /// it** (`rule="half-open"`): the parity is right. Hits count where t_min < t <= t_max.
    #[pyo3(signature = (
        rays, directions=None, *, t_min=None, t_max=None, rule="half-open", out=None, threads=None, check=false
    ))]
    #[expect(clippy::too_many_arguments, reason = "Python has keywords")]
    fn count<'py>(
        &self,
        py: Python<'py>,
        rays: &Bound<'py, PyAny>,
        directions: Given<'_, 'py>,
        t_min: Given<'_, 'py>,
        t_max: Given<'_, 'py>,
        rule: &str,
        out: Given<'_, 'py>,
        threads: Option<usize>,
        check: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let rays = Rays::new(rays, directions, t_min, t_max, check)?;
        let call = RayCall { rays, rule: calls::rule(rule)?, out, threads };
        call.count(py, self.ready(py)?.asked())
    }

    /// For each ray, True if it has at least `hits` hits. Stops there, so it is faster than `count`.
    #[pyo3(signature = (
        hits, rays, directions=None, *, t_min=None, t_max=None, rule="half-open", out=None, threads=None,
        check=false
    ))]
    #[expect(clippy::too_many_arguments, reason = "Python has keywords")]
    fn at_least<'py>(
        &self,
        py: Python<'py>,
        hits: u32,
        rays: &Bound<'py, PyAny>,
        directions: Given<'_, 'py>,
        t_min: Given<'_, 'py>,
        t_max: Given<'_, 'py>,
        rule: &str,
        out: Given<'_, 'py>,
        threads: Option<usize>,
        check: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let rays = Rays::new(rays, directions, t_min, t_max, check)?;
        let call = RayCall { rays, rule: calls::rule(rule)?, out, threads };
        call.at_least(py, self.ready(py)?.asked(), hits)
    }

    /// All hits of rays, nearest first, in lists without gaps.
    ///
    /// The answer has a row for each hit, in the columns of `want` (t, primitive, instance, uv), and two columns more:
    /// `offsets`, int64, one longer than the rays: the hits of ray i (in C order) are rows `offsets[i]` to `offsets[i
    /// + 1]`; and `ray`, int64, the ray of each row, which is computed when it is first read. `max_hits` keeps the
    /// nearest so many of each ray. Arguments and rule are those of `count`.
    #[pyo3(signature = (
        rays, directions=None, *, t_min=None, t_max=None, want=None, max_hits=None, rule="half-open",
        threads=None, check=false
    ))]
    #[expect(clippy::too_many_arguments, reason = "Python has keywords")]
    fn all_hits<'py>(
        &self,
        py: Python<'py>,
        rays: &Bound<'py, PyAny>,
        directions: Given<'_, 'py>,
        t_min: Given<'_, 'py>,
        t_max: Given<'_, 'py>,
        want: Given<'_, 'py>,
        max_hits: Option<usize>,
        rule: &str,
        threads: Option<usize>,
        check: bool,
    ) -> PyResult<Hits> {
        let rays = Rays::new(rays, directions, t_min, t_max, check)?;
        let call = RayCall { rays, rule: calls::rule(rule)?, out: None, threads };
        call.all_hits(py, self.ready(py)?.asked(), calls::of_lists(want)?, max_hits)
    }

    /// The sum of a number of each triangle over all hits of each ray, float32: the exact sum, rounded once.
    ///
    /// `attribute` is `(f,)`, a number for each triangle; a world takes those of one instance after the other,
    /// without those that are hidden. Without it each mesh uses its own.
    #[pyo3(signature = (
        rays, directions=None, *, t_min=None, t_max=None, attribute=None, rule="half-open", out=None,
        threads=None, check=false
    ))]
    #[expect(clippy::too_many_arguments, reason = "Python has keywords")]
    fn sum_along<'py>(
        &self,
        py: Python<'py>,
        rays: &Bound<'py, PyAny>,
        directions: Given<'_, 'py>,
        t_min: Given<'_, 'py>,
        t_max: Given<'_, 'py>,
        attribute: Given<'_, 'py>,
        rule: &str,
        out: Given<'_, 'py>,
        threads: Option<usize>,
        check: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let rays = Rays::new(rays, directions, t_min, t_max, check)?;
        let call = RayCall { rays, rule: calls::rule(rule)?, out, threads };
        let target = self.ready(py)?;
        let given = attribute.map(|attribute| numbers::<f32>(attribute, "attribute")).transpose()?;
        let of_instances = match &given {
            Some(given) => target.attributes_of(given.as_slice()?)?,
            None => target.attributes()?,
        };
        call.sum_along(py, target.asked(), &of_instances)
    }

    /// The point of the surface nearest to each point, `(.., 3)`: an answer with the columns of `want` among distance,
    /// position, position64, primitive, instance, uv, by default "distance position primitive uv". Of equally near
    /// triangles the first is taken. Points farther than `max_distance` have none: their distance is +inf.
    #[pyo3(signature = (points, *, max_distance=f32::INFINITY, want=None, out=None, threads=None))]
    fn nearest<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'py, PyAny>,
        max_distance: f32,
        want: Given<'_, 'py>,
        out: Given<'_, 'py>,
        threads: Option<usize>,
    ) -> PyResult<Hits> {
        let want = calls::of_points(want)?;
        PointCall::new(points, out, threads)?.nearest(py, self.ready(py)?.asked(), max_distance, want)
    }

    /// The distance of each point, `(.., 3)`, from the surface: a float32 array in the shape of the points.
    #[pyo3(signature = (points, *, out=None, threads=None))]
    fn distance<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'py, PyAny>,
        out: Given<'_, 'py>,
        threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let target = self.ready(py)?;
        PointCall::new(points, out, threads)?.each(py, |points, distances| {
            let mut columns = NearestColumns { distance: Some(distances), ..NearestColumns::default() };
            target.asked().nearest_points(points, f32::INFINITY, &mut columns);
        })
    }
}
