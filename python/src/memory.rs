//! Columns of a call in memory: what the query writes to, and what becomes the answer.

use crate::answers::Hits;
use crate::columns::{Column, Number, Out, Want};
use bytemuck::Pod;
use pyo3::prelude::*;
use raystream_rays::query::{Attribute, HitColumns, Interpolated, NearestColumns, VertexNormals};

/// A column with its name and the numbers of each answer.
struct Slot<'py, T: Number> {
    name: &'static str,
    each: usize,
    column: Column<'py, T>,
}

/// A column if it is wanted.
fn slot<'py, T: Number>(
    want: &Want,
    out: Option<&Out<'py>>,
    leading: &[usize],
    name: &'static str,
    each: usize,
) -> PyResult<Option<Slot<'py, T>>> {
    let slot = || Ok(Slot { name, each, column: Column::new(out, name, leading, each)? });
    want.has(name).then(slot).transpose()
}

/// The rows of a column.
fn rows<'a, T: Number + Pod, R: Pod>(slot: &'a mut Option<Slot<'_, T>>) -> PyResult<Option<&'a mut [R]>> {
    let numbers = slot.as_mut().map(|slot| slot.column.slice_mut()).transpose()?;
    Ok(numbers.map(bytemuck::cast_slice_mut))
}

/// Adds a column to an answer.
fn add<'py, T: Number>(
    py: Python<'py>,
    leading: &[usize],
    slot: Option<Slot<'py, T>>,
    columns: &mut Vec<(&'static str, Bound<'py, PyAny>)>,
) -> PyResult<()> {
    if let Some(Slot { name, each, column }) = slot {
        columns.push((name, column.into_array(py, leading, each)?));
    }
    Ok(())
}

/// What columns read that belongs to triangles, by instance; of one for a mesh.
#[derive(Clone, Debug, Default)]
pub struct OfInstances<'a> {
    pub normals: Vec<VertexNormals<'a>>,
    pub attributes: Vec<&'a [f32]>,
}

/// Columns of first hits.
pub struct HitMemory<'py> {
    t: Option<Slot<'py, f32>>,
    primitive: Option<Slot<'py, i32>>,
    instance: Option<Slot<'py, i32>>,
    uv: Option<Slot<'py, f32>>,
    normal: Option<Slot<'py, f32>>,
    shading_normal: Option<Slot<'py, f32>>,
    position: Option<Slot<'py, f32>>,
    position64: Option<Slot<'py, f64>>,
    attribute: Option<Slot<'py, f32>>,
}

impl<'py> HitMemory<'py> {
    /// Of the columns that are wanted.
    ///
    /// # Errors
    /// As for [`Column::new`].
    pub fn new(want: &Want, out: Option<&Out<'py>>, leading: &[usize]) -> PyResult<Self> {
        Ok(Self {
            t: slot(want, out, leading, "t", 1)?,
            primitive: slot(want, out, leading, "primitive", 1)?,
            instance: slot(want, out, leading, "instance", 1)?,
            uv: slot(want, out, leading, "uv", 2)?,
            normal: slot(want, out, leading, "normal", 3)?,
            shading_normal: slot(want, out, leading, "shading_normal", 3)?,
            position: slot(want, out, leading, "position", 3)?,
            position64: slot(want, out, leading, "position64", 3)?,
            attribute: slot(want, out, leading, "attribute", 1)?,
        })
    }

    /// What the query writes to.
    ///
    /// # Errors
    /// Never: columns are contiguous.
    pub fn columns<'a>(&'a mut self, of_instances: &'a OfInstances<'_>) -> PyResult<HitColumns<'a>> {
        let OfInstances { normals, attributes } = of_instances;
        Ok(HitColumns {
            t: rows(&mut self.t)?,
            primitive: rows(&mut self.primitive)?,
            instance: rows(&mut self.instance)?,
            uv: rows(&mut self.uv)?,
            normal: rows(&mut self.normal)?,
            shading_normal: rows(&mut self.shading_normal)?
                .map(|column| Interpolated { of_instances: normals, column }),
            position: rows(&mut self.position)?,
            position64: rows(&mut self.position64)?,
            attribute: rows(&mut self.attribute)?
                .map(|column| Attribute { of_instances: attributes, column }),
        })
    }

    /// The answer.
    ///
    /// # Errors
    /// As NumPy's.
    pub fn into_hits(self, py: Python<'py>, leading: &[usize]) -> PyResult<Hits> {
        let mut columns = Vec::with_capacity(4);
        add(py, leading, self.t, &mut columns)?;
        add(py, leading, self.primitive, &mut columns)?;
        add(py, leading, self.instance, &mut columns)?;
        add(py, leading, self.uv, &mut columns)?;
        add(py, leading, self.normal, &mut columns)?;
        add(py, leading, self.shading_normal, &mut columns)?;
        add(py, leading, self.position, &mut columns)?;
        add(py, leading, self.position64, &mut columns)?;
        add(py, leading, self.attribute, &mut columns)?;
        Ok(Hits::of(columns))
    }
}

/// The first rows of a column, which is left with the others.
fn first<'a, T>(column: &mut Option<&'a mut [T]>, count: usize) -> Option<&'a mut [T]> {
    let (first, others) = column.take()?.split_at_mut(count);
    *column = Some(others);
    Some(first)
}

/// The first rows of columns of hits, which are left with the others.
pub fn first_hits<'a>(columns: &mut HitColumns<'a>, count: usize) -> HitColumns<'a> {
    let shading_normal = columns.shading_normal.take().map(|Interpolated { of_instances, column }| {
        let (column, others) = column.split_at_mut(count);
        columns.shading_normal = Some(Interpolated { of_instances, column: others });
        Interpolated { of_instances, column }
    });
    let attribute = columns.attribute.take().map(|Attribute { of_instances, column }| {
        let (column, others) = column.split_at_mut(count);
        columns.attribute = Some(Attribute { of_instances, column: others });
        Attribute { of_instances, column }
    });
    HitColumns {
        t: first(&mut columns.t, count),
        primitive: first(&mut columns.primitive, count),
        instance: first(&mut columns.instance, count),
        uv: first(&mut columns.uv, count),
        normal: first(&mut columns.normal, count),
        shading_normal,
        position: first(&mut columns.position, count),
        position64: first(&mut columns.position64, count),
        attribute,
    }
}

/// Columns of nearest points.
pub struct PointMemory<'py> {
    distance: Option<Slot<'py, f32>>,
    position: Option<Slot<'py, f32>>,
    position64: Option<Slot<'py, f64>>,
    primitive: Option<Slot<'py, i32>>,
    instance: Option<Slot<'py, i32>>,
    uv: Option<Slot<'py, f32>>,
}

impl<'py> PointMemory<'py> {
    /// Of the columns that are wanted.
    ///
    /// # Errors
    /// As for [`Column::new`].
    pub fn new(want: &Want, out: Option<&Out<'py>>, leading: &[usize]) -> PyResult<Self> {
        Ok(Self {
            distance: slot(want, out, leading, "distance", 1)?,
            position: slot(want, out, leading, "position", 3)?,
            position64: slot(want, out, leading, "position64", 3)?,
            primitive: slot(want, out, leading, "primitive", 1)?,
            instance: slot(want, out, leading, "instance", 1)?,
            uv: slot(want, out, leading, "uv", 2)?,
        })
    }

    /// What the query writes to.
    ///
    /// # Errors
    /// Never: columns are contiguous.
    pub fn columns(&mut self) -> PyResult<NearestColumns<'_>> {
        Ok(NearestColumns {
            distance: rows(&mut self.distance)?,
            position: rows(&mut self.position)?,
            position64: rows(&mut self.position64)?,
            primitive: rows(&mut self.primitive)?,
            instance: rows(&mut self.instance)?,
            uv: rows(&mut self.uv)?,
        })
    }

    /// The answer.
    ///
    /// # Errors
    /// As NumPy's.
    pub fn into_hits(self, py: Python<'py>, leading: &[usize]) -> PyResult<Hits> {
        let mut columns = Vec::with_capacity(4);
        add(py, leading, self.distance, &mut columns)?;
        add(py, leading, self.position, &mut columns)?;
        add(py, leading, self.position64, &mut columns)?;
        add(py, leading, self.primitive, &mut columns)?;
        add(py, leading, self.instance, &mut columns)?;
        add(py, leading, self.uv, &mut columns)?;
        Ok(Hits::of(columns))
    }
}

/// The first rows of columns of points, which are left with the others.
pub fn first_points<'a>(columns: &mut NearestColumns<'a>, count: usize) -> NearestColumns<'a> {
    NearestColumns {
        distance: first(&mut columns.distance, count),
        position: first(&mut columns.position, count),
        position64: first(&mut columns.position64, count),
        primitive: first(&mut columns.primitive, count),
        instance: first(&mut columns.instance, count),
        uv: first(&mut columns.uv, count),
    }
}
