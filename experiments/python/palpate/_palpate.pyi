"""The compiled part. Arrays are read-only views of its memory."""

from typing import Any, Dict, List, NamedTuple, Optional, Tuple, Type, Union

import numpy as np
import numpy.typing as npt

from .protocols import Places, PythonRenderer, SceneLike, Vector

__version__: str
Triple = Tuple[float, float, float]

class Frame(NamedTuple):
    """The answer of a renderer to one place of the HIP."""

    force: Triple  # on the device, world frame, N
    god_object: Triple  # mm; the HIP when free
    contact: bool
    model: int  # index of the touched model, -1 when free
    status: str  # "ok", "bound-hit", "non-finite"

class Scene:
    """Models with poses and surfaces."""

    @property
    def name(self) -> str: ...
    @property
    def clouds(self) -> Tuple[Cloud, ...]: ...
    @property
    def force_limit_n(self) -> float:
        """0: none."""

class Cloud:
    """The points of one model: x, y, z in mm relative to origin_mm, in the model's frame."""

    @property
    def x(self) -> npt.NDArray[np.float32]: ...
    @property
    def y(self) -> npt.NDArray[np.float32]: ...
    @property
    def z(self) -> npt.NDArray[np.float32]: ...
    @property
    def origin_mm(self) -> Triple: ...
    @property
    def box_mm(self) -> npt.NDArray[np.float64]:
        """(2, 3): the lowest and the highest corner."""
    def __len__(self) -> int: ...
    def points(self) -> npt.NDArray[np.float64]:
        """A new (n, 3) array, mm, the origin added."""
    @property
    def properties(self) -> Dict[str, npt.NDArray[np.float32]]:
        """Further columns of the file by name."""
    @property
    def name(self) -> str: ...
    @property
    def source(self) -> str: ...
    @property
    def format(self) -> str: ...
    @property
    def unit(self) -> str:
        """Of the source: m, cm, mm, um, in."""
    @property
    def copied(self) -> bool:
        """False where the points lie in the Columns that were filled."""
    @property
    def warnings(self) -> List[str]: ...
    @property
    def has_formula(self) -> bool: ...
    @property
    def has_faces(self) -> bool: ...
    @property
    def stiffness_n_per_mm(self) -> float: ...
    def prepare(self, file: str, force: bool = False) -> None:
        """Writes a prepared file (.palsurf) that read() opens without building; force: replaces any file."""

class Columns:
    """Room for the x, y and z of n points, mm: a cloud's own memory, to be filled."""

    def __init__(self, count: int) -> None: ...
    @property
    def x(self) -> npt.NDArray[np.float32]: ...
    @property
    def y(self) -> npt.NDArray[np.float32]: ...
    @property
    def z(self) -> npt.NDArray[np.float32]: ...
    def cloud(self, origin_mm: Vector = (0.0, 0.0, 0.0)) -> Cloud:
        """The cloud where the columns lie, which can only be read from then on. origin_mm is added to them."""

class Path:
    """Places of the HIP over time."""

    @property
    def hip_mm(self) -> npt.NDArray[np.float64]:
        """(n, 3), world frame."""
    @property
    def t_s(self) -> npt.NDArray[np.float64]: ...
    @property
    def name(self) -> str: ...
    @property
    def scene(self) -> Optional[Scene]:
        """That it was made for."""
    def __len__(self) -> int: ...
    def write(self, file: str) -> None:
        """As CSV: t_s,x_mm,y_mm,z_mm."""

class Trace:
    """The answers of a renderer, one frame for each sample of a path."""

    @property
    def force_n(self) -> npt.NDArray[np.float64]:
        """(n, 3), on the device, world frame."""
    @property
    def god_object_mm(self) -> npt.NDArray[np.float64]:
        """(n, 3); the HIP when free."""
    @property
    def contact(self) -> npt.NDArray[np.bool_]: ...
    @property
    def model(self) -> npt.NDArray[np.int32]:
        """Index of the touched model, -1 when free."""
    @property
    def status(self) -> npt.NDArray[np.uint8]:
        """0 ok, 1 bound-hit, 2 non-finite."""
    @property
    def frame_ns(self) -> npt.NDArray[np.int64]:
        """Times of frames; empty where none was timed."""
    @property
    def seconds(self) -> float:
        """That all frames of a replay took together."""
    @property
    def label(self) -> str: ...
    @property
    def hash(self) -> str:
        """Over contact, force and god object of every frame: sixteen hexadecimal digits."""
    def __len__(self) -> int: ...
    def write(self, path: Path, file: str) -> None:
        """As a trace.csv of palpate compare."""

class Renderer:
    """A prepared renderer: places of the HIP in, forces out. One caller at a time."""

    def step(self, hip: Vector, t_s: Optional[float] = None) -> Frame:
        """One frame. hip: mm, world frame. t_s: None: 1 ms after the last. The first place must be free."""
    def replay(self, path: Union[Path, Places], rate_hz: float = 1000.0) -> Trace:
        """Restarts, then one frame a sample; other threads run meanwhile. An array has rows in mm."""
    def restart(self, hip: Vector, t_s: float = 0.0) -> None:
        """Begins anew with the HIP free at hip (mm); deformed models are restored."""
    def close(self) -> None:
        """Frees what it holds."""
    @property
    def closed(self) -> bool: ...
    @property
    def name(self) -> str: ...
    @property
    def scene(self) -> Scene: ...
    @property
    def options(self) -> Dict[str, str]:
        """As given."""
    @property
    def prepare_ms(self) -> float: ...
    @property
    def bytes(self) -> int: ...
    @property
    def notes(self) -> List[str]: ...
    @property
    def warnings(self) -> List[str]: ...
    def counters(self) -> Dict[str, int]:
        """Sums since the last restart."""
    def __enter__(self) -> Renderer: ...
    def __exit__(self, *exception: object) -> None: ...

class Truth:
    """The constrained god object of the true surface along a path."""

    @property
    def force_n(self) -> npt.NDArray[np.float64]: ...
    @property
    def god_object_mm(self) -> npt.NDArray[np.float64]: ...
    @property
    def contact(self) -> npt.NDArray[np.bool_]: ...
    @property
    def normal(self) -> npt.NDArray[np.float64]:
        """Outward, at the true god object."""
    @property
    def distance_mm(self) -> npt.NDArray[np.float64]:
        """Of the HIP, negative inside."""
    @property
    def reference(self) -> str: ...
    @property
    def exactness(self) -> str: ...
    def __len__(self) -> int: ...
    def _scores(self, trace: Trace) -> str: ...

def read(source: str, **options: Any) -> Cloud: ...
def scene(source: str, **options: Any) -> Scene: ...
def cloud(points: Places, *, unit: str = "mm", drop_non_finite: bool = False) -> Cloud: ...
def path(source: Any, scene: Optional[SceneLike] = None, rate_hz: float = 1000.0) -> Path: ...
def renderer(
    name: Union[str, PythonRenderer, Type[Any]], scene: SceneLike, *, threads: int = 0, **options: Any
) -> Renderer: ...
def renderers() -> Dict[str, Dict[str, Any]]: ...
def truth(
    path: Union[Path, Places], scene: Optional[SceneLike] = None, *, reference: str = "auto", rate_hz: float = 1000.0
) -> Truth: ...
def read_trace(file: str) -> Tuple[Path, Trace]: ...
def read_recording(file: str, renderer: str = "", skip_damaged: bool = False) -> Tuple[Path, Trace]: ...
def _compare(
    renderers: List[Any],
    path: Any,
    scene: Optional[SceneLike],
    reference: str,
    passes: int,
    budget_s: float,
    rate_hz: float,
    threads: int,
) -> Tuple[str, Path, Dict[str, Trace]]: ...
