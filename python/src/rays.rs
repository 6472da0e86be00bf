//! Rays and points of the caller.

use crate::arrays::{Numbers, leading, numbers, numpy};
use crate::interim::{self as query, Range};
use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::PyValueError;
use pyo3::intern;
use pyo3::prelude::*;
use raystream_rays::query::Ray;

/// Rays of a call.
pub struct Rays<'py> {
    source: Source<'py>,
    leading: Vec<usize>,
    len: usize,
}

enum Source<'py> {
    /// Rows of an origin and a direction.
    Rows(Numbers<'py, f32>, Range),
    /// Origins and directions.
    Pairs(Numbers<'py, f32>, Numbers<'py, f32>, Range),
    /// Ends of segments.
    Segments(Numbers<'py, f32>, Numbers<'py, f32>),
    /// Rays with an interval each.
    Rays(Vec<Ray>),
}

impl<'py> Rays<'py> {
    /// Reads the arguments of a call: `(.., 6)`, or origins and directions `(.., 3)`; ends of the interval of `t`, one
    /// for all rays or one each.
    ///
    /// # Errors
    /// For shapes that are not rays, and, with `check`, for rays that hit nothing by definition.
    pub fn new(
        rays: &Bound<'py, PyAny>,
        directions: Option<&Bound<'py, PyAny>>,
        t_min: Option<&Bound<'py, PyAny>>,
        t_max: Option<&Bound<'py, PyAny>>,
        check: bool,
    ) -> PyResult<Self> {
        let (t_min, t_max) = (Limit::new(t_min, 0.0, "t_min")?, Limit::new(t_max, f32::INFINITY, "t_max")?);
        let range = match (&t_min, &t_max) {
            (Limit::All(t_min), Limit::All(t_max)) => Range { t_min: *t_min, t_max: *t_max },
            _ => Range { t_min: 0.0, t_max: f32::INFINITY },
        };
        let (source, leading) = match directions {
            None => {
                let rows = numbers(rays, "rays")?;
                let leading = leading(&rows, 6, "rays without directions")?;
                (Source::Rows(rows, range), leading)
            }
            Some(directions) => {
                let (origins, directions, leading) = pair([rays, directions], ["origins", "directions"])?;
                (Source::Pairs(origins, directions, range), leading)
            }
        };
        let len = leading.iter().product();
        let mut rays = Self { source, leading, len };
        if !matches!((&t_min, &t_max), (Limit::All(_), Limit::All(_))) {
            rays.limit(&t_min, &t_max)?;
        }
        if check {
            rays.check()?;
        }
        Ok(rays)
    }

    /// Segments between points `(.., 3)`, whose ends do not belong to them.
    ///
    /// # Errors
    /// For shapes that are not points.
    pub fn between(from: &Bound<'py, PyAny>, to: &Bound<'py, PyAny>) -> PyResult<Self> {
        let (from, to, leading) = pair([from, to], ["a", "b"])?;
        let len = leading.iter().product();
        Ok(Self { source: Source::Segments(from, to), leading, len })
    }

    /// Gives each ray its own interval.
    fn limit(&mut self, t_min: &Limit<'py>, t_max: &Limit<'py>) -> PyResult<()> {
        let (t_min, t_max) = (t_min.of(&self.leading, "t_min")?, t_max.of(&self.leading, "t_max")?);
        let rays = self.part(0..self.len)?;
        let ray = |index| Ray { t_min: t_min.at(index), t_max: t_max.at(index), ..rays.get(index) };
        let rays = (0..self.len).map(ray).collect();
        self.source = Source::Rays(rays);
        Ok(())
    }

    /// Number of rays.
    pub fn len(&self) -> usize {
        self.len
    }

    /// The shape of an answer of one number a ray.
    pub fn leading(&self) -> &[usize] {
        &self.leading
    }

    /// Some of the rays.
    pub fn part(&self, range: std::ops::Range<usize>) -> PyResult<query::Rays<'_>> {
        Ok(match &self.source {
            Source::Rows(rows, limits) => query::Rays::Rows(&rows_of(rows)?[range], *limits),
            Source::Pairs(origins, directions, limits) => {
                query::Rays::Pairs(&rows_of(origins)?[range.clone()], &rows_of(directions)?[range], *limits)
            }
            Source::Segments(from, to) => query::Rays::Segments(&rows_of(from)?[range.clone()], &rows_of(to)?[range]),
            Source::Rays(rays) => query::Rays::Rays(&rays[range]),
        })
    }

    /// Checks all rays.
    ///
    /// # Errors
    /// ValueError with the number of rays that hit nothing by definition, and the first of them.
    fn check(&self) -> PyResult<()> {
        let rays = self.part(0..self.len)?;
        let mut broken = (0..self.len).filter(|&index| !rays.is_traceable(index));
        let Some(first) = broken.next() else { return Ok(()) };
        let (count, all) = (1 + broken.count(), self.len);
        Err(PyValueError::new_err(format!(
            "{count} of {all} rays hit nothing by definition, the first of them ray {first}: a number is NaN or too \
             large, or the direction is zero"
        )))
    }
}

/// Rows of an array.
pub fn rows_of<'a, const N: usize>(array: &'a Numbers<'_, f32>) -> PyResult<&'a [[f32; N]]> {
    Ok(array.as_slice()?.as_chunks().0)
}

/// Two arrays of vectors in their common shape, and its leading dimensions.
fn pair<'py>(
    given: [&Bound<'py, PyAny>; 2],
    names: [&str; 2],
) -> PyResult<(Numbers<'py, f32>, Numbers<'py, f32>, Vec<usize>)> {
    let (mut a, mut b) = (numbers(given[0], names[0])?, numbers(given[1], names[1])?);
    leading(&a, 3, names[0])?;
    leading(&b, 3, names[1])?;
    if a.shape() != b.shape() {
        let py = a.py();
        let both = numpy(py)?.call_method1(intern!(py, "broadcast_arrays"), (a.as_any(), b.as_any()))?;
        (a, b) = (numbers(&both.get_item(0)?, names[0])?, numbers(&both.get_item(1)?, names[1])?);
    }
    let leading = leading(&a, 3, names[0])?;
    Ok((a, b, leading))
}

/// An end of the rays: one for all, or one each.
enum Limit<'py> {
    All(f32),
    Each(Numbers<'py, f32>),
}

impl<'py> Limit<'py> {
    fn new(given: Option<&Bound<'py, PyAny>>, usual: f32, name: &str) -> PyResult<Self> {
        let Some(given) = given else { return Ok(Self::All(usual)) };
        if let Ok(number) = given.extract::<f32>() {
            return Ok(Self::All(number));
        }
        Ok(Self::Each(numbers(given, name)?))
    }

    /// In the shape of the rays.
    fn of(&self, leading: &[usize], name: &str) -> PyResult<Self> {
        let limits = match self {
            Self::All(number) => return Ok(Self::All(*number)),
            Self::Each(limits) => limits,
        };
        let py = limits.py();
        let arguments = (limits.as_any(), leading.to_vec());
        let all = numpy(py)?.call_method1(intern!(py, "broadcast_to"), arguments);
        let all = all.map_err(|error| PyValueError::new_err(format!("{name}: {error}")))?;
        Ok(Self::Each(numbers(&all, name)?))
    }

    fn at(&self, index: usize) -> f32 {
        match self {
            Self::All(limit) => *limit,
            Self::Each(limits) => limits.as_slice().map_or(f32::NAN, |limits| limits[index]),
        }
    }
}
