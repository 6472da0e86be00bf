//! Questions: arguments in, arrays out.

use crate::answers::Hits;
use crate::arrays::{array, check_memory, leading, numbers, zeros};
use crate::columns::{Number, OF_HITS, OF_LISTS, OF_POINTS, Out, Want, single};
use crate::memory::{HitMemory, OfInstances, PointMemory, first_hits, first_points};
use crate::rays::{Floats, Rays, part_of, rows_of};
use crate::threads::{FEW, FIRST_POINTS, FIRST_RAYS, Threads};
use bytemuck::allocation::cast_vec;
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;
use raystream_rays::query::{self, Hemisphere, HitListColumns, Points, RayQueries, Rule};

/// An argument that may be left out.
pub type Given<'a, 'py> = Option<&'a Bound<'py, PyAny>>;

/// Arguments that all calls with rays have.
pub struct RayCall<'a, 'py> {
    pub rays: Rays<'py>,
    pub rule: Rule,
    pub out: Given<'a, 'py>,
    pub threads: Option<usize>,
}

/// Arguments that all calls with points have.
pub struct PointCall<'a, 'py> {
    pub points: Floats<'py>,
    pub out: Given<'a, 'py>,
    pub threads: Option<usize>,
}

/// Reads the argument `rule`.
///
/// # Errors
/// For an unknown name.
pub fn rule(name: &str) -> PyResult<Rule> {
    match name {
        "closed" => Ok(Rule::Closed),
        "half-open" => Ok(Rule::HalfOpen),
        _ => Err(PyValueError::new_err(format!("rule is {name:?}; it must be \"closed\" or \"half-open\""))),
    }
}

/// What is asked: a mesh or a world.
pub type Asked<'a> = &'a (dyn RayQueries + Sync);

impl<'py> RayCall<'_, 'py> {
    /// The first hits of rays.
    ///
    /// # Errors
    /// For wrong arguments, too little memory, and interrupts; so, too, below.
    pub fn cast(
        &self,
        py: Python<'py>,
        asked: Asked<'_>,
        want: Want,
        of_instances: &OfInstances<'_>,
    ) -> PyResult<Hits> {
        let (rays, rule) = (&self.rays, self.rule);
        want.check_memory(rays.len())?;
        let out = self.out.map(Out::new).transpose()?;
        let mut memory = HitMemory::new(&want, out.as_ref(), rays.leading())?;
        let (mut columns, all) = (memory.columns(of_instances)?, rays.all()?);
        Threads::new(self.threads, rays.len(), FEW)?.in_blocks(py, rays.len(), FIRST_RAYS, |block| {
            let mut columns = first_hits(&mut columns, block.len());
            asked.cast(&all.part(block), rule, &mut columns);
            Ok(())
        })?;
        memory.into_hits(py, rays.leading())
    }

    /// One number of each ray, in blocks.
    fn each<T: Number>(
        &self,
        py: Python<'py>,
        ask: impl Fn(&query::Rays<'_>, Rule, &mut [T]) + Sync + Send,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (rays, rule) = (&self.rays, self.rule);
        check_memory("an answer", rays.len(), size_of::<T>())?;
        let mut answer = single::<T>(self.out, rays.leading())?;
        let (column, all) = (answer.slice_mut()?, rays.all()?);
        Threads::new(self.threads, rays.len(), FEW)?.in_blocks(py, rays.len(), FIRST_RAYS, |block| {
            ask(&all.part(block.clone()), rule, &mut column[block]);
            Ok(())
        })?;
        answer.into_array(py, rays.leading(), 1)
    }

    /// For each ray, true if it hits anything.
    pub fn occluded(&self, py: Python<'py>, asked: Asked<'_>) -> PyResult<Bound<'py, PyAny>> {
        self.each(py, |rays, rule, answers| asked.cast_occluded(rays, rule, answers))
    }

    /// For each ray, true if it hits nothing.
    pub fn free(&self, py: Python<'py>, asked: Asked<'_>) -> PyResult<Bound<'py, PyAny>> {
        self.each(py, |rays, rule, answers: &mut [bool]| {
            asked.cast_occluded(rays, rule, answers);
            answers.iter_mut().for_each(|answer| *answer = !*answer);
        })
    }

    /// The number of hits of each ray.
    pub fn count(&self, py: Python<'py>, asked: Asked<'_>) -> PyResult<Bound<'py, PyAny>> {
        self.each(py, |rays, rule, counts: &mut [i32]| {
            asked.count_hits(rays, rule, bytemuck::cast_slice_mut(counts));
        })
    }

    /// For each ray, true if it has at least so many hits.
    pub fn at_least(&self, py: Python<'py>, asked: Asked<'_>, count: u32) -> PyResult<Bound<'py, PyAny>> {
        self.each(py, |rays, rule, answers| asked.at_least(count, rays, rule, answers))
    }

    /// Sums of a number of each triangle over the hits of rays.
    pub fn sum_along(
        &self,
        py: Python<'py>,
        asked: Asked<'_>,
        of_instances: &[&[f32]],
    ) -> PyResult<Bound<'py, PyAny>> {
        self.each(py, |rays, rule, sums| asked.sum_along(of_instances, rays, rule, sums))
    }

    /// All hits of rays, or so many of the nearest.
    pub fn all_hits(
        &self,
        py: Python<'py>,
        asked: Asked<'_>,
        want: Want,
        most: Option<usize>,
    ) -> PyResult<Hits> {
        let (count, rule, most) = (self.rays.len(), self.rule, most.unwrap_or(usize::MAX));
        check_memory("an answer", count, size_of::<i64>())?;
        let (all, mut columns) = (self.rays.all()?, list_columns(&want));
        let bytes = want.names().map(|(_, bytes)| bytes).sum::<usize>();
        Threads::new(self.threads, count, FEW)?.in_blocks(py, count, FIRST_RAYS, |block| {
            if block.start == 0 {
                asked.expect_hits(&all, rule, most, &mut columns);
            }
            let mut first = block.start;
            while first < block.end {
                // As long as their hits take little memory, by those so far.
                let hits = columns.len().checked_div(first).map_or(usize::MAX, |hits| hits + 1);
                let length = LISTED_BYTES / bytes.max(1).saturating_mul(hits);
                let some =
                    first..block.end.min(first + length.max(LISTED_RAYS * rayon::current_num_threads()));
                first = some.end;
                let appended = asked.append_hits(&all.part(some), rule, most, &mut columns);
                appended.map_err(|error| PyMemoryError::new_err(error.to_string()))?;
                check_memory("the list of hits", columns.len(), bytes)?;
            }
            Ok(())
        })?;
        lists_of(py, columns)
    }
}

/// Number of rays whose hits one thread lists before memory is looked at, at least.
const LISTED_RAYS: usize = 1 << 14;

/// Memory of so many hits is not looked at meanwhile.
const LISTED_BYTES: usize = 64 << 20;

/// The columns of lists that are wanted, empty.
fn list_columns(want: &Want) -> HitListColumns {
    HitListColumns {
        offsets: vec![0],
        t: want.has("t").then(Vec::new),
        primitive: want.has("primitive").then(Vec::new),
        instance: want.has("instance").then(Vec::new),
        uv: want.has("uv").then(Vec::new),
        // It follows from the offsets where it is asked for.
        ray: None,
    }
}

/// An answer of lists.
fn lists_of(py: Python<'_>, columns: HitListColumns) -> PyResult<Hits> {
    let (hits, HitListColumns { offsets, t, primitive, instance, uv, .. }) = ([columns.len()], columns);
    let offsets: Vec<i64> = cast_vec(offsets);
    let rows = [offsets.len()];
    let mut arrays = vec![("offsets", array(py, offsets, &rows, 1)?)];
    if let Some(t) = t {
        arrays.push(("t", array(py, t, &hits, 1)?));
    }
    for (name, ids) in [("primitive", primitive), ("instance", instance)] {
        if let Some(ids) = ids {
            arrays.push((name, array(py, cast_vec::<u32, i32>(ids), &hits, 1)?));
        }
    }
    if let Some(uv) = uv {
        arrays.push(("uv", array(py, uv.into_flattened(), &hits, 2)?));
    }
    Ok(Hits::of(arrays))
}

impl<'a, 'py> PointCall<'a, 'py> {
    /// Reads the points.
    ///
    /// # Errors
    /// For other shapes.
    pub fn new(points: &Bound<'py, PyAny>, out: Given<'a, 'py>, threads: Option<usize>) -> PyResult<Self> {
        Ok(Self { points: Floats::new(points, 3, "points")?, out, threads })
    }

    /// Points of the surface nearest to points.
    pub fn nearest(&self, py: Python<'py>, asked: Asked<'_>, most: f32, want: Want) -> PyResult<Hits> {
        let (leading, points) = (self.points.leading(3, "points")?, self.points.points()?);
        want.check_memory(points.len())?;
        let out = self.out.map(Out::new).transpose()?;
        let mut memory = PointMemory::new(&want, out.as_ref(), &leading)?;
        let mut columns = memory.columns()?;
        Threads::new(self.threads, points.len(), FEW)?.in_blocks(
            py,
            points.len(),
            FIRST_POINTS,
            |block| {
                let mut columns = first_points(&mut columns, block.len());
                asked.nearest_points(&part_of(&points, block), most, &mut columns);
                Ok(())
            },
        )?;
        memory.into_hits(py, &leading)
    }

    /// One number of each point, in blocks.
    pub fn each<T: Number>(
        &self,
        py: Python<'py>,
        ask: impl Fn(&Points<'_>, &mut [T]) + Sync + Send,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (leading, points) = (self.points.leading(3, "points")?, self.points.points()?);
        check_memory("an answer", points.len(), size_of::<T>())?;
        let mut answer = single::<T>(self.out, &leading)?;
        let column = answer.slice_mut()?;
        Threads::new(self.threads, points.len(), FEW)?.in_blocks(
            py,
            points.len(),
            FIRST_POINTS,
            |block| {
                ask(&part_of(&points, block.clone()), &mut column[block]);
                Ok(())
            },
        )?;
        answer.into_array(py, &leading, 1)
    }
}

/// Rays from points into the hemispheres about their normals, `(.., count, 6)`.
///
/// `normals` have the shape of `points`, `(.., 3)`, and any length; directions have length 1. With `cosine`, as many go
/// towards each direction as the cosine of its angle with the normal, so that the mean over rays is that of light on a
/// matte surface; else as many towards each solid angle. Origins are `offset` away from the points, along the
/// normals: a ten thousandth of the mesh's size keeps rays off the surface that they leave. Rays are stratified, and
/// the same bytes everywhere for the same `seed`.
#[pyfunction]
#[pyo3(signature = (points, normals, count, *, cosine=true, offset=0.0, seed=0, threads=None))]
#[expect(clippy::too_many_arguments, reason = "Python has keywords")]
pub fn hemisphere<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    normals: &Bound<'py, PyAny>,
    count: usize,
    cosine: bool,
    offset: f32,
    seed: u64,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    let (points, normals) = (numbers::<f32>(points, "points")?, numbers::<f32>(normals, "normals")?);
    let mut shape = leading(&points, 3, "points")?;
    if leading(&normals, 3, "normals")? != shape {
        return Err(PyValueError::new_err("normals must have the shape of points"));
    }
    shape.push(count);
    let rays = shape.iter().try_fold(1_usize, |rays, &length| rays.checked_mul(length)).unwrap_or(usize::MAX);
    check_memory("the rays", rays, size_of::<[f32; 6]>())?;
    let (mut made, over) =
        (zeros::<[f32; 6]>(rays)?, if cosine { Hemisphere::Cosine } else { Hemisphere::Uniform });
    let (points, normals) = (rows_of(&points)?, rows_of(&normals)?);
    Threads::new(threads, rays, FEW)?
        .run(py, || query::hemispheres(points, normals, over, offset, seed, &mut made));
    array(py, made.into_flattened(), &shape, 6)
}

/// The columns of first hits that an argument names, by default t and primitive.
///
/// # Errors
/// As for [`Want::new`].
pub fn of_hits(want: Given<'_, '_>) -> PyResult<Want> {
    Want::or(want, OF_HITS, &["t", "primitive"])
}

/// The columns of listed hits that an argument names, by default t and primitive.
///
/// # Errors
/// As for [`Want::new`].
pub fn of_lists(want: Given<'_, '_>) -> PyResult<Want> {
    Want::or(want, OF_LISTS, &["t", "primitive"])
}

/// The columns of nearest points that an argument names, by default distance, position, primitive and uv.
///
/// # Errors
/// As for [`Want::new`].
pub fn of_points(want: Given<'_, '_>) -> PyResult<Want> {
    Want::or(want, OF_POINTS, &["distance", "position", "primitive", "uv"])
}
