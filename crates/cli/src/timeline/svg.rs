//! Timelines as SVG.

use super::{Curve, Timeline, name};
use raystream::schedule::{TaskKind, TaskRecord};
use std::fmt::Write as _;

/// RA's colours: camera rays blue, ray queries yellow, shading green.
fn colour(kind: TaskKind) -> &'static str {
    match kind {
        TaskKind::Spawn => "#3b6fb6",
        TaskKind::Shade => "#3f9b57",
        TaskKind::Trace => "#e3b23c",
        TaskKind::Dispatch => "#c8782d",
        TaskKind::Resolve => "#8fbf6a",
        _ => "#999999",
    }
}

const WIDTH: f64 = 1400.0;
const MARGIN: f64 = 76.0;
const LANE: f64 = 26.0;

/// Height of the curve of paths in flight.
const CURVE: f64 = 60.0;

/// The timeline as SVG text.
pub fn text(timeline: &Timeline) -> String {
    let end_ns = timeline.end_ns();
    let lanes = LANE * timeline.threads.len() as f64;
    let curves = curves(timeline);
    let height = lanes + (CURVE + 8.0) * curves.len() as f64 + 46.0;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {height}\" \
         font-family=\"sans-serif\" font-size=\"11\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
        WIDTH + MARGIN + 8.0
    );
    for (lane, thread) in timeline.threads.iter().enumerate() {
        let y = LANE * lane as f64;
        let _ = writeln!(out, "<text x=\"4\" y=\"{:.1}\">{thread}</text>", y + 17.0);
        let _ = writeln!(
            out,
            "<rect x=\"{MARGIN}\" y=\"{:.1}\" width=\"{WIDTH}\" height=\"{:.1}\" fill=\"#eeeeee\"/>",
            y + 2.0,
            LANE - 4.0
        );
    }
    for task in merged(&timeline.tasks, end_ns) {
        let x = |ns: u64| MARGIN + WIDTH * ns as f64 / end_ns as f64;
        let (start, end) = (x(task.start_ns), x(task.end_ns));
        let y = LANE * f64::from(task.thread) + 2.0;
        let _ = writeln!(
            out,
            "<rect x=\"{start:.2}\" y=\"{y:.1}\" width=\"{:.2}\" height=\"{:.1}\" fill=\"{}\">\
             <title>{}: {} rays, {:.3} ms</title></rect>",
            end - start,
            LANE - 4.0,
            colour(task.kind),
            name(task.kind),
            task.rays,
            (task.end_ns - task.start_ns) as f64 / 1e6
        );
    }
    for (row, curve) in curves.iter().enumerate() {
        draw(&mut out, curve, lanes + 4.0 + (CURVE + 8.0) * row as f64, end_ns);
    }
    let y = height - 14.0;
    let kinds = [TaskKind::Spawn, TaskKind::Trace, TaskKind::Dispatch, TaskKind::Resolve, TaskKind::Shade];
    for (i, kind) in kinds.into_iter().enumerate() {
        let x = MARGIN + 110.0 * i as f64;
        let _ = writeln!(
            out,
            "<rect x=\"{x}\" y=\"{}\" width=\"12\" height=\"12\" fill=\"{}\"/><text x=\"{}\" y=\"{y}\">{}</text>",
            y - 10.0,
            colour(kind),
            x + 18.0,
            name(kind)
        );
    }
    let _ = writeln!(
        out,
        "<text x=\"{}\" y=\"{y}\" text-anchor=\"end\">{:.1} ms</text>\n</svg>",
        MARGIN + WIDTH,
        end_ns as f64 / 1e6
    );
    out
}

/// Paths in flight, if known, and the timeline's own curves.
fn curves(timeline: &Timeline) -> Vec<Curve> {
    let in_flight = |task: &TaskRecord| (task.end_ns, f64::from(task.lists.in_flight));
    let paths = Curve {
        name: "in flight".into(),
        unit: "paths",
        points: timeline.lists().iter().map(in_flight).collect(),
    };
    let own = timeline.curves.iter().cloned();
    std::iter::once(paths).chain(own).filter(|curve| !curve.points.is_empty()).collect()
}

/// Draws a curve over time; the axis starts at 0.
fn draw(out: &mut String, curve: &Curve, top: f64, end_ns: u64) {
    let Curve { name, unit, points } = curve;
    let most = points.iter().map(|point| point.1).fold(f64::MIN_POSITIVE, f64::max);
    let bottom = top + CURVE;
    let x = |at_ns: u64| MARGIN + WIDTH * (at_ns.min(end_ns)) as f64 / end_ns as f64;
    let _ = write!(out, "<path fill=\"#b9c3d0\" d=\"M{:.1} {bottom:.1}", x(points[0].0));
    let (mut last_x, mut last_y) = (f64::NEG_INFINITY, bottom);
    for &(at_ns, number) in points {
        // At most two points per unit of width.
        if x(at_ns) - last_x >= 0.5 {
            (last_x, last_y) = (x(at_ns), bottom - CURVE * number / most);
            let _ = write!(out, "L{last_x:.1} {last_y:.1}");
        }
    }
    let end = MARGIN + WIDTH;
    let _ = writeln!(out, "L{end:.1} {last_y:.1}L{end:.1} {bottom:.1}Z\"/>");
    for (line, text) in [format!("{most:.0} {unit}"), name.clone()].iter().enumerate() {
        let y = top + 12.0 + 16.0 * line as f64;
        let _ = writeln!(out, "<text x=\"4\" y=\"{y:.1}\">{text}</text>");
    }
}

/// Merges short tasks of a kind that follow each other on a thread, so that a long frame stays a small file. Gaps and
/// tasks under a four-thousandth of the timeline count as short.
fn merged(timeline: &[TaskRecord], end_ns: u64) -> Vec<TaskRecord> {
    let gap = end_ns / 4000;
    let mut tasks = timeline.to_vec();
    tasks.sort_by_key(|t| (t.thread, t.start_ns));
    tasks.dedup_by(|next, kept| {
        let joins = kept.thread == next.thread
            && kept.kind == next.kind
            && next.start_ns.saturating_sub(kept.end_ns) < gap
            && next.end_ns - next.start_ns < gap;
        if joins {
            kept.end_ns = next.end_ns;
            kept.rays = kept.rays.saturating_add(next.rays);
        }
        joins
    });
    tasks
}
