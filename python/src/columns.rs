//! Columns of an answer: which a call computes, and the memory that they are written to.

use crate::arrays::{Named, array, check_memory, zeros};
use numpy::{PyArrayDyn, PyArrayMethods, PyReadwriteArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::{PyKeyError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyMapping;

/// A number that a column may hold.
pub trait Number: Named + bytemuck::Zeroable + Send + Sync {}

impl<T: Named + bytemuck::Zeroable + Send + Sync> Number for T {}

/// Columns of hits, with the bytes of each answer.
pub const OF_HITS: &[(&str, usize)] = &[
    ("t", 4),
    ("primitive", 4),
    ("instance", 4),
    ("uv", 8),
    ("normal", 12),
    ("shading_normal", 12),
    ("position", 12),
    ("position64", 24),
    ("attribute", 4),
];

/// Columns of listed hits: what a list says of each.
pub const OF_LISTS: &[(&str, usize)] = &[("t", 4), ("primitive", 4), ("instance", 4), ("uv", 8)];

/// Columns of nearest points.
pub const OF_POINTS: &[(&str, usize)] =
    &[("distance", 4), ("position", 12), ("position64", 24), ("primitive", 4), ("instance", 4), ("uv", 8)];

/// The columns that a call asks for.
#[derive(Clone, Copy, Debug)]
pub struct Want {
    known: &'static [(&'static str, usize)],
    chosen: u32,
}

impl Want {
    /// Reads an argument: names in one string, or a sequence of names.
    ///
    /// # Errors
    /// For a name that is not among `known`.
    pub fn new(want: &Bound<'_, PyAny>, known: &'static [(&'static str, usize)]) -> PyResult<Self> {
        let mut chosen = 0;
        let mut choose = |name: &str| match known.iter().position(|(known, _)| *known == name) {
            Some(index) => {
                chosen |= 1 << index;
                Ok(())
            }
            None => Err(PyValueError::new_err(format!("want: there is no column {name:?}; {}", list(known)))),
        };
        if let Ok(names) = want.cast::<pyo3::types::PyString>() {
            names.to_str()?.split([' ', ',']).filter(|name| !name.is_empty()).try_for_each(&mut choose)?;
        } else {
            for name in want.try_iter()? {
                choose(name?.cast::<pyo3::types::PyString>()?.to_str()?)?;
            }
        }
        if chosen == 0 {
            return Err(PyValueError::new_err(format!("want names no column; {}", list(known))));
        }
        Ok(Self { known, chosen })
    }

    /// As [`Want::new`], or by default these names.
    ///
    /// # Errors
    /// For a name that is not among `known`.
    pub fn or(
        want: Option<&Bound<'_, PyAny>>,
        known: &'static [(&'static str, usize)],
        usual: &[&str],
    ) -> PyResult<Self> {
        if let Some(want) = want {
            return Self::new(want, known);
        }
        let indices = known.iter().enumerate().filter(|(_, (name, _))| usual.contains(name));
        Ok(Self { known, chosen: indices.fold(0, |chosen, (index, _)| chosen | 1 << index) })
    }

    /// True if the call asks for a column.
    pub fn has(&self, name: &str) -> bool {
        self.known
            .iter()
            .position(|(known, _)| *known == name)
            .is_some_and(|index| self.chosen >> index & 1 == 1)
    }

    /// Names of the columns asked for, with their bytes.
    pub fn names(&self) -> impl Iterator<Item = (&'static str, usize)> {
        let Self { known, chosen } = *self;
        known.iter().enumerate().filter(move |(index, _)| chosen >> index & 1 == 1).map(|(_, known)| *known)
    }

    /// Checks that the columns of as many answers fit in memory.
    ///
    /// # Errors
    /// MemoryError.
    pub fn check_memory(&self, answers: usize) -> PyResult<()> {
        check_memory("an answer", answers, self.names().map(|(_, bytes)| bytes).sum())
    }
}

fn list(known: &[(&str, usize)]) -> String {
    format!("the columns are {}", known.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", "))
}

/// Memory of one column: new, or the caller's.
pub enum Column<'py, T: Number> {
    /// To become an array.
    New(Vec<T>),
    /// An array of the argument `out`.
    Given(PyReadwriteArrayDyn<'py, T>),
}

impl<'py, T: Number> Column<'py, T> {
    /// A column of `items` numbers in the shape of the answer.
    ///
    /// # Errors
    /// If the caller's array has another shape or kind of number or is not contiguous, or there is no memory.
    pub fn new(out: Option<&Out<'py>>, name: &str, leading: &[usize], each: usize) -> PyResult<Self> {
        let mut shape = leading.to_vec();
        if each != 1 {
            shape.push(each);
        }
        let Some(given) = out.map(|out| out.get(name)).transpose()?.flatten() else {
            return Ok(Self::New(zeros(shape.iter().product())?));
        };
        let needed = || {
            format!("out: {name} must be a writeable, contiguous array of {} in the shape {shape:?}", T::NAME)
        };
        let array = given.cast::<PyArrayDyn<T>>().map_err(|_| PyTypeError::new_err(needed()))?;
        if array.shape() != shape || !array.is_c_contiguous() {
            return Err(PyValueError::new_err(needed()));
        }
        Ok(Self::Given(
            array.try_readwrite().map_err(|error| PyValueError::new_err(format!("{}: {error}", needed())))?,
        ))
    }

    /// The numbers.
    pub fn slice_mut(&mut self) -> PyResult<&mut [T]> {
        match self {
            Self::New(vector) => Ok(vector),
            Self::Given(array) => Ok(array.as_slice_mut()?),
        }
    }

    /// The column as an array.
    pub fn into_array(self, py: Python<'py>, leading: &[usize], each: usize) -> PyResult<Bound<'py, PyAny>> {
        match self {
            Self::New(vector) => array(py, vector, leading, each),
            Self::Given(array) => Ok(array.as_any().clone()),
        }
    }
}

/// The argument `out`: arrays by the names of their columns.
pub struct Out<'py>(Bound<'py, PyMapping>);

impl<'py> Out<'py> {
    /// Reads the argument, a mapping or an earlier answer.
    ///
    /// # Errors
    /// For anything else.
    pub fn new(out: &Bound<'py, PyAny>) -> PyResult<Self> {
        if let Ok(mapping) = out.cast::<PyMapping>() {
            return Ok(Self(mapping.clone()));
        }
        if let Ok(hits) = out.cast::<crate::answers::Hits>() {
            return Ok(Self(hits.get().dictionary(out.py())?.into_mapping()));
        }
        Err(PyTypeError::new_err(
            "out must be a dictionary of arrays by the names of columns, or an earlier answer",
        ))
    }

    fn get(&self, name: &str) -> PyResult<Option<Bound<'py, PyAny>>> {
        match self.0.get_item(name) {
            Ok(array) => Ok(Some(array)),
            Err(error) if error.is_instance_of::<PyKeyError>(self.0.py()) => Ok(None),
            Err(error) => Err(error),
        }
    }
}

/// An array that is the whole answer: new, or the caller's argument `out`.
///
/// # Errors
/// As for [`Column::new`].
pub fn single<'py, T: Number>(
    out: Option<&Bound<'py, PyAny>>,
    leading: &[usize],
) -> PyResult<Column<'py, T>> {
    let Some(out) = out else { return Column::new(None, "", leading, 1) };
    let mapping = pyo3::types::PyDict::new(out.py());
    mapping.set_item("the answer", out)?;
    Column::new(Some(&Out(mapping.into_mapping())), "the answer", leading, 1)
}
