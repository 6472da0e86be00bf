//! Hashes of a million answers at every SIMD level: those that the wheel's `Hits.hash()` gives, too.

use super::*;
use crate::query::target::Target;
use sha2::{Digest, Sha256};
use std::fmt::Write;

/// Hash of the answers by [`Rule::Closed`]. `python/tests/test_hashes.py` has both, too.
const CLOSED: &str = "a47800f3d48c0a7b913fb9e77854f5a2bf0d415610199c67374d1602a18955c4";

/// Hash of the answers by [`Rule::HalfOpen`].
const HALF_OPEN: &str = "f0d234e88a4fec0b6ea3b7fc9107113bb87cd98c8cee0b42692de7aa52a7890c";

/// Squares along an edge of the mesh.
const EDGE: u32 = 200;

/// A rough plane. Sums and products are exact, so that everyone gets the same bits.
fn rough() -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let middle = EDGE as f32 / 2.0;
    let corner = |i: u32| {
        let (x, y) = (i % (EDGE + 1), i / (EDGE + 1));
        [(x as f32 - middle) / 64.0, (y as f32 - middle) / 64.0, signed(i) / 16.0]
    };
    let square = |i: u32| {
        let at = i / EDGE * (EDGE + 1) + i % EDGE;
        let above = at + EDGE + 1;
        [[at, at + 1, above + 1], [at, above + 1, above]]
    };
    ((0..(EDGE + 1) * (EDGE + 1)).map(corner).collect(), (0..EDGE * EDGE).flat_map(square).collect())
}

/// The columns t, primitive, uv and normal as bytes of little-endian numbers.
struct Answers {
    t: Vec<f32>,
    primitive: Vec<u32>,
    uv: Vec<[f32; 2]>,
    normal: Vec<[f32; 3]>,
}

impl Answers {
    fn of(target: Target<'_>, rays: &Rays<'_>, rule: Rule) -> Self {
        struct Of<'a>(Target<'a>);
        impl RayQueries for Of<'_> {
            fn target(&self) -> Target<'_> {
                self.0
            }
        }
        let count = rays.len();
        let mut answers = Self {
            t: vec![0.0; count],
            primitive: vec![0; count],
            uv: vec![[0.0; 2]; count],
            normal: vec![[0.0; 3]; count],
        };
        let mut columns = HitColumns {
            t: Some(&mut answers.t),
            primitive: Some(&mut answers.primitive),
            uv: Some(&mut answers.uv),
            normal: Some(&mut answers.normal),
            ..HitColumns::default()
        };
        Of(target).cast(rays, rule, &mut columns);
        answers
    }

    /// As the wheel's: SHA-256 of the columns' names, kinds, shapes and bytes, in the order of the names.
    fn hash(&self) -> String {
        let (mut digest, count) = (Sha256::new(), self.t.len());
        let mut add = |head: String, bytes: &[u8]| {
            digest.update(head);
            digest.update(bytes);
        };
        add(format!("normal float32 ({count}, 3);"), bytemuck::cast_slice(&self.normal));
        add(format!("primitive int32 ({count},);"), bytemuck::cast_slice(&self.primitive));
        add(format!("t float32 ({count},);"), bytemuck::cast_slice(&self.t));
        add(format!("uv float32 ({count}, 2);"), bytemuck::cast_slice(&self.uv));
        digest.finalize().iter().fold(String::new(), |mut text, byte| {
            write!(text, "{byte:02x}").expect("a string takes it");
            text
        })
    }
}

#[test]
fn a_million_answers_have_one_hash_at_every_level() {
    let (positions, triangles) = rough();
    let mesh = Mesh::build(&positions, &triangles).expect("sound");
    let row = |i: u32| {
        let at = |k: u32| signed(6 * i + k);
        [2.0 * at(0), 2.0 * at(1), 2.0 * at(2), at(3), at(4), at(5)]
    };
    let rows: Vec<[f32; 6]> = (0..1_000_000).map(row).collect();
    let rays = Rays::Rows(&rows, Range::default());
    for level in SimdLevel::available() {
        let tracers = TreeTracers::new(mesh.bvh().clone(), level);
        let target = Target { tracers: &tracers, starts: None, center: DVec3::ZERO };
        for (rule, expected) in [(Rule::Closed, CLOSED), (Rule::HalfOpen, HALF_OPEN)] {
            let answers = pool(2).install(|| Answers::of(target, &rays, rule));
            assert!(answers.t.iter().filter(|t| t.is_finite()).count() > 100_000);
            assert_eq!(answers.hash(), expected, "{level:?}, {rule:?}");
            // Normals that are kept have the bits of those that are computed for a hit.
            let again = pool(3).install(|| Answers::of(target, &rays, rule));
            assert_eq!(again.hash(), expected, "{level:?}, {rule:?}, again");
        }
    }
}
