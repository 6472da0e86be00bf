//! Rays and points of the caller.

use crate::arrays::{Numbers, exactly, leading, numbers, numpy};
use numpy::{Element, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::intern;
use pyo3::prelude::*;
use raystream_rays::query::{self, Range, Ray};

/// Vectors or rows of an argument: in float64 where the caller has them so, else in float32.
pub enum Floats<'py> {
    F32(Numbers<'py, f32>),
    F64(Numbers<'py, f64>),
}

impl<'py> Floats<'py> {
    /// Reads an argument `(.., last)`; lists of numbers are float64, as NumPy has them.
    ///
    /// # Errors
    /// As NumPy's.
    pub fn new(value: &Bound<'py, PyAny>, last: usize, name: &str) -> PyResult<Self> {
        if let Some(array) = exactly::<f32>(value) {
            leading(&array, last, name)?;
            return Ok(Self::F32(array));
        }
        let py = value.py();
        let kind = match value.getattr_opt(intern!(py, "dtype"))? {
            Some(kind) => kind.str()?.to_str()?.ends_with("float64"),
            None => true,
        };
        let floats = if kind { Self::F64(numbers(value, name)?) } else { Self::F32(numbers(value, name)?) };
        floats.leading(last, name)?;
        Ok(floats)
    }

    fn array(&self) -> &Bound<'py, PyAny> {
        match self {
            Self::F32(array) => array.as_any(),
            Self::F64(array) => array.as_any(),
        }
    }

    fn shape(&self) -> &[usize] {
        match self {
            Self::F32(array) => array.shape(),
            Self::F64(array) => array.shape(),
        }
    }

    /// All dimensions but the last.
    ///
    /// # Errors
    /// If the last one is another.
    pub fn leading(&self, last: usize, name: &str) -> PyResult<Vec<usize>> {
        match self {
            Self::F32(array) => leading(array, last, name),
            Self::F64(array) => leading(array, last, name),
        }
    }

    /// The vectors as points.
    ///
    /// # Errors
    /// Never: the array is contiguous.
    pub fn points(&self) -> PyResult<query::Points<'_>> {
        Ok(match self {
            Self::F32(points) => query::Points::F32(rows_of(points)?),
            Self::F64(points) => query::Points::F64(rows_of(points)?),
        })
    }
}

/// Some of the points.
pub fn part_of<'a>(points: &query::Points<'a>, range: std::ops::Range<usize>) -> query::Points<'a> {
    match points {
        query::Points::F32(points) => query::Points::F32(&points[range]),
        query::Points::F64(points) => query::Points::F64(&points[range]),
        _ => unreachable!("points are made by `Floats::points`"),
    }
}

/// Rays of a call.
pub struct Rays<'py> {
    source: Source<'py>,
    leading: Vec<usize>,
    len: usize,
}

enum Source<'py> {
    /// Rows of an origin and a direction.
    Rows(Floats<'py>, Range),
    /// Origins and directions, both of one kind.
    Pairs(Floats<'py>, Floats<'py>, Range),
    /// Ends of segments, both of one kind.
    Segments(Floats<'py>, Floats<'py>),
    /// Rays with an interval each.
    Rays(Vec<Ray>),
}

impl<'py> Rays<'py> {
    /// Reads the arguments of a call: `(.., 6)`, or origins and directions `(.., 3)`; ends of the interval of `t`, one
    /// for all rays or one each. Rays with intervals of their own are float32.
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
        let (range, each) = match (&t_min, &t_max) {
            (Limit::All(t_min), Limit::All(t_max)) => (Range { t_min: *t_min, t_max: *t_max }, false),
            _ => (Range::default(), true),
        };
        let (source, leading) = match directions {
            None if each => {
                let rows = Floats::F32(numbers(rays, "rays")?);
                let leading = rows.leading(6, "rays without directions")?;
                (Source::Rows(rows, range), leading)
            }
            None => {
                let rows = Floats::new(rays, 6, "rays without directions")?;
                let leading = rows.leading(6, "rays without directions")?;
                (Source::Rows(rows, range), leading)
            }
            Some(directions) => {
                let (origins, directions, leading) =
                    pair([rays, directions], ["origins", "directions"], each)?;
                (Source::Pairs(origins, directions, range), leading)
            }
        };
        let len = leading.iter().product();
        let mut rays = Self { source, leading, len };
        if each {
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
        let (from, to, leading) = pair([from, to], ["a", "b"], false)?;
        let len = leading.iter().product();
        Ok(Self { source: Source::Segments(from, to), leading, len })
    }

    /// Gives each ray its own interval.
    fn limit(&mut self, t_min: &Limit<'py>, t_max: &Limit<'py>) -> PyResult<()> {
        let (t_min, t_max) = (t_min.of(&self.leading, "t_min")?, t_max.of(&self.leading, "t_max")?);
        let ray = |index, origin, direction| {
            Ok(Ray { origin, t_min: t_min.at(index)?, direction, t_max: t_max.at(index)? })
        };
        let rays: PyResult<Vec<Ray>> = match self.all()? {
            query::Rays::Rows(rows, _) => {
                let rows = rows.iter().enumerate();
                rows.map(|(index, &[x, y, z, dx, dy, dz])| ray(index, [x, y, z], [dx, dy, dz])).collect()
            }
            query::Rays::Pairs(origins, directions, _) => {
                let pairs = origins.iter().zip(directions).enumerate();
                pairs.map(|(index, (origin, direction))| ray(index, *origin, *direction)).collect()
            }
            _ => unreachable!("rays with intervals of their own are read as float32"),
        };
        self.source = Source::Rays(rays?);
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

    /// The rays.
    ///
    /// # Errors
    /// Never: the arrays are contiguous.
    pub fn all(&self) -> PyResult<query::Rays<'_>> {
        use Floats::{F32, F64};
        Ok(match &self.source {
            Source::Rays(rays) => query::Rays::Rays(rays),
            Source::Rows(F32(rows), limits) => query::Rays::Rows(rows_of(rows)?, *limits),
            Source::Rows(F64(rows), limits) => query::Rays::Rows64(rows_of(rows)?, *limits),
            Source::Pairs(F32(a), F32(b), limits) => query::Rays::Pairs(rows_of(a)?, rows_of(b)?, *limits),
            Source::Pairs(F64(a), F64(b), limits) => query::Rays::Pairs64(rows_of(a)?, rows_of(b)?, *limits),
            Source::Segments(F32(a), F32(b)) => query::Rays::Segments(rows_of(a)?, rows_of(b)?),
            Source::Segments(F64(a), F64(b)) => query::Rays::Segments64(rows_of(a)?, rows_of(b)?),
            Source::Pairs(..) | Source::Segments(..) => unreachable!("pairs are of one kind"),
        })
    }

    /// Checks all rays.
    fn check(&self) -> PyResult<()> {
        let rays = self.all()?;
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
///
/// # Errors
/// Never: the array is contiguous.
pub fn rows_of<'a, T: Element, const N: usize>(array: &'a Numbers<'_, T>) -> PyResult<&'a [[T; N]]> {
    Ok(array.as_slice()?.as_chunks().0)
}

/// Two arrays of vectors in their common shape and kind, and the leading dimensions.
fn pair<'py>(
    given: [&Bound<'py, PyAny>; 2],
    names: [&str; 2],
    single: bool,
) -> PyResult<(Floats<'py>, Floats<'py>, Vec<usize>)> {
    let read = |value: &Bound<'py, PyAny>, name, single| -> PyResult<Floats<'py>> {
        if single { Ok(Floats::F32(numbers(value, name)?)) } else { Floats::new(value, 3, name) }
    };
    let (mut a, mut b) = (read(given[0], names[0], single)?, read(given[1], names[1], single)?);
    match (&a, &b) {
        (Floats::F32(_), Floats::F64(_)) => a = Floats::F64(numbers(given[0], names[0])?),
        (Floats::F64(_), Floats::F32(_)) => b = Floats::F64(numbers(given[1], names[1])?),
        _ => {}
    }
    if a.shape() != b.shape() {
        let py = given[0].py();
        let both = numpy(py)?.call_method1(intern!(py, "broadcast_arrays"), (a.array(), b.array()))?;
        (a, b) = (read(&both.get_item(0)?, names[0], single)?, read(&both.get_item(1)?, names[1], single)?);
    }
    let leading = a.leading(3, names[0])?;
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

    fn at(&self, index: usize) -> PyResult<f32> {
        Ok(match self {
            Self::All(limit) => *limit,
            Self::Each(limits) => limits.as_slice()?[index],
        })
    }
}
