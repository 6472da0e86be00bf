"""Tests scripts/measure: its questions against the pages, and what counts as a change of code."""

import importlib.machinery
import importlib.util
import pathlib
import subprocess
import sys
import tempfile
import types
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]


def load(path):
    loader = importlib.machinery.SourceFileLoader("measure", str(path))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader("measure", loader))
    sys.modules["measure"] = module
    sys.dont_write_bytecode = True
    loader.exec_module(module)
    return module


measure = load(ROOT / "scripts" / "measure")


class Measure(unittest.TestCase):
    def test_every_table_of_a_page_has_its_question(self):
        known = {(question.page, question.block) for question in measure.QUESTIONS}
        for page in measure.PAGES.glob("*.md"):
            for line in page.read_text().splitlines():
                block = line.removeprefix("<!-- begin: ").removesuffix(" -->")
                if line.startswith("<!-- begin: ") and block not in ("soak", "stale", "livefarm", "livelinks"):
                    self.assertIn((page.name, block), known)

    def test_commands_fill_their_places(self):
        values = {"json": "a.json", "scenes": "s", "embree": "e.so", "folder": "f"}
        for question in measure.QUESTIONS:
            for words in question.commands or []:
                self.assertNotRegex(words.format(**values), r"[{}]")
        build = next(question for question in measure.QUESTIONS if question.block == "build")
        self.assertIn("bench build s/sponza/sponza.obj --threads 2", build.commands[1].format(**values))

    def test_what_a_question_lacks_is_named(self):
        args = types.SimpleNamespace(embree=None, scenes=pathlib.Path("/nowhere"))
        by_block = {question.block: question for question in measure.QUESTIONS if question.commands}
        self.assertEqual(measure.lacks(by_block["small"], args), "Embree (--embree)")
        self.assertIn("the scene country-kitchen", measure.lacks(by_block["live"], args))
        self.assertIsNone(measure.lacks(by_block["schedule"], args))

    def test_figures_name_their_commit(self):
        pages = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))
        (pages / "p.md").write_text("commit 1111111\n<!-- begin: b -->\nP; commit 2222222, 2026\n<!-- end: b -->\n")
        question = lambda block: measure.Question("p.md", block, [], [])
        self.assertEqual(measure.measured_at(question("b"), pages), "2222222")
        self.assertEqual(measure.measured_at(question(""), pages), "1111111")
        self.assertIsNone(measure.measured_at(question("c"), pages))

    def test_comments_and_tests_are_no_change(self):
        root = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))
        commit = ["-c", "user.name=n", "-c", "user.email=e", "commit", "-qam", "x"]

        def write(**files):
            for name, text in files.items():
                path = root / "src" / name.replace("__", "/").replace("_rs", ".rs")
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text)
            subprocess.run(["git", "add", "-A"], cwd=root, check=True)
            subprocess.run(["git", *commit], cwd=root, check=True)

        subprocess.run(["git", "init", "-q"], cwd=root, check=True)
        write(a_rs="/// One.\nfn a() {}\n", tests__b_rs="fn b() {}\n")
        first = measure.git("rev-parse", "HEAD", cwd=root).strip()
        write(a_rs="/// Two.\n\nfn a() {}\n", tests__b_rs="fn c() {}\n")
        self.assertEqual(measure.changed(first, ["src"], root), 0)
        write(a_rs="/// Two.\nfn a() {}\nfn d() {}\n")
        self.assertEqual(measure.changed(first, ["src"], root), 1)
        self.assertIsNone(measure.changed("0000000", ["src"], root))


if __name__ == "__main__":
    unittest.main()
