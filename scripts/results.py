#!/usr/bin/env python3
"""Writes what a bench measured into a page of results, so that no figure is typed by hand.

    raystream bench build scenes/glass.json --rounds 9 --json glass.json
    python scripts/results.py docs/results/build.md build glass.json "LABEL=MORE.json" ..

The page has a line `<!-- begin: NAME -->` and a line `<!-- end: NAME -->`; what stands between them is replaced by the
command, the machine and the table. NAME's first word says which table: `rays`, `contenders`, `threads`, `small`,
`build`, `ladder`, `frame`, `tail`, `textures`, `shaders`, `adaptive`, `noise`, `profiles`, `schedule`, `latency`,
`rtrt`, `povray`, `raster`, `live`, `livefarm`, `livelinks`, `moving`, `service`, `plan`, `plancheck` or `farmspeed`;
further words only distinguish two blocks of a page. A page without the two lines gets them at its end, with the table.
Tables over scenes take files of one machine and one build, with one scene or several in each. A scene is called what
its file is called, or LABEL where there is one in the file.

--machine TEXT    names the machine where the file does not, or better than the file does
--build COMMIT    the commit that was measured [default: the checkout's, with "changed" if it has changes]
--note TEXT       one sentence more about the circumstances
--command TEXT    the command, for files of builds that did not record theirs

Only the standard library is used.
"""

import argparse
import datetime
import json
import math
import pathlib
import re
import shlex
import subprocess
import sys
import textwrap

COLUMNS = 120
KINDS = {
    "camera": "camera",
    "bounce": "bounce",
    "shuffled-bounce": "shuffled",
    "soft-shadow": "soft shadow",
    "occluded-bounce": "any hit",
}
# Tables with a row for each row of the file: title, where the number is (`a.b` goes inwards), factor, format.
PLAIN = {
    "frame": [
        ("configuration", "configuration", None, "{}"),
        ("Mray/s", "mray_per_s.median", 1, "{:.2f}"),
        ("best", "mray_per_s.best", 1, "{:.2f}"),
        ("worst", "mray_per_s.worst", 1, "{:.2f}"),
        ("frame, ms", "seconds.median", 1e3, "{:.1f}"),
        ("shading, ns a ray", "shade_ns_per_ray.median", 1, "{:.1f}"),
    ],
    "tail": [
        ("streams", "configuration", None, "{}"),
        ("frame, ms", "seconds.median", 1e3, "{:.1f}"),
        ("idle, ms", "idle_s.median", 1e3, "{:.2f}"),
        ("idle at worst, ms", "idle_s.worst", 1e3, "{:.2f}"),
        ("of it in the tail, ms", "tail_idle_s.median", 1e3, "{:.2f}"),
        ("threads busy", "busy_share.median", 100, "{:.1f} %"),
    ],
    "noise": [
        ("scene", "label", None, "{}"),
        ("paths end by", "configuration", None, "{}"),
        ("Mpath/s", "mpath_per_s.median", 1, "{:.2f}"),
        ("s", "seconds.median", 1, "{:.2f}"),
        ("error", "error.median", 1, "{:.4f}"),
        ("robust", "robust_error.median", 1, "{:.4f}"),
        ("robust error × s", "robust_error_seconds", 1, "{:.4f}"),
        ("ratio", "ratio", 1, "{:.2f}"),
    ],
    "textures": [
        ("scene", "label", None, "{}"),
        ("textures", "configuration", None, "{}"),
        ("frame, ns a ray", "ns_per_ray.median", 1, "{:.1f}"),
        ("shading, ns a ray", "shade_ns_per_ray.median", 1, "{:.1f}"),
        ("texels, MB", "texel_bytes", 1e-6, "{:.1f}"),
        ("times constants", "ratio", 1, "{:.2f}"),
    ],
    "shaders": [
        ("what", "configuration", None, "{}"),
        ("block", "block", None, "{}"),
        ("shading, ns a ray", "shade_ns_per_ray.median", 1, "{:.1f}"),
        ("shading, times Rust", "shading_ratio", 1, "{:.2f}"),
        ("frame, times Rust", "frame_ratio", 1, "{:.2f}"),
        ("cycles", "cycles", 1, "{:.2f}"),
        ("ms", "seconds.median", 1e3, "{:.4g}"),
    ],
    "adaptive": [
        ("scene", "label", None, "{}"),
        ("samples", "configuration", None, "{}"),
        ("target", "noise", None, "{}"),
        ("s", "seconds.median", 1, "{:.2f}"),
        ("samples a pixel", "mean_spp.median", 1, "{:.1f}"),
        ("relative", "efficiency.relative", 1, "{:.2f}"),
        ("absolute", "efficiency.absolute", 1, "{:.2f}"),
        ("worst block", "efficiency.worst_block", 1, "{:.2f}"),
    ],
    "schedule": [
        ("threads", "threads", None, "{}"),
        ("task, µs", "load_us", 1, "{:.0f}"),
        ("timeline", "timeline", None, "{}"),
        ("tasks", "tasks", None, "{}"),
        ("tasks/s", "tasks_per_s.median", 1, "{:.0f}"),
        ("overhead, ns", "overhead_ns.median", 1, "{:.0f}"),
        ("best", "overhead_ns.best", 1, "{:.0f}"),
        ("worst", "overhead_ns.worst", 1, "{:.0f}"),
        ("threads busy", "busy_share.median", 100, "{:.1f} %"),
    ],
    "live": [
        ("scene", "label", None, "{}"),
        ("first frame, ms", "first_ms.median", 1, "{:.0f}"),
        ("at worst", "first_ms.worst", 1, "{:.0f}"),
        ("frames/s, moving", "frames_per_s", 1, "{:.1f}"),
        ("share of width", "share", 100, "{:.0f} %"),
        ("s to all samples", "full_s.median", 1, "{:.2f}"),
        ("at worst", "full_s.worst", 1, "{:.2f}"),
    ],
    "livefarm": [
        ("scene", "label", None, "{}"),
        ("workers", "workers", None, "{}"),
        ("frames/s", "frames_per_s", 1, "{:.1f}"),
        ("pixels", "area", 100, "{:.0f} %"),
        ("full frames/s", "full_frames_per_s", 1, "{:.1f}"),
        ("slowest, ms", "worst_ms", 1, "{:.0f}"),
        ("kB", "frame_bytes", 1e-3, "{:.0f}"),
        ("at 100 Mbit", "network_frames_per_s", 1, "{:.0f}"),
        ("late", "late", None, "{}"),
    ],
    "povray": [
        ("scene", "label", None, "{}"),
        ("triangles", "triangles", None, "{}"),
        ("threads", "threads", None, "{}"),
        ("shadows", "shadows", None, "{}"),
        ("renderer", "renderer", None, "{}"),
        ("µs a ray", "us_per_ray.median", 1, "{:.3f}"),
        ("best", "us_per_ray.best", 1, "{:.3f}"),
        ("worst", "us_per_ray.worst", 1, "{:.3f}"),
        ("times", "times", 1, "{:.1f}"),
        ("before the first ray, s", "prepare_s", 1, "{:.2f}"),
    ],
    "raster": [
        ("layers", "layers", None, "{}"),
        ("triangles", "triangles", None, "{}"),
        ("a ray", "depth_complexity", 1, "{:.1f}"),
        ("near first", "near_first_s.median", 1e3, "{:.2f}"),
        ("far first", "far_first_s.median", 1e3, "{:.2f}"),
        ("rays alone", "rays_s.median", 1e3, "{:.2f}"),
        ("frame of rays", "frame_s.median", 1e3, "{:.2f}"),
        ("tree", "build_s", 1e3, "{:.0f}"),
    ],
    "moving": [
        ("frames", "configuration", None, "{}"),
        ("moving, ms", "moving_s.median", 1e3, "{:.0f}"),
        ("best", "moving_s.best", 1e3, "{:.0f}"),
        ("worst", "moving_s.worst", 1e3, "{:.0f}"),
        ("still, ms", "still_s.median", 1e3, "{:.0f}"),
        ("times", "times", 1, "{:.2f}"),
        ("CPU, moving, ms", "moving_cpu_s.median", 1e3, "{:.0f}"),
        ("CPU, still, ms", "still_cpu_s.median", 1e3, "{:.0f}"),
        ("times", "cpu_times", 1, "{:.2f}"),
    ],
    "profiles": [
        ("raystream", "label", None, "{}"),
        ("compile, s", "compile_s", 1, "{:.0f}"),
        ("5 k, ms", "build_5k_s", 1e3, "{:.1f}"),
        ("1 M, s", "build_s", 1, "{:.2f}"),
        ("closest, s", "closest_s", 1, "{:.2f}"),
        ("frame, s", "frame_s", 1, "{:.2f}"),
    ],
    "beside": [
        ("a frame", "configuration", None, "{}"),
        ("Mray/s", "mray_per_s.median", 1, "{:.2f}"),
        ("best", "mray_per_s.best", 1, "{:.2f}"),
        ("worst", "mray_per_s.worst", 1, "{:.2f}"),
        ("loss", "loss", 100, "{:.1f} %"),
    ],
    "accepted": [
        ("submitted", "configuration", None, "{}"),
        ("accepted a second", "accepted_per_s", 1, "{:.0f}"),
        ("median, ms", "latency.p50", 1e3, "{:.1f}"),
        ("p99, ms", "latency.p99", 1e3, "{:.1f}"),
        ("slowest, ms", "latency.worst", 1e3, "{:.1f}"),
    ],
    "answered": [
        ("requests under load", "configuration", None, "{}"),
        ("number", "requests", None, "{}"),
        ("median, ms", "latency.p50", 1e3, "{:.1f}"),
        ("p99, ms", "latency.p99", 1e3, "{:.1f}"),
        ("slowest, ms", "latency.worst", 1e3, "{:.1f}"),
        ("MB, 10 s", "memory_start", 1e-6, "{:.1f}"),
        ("MB, a fifth", "memory_settled", 1e-6, "{:.1f}"),
        ("MB, end", "memory_end", 1e-6, "{:.1f}"),
        ("MB, most", "memory_most", 1e-6, "{:.1f}"),
    ],
    "served": [
        ("a long job", "configuration", None, "{}"),
        ("s", "job_s.median", 1, "{:.2f}"),
        ("best", "job_s.best", 1, "{:.2f}"),
        ("worst", "job_s.worst", 1, "{:.2f}"),
        ("loss", "loss", 100, "{:.1f} %"),
    ],
    "plan": [
        ("job", "job", None, "{}"),
        ("machines", "machines", None, "{}"),
        ("s", "seconds", 1, "{:.1f}"),
        ("times as fast", "speedup", 1, "{:.1f}"),
        ("efficiency", "efficiency", 100, "{:.1f} %"),
        ("idle", "idle_share", 100, "{:.0f} %"),
        ("network", "network_share", 100, "{:.1f} %"),
        ("busiest besides machines", "busiest", None, "{}"),
        ("its load", "busiest_share", 100, "{:.0f} %"),
    ],
    "plancheck": [
        ("workers", "workers", None, "{}"),
        ("measured, s", "measured_s.median", 1, "{:.1f}"),
        ("best", "measured_s.best", 1, "{:.1f}"),
        ("worst", "measured_s.worst", 1, "{:.1f}"),
        ("predicted, s", "predicted_s", 1, "{:.1f}"),
        ("difference", "difference", 100, "{:+.1f} %"),
        ("efficiency", "efficiency", 100, "{:.0f} %"),
        ("predicted", "predicted_efficiency", 100, "{:.0f} %"),
    ],
    "farmspeed": [
        ("the same picture", "configuration", None, "{}"),
        ("s", "job_s.median", 1, "{:.2f}"),
        ("best", "job_s.best", 1, "{:.2f}"),
        ("worst", "job_s.worst", 1, "{:.2f}"),
        ("share of its speed", "share", 1, "{:.3f}"),
        ("units", "units", 1, "{:.0f}"),
        ("a unit besides its samples, ms", "unit_overhead_s", 1e3, "{:.1f}"),
    ],
    "kernels": [
        ("a ray/triangle test (Table 1)", "kernel", None, "{}"),
        ("ends early, ns", "least_ns.median", 1, "{:.2f}"),
        ("hits, ns", "most_ns.median", 1, "{:.2f}"),
        ("times one lane, where it hits", "speedup", 1, "{:.2f}"),
    ],
    "packets": [
        ("packet's edge, rays (Table 2)", "packet", None, "{}"),
        ("picture's edge", "resolution", None, "{}"),
        ("nodes a lone ray visits", "nodes_per_ray", 1, "{:.1f}"),
        ("more in packets", "node_overhead", 100, "{:.1f} %"),
        ("leaf blocks a lone ray visits", "blocks_per_ray", 1, "{:.1f}"),
        ("more in packets", "block_overhead", 100, "{:.1f} %"),
    ],
    "effects": [
        ("Whitted (section 6.2)", "configuration", None, "{}"),
        ("ms", "seconds.median", 1e3, "{:.1f}"),
        ("times camera rays alone", "times_as_long", 1, "{:.2f}"),
        ("Mray/s", "mray_per_s.median", 1, "{:.2f}"),
    ],
    "hills": [
        ("triangles (Figure 5)", "triangles", None, "{}"),
        ("build, ms", "build_s", 1e3, "{:.1f}"),
        ("camera, Mray/s", "camera_mray_per_s.median", 1, "{:.2f}"),
        ("bounce, Mray/s", "bounce_mray_per_s.median", 1, "{:.2f}"),
    ],
}
LINKED = [column for column in PLAIN["livefarm"] if column[0] != "at 100 Mbit"]
PLAIN["livelinks"] = [*LINKED[:2], ("links", "link", None, "{}"), *LINKED[2:]]
CROSSOVERS = ["layers", "rasteriser draws", "rays faster from", "faster with the most triangles"]


def table(titles, rows):
    """A Markdown table; the first column is text, the others are numbers."""
    lines = [titles, ["---"] + ["---:"] * (len(titles) - 1), *rows]
    lines = ["| " + " | ".join(cells) + " |" for cells in lines]
    if wide := [line for line in lines if len(line) > COLUMNS]:
        sys.exit(f"a row is wider than {COLUMNS} columns; give fewer columns or shorter names:\n{wide[0]}")
    return "\n".join(lines)


def number(value, factor, style):
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return style.format(value if factor is None else value * factor)


def find(row, path):
    for name in path.split("."):
        row = row.get(name) if isinstance(row, dict) else None
    return row


def plain(name, rows):
    """One row of the table for each row of the file."""
    columns = PLAIN[name]
    cells = [[number(find(row, path), factor, style) for _, path, factor, style in columns] for row in rows]
    return table([title for title, *_ in columns], cells)


def scenes(rows):
    """Rows by scene, in the order of the files; with as many threads as the first row has."""
    threads = rows[0]["threads"]
    groups = {}
    for row in rows:
        if row["threads"] == threads:
            groups.setdefault(row["label"], []).append(row)
    return groups


def geometric_mean(values):
    return math.exp(sum(map(math.log, values)) / len(values))


def fastest(rows, kind, unit):
    """The best SIMD level of one of raystream's units on a kind of rays."""
    ours = [row for row in rows if row["kind"] == kind and row["unit"] == unit]
    return max(ours, key=lambda row: row["mray_per_s"]["median"], default=None)


def kinds_of(rows):
    return [kind for kind in KINDS if any(row["kind"] == kind for row in rows)]


def rays(rows, _):
    """Scenes by kinds of rays beside Embree's fastest mode; then means and leasts of the other comparisons."""
    groups, kinds = scenes(rows), kinds_of(rows)

    def ratios(unit, peer):
        """Of each kind, the ratios in the scenes that have one."""
        best = {kind: [fastest(group, kind, unit) for group in groups.values()] for kind in kinds}
        return {kind: [row["ratio"][peer] for row in of if row and peer in row["ratio"]] for kind, of in best.items()}

    first = ratios("raystream", "embree")
    if not all(first.values()):
        sys.exit("no row of 'raystream' has a ratio to Embree: measure with --embree")
    cells = []
    for name, group in groups.items():
        best = [fastest(group, kind, "raystream") for kind in kinds]
        cells.append([name] + [f"{row['mray_per_s']['median']:.1f} ({row['ratio']['embree']:.2f})" for row in best])
    for of, name in [(geometric_mean, "geometric mean of the ratios"), (min, "least ratio")]:
        cells.append([name] + [f"{of(first[kind]):.2f}" for kind in kinds])
    titles = [KINDS[kind] for kind in kinds]
    scene_table = table(["scene", *titles], cells)

    cells = []
    for unit, peer, name in [
        ("raystream", "embree_robust", "tracer, Embree's fastest robust mode"),
        ("raystream query", "embree", "`query`, Embree's fastest mode"),
        ("raystream service", "embree", "service, Embree's fastest mode"),
        ("raystream", "tinybvh", "tracer, tinybvh's fastest tree"),
        ("raystream", "obvhs", "tracer, obvhs"),
        ("raystream", "rtrt", "tracer, RTRT's method"),
    ]:
        of = ratios(unit, peer)
        if all(of.values()):
            count = len(next(iter(of.values())))
            cells.append([name, str(count)] + [f"{geometric_mean(of[k]):.2f} ({min(of[k]):.2f})" for k in kinds])
    other = table(["raystream's unit, beside", "scenes", *titles], cells) if cells else ""
    headings = [
        "Mray/s of raystream's tracer (times as fast as Embree's fastest mode):",
        "Geometric means of other ratios (least):",
    ]
    tables = [scene_table, other]
    return "\n\n".join(f"{heading}\n\n{body}" for heading, body in zip(headings, tables) if body)


def contenders(rows, _):
    """All contenders of one scene by kinds of rays, Mray/s and the order of their rays."""
    (_, group), *others = scenes(rows).items()
    if others:
        sys.exit("a table of contenders is of one scene: give one file")
    kinds, lines = kinds_of(group), {}
    for row in group:
        name = " ".join(filter(None, [row["unit"], row.get("simd")]))
        order = "" if row.get("order", "shuffled") == "shuffled" else " " + row["order"]
        lines.setdefault(name, {})[row["kind"]] = f"{row['mray_per_s']['median']:.2f}{order}"
    cells = [[name] + [of.get(kind, "") for kind in kinds] for name, of in lines.items()]
    return table(["contender", *(KINDS[kind] for kind in kinds)], cells)


def threads(rows, _):
    """Scenes by kinds of rays: how many times as fast the most threads are as one, beside Embree's fastest mode."""
    most, kinds, cells = max(row["threads"] for row in rows), kinds_of(rows), []
    if most == 1:
        sys.exit("all rows are of one thread: measure with --threads 1,2")
    for name in dict.fromkeys(row["label"] for row in rows):
        for who in ["raystream", "embree"]:
            line = []
            for kind in kinds:
                among = [r for r in rows if (r["label"], r["kind"], r["threads"]) == (name, kind, most)]
                among = [r for r in among if r["unit"] == who or who == "embree" and r["unit"].startswith(who)]
                best = max(among, key=lambda row: row["mray_per_s"]["median"], default=None)
                line += [best["ratio"]["one_thread"]] if best else []
            if len(line) == len(kinds):
                numbers = [f"{ratio:.2f}" for ratio in [*line, geometric_mean(line)]]
                cells.append([f"{name}, {'Embree' if who == 'embree' else who}", *numbers])
    return table([f"{most} threads by one", *(KINDS[kind] for kind in kinds), "geometric mean"], cells)


def small(rows, _):
    """Contenders by numbers of rays a call: nanoseconds a ray, for each kind of rays."""
    blocks = []
    for kind in kinds_of(rows):
        group = [row for row in rows if row["kind"] == kind]
        counts = list(dict.fromkeys(row["rays_a_call"] for row in group))
        cells = []
        for unit in dict.fromkeys(row["unit"] for row in group):
            times = {row["rays_a_call"]: row["ray_ns"] for row in group if row["unit"] == unit}
            cells.append([unit] + [f"{times[count]:.0f}" if count in times else "" for count in counts])
        heading = f"{KINDS[kind].capitalize()} rays, ns a ray by the number of rays a call:"
        blocks.append(heading + "\n\n" + table(["unit", *map(str, counts)], cells))
    return "\n\n".join(blocks)


def build(rows, _):
    """Scenes by time and memory of the tree, beside Embree's of medium quality."""
    titles = ["scene", "ms", "Embree's ms", "ratio", "refit, ms", "bytes a triangle", "Embree's", "ratio", "SAH cost"]
    cells, ratios = [], ([], [])
    for name, group in scenes(rows).items():
        units = {row["unit"]: row for row in group}
        ours, refit, theirs = (units.get(unit) for unit in ["raystream", "raystream, refit", "embree medium"])
        line = [name, *(number(find(row or {}, "seconds.median"), 1e3, "{:.1f}") for row in (ours, theirs))]
        if theirs:
            ratios[0].append(ours["seconds"]["median"] / theirs["seconds"]["median"])
            ratios[1].append(ours["bytes_per_triangle"] / theirs["bytes_per_triangle"])
        line += [f"{ratios[0][-1]:.2f}" if theirs else ""]
        line += [number(find(refit or {}, "seconds.median"), 1e3, "{:.1f}")]
        line += [number((row or {}).get("bytes_per_triangle"), 1, "{:.1f}") for row in (ours, theirs)]
        line += [f"{ratios[1][-1]:.2f}" if theirs else "", number(ours.get("cost"), 1, "{:.1f}")]
        cells.append(line)
    if ratios[0] and len(cells) > 1:
        time, memory = (f"{geometric_mean(of):.2f}" for of in ratios)
        cells.append(["geometric mean", "", "", time, "", "", "", memory, ""])
    return table(titles, cells)


def ladder(rows, _):
    """Scenes by configurations of the ladder: speed of the frame, ratio to the first, and shading."""
    groups = scenes(rows)
    names = list(dict.fromkeys(row["configuration"] for row in rows))
    blocks = []
    for heading, path, style in [
        ("Mray/s of the whole frame:", "mray_per_s.median", "{:.2f}"),
        (f"Times as fast as {names[0]}:", None, "{:.2f}"),
        ("Thread time of shading, ns a ray:", "shade_ns_per_ray.median", "{:.0f}"),
    ]:
        cells = []
        for name, group in groups.items():
            by_name = {row["configuration"]: row for row in group}
            first = by_name[names[0]]["mray_per_s"]["median"]
            value = (lambda row: find(row, path)) if path else (lambda row: find(row, "mray_per_s.median") / first)
            cells.append([name] + [number(value(by_name[n]) if n in by_name else None, 1, style) for n in names])
        blocks.append(heading + "\n\n" + table(["scene", *names], cells))
    return "\n\n".join(blocks)


def rtrt(rows, _):
    """The tables of RTRT, each told by what its rows have."""
    parts = {"kernels": "kernel", "packets": "packet", "effects": "times_as_long", "hills": "triangles"}
    parts = {name: [row for row in rows if key in row] for name, key in parts.items()}
    return "\n\n".join(plain(name, rows) for name, rows in parts.items() if rows)


def raster(rows, _):
    """Frames by a rasteriser and by camera rays, then where rays become faster."""
    frames, crossed = ([row for row in rows if key in row] for key in ["frame_s", "crossover"])
    on = f"{frames[0]['adapter']} rasterises, {frames[0]['threads']} threads trace; ms:"
    at = lambda of: number(of["crossover"], 1, "{:.0f}")
    cells = [[str(of["layers"]), of["order"], at(of), of["faster_at_most"]] for of in crossed]
    return "\n\n".join([on, plain("raster", frames), table(CROSSOVERS, cells)])


def latency(rows, _):
    """Times of queries by their rays, then the speed of a frame beside an interactive client."""
    queries = [row for row in rows if "latency_us" in row]
    counts = list(dict.fromkeys(row["rays"] for row in queries))
    lines = {}
    for row in queries:
        spread = row["latency_us"]
        time = f"{spread['p50']:.1f} ({spread['p99']:.1f})"
        lines.setdefault((row["configuration"], str(row["frames"])), {})[row["rays"]] = time
    cells = [[*name] + [of.get(count, "") for count in counts] for name, of in lines.items()]
    titles = ["query", "frames", *(f"{count} ray{'s' if count > 1 else ''}" for count in counts)]
    beside = [row for row in rows if "mray_per_s" in row]
    times = ["Microseconds, median (p99):\n\n" + table(titles, cells)] if queries else []
    return "\n\n".join(times + ([plain("beside", beside)] if beside else []))


def service(rows, _):
    """What `scripts/load` measures: jobs accepted, requests answered, a long job."""
    parts = {"accepted": "accepted_per_s", "answered": "requests", "served": "job_s"}
    parts = {name: [row for row in rows if key in row] for name, key in parts.items()}
    return "\n\n".join(plain(name, rows) for name, rows in parts.items() if rows)


OTHERS = {
    "service": service,
    "latency": latency,
    "rays": rays,
    "contenders": contenders,
    "threads": threads,
    "small": small,
    "build": build,
    "ladder": ladder,
    "rtrt": rtrt,
    "raster": raster,
}


def read(argument):
    """A file's sheet, its rows labelled with what their scene is called."""
    label, _, path = argument.rpartition("=")
    sheet = json.loads(pathlib.Path(path).read_text())
    if label and len({row.get("scene") for row in sheet["rows"]}) > 1:
        sys.exit(f"{path} has several scenes, for which {label!r} is one name")
    for row in sheet["rows"]:
        row["label"] = label or re.sub(r"\.(json|obj|gltf|glb|ply|stl|off)$", "", row.get("scene", ""))
    return sheet


def command(sheet, given):
    """The words of a file's command as a stranger would give them: without folders but `scenes/`."""
    own = sheet.get("command", [])
    of_script = bool(own) and own[0].startswith("scripts/")
    words = shlex.split(given) if given else own if of_script else ["raystream", *own]
    if len(words) == 1:
        sys.exit("this file does not say which command wrote it; give it with --command")
    words = [part for word in words for part in (word.split("=", 1) if word.startswith("--") else [word])]
    kept = []
    for before, word in zip(["", *words], words):
        if before == "--embree":
            kept.append("EMBREE.so")
        elif "--json" not in (before, word):
            folder, _, name = word.rpartition("/")
            kept.append(word if folder in ("", "scenes", "scripts") else name)
    return kept


def commands(sheets, given):
    """All commands, one with SCENE where they differ by that alone; wide ones go on in a second line."""
    lists = [command(sheet, given) for sheet in sheets]
    scenes = [sheet["rows"][0].get("scene") for sheet in sheets]
    general = set()
    for words, scene in zip(lists, scenes):
        general.add(shlex.join("SCENE" if pathlib.PurePath(word).name == scene else word for word in words))
    lines = general if len(general) == 1 and len(sheets) > 1 else dict.fromkeys(map(shlex.join, lists))
    wrap = {"width": COLUMNS - 2, "subsequent_indent": "    ", "break_long_words": False, "break_on_hyphens": False}
    return [" \\\n".join(textwrap.wrap(line, **wrap)) for line in lines]


def git(*words):
    return subprocess.run(["git", *words], capture_output=True, text=True, check=True).stdout.strip()


def source(given):
    """The commit that was measured."""
    changed = not given and git("status", "--porcelain", "--untracked-files=no", "src", "Cargo.lock")
    return (given or git("rev-parse", "--short", "HEAD")) + (" (changed)" if changed else "")


def block(args, sheets):
    """What stands between the marks."""
    layout, *part = args.name.split()
    rows = [row for sheet in sheets for row in sheet["rows"]]
    if layout in OTHERS:
        body = OTHERS[layout](rows, part)
    elif layout in PLAIN:
        # A plot has the sizes between.
        kept = [row for row in rows if layout != "plan" or str(row["machines"]).strip("0") == "1"]
        body = plain(layout, kept)
    else:
        sys.exit(f"there is no table called {layout}")
    machines = {json.dumps(sheet["machine"]) for sheet in sheets}
    if len(machines) > 1:
        sys.exit("these files are of different machines; a table is of one")
    machine = sheets[0]["machine"]
    name = args.machine or machine.get("processor")
    if not name:
        sys.exit("this file does not name its processor; give it with --machine")
    words = f"{name}; {machine['threads']} threads available, {machine['simd']}; commit {source(args.build)},"
    words = " ".join([words, f"{datetime.date.today()}.", args.note or ""])
    lines = ["```text", *commands(sheets, args.command), "```", "", *textwrap.wrap(words, COLUMNS), "", body]
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("page", type=pathlib.Path)
    parser.add_argument("name")
    parser.add_argument("files", nargs="+", metavar="[LABEL=]FILE")
    for option in ["machine", "build", "note", "command"]:
        parser.add_argument(f"--{option}")
    args = parser.parse_args()
    text = args.page.read_text()
    begin, end = f"<!-- begin: {args.name} -->", f"<!-- end: {args.name} -->"
    if begin not in text and end not in text:
        text = f"{text.rstrip()}\n\n{begin}\n{end}\n"
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        sys.exit(f"{args.page} has no block between {begin} and {end}")
    before, rest = text.split(begin)
    sheets = [read(argument) for argument in args.files]
    args.page.write_text(f"{before}{begin}\n{block(args, sheets)}\n{end}{rest.split(end)[1]}")


if __name__ == "__main__":
    main()
