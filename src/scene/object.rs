//! The object table: which triangles belong to which object of the scene file.

use crate::lanes::{Int, Lanes, Num, Vector};
use glam::DMat4;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// An object of a scene file: a node of glTF, an object or a group of OBJ, a shape of a recipe, or a whole PLY file.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Object {
    /// Name in the file. Several objects may have the same name.
    pub name: String,
    /// Index of the object above in the file's hierarchy.
    pub parent: Option<u32>,
    /// Number of this object among those that show the same geometry, from 0 in file order. `None` if no other object
    /// shows its geometry.
    pub instance: Option<u32>,
}

impl Object {
    /// An object without a parent.
    pub fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), ..Self::default() }
    }

    /// The same object below another.
    pub fn below(self, parent: Option<u32>) -> Self {
        Self { parent, ..self }
    }
}

/// The objects of a scene and the triangles of each.
///
/// Memory grows with the number of runs of triangles that belong to one object, not with the number of triangles.
///
/// ```
/// use raystream::scene::{Object, Objects};
///
/// let mut objects = Objects::default();
/// let table = objects.add(Object::new("table"));
/// let leg = objects.add(Object::new("leg").below(Some(table)));
/// objects.assign(0, table);
/// objects.assign(12, leg); // triangles 12, 13, ..
/// assert_eq!((objects.of(11), objects.of(12)), (Some(table), Some(leg)));
/// assert_eq!(objects.path(leg), "table/leg");
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Objects {
    list: Vec<Object>,
    /// The first triangle of each run, ascending; the first is 0.
    starts: Vec<u32>,
    /// The object of each run, or [`Objects::NONE`].
    owners: Vec<u32>,
    /// For each object the three rows of the matrix from the world into its own space; empty if that is the world for
    /// all of them.
    spaces: Vec<f32>,
}

/// Numbers of an object in [`Objects::spaces`].
const SPACE: usize = 12;

/// The rows of the identity.
const WORLD: [f32; SPACE] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];

impl Objects {
    /// The index that [`Objects::at`] returns for a triangle without an object.
    pub const NONE: u32 = u32::MAX;

    /// Adds an object without triangles; returns its index.
    pub fn add(&mut self, object: Object) -> u32 {
        self.list.push(object);
        if !self.spaces.is_empty() {
            self.spaces.extend(WORLD);
        }
        self.list.len() as u32 - 1
    }

    /// Places an object: `placement` leads from its own space into the world. Without an inverse, the object's space
    /// remains the world.
    ///
    /// # Panics
    /// If there is no such object.
    pub fn place(&mut self, object: u32, placement: &DMat4) {
        assert!((object as usize) < self.list.len(), "object {object} of {}", self.list.len());
        let inverse = placement.inverse();
        let rows = [0, 1, 2].map(|row| inverse.row(row).as_vec4().to_array());
        let space = rows.as_flattened();
        if *space == WORLD || !space.iter().all(|number| number.is_finite()) {
            return;
        }
        if self.spaces.is_empty() {
            self.spaces = WORLD.repeat(self.list.len());
        }
        self.spaces[object as usize * SPACE..][..SPACE].copy_from_slice(space);
    }

    /// Assigns the triangles from `first` on to an object, up to the next assignment.
    ///
    /// # Panics
    /// If there is no such object, or `first` is below that of the assignment before.
    pub fn assign(&mut self, first: u32, object: u32) {
        assert!((object as usize) < self.list.len(), "object {object} of {}", self.list.len());
        let last = self.starts.last().copied();
        assert!(last.is_none_or(|last| last <= first), "triangle {first} after {last:?}");
        if last.is_none() && first > 0 {
            self.starts.push(0);
            self.owners.push(Self::NONE);
        }
        if last == Some(first) {
            self.starts.pop();
            self.owners.pop();
        }
        if self.owners.last() != Some(&object) {
            self.starts.push(first);
            self.owners.push(object);
        }
    }

    /// Number of objects.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// True if there are no objects.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// The object of this index.
    pub fn get(&self, object: u32) -> Option<&Object> {
        self.list.get(object as usize)
    }

    /// The object of this index, to be changed.
    pub fn get_mut(&mut self, object: u32) -> Option<&mut Object> {
        self.list.get_mut(object as usize)
    }

    /// All objects, by index.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &Object> {
        self.list.iter()
    }

    /// The names of an object and of those above it, outermost first, joined by slashes.
    pub fn path(&self, object: u32) -> String {
        let mut names = Vec::new();
        let mut next = Some(object);
        // No path is longer than the table, even if parents form a cycle.
        while let Some(object) = next.and_then(|next| self.get(next)).filter(|_| names.len() < self.len()) {
            names.push(&*object.name);
            next = object.parent;
        }
        names.reverse();
        names.join("/")
    }

    /// The object of a triangle.
    pub fn of(&self, primitive: u32) -> Option<u32> {
        let run = self.starts.partition_point(|&start| start <= primitive).checked_sub(1)?;
        Some(self.owners[run]).filter(|&owner| owner != Self::NONE)
    }

    /// The objects of triangles, one in each lane; [`Objects::NONE`] where there is none.
    #[inline(always)]
    pub fn at<L: Lanes>(&self, primitive: Int<L>) -> Int<L> {
        let l = primitive.lanes();
        let Some(last) = self.starts.len().checked_sub(1) else { return Int::splat(l, Self::NONE) };
        let mut run = Int::splat(l, 0);
        // The last run that starts at or before the triangle, one bit of its index at a time.
        let mut step = (last + 1).next_power_of_two() as u32;
        while step > 0 {
            let next = run + step;
            let [start] = next.at_most(last as u32).rows(&self.starts);
            let reached = next.below(last as u32 + 1) & !primitive.lt(start);
            run = Int::select(reached, next, run);
            step >>= 1;
        }
        let [owner] = run.rows(&self.owners);
        owner
    }

    /// Points of the world on triangles, one in each lane, in the own space of the triangle's object.
    #[inline(always)]
    pub fn local_at<L: Lanes>(&self, primitive: Int<L>, position: Vector<L>) -> Vector<L> {
        if self.spaces.is_empty() { position } else { self.local(self.at(primitive), position) }
    }

    /// Points of the world, one in each lane, in the own spaces of objects.
    #[inline(always)]
    pub(super) fn local<L: Lanes>(&self, object: Int<L>, position: Vector<L>) -> Vector<L> {
        let Some(last) = (self.spaces.len() / SPACE).checked_sub(1) else { return position };
        let [a, b, c, d, e, f, g, h, i, j, k, l] = object.at_most(last as u32).rows_of::<SPACE>(&self.spaces);
        let Vector { x, y, z } = position;
        let local =
            Vector::new(a * x + b * y + c * z + d, e * x + f * y + g * z + h, i * x + j * y + k * z + l);
        Vector::select(object.is(Self::NONE), position, local)
    }

    /// Length in the own space of the objects of triangles that a unit of the world has in the mean over directions,
    /// one in each lane.
    #[inline(always)]
    pub fn scale_at<L: Lanes>(&self, primitive: Int<L>) -> Num<L> {
        let one = Num::splat(primitive.lanes(), 1.0);
        let Some(last) = (self.spaces.len() / SPACE).checked_sub(1) else { return one };
        let object = self.at(primitive);
        let [a, b, c, _, e, f, g, _, i, j, k, _] = object.at_most(last as u32).rows_of::<SPACE>(&self.spaces);
        let squares = (a * a + b * b + c * c) + (e * e + f * f + g * g) + (i * i + j * j + k * k);
        Num::select(object.is(Self::NONE), one, (squares * (1.0 / 3.0)).sqrt())
    }

    /// True if each object has its space, or none has one, and all numbers are finite.
    pub(super) fn has_sound_spaces(&self) -> bool {
        let is_complete = self.spaces.is_empty() || self.spaces.len() == SPACE * self.list.len();
        is_complete && self.spaces.iter().all(|number| number.is_finite())
    }

    /// The runs of triangles with their objects, in the order of the triangles, of a mesh of `triangles` triangles.
    pub fn runs(&self, triangles: u32) -> impl Iterator<Item = (Range<u32>, Option<u32>)> {
        let ends = self.starts.iter().skip(1).copied().chain([triangles]);
        self.starts
            .iter()
            .zip(ends)
            .zip(&self.owners)
            .map(|((&start, end), &owner)| (start..end, Some(owner).filter(|&owner| owner != Self::NONE)))
    }

    /// Columns that pictures can depend on: the first triangle and the object of each run, and the words of spaces.
    pub(super) fn columns(&self) -> [&[u32]; 3] {
        [&self.starts, &self.owners, bytemuck::cast_slice(&self.spaces)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::{LaneTask, SimdLevel, SingleLane};
    use glam::{DVec3, Vec3};

    /// Objects 0, 1, 2, .. with these first triangles.
    fn table(starts: &[u32]) -> Objects {
        let mut objects = Objects::default();
        for (i, &start) in starts.iter().enumerate() {
            let object = objects.add(Object::new(format!("{i}")));
            objects.assign(start, object);
        }
        objects
    }

    struct Search<'a>(&'a Objects, u32);

    impl LaneTask for Search<'_> {
        type Output = Vec<u32>;

        #[inline(always)]
        fn run<L: Lanes>(self, l: L) -> Vec<u32> {
            self.0.at(Int::iota(l) + self.1).to_array().as_ref().to_vec()
        }
    }

    #[test]
    fn lanes_find_the_object_that_a_search_finds() {
        for count in [0, 1, 2, 3, 5, 16, 17, 100] {
            let starts: Vec<u32> = (0..count).map(|i| 3 + i * (i % 5 + 1)).collect();
            let mut starts = starts;
            starts.sort_unstable();
            starts.dedup();
            let objects = table(&starts);
            for simd in SimdLevel::available() {
                for first in (0..600).step_by(13) {
                    for (i, found) in simd.run(Search(&objects, first)).into_iter().enumerate() {
                        let expected = objects.of(first + i as u32).unwrap_or(Objects::NONE);
                        assert_eq!(found, expected, "triangle {} of {starts:?} at {simd}", first + i as u32);
                    }
                }
            }
        }
    }

    #[test]
    fn an_object_has_all_triangles_up_to_the_next_assignment() {
        let mut objects = table(&[2, 5]);
        objects.assign(8, 0);
        objects.assign(9, 0);
        let runs: Vec<_> = objects.runs(11).collect();
        assert_eq!(runs, [(0..2, None), (2..5, Some(0)), (5..8, Some(1)), (8..11, Some(0))]);
        assert_eq!([1, 2, 7, 10].map(|primitive| objects.of(primitive)), [None, Some(0), Some(1), Some(0)]);
        // An assignment of no triangles is replaced.
        objects.assign(9, 1);
        objects.assign(9, 0);
        assert_eq!(objects.runs(11).count(), 4);
    }

    #[test]
    fn points_are_found_in_the_space_of_their_object() {
        let mut objects = table(&[0, 2, 4]);
        let turn = DMat4::from_rotation_z(std::f64::consts::FRAC_PI_2);
        objects.place(
            1,
            &(DMat4::from_translation(DVec3::new(1.0, 2.0, 3.0))
                * turn
                * DMat4::from_scale(DVec3::splat(2.0))),
        );
        objects.place(2, &DMat4::ZERO);
        let fourth = objects.add(Object::new("3"));
        objects.assign(6, fourth);
        let local = |primitive: u32| {
            let at: Vector<SingleLane> = Vec3::new(1.0, 4.0, 3.0).into();
            Vec3::from(objects.local_at(primitive.into(), at))
        };
        for primitive in [0, 1, 4, 6] {
            assert_eq!(local(primitive), Vec3::new(1.0, 4.0, 3.0), "the world");
        }
        assert!((local(3) - Vec3::X).length() < 1e-6, "{}", local(3));
        let scale = |primitive: u32| objects.scale_at::<SingleLane>(primitive.into()).get();
        assert_eq!([0, 4, 6].map(scale), [1.0; 3], "the world");
        assert!((scale(3) - 0.5).abs() < 1e-6, "{}", scale(3));
        assert!(objects.has_sound_spaces());
        objects.spaces.pop();
        assert!(!objects.has_sound_spaces());
    }

    #[test]
    fn paths_name_all_objects_above_and_cycles_end() {
        let mut objects = Objects::default();
        let above = objects.add(Object::new("tower"));
        let below = objects.add(Object::new("roof").below(Some(above)));
        assert_eq!((objects.path(below), objects.path(7)), ("tower/roof".into(), String::new()));
        objects.get_mut(above).expect("the tower").parent = Some(below);
        assert_eq!(objects.path(below), "tower/roof");
    }
}
