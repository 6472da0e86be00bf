//! What a picture is a function of, with resolved values: what checkpoints, partial films and workers compare.

use super::Rendering;
use crate::render::Identity;
use crate::scene::{Camera, FINGERPRINT_VERSION};

impl Rendering {
    /// Everything that the sums of a whole picture depend on; without a camera, everything that an animation's pictures
    /// share.
    pub fn whole_identity(&self, camera: Option<&Camera>) -> Identity {
        let (spec, settings) = (self.spec(), self.spec().settings());
        let noise = spec.stop.noise.map_or_else(|| "no target".into(), |noise| noise.to_string());
        let limit = spec.indirect_limit().map_or_else(|| "no limit".into(), |limit| limit.to_string());
        let scene_hash = self.prepared().scene_hash();
        let aovs = spec.aovs();
        let parts = [
            ("the scene", format!("of fingerprint {scene_hash} (encoding {FINGERPRINT_VERSION})")),
            ("--integrator", self.shader().unwrap_or(self.integrator_name()).to_owned()),
            ("--size", format!("{}x{}", settings.width, settings.height)),
            ("--spp", settings.spp.to_string()),
            ("--max-bounces", settings.max_bounces.to_string()),
            ("--seed", settings.seed.to_string()),
            ("--no-russian-roulette", spec.no_russian_roulette.to_string()),
            ("--noise", noise),
            ("--filter", settings.filter.to_string()),
            ("the radiance of --clamp-indirect", limit),
            ("--aov", if aovs.iter().next().is_none() { "nothing".into() } else { aovs.to_string() }),
            ("--transparent", aovs.is_transparent().to_string()),
        ];
        let halves = if settings.may_end_early { "in turns" } else { "one after the other" };
        let halves = aovs.has_halves().then(|| ("the order of the halves of --aov variance", halves.into()));
        let denoised = aovs.is_denoised().then(|| ("--denoise", "true".into()));
        let (loading, rate) = (&spec.loading, spec.animation.rate());
        let moves = || format!("{:?} from {:?} s at {rate} frames a second", loading.animation, loading.time);
        let moved = self.moves().then(|| ("the scene's animation", moves()));
        let opened = (self.steps() > 1).then(|| {
            let seconds = spec.animation.shutter.unwrap_or(0.0);
            let shutter = format!("{seconds} s in {} steps, of the animation {}", self.steps(), moves());
            ("--shutter", shutter)
        });
        let camera = camera.map(|camera| ("the camera", camera.to_string()));
        let parts = parts
            .into_iter()
            .chain(halves)
            .chain(denoised)
            .chain(moved)
            .chain(opened)
            .chain(camera)
            .map(|(what, value)| (what.to_owned(), value));
        let options = self.options().iter().map(|(key, value)| (format!("option {key}"), value.to_owned()));
        Identity::new(parts.chain(options))
    }

    /// [`Rendering::whole_identity`] of the part that the spec names.
    pub fn identity(&self, camera: Option<&Camera>) -> Identity {
        let (identity, part) = (self.whole_identity(camera), &self.spec().part);
        let identity =
            part.region.iter().fold(identity, |of, region| of.with("--region", region.to_string()));
        let samples = part.samples.iter();
        samples.fold(identity, |of, some| of.with("--samples", format!("{}..{}", some.start, some.end)))
    }
}
