"""Types of what users hand in."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Optional, Protocol, Sequence, Tuple, Union

if TYPE_CHECKING:
    import numpy.typing as npt

    from ._palpate import Cloud, Scene

    Places = Union[npt.NDArray[Any], Sequence[Sequence[float]]]
    Vector = Union[npt.NDArray[Any], Sequence[float]]
    SceneLike = Union[Scene, Cloud, str, "os.PathLike[str]", Places]
    Answer = Optional[Union[Vector, Tuple[Vector, Vector]]]
else:
    Places = Vector = SceneLike = Answer = Any


class ExecutorLike(Protocol):
    """What runs jobs: an executor of concurrent.futures, or a client of Dask."""

    def submit(self, job: Any, *given: Any, **named: Any) -> Any:
        """Something with a method result()."""


class PythonRenderer(Protocol):
    """A renderer written in Python. If they are there, restart(hip, t_s) is called before the first frame, the
    attribute `bytes` is the memory that it takes, and `name` names it."""

    def prepare(self, scene: "Scene") -> None:
        """Called once, before the first frame; scene.clouds holds the points, mm."""

    def step(self, hip: Tuple[float, float, float], t_s: float) -> "Answer":
        """One frame. hip: mm. None: free; else the force, N; or (force, god object in mm)."""
