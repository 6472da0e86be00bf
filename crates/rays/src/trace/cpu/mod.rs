//! The CPU tracer: dynamic ray streams over the eight-wide tree (Barringer and Akenine-Möller 2014, *Dynamic Ray Stream
//! Traversal*), and the scalar reference that every tracer equals bit for bit.
//!
//! A slice of rays is traced on the calling thread, as the CPU's unit traces the chunks of a stream (RA section 3). It
//! is split into sub-streams of up to 16384 rays, whose data fits the second-level cache. A sub-stream that starts at
//! one point is traced as packets; any other is traced as lists of single rays.
//!
//! ```text
//!  rays --split_substreams--> sub-stream --one origin?--+- yes -> packet::form -> lists of packets -+
//!                                                       +- no --> setup --------> lists of ids -----+
//!                                                                                                   v
//!    one stack per octant                                  traversal: two octants take turns, a visit each
//!   +----------------------+  pop   +--------------------------+
//!   | child 7  list of 3   | -----> | visit a node:            |  survivors   one list per child,
//!   | child 2  list of 41  |        | 16 rays × 8 boxes        | -----------> pushed in visit order
//!   | child 5  list of 200 |        +--------------------------+
//!   +----------------------+  pop   | visit a leaf block:      |  hits        row.limit shrinks,
//!    short lists end as pairs ----> | 16 rays × each triangle, | -----------> answers are written
//!    (ray, child), in batches       | or 1 ray × 8 triangles   |
//!                                   +--------------------------+
//! ```
//!
//! - **Lists by octant.** Rays are sorted by the octant of their direction, so all rays of a list cross a box by the
//!   same faces and visit children in the same order. A visit tests a list against the eight boxes of a node, many rays
//!   in a vector, and appends the survivors to a list for each child. A node's memory is thus read once per list, not
//!   once per ray (`ray_lists`, `child_lists`, `leaf`).
//! - **Octants take turns**, which gives each prefetch the time of another visit to arrive (`traversal`).
//! - **Ray-node pairs.** A list that has become too short to fill lanes ends. Its rays go on as pairs of a ray and a
//!   child, which are visited in batches, one ray against the eight boxes or triangles of a node (`ray_node_pairs`,
//!   `leaf`).
//! - **Shafts** bound 512 consecutive rays each and exclude boxes before the rays of a long list are tested (`shaft`).
//! - **Packets.** Coherent rays of one origin, such as camera rays, are traced in sixteens (RTRT section 4). Boxes are
//!   tested against the interval of a packet first, and triangle terms that depend on the origin alone are shared
//!   (`packet`).
//! - **A few rays** are no stream: up to 32 rays take turns, each from front to back (`few_rays`).
//! - **Instances.** Lists that reach an instance visit its tree, whose boxes and corners are moved to world space once
//!   per visit (`instances`, `instance_space`).
//! - **Without vector instructions** a ray is traced by itself, one box or triangle at a time (`scalar`).
//! - **Any-hit queries** visit the child first in which a hit is likeliest, and drop occluded rays from lists.
//!
//! Whatever the path, a hit is decided by the canonical test in lanes (`slabs`, `triangle`), after RTRT section 3. What
//! was tried and measured stands in `docs/lab/tracing.md`.

mod accept;
mod child_lists;
mod crossings;
mod few_rays;
mod instance_space;
mod instances;
mod interval;
#[doc(hidden)]
pub mod lane_math;
mod leaf;
mod moved_nodes;
mod oracle;
mod packet;
mod pair_stack;
mod ray_lists;
mod ray_node_pairs;
#[doc(hidden)]
#[expect(missing_debug_implementations, reason = "lanes of kernels")]
pub mod ray_triangle_pairs;
mod scalar;
mod setup;
mod shaft;
mod single;
#[doc(hidden)]
#[expect(missing_debug_implementations, reason = "lanes of kernels")]
pub mod slabs;
mod split_substreams;
mod substream;
mod tracer;
mod traversal;
mod tree_view;
#[doc(hidden)]
#[expect(missing_debug_implementations, reason = "lanes of kernels")]
pub mod triangle;
mod visit_order;

pub use crate::lanes::{SimdError, SimdLevel};
pub(crate) use crossings::{Candidate, CandidateColumns, MAX_BATCH, Tally, TriangleSink};
pub use oracle::Oracle;
pub use single::SingleRayTracer;
pub use tracer::CpuTracer;
pub(crate) use tree_view::TreeView;

use crate::geom::CanonicalRay;
use crate::stream::Ray;

/// True if a ray means something. One that does not hits nothing: its origin or direction is out of range
/// ([`CanonicalRay::new`]), as NaN and a zero direction are, or `t_min` or `t_max` is NaN.
pub fn is_traceable(ray: &Ray) -> bool {
    CanonicalRay::can_start(ray.origin, ray.direction) && !ray.t_min.is_nan() && !ray.t_max.is_nan()
}
