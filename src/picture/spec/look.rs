//! How a picture is shown.

use super::form;
use super::option::spec_group;
use crate::film::{Exposure, Look, View};

spec_group! {
    /// The look of a .png; other formats store radiance.
    pub struct LookSpec {
        /// View transform: agx, agx-punchy, pbr-neutral, aces, filmic, standard (cut at 1) or raw (cut at 1, not sRGB).
        one "view" view: form::ViewName = View::default(), "NAME";
        /// Brighten by this many stops, or `auto`: the mean becomes middle grey.
        one "exposure" exposure: form::Stops = Exposure::Stops(0.0), "STOPS|auto";
        /// Show light of this colour temperature as white, in kelvin.
        maybe "white-balance" white_balance: form::Kelvin, "KELVIN";
    }
}

impl LookSpec {
    /// The look.
    pub fn look(&self) -> Look {
        let look = Look::default().with_view(self.view).with_exposure(self.exposure);
        self.white_balance.map_or(look, |kelvin| look.with_white_balance(kelvin))
    }
}
