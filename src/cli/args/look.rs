//! How a picture is shown.

use crate::film::{Exposure, Look, View};
use clap::Args;

/// How a .png shows the picture; other formats store radiance.
#[derive(Debug, Args)]
pub struct LookArgs {
    /// View transform: agx, agx-punchy, pbr-neutral, aces, filmic, standard (cut at 1) or raw (cut at 1, not sRGB).
    #[arg(long, value_name = "NAME", default_value = View::default().name(), value_parser = view)]
    pub view: View,
    /// Brighten by this many stops, or `auto`: the mean becomes middle grey.
    #[arg(long, value_name = "STOPS|auto", allow_hyphen_values = true, default_value = "0", value_parser = exposure)]
    pub exposure: Exposure,
    /// Show light of this colour temperature as white, in kelvin.
    #[arg(long, value_name = "KELVIN", value_parser = kelvin)]
    pub white_balance: Option<f32>,
}

impl LookArgs {
    /// The look.
    pub fn look(&self) -> Look {
        let look = Look::default().with_view(self.view).with_exposure(self.exposure);
        self.white_balance.map_or(look, |kelvin| look.with_white_balance(kelvin))
    }
}

fn view(text: &str) -> Result<View, String> {
    let names = || View::ALL.map(View::name).join(", ");
    View::ALL
        .into_iter()
        .find(|view| view.name() == text)
        .ok_or_else(|| format!("ask for one of {}", names()))
}

fn exposure(text: &str) -> Result<Exposure, String> {
    if text == "auto" {
        return Ok(Exposure::Auto);
    }
    match text.parse::<f32>() {
        Ok(stops) if stops.abs() <= 126.0 => Ok(Exposure::Stops(stops)),
        _ => Err("write a number of stops from -126 to 126, as in 1.5, or auto".into()),
    }
}

fn kelvin(text: &str) -> Result<f32, String> {
    let (least, greatest) = (Look::KELVINS.start(), Look::KELVINS.end());
    let kelvin = text.parse::<f32>().ok().filter(|kelvin| Look::KELVINS.contains(kelvin));
    kelvin.ok_or_else(|| format!("write a colour temperature from {least} to {greatest} kelvin"))
}
