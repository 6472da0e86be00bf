"""Tests scripts/results.py on a small file like those that `raystream bench build --json` writes."""

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
        sheet = {"machine": {"processor": "P", "threads": 2, "simd": "avx2"}, "command": ["bench", "schedule"], "rows": [row]}
        run, page = self.write(PAGE, sheet)
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertIn("raystream bench schedule", page)
        self.assertIn("P; 2 threads available, avx2; commit", page)
        self.assertNotIn("old", page)
        self.assertTrue(page.startswith("# Page\n") and page.endswith("\nKept.\n"))

    def test_a_page_without_the_block_is_left_alone(self):
        run, page = self.write("# Page\n", {"machine": {}, "rows": []})
        self.assertNotEqual(run.returncode, 0)
        self.assertIn("has no block", run.stderr)
        self.assertEqual(page, "# Page\n")


if __name__ == "__main__":
    unittest.main()
