//! Embree, tinybvh, obvhs, RTRT and the scalar reference as contenders.

use super::Kind;
use super::contender::{Clock, Contender};
use crate::embree::{EmbreeRays, EmbreeScene, Mode};
use crate::rtrt::{KdTree, Packet};
use crate::tinybvh::{BuildOptions, TinyBvhRays, TinyBvhTree};
use crate::{PeerError, Peers};
use glam::Vec3A;
use obvhs::cwbvh::CwBvh;
use obvhs::triangle::Triangle;
use rayon::prelude::*;
use raystream::bvh::Bvh;
use raystream::engine::PreparedScene;
use raystream::stream::Ray;
use raystream::trace::cpu::Oracle;
use std::sync::Arc;

/// Rays that a thread passes to a library at a time. Embree takes them sixteen by sixteen and tinybvh one by one, so a
/// small number is as fast as a large one, and threads end together.
const SHARE: usize = 1024;

/// Embree in each mode, on each of the scenes.
pub fn embree<'a>(scenes: &'a [EmbreeScene<'_>], kind: Kind, clock: Clock<'a>) -> Vec<Contender<'a>> {
    let contender = |scene: &'a EmbreeScene<'_>, mode: Mode| {
        let mut shares: Vec<EmbreeRays> = Vec::new();
        let round = move |rays: &Arc<[Ray]>| {
            let count = rays.len().div_ceil(SHARE);
            shares.resize_with(count, || EmbreeRays::new(&[], mode));
            shares.iter_mut().zip(rays.chunks(SHARE)).for_each(|(share, rays)| share.set(rays));
            let shares = shares.par_iter_mut().with_max_len(1);
            Ok(clock.seconds(|| shares.for_each(|rays| scene.trace(rays, kind.is_any_hit()))))
        };
        let name = format!("embree {}{}", mode.name(), if scene.is_robust() { ", robust" } else { "" });
        let (threads, is_robust, round) = (clock.threads(), scene.is_robust(), Box::new(round));
        Contender { name, threads, simd: None, is_robust, is_slow: false, round }
    };
    scenes.iter().flat_map(|scene| Mode::ALL.map(|mode| contender(scene, mode))).collect()
}

/// obvhs' own tree, built at its highest quality, and its traversal.
pub struct Obvhs {
    tree: CwBvh,
    triangles: Vec<Triangle>,
}

impl Obvhs {
    /// Its tree over the same triangles.
    pub fn new(bvh: &Bvh) -> Self {
        let triangle = |primitive| {
            let [v0, v1, v2] = bvh.corners(primitive).map(Vec3A::from);
            Triangle { v0, v1, v2 }
        };
        let triangles: Vec<Triangle> = (0..bvh.len() as u32).map(triangle).collect();
        let tree = obvhs::cwbvh::builder::build_cwbvh_from_tris(
            &triangles,
            obvhs::BvhBuildParams::very_slow_build(),
            &mut Default::default(),
        );
        let triangles = tree.primitive_indices.iter().map(|&i| triangles[i as usize]).collect();
        Self { tree, triangles }
    }

    /// Distance of the nearest hit, or 0 for any hit; +∞ for none.
    fn trace(&self, ray: &Ray, any: bool) -> f32 {
        use obvhs::ray::{Ray as ObvhsRay, RayHit};
        let ray = ObvhsRay::new(ray.origin.into(), ray.direction.into(), ray.t_min.max(0.0), ray.t_max);
        let test = |ray: &ObvhsRay, id: usize| self.triangles[id].intersect(ray);
        if any {
            return if self.tree.ray_traverse_miss(ray, test) { f32::INFINITY } else { 0.0 };
        }
        let mut hit = RayHit::none();
        if self.tree.ray_traverse(ray, &mut hit, test) { hit.t } else { f32::INFINITY }
    }
}

/// Peers without an alpha test, with trees of their own over a scene's triangles.
pub struct PeersOfOpaque<'a> {
    tinybvh: Vec<TinyBvhTree<'a>>,
    obvhs: Obvhs,
    rtrt: KdTree,
}

impl<'a> PeersOfOpaque<'a> {
    /// Builds their trees.
    pub fn new(prepared: &PreparedScene, peers: Peers<'a>) -> Result<Self, PeerError> {
        let mesh = &prepared.scene.mesh;
        let mut tinybvh = Vec::new();
        if let Some(library) = peers.tinybvh {
            for options in BuildOptions::ALL {
                tinybvh.push(library.build(&mesh.positions, &mesh.triangles, options)?);
            }
        }
        Ok(Self { tinybvh, obvhs: Obvhs::new(&prepared.bvh), rtrt: KdTree::new(&prepared.bvh) })
    }

    /// All of them.
    pub fn contenders<'s>(&'s self, kind: Kind, clock: Clock<'s>) -> Vec<Contender<'s>> {
        let any = kind.is_any_hit();
        let mut contenders: Vec<_> = self.tinybvh.iter().map(|tree| tinybvh(tree, any, clock)).collect();
        contenders.push(one_by_one("obvhs", move |ray: &Ray| self.obvhs.trace(ray, any), clock));
        contenders.push(rtrt(&self.rtrt, any, clock));
        contenders
    }
}

/// tinybvh's traversal, which takes single rays. They are in its layout before the clock starts.
fn tinybvh<'a>(tree: &'a TinyBvhTree<'_>, any: bool, clock: Clock<'a>) -> Contender<'a> {
    let mut shares: Vec<TinyBvhRays<'_>> = Vec::new();
    let round = move |rays: &Arc<[Ray]>| {
        let lengths = rays.chunks(SHARE).map(<[Ray]>::len);
        if !shares.iter().map(TinyBvhRays::len).eq(lengths.clone()) {
            let room = |length| tree.tinybvh().rays(length).expect("memory for rays");
            shares = lengths.map(room).collect();
        }
        shares.iter_mut().zip(rays.chunks(SHARE)).for_each(|(share, rays)| share.set(rays));
        let shares = shares.par_iter_mut().with_max_len(1);
        Ok(clock.seconds(|| shares.for_each(|rays| tree.trace(rays, any))))
    };
    let (name, threads) = (tree.name(), clock.threads());
    Contender { name, threads, simd: None, is_robust: false, is_slow: false, round: Box::new(round) }
}

/// The packets of RTRT. They are made before the clock starts.
fn rtrt<'a>(tree: &'a KdTree, any: bool, clock: Clock<'a>) -> Contender<'a> {
    let mut answers = Vec::new();
    let round = move |rays: &Arc<[Ray]>| {
        let packets: Vec<Packet> = rays.chunks(Packet::RAYS).map(Packet::new).collect();
        answers.resize(packets.len(), [0.0; Packet::RAYS]);
        let share = SHARE / Packet::RAYS;
        let shares = packets.par_chunks(share).zip(answers.par_chunks_mut(share));
        Ok(clock.seconds(|| shares.for_each(|(packets, answers)| tree.trace(packets, any, answers))))
    };
    let (name, threads) = ("rtrt".to_owned(), clock.threads());
    Contender { name, threads, simd: None, is_robust: false, is_slow: true, round: Box::new(round) }
}

/// The scalar reference.
pub fn scalar<'a>(prepared: &PreparedScene, kind: Kind, clock: Clock<'a>) -> Contender<'a> {
    let oracle = Oracle::new(prepared.bvh.clone(), prepared.filter.clone());
    let any = kind.is_any_hit();
    let trace =
        move |ray: &Ray| if any { oracle.occluded_one(ray).into() } else { oracle.closest_one(ray).t };
    one_by_one("scalar", trace, clock)
}

/// Traces rays one at a time.
fn one_by_one<'a>(
    name: &str,
    trace: impl Fn(&Ray) -> f32 + Send + Sync + 'a,
    clock: Clock<'a>,
) -> Contender<'a> {
    let mut answers = Vec::new();
    let round = move |rays: &Arc<[Ray]>| {
        Ok(clock.seconds(|| rays.par_iter().map(&trace).collect_into_vec(&mut answers)))
    };
    let (name, threads) = (name.to_owned(), clock.threads());
    Contender { name, threads, simd: None, is_robust: false, is_slow: true, round: Box::new(round) }
}
