"""Haptic rendering of dense point clouds: touch scans, and compare renderers.

Units: mm, N, s, N/mm; a function that reads files takes their unit. Mistakes raise palpate.Error.

    cloud = palpate.read("scan.ply", unit="m")
    renderer = palpate.renderer("cloud", cloud, stiffness=0.5)
    frame = renderer.step((0.0, 0.0, 12.5))
    palpate.compare(["cloud", "mesh-godobject"], "hand", scene=cloud).plot()
"""

from __future__ import annotations

import json
import os
from pkgutil import extend_path
from typing import Any, Dict, List, Optional, Sequence, Tuple, Union

# Found first in a checkout, this folder lacks the compiled part, which stands in the build's on the search path.
__path__ = extend_path(__path__, __name__)

from . import _palpate
from ._palpate import Cloud, Columns, Frame, Path, Renderer, Scene, Trace, Truth, __version__
from .comparison import Comparison, joined
from .errors import Error
from .protocols import Answer, ExecutorLike, Places, PythonRenderer, SceneLike, Vector

__all__ = [
    "Answer", "Cloud", "Columns", "Comparison", "Error", "ExecutorLike", "Frame", "Path", "Places", "PythonRenderer",
    "Renderer", "Scene", "SceneLike", "Trace", "Truth", "Vector", "__version__", "cloud", "compare", "generate", "path", "read",
    "read_recording", "read_trace", "renderer", "renderers", "scene", "score", "truth",
]

FileName = Union[str, "os.PathLike[str]"]


def _given(**options: Optional[object]) -> Dict[str, Any]:
    return {key: value for key, value in options.items() if value is not None}


def read(source: FileName, *, unit: Optional[str] = None, scale: Optional[float] = None,
         non_finite: Optional[str] = None) -> Cloud:
    """The points of a file, a prepared file, or a generator such as "sinusoid:points=10201".

    unit: of the file: m, cm, mm, um, in; None: as the file says, else a guess that Cloud.warnings tells.
    scale: multiplies all lengths. non_finite: "drop" (as None) or "refuse" points that are not finite.
    """
    return _palpate.read(os.fspath(source), **_given(unit=unit, scale=scale, non_finite=non_finite))


def cloud(points: Places, *, unit: str = "mm", drop_non_finite: bool = False) -> Cloud:
    """A cloud from an (n, 3) array of x, y, z.

    unit: of the numbers: mm, m, cm, um, in. Points that are not finite are an Error, or dropped. The array is copied, since a
    cloud owns its columns; Columns(n) hands these out before, to be filled without a copy.
    """
    return _palpate.cloud(points, unit=unit, drop_non_finite=drop_non_finite)


def generate(name: str, **options: Union[str, float, int, bool]) -> Cloud:
    """A model known by formula: generate("sphere", points=10_000, extent_mm=80); see `palpate list scans`."""
    return read(":".join([name] + [f"{key}={str(value).lower() if isinstance(value, bool) else value}"
                                   for key, value in options.items()]))


def scene(source: FileName, *, unit: Optional[str] = None, scale: Optional[float] = None,
          non_finite: Optional[str] = None) -> Scene:
    """Models with poses and surfaces, from a scene file (TOML) or anything that read() takes."""
    return _palpate.scene(os.fspath(source), **_given(unit=unit, scale=scale, non_finite=non_finite))


def path(source: Union[FileName, Places], scene: Optional[SceneLike] = None, *, rate_hz: float = 1000.0) -> Path:
    """Places of the HIP over time, mm, world frame: they begin in free space.

    source: a file (CSV with t_s,x_mm,y_mm,z_mm; a recording), a generator made for `scene` such as
    "weave:frames=20000" or "hand", or an (n, 3) array at `rate_hz`.
    """
    return _palpate.path(source, scene, rate_hz)


def renderer(name: Union[str, PythonRenderer, type], scene: SceneLike, *, threads: int = 0,
             **options: Any) -> Renderer:
    """A renderer, prepared for a scene.

    name: one of renderers(), or a class or object with prepare(scene) and step(hip, t_s). threads: of
    preparation; 0: all. stiffness (N/mm), friction (one coefficient, or static and dynamic), deformation
    (0 up to 1) and force_limit (N) replace those of the scene; other options are the renderer's own.
    """
    return _palpate.renderer(name, scene, threads=threads, **options)


def renderers() -> Dict[str, Dict[str, Any]]:
    """Every renderer by name: summary, source, role, and options with default and help."""
    return _palpate.renderers()


def truth(path: Union[Path, Places], scene: Optional[SceneLike] = None, *, reference: str = "auto",
          rate_hz: float = 1000.0) -> Truth:
    """The true surface's answers along a path: N, mm.

    reference: auto (the formula, else the model's own faces), analytic, original-mesh, closest-point, or the
    name of a mesh file in the model's frame and unit.
    """
    return _palpate.truth(path, scene, reference=reference, rate_hz=rate_hz)


def score(trace: Trace, truth: Truth) -> Dict[str, Dict[str, Any]]:
    """Scores of a trace by their names in docs/reference/scores.md: {"accuracy": .., "energy": ..}."""
    if not isinstance(trace, Trace) or not isinstance(truth, Truth):
        raise Error("a score is of a Trace and a Truth", "score(renderer.replay(path), palpate.truth(path))")
    row = json.loads(truth._scores(trace))["renderers"][0]
    return {"accuracy": row["accuracy"], "energy": row["energy"]}


def compare(renderers: Sequence[Union[str, Renderer, PythonRenderer, type]], path: Union[str, Path, Places] = "", *,
            scene: Optional[SceneLike] = None, reference: str = "auto", passes: int = 30, budget_s: float = 6.0,
            rate_hz: float = 1000.0, threads: int = 0, executor: Optional[ExecutorLike] = None) -> Comparison:
    """Renderers along one path, prepared, timed in turns and scored in this process.

    renderers: names with options ("cloud:refine=1:label=bare"), prepared ones (prepared anew by their options),
    classes written in Python. path: a Path, an (n, 3) array in mm at `rate_hz`, a generator, or "": one that
    suits the scene. scene: that of the first prepared renderer or of the path where none is given.
    passes, budget_s: timed passes of each renderer, and seconds that they may take. executor: of
    concurrent.futures or Dask: each renderer is a job, whose times stand beside those of its neighbours. Processes
    take names and classes, and have to be spawned: a forked one has none of our threads.
    """
    chosen: List[Union[str, Renderer, PythonRenderer, type]] = (
        [renderers] if isinstance(renderers, str) else list(renderers))
    if executor is None or not chosen:
        document, walked, traces = _palpate._compare(chosen, path, scene, reference, passes, budget_s, rate_hz, threads)
        return Comparison(json.loads(document), walked, traces)
    if scene is None:
        scene = next((one.scene for one in chosen if isinstance(one, Renderer)),
                     path.scene if isinstance(path, Path) else None)
    jobs = [executor.submit(compare, [one], path, scene=scene, reference=reference, passes=passes, budget_s=budget_s,
                                            rate_hz=rate_hz, threads=threads) for one in chosen]
    return joined([job.result() for job in jobs])


def read_trace(file: FileName) -> Tuple[Path, Trace]:
    """A path and what was answered along it, from a trace of `palpate compare` (trace.csv)."""
    return _palpate.read_trace(os.fspath(file))


def read_recording(file: FileName, renderer: str = "", skip_damaged: bool = False) -> Tuple[Path, Trace]:
    """The path of a recorded session (.palrec) and the frames of one of its renderers; "": its first.

    skip_damaged: leaves out damaged parts, which are an Error otherwise.
    """
    return _palpate.read_recording(os.fspath(file), renderer, skip_damaged)
