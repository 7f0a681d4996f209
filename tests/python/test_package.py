"""Types, words and the notebook of the package."""

import importlib.util
import inspect
import os
import re
import subprocess
import sys
import tempfile
import unittest

import palpate

SOURCE = os.environ.get("PALPATE_SOURCE", os.path.join(os.path.dirname(__file__), "..", ".."))
FOLDER = os.path.join(SOURCE, "experiments", "python")


class Types(unittest.TestCase):
    @unittest.skipUnless(importlib.util.find_spec("mypy"), "mypy is not installed")
    def test_mypy_strict_finds_nothing(self):
        with tempfile.TemporaryDirectory() as cache:
            check = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", cache]
            checked = subprocess.run([*check, os.path.join(FOLDER, "palpate")], capture_output=True, text=True)
            self.assertEqual(checked.returncode, 0, checked.stdout)
            wrong = subprocess.run([*check, "-c", "import palpate; palpate.renderer('cloud', 'x').step(3)"],
                                   capture_output=True, text=True, env={**os.environ, "MYPYPATH": FOLDER})
            self.assertIn("[arg-type]", wrong.stdout)

    def test_the_stub_names_what_is_there(self):
        with open(os.path.join(FOLDER, "palpate", "_palpate.pyi")) as stub:
            lines = stub.read().split("\n")
        stated, inside = set(), None
        for line in lines:
            if line.startswith("class "):
                inside = line[6:].split("(")[0].rstrip(":")
            elif line.startswith("def "):
                stated.add(line[4:].split("(")[0])
            elif line.startswith("    def ") and inside:
                stated.add(inside + "." + line[8:].split("(")[0])
        compiled = sys.modules["palpate._palpate"]
        there = {name for name in vars(compiled) if not name.startswith("__")}
        classes = {name for name in there if inspect.isclass(getattr(compiled, name)) and name != "Frame"}
        there -= classes | {"Frame"}
        there |= {f"{name}.{member}" for name in classes for member in vars(getattr(compiled, name))
                  if not member.startswith("_") or member in ("__len__", "__enter__", "__exit__", "_scores")}
        stated = {name for name in stated if not name.endswith("__init__")}
        self.assertEqual(stated ^ there, set())

    def test_everything_has_a_docstring(self):
        bare = [name for name in palpate.__all__ if not name.startswith("__")
                and name not in ("Answer", "Places", "SceneLike", "Vector") and not getattr(palpate, name).__doc__]
        self.assertEqual(bare, [])
        for name in ("renderer", "path", "truth", "compare", "cloud", "Cloud", "Columns", "Renderer", "Trace", "Truth"):
            self.assertRegex(getattr(palpate, name).__doc__, r"\bmm\b")


class Import(unittest.TestCase):
    def test_it_brings_no_library_of_tables_or_figures(self):
        script = "import palpate, sys; print('pandas' in sys.modules, 'matplotlib' in sys.modules)"
        loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout
        self.assertEqual(loaded.split(), ["False", "False"])


class Page(unittest.TestCase):
    def test_its_recipes_run_one_after_the_other(self):
        with open(os.path.join(SOURCE, "docs", "how-to", "use-python.md")) as page:
            recipes = re.findall(r"```python\n(.*?)```", page.read(), re.DOTALL)
        self.assertEqual(len(recipes), 10)
        with tempfile.TemporaryDirectory() as folder:
            ran = subprocess.run([sys.executable, "-c", "\n".join(recipes)], cwd=folder, capture_output=True, text=True,
                                 env={**os.environ, "MPLBACKEND": "agg"})
        self.assertEqual(ran.returncode, 0, ran.stderr)


class Notebook(unittest.TestCase):
    @unittest.skipUnless(importlib.util.find_spec("nbconvert") and importlib.util.find_spec("ipykernel"),
                         "nbconvert or ipykernel is not installed")
    def test_it_runs_and_draws(self):
        import nbformat
        from nbconvert.preprocessors import ExecutePreprocessor

        book = nbformat.read(os.path.join(FOLDER, "trade.ipynb"), as_version=4)
        with tempfile.TemporaryDirectory() as folder:
            ExecutePreprocessor(timeout=600, kernel_name="python3").preprocess(book, {"metadata": {"path": folder}})
        pictures = [output for cell in book.cells if cell.cell_type == "code" for output in cell.outputs
                    if "image/png" in output.get("data", {})]
        self.assertEqual(len(pictures), 2)
        self.assertGreater(min(len(picture["data"]["image/png"]) for picture in pictures), 5000)


if __name__ == "__main__":
    unittest.main()
