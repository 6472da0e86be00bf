"""Documents against the package: examples in docstrings and pages run, stubs and the guide name all there is."""

import ast
import contextlib
import doctest
import importlib
import importlib.metadata
import inspect
import io
import json
import os
import re
import unittest
from pathlib import Path

import raystream as rs

PACKAGE = Path(rs.__file__).parent
CHECKOUT = Path(__file__).resolve().parents[2]
CLASSES = [rs.Hits, rs.Queries, rs.Mesh, rs.World, rs.Scene, rs.Material, rs.Texture, rs.Rendering, rs.Picture]
FUNCTIONS = [rs.info, rs.open, rs.render]
MODULES = ["raystream", "raystream.rays", "raystream.compat", "raystream.compat.open3d", "raystream.compat.embreex"]


def public(owner):
    """Names of a class's own members."""
    return [name for name in vars(owner) if not name.startswith("_")]


class Docstrings(unittest.TestCase):
    def test_examples_in_docstrings_run(self):
        finder, runner = doctest.DocTestFinder(recurse=True), doctest.DocTestRunner()
        count = 0
        for owner in [importlib.import_module(name) for name in MODULES]:
            for test in finder.find(owner):
                count += len(test.examples)
                runner.run(test)
        self.assertEqual(runner.failures, 0)
        self.assertGreater(count, 30)

    def test_everything_public_says_what_it_does(self):
        for owner in CLASSES:
            self.assertTrue(inspect.getdoc(owner), owner)
            for name in public(owner):
                self.assertTrue(inspect.getdoc(getattr(owner, name)), f"{owner.__name__}.{name}")
        for function in FUNCTIONS + [getattr(rs.rays, name) for name in rs.rays.__all__]:
            self.assertTrue(inspect.getdoc(function), function)


class Stubs(unittest.TestCase):
    def setUp(self):
        tree = ast.parse((PACKAGE / "_raystream.pyi").read_text())
        self.classes = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}
        self.functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}

    def test_stubs_have_the_members_of_classes(self):
        columns = {"t", "primitive", "instance", "uv", "normal", "shading_normal", "position", "position64"}
        columns |= {"attribute", "distance", "offsets", "ray"}
        mapping = {"keys", "values", "items"}
        for owner in CLASSES:
            body = self.classes[owner.__name__].body
            stubbed = {node.name for node in body if isinstance(node, ast.FunctionDef)}
            stubbed = {name for name in stubbed if not name.startswith("_")}
            self.assertEqual(stubbed, set(public(owner)) - (mapping if owner is rs.Hits else set()), owner)
        named = {node.target.id for node in self.classes["Hits"].body if isinstance(node, ast.AnnAssign)}
        self.assertEqual(named, columns)

    def test_stubs_have_the_arguments_of_methods(self):
        for owner in CLASSES:
            for node in self.classes[owner.__name__].body:
                if not isinstance(node, ast.FunctionDef) or node.decorator_list or node.name == "__init__":
                    continue
                if node.name.startswith("__"):
                    continue
                self.check_arguments(node, getattr(owner, node.name))
        for function in FUNCTIONS:
            self.check_arguments(self.functions[function.__name__], function)

    def check_arguments(self, node, function):
        """A stub has the arguments of its function."""
        found = inspect.signature(function).parameters
        positional = [argument.arg for argument in node.args.posonlyargs + node.args.args]
        keywords = [argument.arg for argument in node.args.kwonlyargs]
        others = [node.args.kwarg.arg] if node.args.kwarg else []
        self.assertEqual(positional + keywords + others, list(found), node.name)
        for name in keywords:
            self.assertEqual(found[name].kind, inspect.Parameter.KEYWORD_ONLY, name)

    def test_the_package_is_typed_and_needs_numpy_alone(self):
        self.assertTrue((PACKAGE / "py.typed").is_file())
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            required = importlib.metadata.requires("raystream") or []
            needed = [name for name in required if "extra ==" not in name]
            self.assertEqual([re.match(r"\w+", name)[0] for name in needed], ["numpy"])


class Pages(unittest.TestCase):
    PAGES = ["python/README.md", "docs/guide/python.md", "README.md"]

    def test_programs_in_pages_run(self):
        count = 0
        for page in self.PAGES:
            text = (CHECKOUT / page).read_text()
            names = {}
            for match in re.finditer(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
                program = "\n" * text[: match.start()].count("\n") + match[1]
                with contextlib.redirect_stdout(io.StringIO()):
                    exec(compile(program, page, "exec"), names)
                count += 1
        self.assertGreater(count, 4)

    def test_cells_of_the_notebook_run(self):
        notebook = json.loads((CHECKOUT / "python/examples/views.ipynb").read_text())
        names, folder = {}, os.getcwd()
        os.chdir(CHECKOUT / "python/examples")
        try:
            for cell in notebook["cells"]:
                if cell["cell_type"] == "code":
                    program = ast.parse("".join(cell["source"]))
                    last = program.body.pop() if isinstance(program.body[-1], ast.Expr) else None
                    exec(compile(program, "views.ipynb", "exec"), names)
                    shown = last and eval(compile(ast.Expression(last.value), "views.ipynb", "eval"), names)
        finally:
            os.chdir(folder)
        self.assertTrue(shown and 0 < sum(shown.values()) <= 1, shown)

    def test_the_guide_names_all_there_is(self):
        text = (CHECKOUT / "docs/guide/python.md").read_text()
        for owner in CLASSES:
            for name in public(owner):
                self.assertRegex(text, rf"`[^`]*\b{name}\b[^`]*`", f"{owner.__name__}.{name}")
        for name in rs.rays.__all__:
            self.assertIn(f"rays.{name}", text)
        for function in FUNCTIONS:
            self.assertIn(f"rs.{function.__name__}(", text)


if __name__ == "__main__":
    unittest.main()
