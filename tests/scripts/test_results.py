"""Tests scripts/results.py on small files like those that `raystream bench --json` writes."""

import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

SCRIPT = pathlib.Path(__file__).resolve().parents[2] / "scripts" / "results.py"
PAGE = "# Page\n\n<!-- begin: schedule -->\nold\n<!-- end: schedule -->\n\nKept.\n"


class Results(unittest.TestCase):
    def write(self, page, sheet, name="schedule"):
        folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))
        (folder / "page.md").write_text(page)
        (folder / "sheet.json").write_text(json.dumps(sheet))
        run = subprocess.run(
            [sys.executable, SCRIPT, folder / "page.md", name, folder / "sheet.json"], capture_output=True, text=True
        )
        return run, (folder / "page.md").read_text()

    def test_a_block_is_replaced_and_the_rest_kept(self):
        row = {
            "threads": 2,
            "load": "empty",
            "tasks_per_s": {"median": 1234567.0, "best": 2e6, "worst": 1e6},
            "busy_share": {"median": 0.5, "best": 0.6, "worst": 0.4},
            "overhead_ns": {"median": 436.0, "best": 400.0, "worst": 500.0},
            "ns_per_task": {"median": 436.0, "best": 400.0, "worst": 500.0},
        }
        sheet = self.sheet("bench schedule", row)
        run, page = self.write(PAGE, sheet)
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertIn("raystream bench schedule", page)
        self.assertIn("P; 2 threads available, avx2; commit", page)
        self.assertNotIn("old", page)
        self.assertTrue(page.startswith("# Page\n") and page.endswith("\nKept.\n"))

    def sheet(self, words, *rows):
        machine = {"processor": "P", "threads": 2, "simd": "avx2"}
        return {"machine": machine, "command": words.split(), "rows": [{"threads": 1, **row} for row in rows]}

    def test_a_build_stands_beside_embree(self):
        row = lambda unit, seconds, size, cost=None: {
            "scene": "glass.json", "unit": unit, "seconds": {"median": seconds},
            "bytes_per_triangle": size, "cost": cost,
        }
        rows = [row("raystream", 0.05, 40.0, 5.0), row("raystream, refit", 0.01, 40.0), row("embree medium", 0.1, 80.0)]
        sheet = self.sheet("bench build /far/glass.json --embree=/far/lib.so --json /far/b.json", *rows)
        run, page = self.write(PAGE.replace("schedule", "build"), sheet, "build")
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertIn("raystream bench build glass.json --embree EMBREE.so\n", page)
        self.assertIn("| glass | 50.0 | 100.0 | 0.50 | 10.0 | 40.0 | 80.0 | 0.50 | 5.0 |", page)

    def test_predictions_stand_beside_measurements(self):
        row = {
            "workers": 4, "measured_s": {"median": 60.0, "best": 59.0, "worst": 61.0}, "predicted_s": 57.0,
            "difference": -0.05, "efficiency": 0.97, "predicted_efficiency": 0.985,
        }
        sheet = self.sheet("scripts/farm_plan_check plancheck.json --rounds 1", row)
        run, page = self.write(PAGE.replace("schedule", "plancheck"), sheet, "plancheck")
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertIn("| 4 | 60.0 | 59.0 | 61.0 | 57.0 | -5.0 % | 97 % | 98 % |", page)
        self.assertIn("scripts/farm_plan_check plancheck.json --rounds 1\n", page)
        row = {
            "job": "still", "machines": 100, "seconds": 61.25, "speedup": 150.0, "efficiency": 0.75, "idle_share": 0.2,
            "network_share": 0.125, "busiest": "planner", "busiest_share": 0.5,
        }
        run, page = self.write(PAGE.replace("schedule", "plan"), self.sheet("farm plan --json a/p.json", row), "plan")
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertIn("| still | 100 | 61.2 | 150.0 | 75.0 % | 20 % | 12.5 % | planner | 50 % |", page)

    def test_the_service_has_three_tables(self):
        times = {"p50": 0.001, "p99": 0.0123, "worst": 0.5}
        rows = [
            {"configuration": "200 jobs a second", "accepted_per_s": 199.9, "latency": times},
            {"configuration": "50 clients", "requests": 60000, "latency": times, "memory_start": 5e8,
             "memory_settled": 5.005e8, "memory_end": 5.01e8, "memory_most": 6e8},
            {"configuration": "a job that renders is cancelled", "requests": 20, "latency": times},
            {"configuration": "raystream serve", "job_s": {"median": 60.0, "best": 59.0, "worst": 61.0}, "loss": 0.012},
        ]
        sheet = self.sheet("scripts/load load.json --minutes 1", *rows)
        run, page = self.write(PAGE.replace("schedule", "service"), sheet, "service")
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertIn("scripts/load load.json --minutes 1\n", page)
        self.assertIn("| 200 jobs a second | 200 | 1.0 | 12.3 | 500.0 |", page)
        self.assertIn("| 50 clients | 60000 | 1.0 | 12.3 | 500.0 | 500.0 | 500.5 | 501.0 | 600.0 |", page)
        self.assertIn("| raystream serve | 60.00 | 59.00 | 61.00 | 1.2 % |", page)

    def test_latencies_stand_above_what_a_frame_loses(self):
        times = {"p50": 1.5, "p99": 3, "worst": 9}
        query = {"configuration": "interactive", "frames": 4, "rays": 1, "latency_us": times}
        spread = {"median": 10.0, "best": 11.0, "worst": 9.0}
        beside = {"configuration": "frame, a client registered", "frames": 1, "mray_per_s": spread, "loss": 0.032}
        sheet = self.sheet("bench latency cornell.json", query, beside)
        run, page = self.write(PAGE.replace("schedule", "latency"), sheet, "latency")
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertIn("| query | frames | 1 ray |", page)
        self.assertIn("| interactive | 4 | 1.5 (3.0) |", page)
        self.assertIn("| frame, a client registered | 10.00 | 11.00 | 9.00 | 3.2 % |", page)

    def test_rays_have_ratios_means_and_leasts(self):
        row = lambda scene, simd, speed, ratio: {
            "scene": scene, "kind": "bounce", "unit": "raystream", "simd": simd, "order": "rows",
            "mray_per_s": {"median": speed}, "ratio": {"embree": ratio, "obvhs": 2 * ratio},
        }
        rows = [row("a.obj", "avx2", 5.0, 1.0), row("a.obj", "avx512", 10.0, 2.0), row("b.obj", "avx512", 30.0, 8.0)]
        sheet = self.sheet("bench rays a.obj b.obj", *rows)
        run, page = self.write(PAGE.replace("schedule", "rays"), sheet, "rays")
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertIn("| a | 10.0 (2.00) |\n| b | 30.0 (8.00) |\n", page)
        self.assertIn("| geometric mean of the ratios | 4.00 |\n| least ratio | 2.00 |\n", page)
        self.assertIn("| tracer, obvhs | 2 | 8.00 (4.00) |\n", page)

    def test_povray_and_raystream_have_a_line_each(self):
        row = lambda renderer, time, times: {
            "scene": "terrain:142", "triangles": 40328, "shadows": False, "renderer": renderer, "prepare_s": 0.5,
            "us_per_ray": {"median": time, "best": time, "worst": 2 * time}, **times,
        }
        sheet = self.sheet("bench povray", row("raystream", 0.05, {}), row("POV-Ray", 1.25, {"times": 25.0}))
        run, page = self.write(PAGE.replace("schedule", "povray"), sheet, "povray")
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertIn("| terrain:142 | 40328 | 1 | no | raystream | 0.050 | 0.050 | 0.100 |  | 0.50 |", page)
        self.assertIn("| terrain:142 | 40328 | 1 | no | POV-Ray | 1.250 | 1.250 | 2.500 | 25.0 | 0.50 |", page)

    def test_frames_of_a_rasteriser_stand_above_the_crossovers(self):
        time = lambda ms: {"median": ms / 1e3}
        frame = {
            "layers": 4, "triangles": 1000, "depth_complexity": 4.25, "adapter": "A (vulkan, software)",
            "build_s": 0.01, "near_first_s": time(1), "far_first_s": time(2), "rays_s": time(3),
            "frame_s": time(4),
        }
        crossed = {"layers": 4, "order": "near first", "crossover": 12345.6, "faster_at_most": "rays"}
        never = {"layers": 4, "order": "far first", "crossover": None, "faster_at_most": "rasteriser"}
        sheet = self.sheet("bench raster", frame, crossed, never)
        run, page = self.write(PAGE.replace("schedule", "raster"), sheet, "raster")
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertIn("A (vulkan, software) rasterises, 1 threads trace; ms:", page)
        self.assertIn("| 4 | 1000 | 4.2 | 1.00 | 2.00 | 3.00 | 4.00 | 10 |", page)
        self.assertIn("| 4 | near first | 12346 | rays |\n| 4 | far first |  | rasteriser |", page)

    def test_a_page_without_the_block_gets_one(self):
        row = {"threads": 2, "load": "empty", "tasks_per_s": {"median": 1e6}}
        run, page = self.write("# Page\n", self.sheet("bench schedule", row))
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertTrue(page.startswith("# Page\n\n<!-- begin: schedule -->\n"))
        self.assertTrue(page.endswith("<!-- end: schedule -->\n"))

    def test_a_page_with_half_a_block_is_left_alone(self):
        half = "# Page\n<!-- end: schedule -->\n"
        run, page = self.write(half, {"machine": {}, "rows": []})
        self.assertNotEqual(run.returncode, 0)
        self.assertIn("has no block", run.stderr)
        self.assertEqual(page, half)


if __name__ == "__main__":
    unittest.main()
