//! Reads animations. Only the camera's animation is supported.

use super::super::LoadProblem;
use super::Context;
use super::accessor::vectors;
use crate::scene::{
    AnimatedNode, Camera, CameraMotion, Interpolate, Interpolation, Key, Track, unit_rotation,
};
use ::gltf::Node;
use ::gltf::animation::{Channel, Interpolation as SourceInterpolation, Property};
use glam::{DQuat, DVec3};
use std::collections::BTreeSet;

/// The animation of the camera. `chain` lists the nodes from the root down to the camera's node. `None` if no
/// animation moves a node of the chain. If several do, the first is used.
///
/// # Errors
/// When keys are missing or out of order.
pub(super) fn camera_motion(
    context: &mut Context,
    chain: &[Node],
    camera: Camera,
) -> Result<Option<CameraMotion>, LoadProblem> {
    let moves = |channel: &Channel| {
        let in_chain = chain.iter().any(|node| node.index() == channel.target().node().index());
        in_chain && channel.target().property() != Property::MorphTargetWeights
    };
    let document = context.document;
    let mut moving = document.animations().filter(|animation| animation.channels().any(|c| moves(&c)));
    let Some(animation) = moving.next() else { return Ok(None) };
    if moving.next().is_some() {
        context.session.warnings.add("Several animations move a camera; the first one is used.");
    }
    let mut nodes: Vec<AnimatedNode> = chain.iter().map(constant).collect();
    for channel in animation.channels().filter(moves) {
        let target = channel.target();
        let node = chain.iter().position(|node| node.index() == target.node().index());
        let node = &mut nodes[node.expect("the channel moves a node of the chain")];
        match target.property() {
            Property::Translation => {
                node.translation = track(context, &animation, &channel, DVec3::from_array)?
            }
            Property::Scale => node.scale = track(context, &animation, &channel, DVec3::from_array)?,
            Property::Rotation => node.rotation = track(context, &animation, &channel, DQuat::from_array)?,
            Property::MorphTargetWeights => {}
        }
    }
    Ok(Some(CameraMotion::new(40.0, nodes).with_optics_of(camera)))
}

/// Warns if the file animates anything except cameras; `nodes` are theirs and those above them.
pub(super) fn warn_of_others(context: &mut Context, nodes: &BTreeSet<usize>) {
    let in_chain = |channel: &Channel| nodes.contains(&channel.target().node().index());
    if context.document.animations().any(|animation| !animation.channels().all(|c| in_chain(&c))) {
        context
            .session
            .warnings
            .add("Only animations of the camera are supported; everything else keeps its rest pose.");
    }
}

fn constant(node: &Node) -> AnimatedNode {
    let (translation, rotation, scale) = node.transform().decomposed();
    AnimatedNode {
        translation: Track::constant(DVec3::from_array(translation.map(f64::from))),
        rotation: Track::constant(unit_rotation(DQuat::from_array(rotation.map(f64::from)))),
        scale: Track::constant(DVec3::from_array(scale.map(f64::from))),
    }
}

fn track<T: Interpolate, const N: usize>(
    context: &Context,
    animation: &::gltf::Animation,
    channel: &Channel,
    value: fn([f64; N]) -> T,
) -> Result<Track<T>, LoadProblem> {
    let sampler = channel.sampler();
    let place = format!("animations[{}].channels[{}]", animation.index(), channel.index());
    let wrong = |problem: String| context.error(place.clone(), problem);
    let times =
        vectors::<1>(context.buffers, &sampler.input()).map_err(|e| wrong(format!("its input {e}")))?;
    let values =
        vectors::<N>(context.buffers, &sampler.output()).map_err(|e| wrong(format!("its output {e}")))?;
    let finite = values.as_flattened().iter().all(|number| number.is_finite());
    let values: Vec<T> = values.into_iter().map(|v| value(v.map(f64::from))).collect();
    let (interpolation, width) = match sampler.interpolation() {
        SourceInterpolation::Step => (Interpolation::Step, 1),
        SourceInterpolation::Linear => (Interpolation::Linear, 1),
        SourceInterpolation::CubicSpline => (Interpolation::Cubic, 3),
    };
    let found = (times.len(), values.len());
    let key = |v: &[T]| Key { arriving: v[0], value: v[width / 2], leaving: v[width - 1] };
    let is_complete = values.len() == width * times.len() && finite;
    let keys = values.chunks_exact(width).map(key).collect();
    let times = times.into_iter().map(|[time]| f64::from(time)).collect();
    Track::new(times, keys, interpolation).filter(|_| is_complete).ok_or_else(|| {
        wrong(format!(
            "has {} times and {} values; there must be {width} finite values for each time, and times must increase",
            found.0, found.1
        ))
    })
}
