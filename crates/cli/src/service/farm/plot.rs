//! Time and efficiency over the number of machines, as SVG.

use anyhow::{Result, anyhow};
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;
use raystream::files;
use std::io::Write as _;
use std::ops::Range;
use std::path::Path;

/// Pixels of the plot.
const SIZE: (u32, u32) = (900, 760);

const COLOURS: [RGBColor; 4] =
    [RGBColor(59, 111, 182), RGBColor(200, 120, 45), RGBColor(63, 155, 87), RGBColor(140, 80, 160)];

/// A job's predictions: numbers of machines and values.
#[derive(Debug)]
pub struct Curve {
    pub name: String,
    pub seconds: Vec<(f64, f64)>,
    pub efficiency: Vec<(f64, f64)>,
}

/// Draws the curves.
pub fn write(path: &Path, curves: &[Curve]) -> Result<()> {
    let text = text(curves).map_err(|error| anyhow!("the plot cannot be drawn: {error}"))?;
    files::write(path, |file| file.write_all(text.as_bytes()))?;
    Ok(())
}

fn text(curves: &[Curve]) -> Result<String, Box<dyn std::error::Error>> {
    let mut text = String::new();
    let area = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let (upper, lower) = area.split_vertically(SIZE.1 / 2);
    let machines = bounds(curves.iter().flat_map(|curve| curve.seconds.iter().map(|point| point.0)));
    let seconds = bounds(curves.iter().flat_map(|curve| curve.seconds.iter().map(|point| point.1)));
    let machines_log = || machines.clone().log_scale();
    // Where no curve is.
    let (seconds_title, efficiency_title) =
        (("seconds", SeriesLabelPosition::UpperMiddle), ("efficiency", SeriesLabelPosition::UpperRight));
    panel(&upper, seconds_title, machines_log(), seconds.log_scale(), curves, |curve| &curve.seconds)?;
    panel(&lower, efficiency_title, machines_log(), 0.0..1.05, curves, |curve| &curve.efficiency)?;
    area.present()?;
    drop((upper, lower, area));
    Ok(text)
}

/// A range with some space around all values, which are more than 0.
fn bounds(values: impl Iterator<Item = f64>) -> Range<f64> {
    let (least, most) =
        values.fold((f64::INFINITY, 0.0_f64), |(least, most), value| (least.min(value), most.max(value)));
    0.8 * least..1.25 * most
}

fn panel<X, Y>(
    area: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>,
    (title, legend): (&str, SeriesLabelPosition),
    x: X,
    y: Y,
    curves: &[Curve],
    of: fn(&Curve) -> &Vec<(f64, f64)>,
) -> Result<(), Box<dyn std::error::Error>>
where
    X: AsRangedCoord<Value = f64>,
    Y: AsRangedCoord<Value = f64>,
    X::CoordDescType: ValueFormatter<f64> + Ranged<ValueType = f64>,
    Y::CoordDescType: ValueFormatter<f64> + Ranged<ValueType = f64>,
{
    let mut builder = ChartBuilder::on(area);
    builder.margin(12).x_label_area_size(36).y_label_area_size(64);
    let mut chart = builder.build_cartesian_2d(x, y)?;
    let short = |value: &f64| if *value >= 1.0 { format!("{value:.0}") } else { format!("{value:.2}") };
    let mut mesh = chart.configure_mesh();
    mesh.x_desc("machines").y_desc(title).x_label_formatter(&short).y_label_formatter(&short);
    mesh.light_line_style(RGBColor(240, 240, 240)).draw()?;
    for (curve, colour) in curves.iter().zip(COLOURS.into_iter().cycle()) {
        let style = colour.stroke_width(2);
        let line = LineSeries::new(of(curve).iter().copied(), style);
        chart
            .draw_series(line)?
            .label(&curve.name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
    }
    chart.configure_series_labels().position(legend).background_style(WHITE).border_style(BLACK).draw()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_curve_is_drawn_twice() {
        let curve = |name: &str| Curve {
            name: name.into(),
            seconds: vec![(1.0, 100.0), (10.0, 12.0), (10_000.0, 3.0)],
            efficiency: vec![(1.0, 1.0), (10.0, 0.8), (10_000.0, 0.003)],
        };
        let text = text(&[curve("still"), curve("film")]).expect("it is drawn");
        assert!(text.starts_with("<svg") && text.trim_end().ends_with("</svg>"), "{text}");
        let count = |part: &str| text.matches(part).count();
        assert_eq!((count("still"), count("film"), count("efficiency")), (2, 2, 1));
        let lines =
            COLOURS[..2].iter().map(|colour| format!("#{:02X}{:02X}{:02X}", colour.0, colour.1, colour.2));
        for colour in lines {
            assert!(count(&colour) >= 4, "two curves and two legends in {colour}");
        }
    }
}
