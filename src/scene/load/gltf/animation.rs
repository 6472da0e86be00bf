//! Reads animations: that of a camera, and the keys of any node.

use super::super::LoadProblem;
use super::accessor::vectors;
use super::{Context, pose};
use crate::scene::{
    AnimatedNode, Camera, CameraMotion, Interpolate, Interpolation, Key, Track, unit_rotation,
};
use ::gltf::animation::{Channel, Interpolation as SourceInterpolation, Property};
use ::gltf::{Animation, Node};
use glam::{DQuat, DVec3};

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
    let animation = if context.session.options.animation.is_some() {
        pose::chosen(context)?.filter(|animation| animation.channels().any(|c| moves(&c)))
    } else {
        let first = moving.next();
        if moving.next().is_some() {
            context.session.warnings.add("Several animations move a camera; the first one is used.");
        }
        first
    };
    let Some(animation) = animation else { return Ok(None) };
    let mut nodes: Vec<AnimatedNode> = chain.iter().map(constant).collect();
    for channel in animation.channels().filter(moves) {
        let target = channel.target();
        let node = chain.iter().position(|node| node.index() == target.node().index());
        let node = &mut nodes[node.expect("the channel moves a node of the chain")];
        read(context, &animation, &channel, node)?;
    }
    Ok(Some(CameraMotion::new(40.0, nodes).with_optics_of(camera)))
}

/// Reads the keys of a channel into the node that it moves. Weights of morph targets are no part of it.
///
/// # Errors
/// When keys are missing or out of order.
pub(super) fn read(
    context: &Context,
    animation: &Animation,
    channel: &Channel,
    node: &mut AnimatedNode,
) -> Result<(), LoadProblem> {
    match channel.target().property() {
        Property::Translation => node.translation = track(context, animation, channel, DVec3::from_array)?,
        Property::Scale => node.scale = track(context, animation, channel, DVec3::from_array)?,
        Property::Rotation => node.rotation = track(context, animation, channel, DQuat::from_array)?,
        Property::MorphTargetWeights => {}
    }
    Ok(())
}

/// A node that stands still.
pub(super) fn constant(node: &Node) -> AnimatedNode {
    let (translation, rotation, scale) = node.transform().decomposed();
    AnimatedNode {
        translation: Track::constant(DVec3::from_array(translation.map(f64::from))),
        rotation: Track::constant(unit_rotation(DQuat::from_array(rotation.map(f64::from)))),
        scale: Track::constant(DVec3::from_array(scale.map(f64::from))),
    }
}

/// The keys of each of a mesh's morph targets.
///
/// # Errors
/// When keys are missing or out of order.
pub(super) fn weights(
    context: &Context,
    animation: &Animation,
    channel: &Channel,
    targets: usize,
) -> Result<Vec<Track<f64>>, LoadProblem> {
    let keys = Keys::<1>::read(context, animation, channel)?;
    let value = |[weight]: [f32; 1]| f64::from(weight);
    (0..targets).map(|target| keys.track((target, targets), value)).collect()
}

fn track<T: Interpolate, const N: usize>(
    context: &Context,
    animation: &Animation,
    channel: &Channel,
    value: fn([f64; N]) -> T,
) -> Result<Track<T>, LoadProblem> {
    Keys::<N>::read(context, animation, channel)?.track((0, 1), |numbers| value(numbers.map(f64::from)))
}

/// The keys of a channel as the file has them.
struct Keys<'a, const N: usize> {
    context: &'a Context<'a>,
    place: String,
    times: Vec<f64>,
    values: Vec<[f32; N]>,
    interpolation: Interpolation,
}

impl<'a, const N: usize> Keys<'a, N> {
    fn read(context: &'a Context<'a>, animation: &Animation, channel: &Channel) -> Result<Self, LoadProblem> {
        let sampler = channel.sampler();
        let place = format!("animations[{}].channels[{}]", animation.index(), channel.index());
        let wrong = |problem: String| context.error(place.clone(), problem);
        let times =
            vectors::<1>(context.buffers, &sampler.input()).map_err(|e| wrong(format!("its input {e}")))?;
        let values =
            vectors::<N>(context.buffers, &sampler.output()).map_err(|e| wrong(format!("its output {e}")))?;
        let times = times.into_iter().map(|[time]| f64::from(time)).collect();
        let interpolation = match sampler.interpolation() {
            SourceInterpolation::Step => Interpolation::Step,
            SourceInterpolation::Linear => Interpolation::Linear,
            SourceInterpolation::CubicSpline => Interpolation::Cubic,
        };
        Ok(Self { context, place, times, values, interpolation })
    }

    /// The track of one of several values that each key has.
    fn track<T: Interpolate>(
        &self,
        (which, all): (usize, usize),
        value: impl Fn([f32; N]) -> T,
    ) -> Result<Track<T>, LoadProblem> {
        let width = if self.interpolation == Interpolation::Cubic { 3 } else { 1 };
        let finite = self.values.as_flattened().iter().all(|number| number.is_finite());
        let is_complete = self.values.len() == width * all * self.times.len() && finite;
        // Of a cubic: all tangents before the key, all values, all tangents after it.
        let key = |key: &[[f32; N]]| {
            let of = |part: usize| value(key[part * all + which]);
            Key { arriving: of(0), value: of(width / 2), leaving: of(width - 1) }
        };
        let keys = || self.values.chunks_exact(width * all).map(key).collect();
        let track = is_complete.then(|| Track::new(self.times.clone(), keys(), self.interpolation)).flatten();
        track.ok_or_else(|| {
            self.context.error(
                self.place.clone(),
                format!(
                    "has {} times and {} values; there must be {} finite values for each time, and times must \
                     increase",
                    self.times.len(),
                    self.values.len(),
                    width * all
                ),
            )
        })
    }
}
