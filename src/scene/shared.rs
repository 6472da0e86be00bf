//! Values that clones share until one of them changes.

use std::ops::{Deref, DerefMut};
use std::sync::Arc;

/// A value that clones share. Cloning copies a pointer. Changing a shared value copies it first (copy on write), so
/// each clone behaves as a value of its own.
///
/// ```
/// use raystream::scene::{TriangleMesh, Shared};
///
/// let mesh = Shared::new(TriangleMesh::default());
/// let mut other = mesh.clone();
/// assert!(Shared::is_same(&mesh, &other));
/// other.positions.push(glam::Vec3::ZERO);
/// assert!(!Shared::is_same(&mesh, &other) && mesh.positions.is_empty());
/// ```
#[derive(Debug, Default)]
pub struct Shared<T>(Arc<T>);

impl<T> Shared<T> {
    /// A value that no clone shares yet.
    pub fn new(value: T) -> Self {
        Self(Arc::new(value))
    }

    /// The value, copied if a clone shares it.
    pub fn into_inner(this: Self) -> T
    where
        T: Clone,
    {
        Arc::unwrap_or_clone(this.0)
    }

    /// True if both are the same value in memory, so that they are equal without a comparison.
    pub fn is_same(a: &Self, b: &Self) -> bool {
        Arc::ptr_eq(&a.0, &b.0)
    }
}

impl<T> Clone for Shared<T> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<T> From<T> for Shared<T> {
    fn from(value: T) -> Self {
        Self::new(value)
    }
}

impl<T> Deref for Shared<T> {
    type Target = T;

    #[inline(always)]
    fn deref(&self) -> &T {
        &self.0
    }
}

/// Copies the value first if a clone shares it.
impl<T: Clone> DerefMut for Shared<T> {
    fn deref_mut(&mut self) -> &mut T {
        Arc::make_mut(&mut self.0)
    }
}
