from collections.abc import Callable, Iterator, Mapping, Sequence
from os import PathLike
from typing import Any, Literal, SupportsFloat

import numpy as np
from numpy.typing import ArrayLike, NDArray

__version__: str
simd: str

_Floats = NDArray[np.float32]
_Ints = NDArray[np.int32]
_Bools = NDArray[np.bool_]
_Rule = Literal["closed", "half-open"]
_Want = str | Sequence[str]
_Out = Mapping[str, NDArray[Any]] | Hits
_Path = str | PathLike[str]
_Scene = _Path | Scene | Mesh | dict[str, Any]
_Wrap = Literal["repeat", "mirror", "clamp"]
_Progress = Callable[[float], object]

def info() -> dict[str, Any]: ...
def load(path: _Path, *, threads: int | None = None) -> Mesh: ...
def open(
    scene: _Scene | None = None,
    /,
    *,
    options: _Path | None = None,
    threads: int | None = None,
    **spec: Any,
) -> Rendering: ...
def render(
    scene: _Scene | None = None,
    /,
    *,
    options: _Path | None = None,
    progress: _Progress | None = None,
    threads: int | None = None,
    **spec: Any,
) -> Any: ...

def hemisphere(
    points: ArrayLike,
    normals: ArrayLike,
    count: int,
    *,
    cosine: bool = True,
    offset: float = 0.0,
    seed: int = 0,
    threads: int | None = None,
) -> _Floats: ...

class Hits(Mapping[str, NDArray[Any]]):
    t: _Floats
    primitive: _Ints
    instance: _Ints
    uv: _Floats
    normal: _Floats
    shading_normal: _Floats
    position: _Floats
    position64: NDArray[np.float64]
    attribute: _Floats
    distance: _Floats
    offsets: NDArray[np.int64]
    ray: NDArray[np.int64]
    def __init__(self, columns: dict[str, NDArray[Any]]) -> None: ...
    def __getitem__(self, name: str, /) -> NDArray[Any]: ...
    def __len__(self) -> int: ...
    def __iter__(self) -> Iterator[str]: ...
    @property
    def hit(self) -> _Bools: ...
    def hash(self) -> str: ...

class Queries:
    def cast(
        self,
        rays: ArrayLike,
        directions: ArrayLike | None = None,
        *,
        t_min: ArrayLike | None = None,
        t_max: ArrayLike | None = None,
        want: _Want | None = None,
        rule: _Rule = "closed",
        out: _Out | None = None,
        threads: int | None = None,
        check: bool = False,
    ) -> Hits: ...
    def occluded(
        self,
        rays: ArrayLike,
        directions: ArrayLike | None = None,
        *,
        t_min: ArrayLike | None = None,
        t_max: ArrayLike | None = None,
        rule: _Rule = "closed",
        out: _Bools | None = None,
        threads: int | None = None,
        check: bool = False,
    ) -> _Bools: ...
    def visible(
        self,
        a: ArrayLike,
        b: ArrayLike,
        *,
        rule: _Rule = "closed",
        out: _Bools | None = None,
        threads: int | None = None,
    ) -> _Bools: ...
    def count(
        self,
        rays: ArrayLike,
        directions: ArrayLike | None = None,
        *,
        t_min: ArrayLike | None = None,
        t_max: ArrayLike | None = None,
        rule: _Rule = "half-open",
        out: _Ints | None = None,
        threads: int | None = None,
        check: bool = False,
    ) -> _Ints: ...
    def at_least(
        self,
        hits: int,
        rays: ArrayLike,
        directions: ArrayLike | None = None,
        *,
        t_min: ArrayLike | None = None,
        t_max: ArrayLike | None = None,
        rule: _Rule = "half-open",
        out: _Bools | None = None,
        threads: int | None = None,
        check: bool = False,
    ) -> _Bools: ...
    def all_hits(
        self,
        rays: ArrayLike,
        directions: ArrayLike | None = None,
        *,
        t_min: ArrayLike | None = None,
        t_max: ArrayLike | None = None,
        want: _Want | None = None,
        max_hits: int | None = None,
        rule: _Rule = "half-open",
        threads: int | None = None,
        check: bool = False,
    ) -> Hits: ...
    def sum_along(
        self,
        rays: ArrayLike,
        directions: ArrayLike | None = None,
        *,
        t_min: ArrayLike | None = None,
        t_max: ArrayLike | None = None,
        attribute: ArrayLike | None = None,
        rule: _Rule = "half-open",
        out: _Floats | None = None,
        threads: int | None = None,
        check: bool = False,
    ) -> _Floats: ...
    def nearest(
        self,
        points: ArrayLike,
        *,
        max_distance: SupportsFloat = ...,
        want: _Want | None = None,
        out: _Out | None = None,
        threads: int | None = None,
    ) -> Hits: ...
    def distance(
        self, points: ArrayLike, *, out: _Floats | None = None, threads: int | None = None
    ) -> _Floats: ...

class Mesh(Queries):
    def __init__(
        self,
        vertices: ArrayLike,
        faces: ArrayLike | None = None,
        attributes: ArrayLike | None = None,
        *,
        normals: ArrayLike | None = None,
        threads: int | None = None,
    ) -> None: ...
    def refit(self, vertices: ArrayLike, *, threads: int | None = None) -> None: ...
    def contains(
        self,
        points: ArrayLike,
        *,
        allow_open: bool = False,
        out: _Bools | None = None,
        threads: int | None = None,
    ) -> _Bools: ...
    def signed_distance(
        self,
        points: ArrayLike,
        *,
        allow_open: bool = False,
        out: _Floats | None = None,
        threads: int | None = None,
    ) -> _Floats: ...
    @property
    def open_edges(self) -> int: ...
    @property
    def is_closed(self) -> bool: ...
    @property
    def vertices(self) -> NDArray[Any]: ...
    @property
    def faces(self) -> NDArray[np.uint32]: ...
    @property
    def attributes(self) -> _Floats | None: ...
    @property
    def normals(self) -> _Floats | None: ...
    @property
    def triangle_count(self) -> int: ...

class World(Queries):
    def __init__(self) -> None: ...
    def __len__(self) -> int: ...
    def add(self, mesh: Mesh, transform: ArrayLike | None = None) -> int: ...
    def remove(self, ids: ArrayLike) -> None: ...
    def set_visible(self, ids: ArrayLike, visible: bool) -> None: ...
    def set_mesh(self, ids: ArrayLike, mesh: Mesh) -> None: ...
    def set_transforms(self, ids: ArrayLike, transforms: ArrayLike) -> None: ...

class Texture:
    def __init__(
        self,
        pixels: ArrayLike | Texture,
        *,
        wrap: _Wrap | tuple[_Wrap, _Wrap] | None = None,
        uv: int = 0,
        offset: tuple[float, float] = (0.0, 0.0),
        rotation_degrees: float = 0.0,
        scale: tuple[float, float] = (1.0, 1.0),
    ) -> None: ...
    @property
    def size(self) -> tuple[int, int]: ...
    @property
    def pixels(self) -> NDArray[Any]: ...

class Material:
    def __init__(self, name: str, /, **values: Any) -> None: ...
    @property
    def name(self) -> str: ...
    @property
    def values(self) -> dict[str, Any]: ...

class Scene:
    def __init__(
        self,
        vertices: ArrayLike | Mesh | None = None,
        faces: ArrayLike | None = None,
        *,
        name: str = "mesh",
        material: Material | dict[str, Any] | None = None,
        transform: ArrayLike | None = None,
        normals: ArrayLike | None = None,
        colours: ArrayLike | None = None,
        uvs: ArrayLike | None = None,
        attributes: Mapping[str, ArrayLike] | None = None,
    ) -> None: ...
    def add(
        self,
        vertices: ArrayLike | Mesh,
        faces: ArrayLike | None = None,
        *,
        name: str | None = None,
        material: Material | dict[str, Any] | None = None,
        transform: ArrayLike | None = None,
        normals: ArrayLike | None = None,
        colours: ArrayLike | None = None,
        uvs: ArrayLike | None = None,
        attributes: Mapping[str, ArrayLike] | None = None,
    ) -> None: ...
    def __len__(self) -> int: ...
    @property
    def objects(self) -> list[str]: ...
    @property
    def materials(self) -> list[str]: ...
    @property
    def triangle_count(self) -> int: ...
    @property
    def bounds(self) -> _Floats: ...

class Rendering:
    def render(
        self,
        frame: int | None = None,
        *,
        progress: _Progress | None = None,
        threads: int | None = None,
    ) -> Picture: ...
    @property
    def frames(self) -> range: ...
    @property
    def names(self) -> list[str]: ...
    @property
    def spec(self) -> dict[str, Any]: ...
    @property
    def warnings(self) -> list[str]: ...
    @property
    def scene_hash(self) -> str: ...

class Picture:
    def __getitem__(self, name: str, /) -> NDArray[Any]: ...
    def keys(self) -> list[str]: ...
    def shown(self) -> NDArray[np.uint8]: ...
    def save(self, path: _Path) -> None: ...
    def hash(self) -> str: ...
    def layer_hashes(self) -> dict[str, str]: ...
    @property
    def image(self) -> _Floats: ...
    @property
    def layers(self) -> dict[str, NDArray[Any]]: ...
    @property
    def names(self) -> dict[str, list[str]]: ...
    @property
    def metadata(self) -> dict[str, str]: ...
    @property
    def stats(self) -> dict[str, Any]: ...
    @property
    def frame(self) -> int: ...
    @property
    def name(self) -> str: ...
