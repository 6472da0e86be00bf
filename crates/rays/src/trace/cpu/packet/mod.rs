//! Packets: coherent rays from one origin that are traced together, sixteen to a packet (RTRT section 4).
//!
//! A common origin saves work. The [edge normals](super::triangle::OriginTerms) of a triangle are the same for all rays
//! and computed once per visit. The planes of a node's boxes are tested once against the interval of a packet's inverse
//! directions. Lists hold packets, each with a mask of its rays that are still in play. Rays remain in place as
//! columns, and hits are recorded in lanes. If only a few rays of a packet reach a leaf block, each is tested against
//! all triangles at once instead.
//!
//! Every lane answers by the canonical operations: intervals only skip what they prove to be missed (see
//! [`Interval`](super::interval::Interval)).

mod columns;
mod form;
mod triangles;
mod visitor;

pub(super) use columns::Packet;
pub(super) use form::{PacketSet, form, may_form};
pub(super) use visitor::{PacketVisitor, write_answers};
