from . import rays as rays
from ._raystream import Hits as Hits
from ._raystream import Mesh as Mesh
from ._raystream import Queries as Queries
from ._raystream import World as World
from ._raystream import __version__ as __version__
from ._raystream import simd as simd

__all__: list[str]
