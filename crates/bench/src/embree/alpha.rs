//! Alpha-tested triangles: a filter function that Embree calls for each candidate hit of a masked geometry.
//!
//! Unsafe code for reading what Embree passes. Invariants:
//! 1. A geometry that calls [`alpha_test`] has an [`AlphaTest`] as its user data, which lives as long as the scene.
//! 2. Embree passes `count` numbers in `valid`, and `count` of each field of `RTCHitN` in `hit`: the normal's three,
//!    `u`, `v`, the primitive and further ids. A valid candidate's primitive is one of that geometry's.
#![allow(unsafe_code, reason = "is called by a foreign library; the invariants above")]

use super::api::FilterArguments;
use raystream::bvh::Filter;
use std::fmt;
use std::sync::Arc;

/// Rows of `RTCHitN`.
const U: usize = 3;
const V: usize = 4;
const PRIMITIVE: usize = 5;

/// Masked triangles of a scene and the alpha test that decides about their hits.
pub struct Mask {
    /// For each triangle, true if it is masked.
    pub masked: Vec<bool>,
    /// The alpha test.
    pub filter: Arc<dyn Filter>,
}

impl fmt::Debug for Mask {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Mask").finish_non_exhaustive()
    }
}

/// The user data of a masked geometry.
pub struct AlphaTest {
    /// The scene's number of each triangle of the geometry.
    pub primitives: Arc<[u32]>,
    /// The alpha test.
    pub filter: Arc<dyn Filter>,
}

/// `RTCFilterFunctionN`: refuses the candidates that the alpha test refuses.
///
/// # Safety
/// Only for Embree to call, on a geometry with an [`AlphaTest`].
pub unsafe extern "C" fn alpha_test(arguments: *const FilterArguments) {
    // SAFETY: Embree passes a valid pointer; invariant 1.
    let (arguments, test) = unsafe { (&*arguments, &*(*arguments).user_data.cast::<AlphaTest>()) };
    let count = arguments.count as usize;
    for lane in 0..count {
        // SAFETY: invariant 2: `lane` is less than `count`.
        let valid = unsafe { &mut *arguments.valid.add(lane) };
        if *valid != -1 {
            continue;
        }
        let hit = arguments.hit.cast::<u32>();
        // SAFETY: invariant 2: rows of `count` numbers.
        let field = |row: usize| unsafe { *hit.add(row * count + lane) };
        let primitive = test.primitives[field(PRIMITIVE) as usize];
        if !test.filter.accepts(primitive, f32::from_bits(field(U)), f32::from_bits(field(V))) {
            *valid = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::c_int;
    use std::ptr;

    struct LeftHalf;

    impl Filter for LeftHalf {
        fn accepts(&self, primitive: u32, u: f32, v: f32) -> bool {
            primitive == 70 && u < 0.5 && v == 0.25
        }
    }

    #[test]
    fn candidates_are_refused_lane_by_lane() {
        const COUNT: usize = 4;
        let mut test = AlphaTest { primitives: [70, 80].into(), filter: Arc::new(LeftHalf) };
        let mut hit = [[0_u32; COUNT]; 8];
        hit[U] = [0.1_f32, 0.9, 0.1, 0.1].map(f32::to_bits);
        hit[V] = [0.25_f32.to_bits(); COUNT];
        hit[PRIMITIVE] = [0, 0, 1, u32::MAX];
        let mut valid: [c_int; COUNT] = [-1, -1, -1, 0];
        let arguments = FilterArguments {
            valid: valid.as_mut_ptr(),
            user_data: ptr::from_mut(&mut test).cast(),
            context: ptr::null_mut(),
            ray: ptr::null_mut(),
            hit: hit.as_mut_ptr().cast(),
            count: COUNT as u32,
        };
        // SAFETY: what Embree would pass; invariants 1 and 2.
        unsafe { alpha_test(&arguments) };
        assert_eq!(valid, [-1, 0, 0, 0]);
    }
}
