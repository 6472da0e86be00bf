//! The questions that a mesh and a world answer alike: arguments in, arrays out.

use crate::answers::Hits;
use crate::arrays::{array, check_memory, leading, numbers};
use crate::columns::{Column, OF_HITS, OF_POINTS, Out, Want, single};
use crate::interim::{HitColumns, PointColumns, Target, rows};
use crate::rays::{Rays, rows_of};
use crate::threads::{FEW, Threads};
use pyo3::prelude::*;
use raystream_rays::query::WorldHit;
use std::ops::Range;

type Argument<'a, 'py> = Option<&'a Bound<'py, PyAny>>;

/// The most points of a call that stay on the calling thread.
const FEW_POINTS: usize = 64;

/// Arguments that all calls with rays have.
pub struct Arguments<'a, 'py> {
    pub rays: Rays<'py>,
    pub out: Argument<'a, 'py>,
    pub threads: Option<usize>,
}

impl Arguments<'_, '_> {
    fn threads(&self) -> PyResult<Threads> {
        Threads::new(self.threads, self.rays.len(), FEW)
    }
}

fn floats<'a>(column: &'a mut Option<Column<'_, f32>>) -> PyResult<Option<&'a mut [f32]>> {
    column.as_mut().map(Column::slice_mut).transpose()
}

fn ids<'a>(column: &'a mut Option<Column<'_, i32>>) -> PyResult<Option<&'a mut [u32]>> {
    Ok(column.as_mut().map(Column::slice_mut).transpose()?.map(bytemuck::cast_slice_mut))
}

/// Columns of first hits, in memory of this call or of the caller.
struct HitMemory<'py> {
    t: Option<Column<'py, f32>>,
    primitive: Option<Column<'py, i32>>,
    instance: Option<Column<'py, i32>>,
    uv: Option<Column<'py, f32>>,
    normal: Option<Column<'py, f32>>,
    position: Option<Column<'py, f32>>,
}

impl<'py> HitMemory<'py> {
    fn new(want: &Want<'_>, out: Option<&Out<'py>>, leading: &[usize]) -> PyResult<Self> {
        let floats = |name, each| want.has(name).then(|| Column::new(out, name, leading, each)).transpose();
        let ids = |name| want.has(name).then(|| Column::new(out, name, leading, 1)).transpose();
        Ok(Self {
            t: floats("t", 1)?,
            primitive: ids("primitive")?,
            instance: ids("instance")?,
            uv: floats("uv", 2)?,
            normal: floats("normal", 3)?,
            position: floats("position", 3)?,
        })
    }

    fn columns(&mut self) -> PyResult<HitColumns<'_>> {
        Ok(HitColumns {
            t: floats(&mut self.t)?,
            primitive: ids(&mut self.primitive)?,
            instance: ids(&mut self.instance)?,
            uv: floats(&mut self.uv)?.map(rows),
            normal: floats(&mut self.normal)?.map(rows),
            position: floats(&mut self.position)?.map(rows),
        })
    }

    fn into_hits(self, py: Python<'py>, leading: &[usize]) -> PyResult<Hits> {
        let mut columns = Vec::new();
        let mut add = |name, array: Option<PyResult<Bound<'py, PyAny>>>| -> PyResult<()> {
            columns.extend(array.transpose()?.map(|array| (name, array)));
            Ok(())
        };
        add("t", self.t.map(|column| column.into_array(py, leading, 1)))?;
        add("primitive", self.primitive.map(|column| column.into_array(py, leading, 1)))?;
        add("instance", self.instance.map(|column| column.into_array(py, leading, 1)))?;
        add("uv", self.uv.map(|column| column.into_array(py, leading, 2)))?;
        add("normal", self.normal.map(|column| column.into_array(py, leading, 3)))?;
        add("position", self.position.map(|column| column.into_array(py, leading, 3)))?;
        Ok(Hits::of(columns))
    }
}

/// The first hits of rays.
pub fn cast<'py>(
    py: Python<'py>,
    target: &Target,
    arguments: &Arguments<'_, 'py>,
    want: &Bound<'py, PyAny>,
) -> PyResult<Hits> {
    let (rays, want) = (&arguments.rays, Want::new(want, &OF_HITS)?);
    want.check_memory(rays.len())?;
    let out = arguments.out.map(Out::new).transpose()?;
    let mut memory = HitMemory::new(&want, out.as_ref(), rays.leading())?;
    let (mut columns, all) = (memory.columns()?, rays.part(0..rays.len())?);
    arguments.threads()?.in_blocks(py, rays.len(), |block| {
        target.cast(all.part(block.clone()), &mut columns.take(block.len()));
        Ok(())
    })?;
    memory.into_hits(py, rays.leading())
}

/// For each ray, true if it hits anything.
pub fn occluded<'py>(
    py: Python<'py>,
    target: &Target,
    arguments: &Arguments<'_, 'py>,
    negated: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let rays = &arguments.rays;
    check_memory("an answer", rays.len(), 1)?;
    let mut answer = single::<bool>(arguments.out, rays.leading())?;
    let (column, all) = (answer.slice_mut()?, rays.part(0..rays.len())?);
    arguments.threads()?.in_blocks(py, rays.len(), |block| {
        let column = &mut column[block.clone()];
        target.occluded(all.part(block), column);
        if negated {
            column.iter_mut().for_each(|answer| *answer = !*answer);
        }
        Ok(())
    })?;
    answer.into_array(py, rays.leading(), 1)
}

/// The number of hits of each ray.
pub fn count<'py>(
    py: Python<'py>,
    target: &Target,
    arguments: &Arguments<'_, 'py>,
) -> PyResult<Bound<'py, PyAny>> {
    let rays = &arguments.rays;
    check_memory("an answer", rays.len(), 4)?;
    let mut answer = single::<i32>(arguments.out, rays.leading())?;
    let (column, all) = (answer.slice_mut()?, rays.part(0..rays.len())?);
    arguments.threads()?.in_blocks(py, rays.len(), |block| {
        let (_, ranges) = target.all_hits(all.part(block.clone()));
        let counts = ranges.iter().map(|range| i32::try_from(range.len()).unwrap_or(i32::MAX));
        column[block].iter_mut().zip(counts).for_each(|(answer, count)| *answer = count);
        Ok(())
    })?;
    answer.into_array(py, rays.leading(), 1)
}

/// All hits of all rays, one after the other.
#[derive(Default)]
struct AllHits {
    offsets: Vec<i64>,
    rays: Vec<i64>,
    hits: Vec<WorldHit>,
}

impl AllHits {
    /// Adds those of a block of rays.
    fn add(&mut self, block: Range<usize>, found: (Vec<WorldHit>, Vec<Range<usize>>), most: usize) -> PyResult<()> {
        let (hits, ranges) = found;
        check_memory("the list of hits", self.hits.len() + hits.len(), size_of::<WorldHit>() + 8)?;
        for (ray, range) in block.zip(ranges) {
            let hits = &hits[range.start..range.end.min(range.start.saturating_add(most))];
            self.hits.extend_from_slice(hits);
            self.rays.extend(std::iter::repeat_n(ray as i64, hits.len()));
            self.offsets.push(self.hits.len() as i64);
        }
        Ok(())
    }
}

/// All hits of rays, nearest first.
pub fn all_hits<'py>(
    py: Python<'py>,
    target: &Target,
    arguments: &Arguments<'_, 'py>,
    want: &Bound<'py, PyAny>,
    most: Option<usize>,
) -> PyResult<Hits> {
    let (rays, want) = (&arguments.rays, Want::new(want, &OF_HITS)?);
    check_memory("an answer", rays.len(), 8)?;
    let all = rays.part(0..rays.len())?;
    let mut found = AllHits { offsets: vec![0], ..AllHits::default() };
    arguments.threads()?.in_blocks(py, rays.len(), |block| {
        found.add(block.clone(), target.all_hits(all.part(block)), most.unwrap_or(usize::MAX))
    })?;
    let AllHits { offsets, rays: of, hits } = found;
    let leading = [hits.len()];
    want.check_memory(hits.len())?;
    let mut memory = HitMemory::new(&want, None, &leading)?;
    let mut columns = memory.columns()?;
    let ray_of: Vec<_> = of.iter().map(|&ray| all.get(ray as usize)).collect();
    columns.write(target, &ray_of, &hits);
    let answer = memory.into_hits(py, &leading)?;
    let offsets = array(py, offsets, &[rays.len() + 1], 1)?;
    let of = array(py, of, &leading, 1)?;
    Ok(answer.with(vec![("offsets", offsets), ("ray", of)]))
}

/// Points of the surface nearest to points.
pub fn nearest<'py>(
    py: Python<'py>,
    target: &Target,
    points: &Bound<'py, PyAny>,
    max_distance: f32,
    want: &Bound<'py, PyAny>,
    out: Argument<'_, 'py>,
    threads: Option<usize>,
) -> PyResult<Hits> {
    let (points, want) = (numbers::<f32>(points, "points")?, Want::new(want, &OF_POINTS)?);
    let leading = leading(&points, 3, "points")?;
    let points = rows_of(&points)?;
    want.check_memory(points.len())?;
    let out = out.map(Out::new).transpose()?;
    let mut memory = PointMemory::new(&want, out.as_ref(), &leading)?;
    let mut columns = memory.columns()?;
    Threads::new(threads, points.len(), FEW_POINTS)?.in_blocks(py, points.len(), |block| {
        target.nearest(&points[block.clone()], max_distance, &mut columns.take(block.len()));
        Ok(())
    })?;
    memory.into_hits(py, &leading)
}

/// Distances of points from the surface.
pub fn distance<'py>(
    py: Python<'py>,
    target: &Target,
    points: &Bound<'py, PyAny>,
    out: Argument<'_, 'py>,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    let points = numbers::<f32>(points, "points")?;
    let leading = leading(&points, 3, "points")?;
    let points = rows_of(&points)?;
    check_memory("an answer", points.len(), 4)?;
    let mut answer = single::<f32>(out, &leading)?;
    let column = answer.slice_mut()?;
    Threads::new(threads, points.len(), FEW_POINTS)?.in_blocks(py, points.len(), |block| {
        let mut columns = PointColumns { distance: Some(&mut column[block.clone()]), ..PointColumns::default() };
        target.nearest(&points[block], f32::INFINITY, &mut columns);
        Ok(())
    })?;
    answer.into_array(py, &leading, 1)
}

/// Columns of nearest points.
struct PointMemory<'py> {
    distance: Option<Column<'py, f32>>,
    position: Option<Column<'py, f32>>,
    primitive: Option<Column<'py, i32>>,
    uv: Option<Column<'py, f32>>,
    normal: Option<Column<'py, f32>>,
}

impl<'py> PointMemory<'py> {
    fn new(want: &Want<'_>, out: Option<&Out<'py>>, leading: &[usize]) -> PyResult<Self> {
        let floats = |name, each| want.has(name).then(|| Column::new(out, name, leading, each)).transpose();
        Ok(Self {
            distance: floats("distance", 1)?,
            position: floats("position", 3)?,
            primitive: want.has("primitive").then(|| Column::new(out, "primitive", leading, 1)).transpose()?,
            uv: floats("uv", 2)?,
            normal: floats("normal", 3)?,
        })
    }

    fn columns(&mut self) -> PyResult<PointColumns<'_>> {
        Ok(PointColumns {
            distance: floats(&mut self.distance)?,
            position: floats(&mut self.position)?.map(rows),
            primitive: ids(&mut self.primitive)?,
            uv: floats(&mut self.uv)?.map(rows),
            normal: floats(&mut self.normal)?.map(rows),
        })
    }

    fn into_hits(self, py: Python<'py>, leading: &[usize]) -> PyResult<Hits> {
        let mut columns = Vec::new();
        let mut add = |name, array: Option<PyResult<Bound<'py, PyAny>>>| -> PyResult<()> {
            columns.extend(array.transpose()?.map(|array| (name, array)));
            Ok(())
        };
        add("distance", self.distance.map(|column| column.into_array(py, leading, 1)))?;
        add("position", self.position.map(|column| column.into_array(py, leading, 3)))?;
        add("primitive", self.primitive.map(|column| column.into_array(py, leading, 1)))?;
        add("uv", self.uv.map(|column| column.into_array(py, leading, 2)))?;
        add("normal", self.normal.map(|column| column.into_array(py, leading, 3)))?;
        Ok(Hits::of(columns))
    }
}
