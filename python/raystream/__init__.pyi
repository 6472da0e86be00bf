from . import rays as rays
from ._raystream import Hits as Hits
from ._raystream import Material as Material
from ._raystream import Mesh as Mesh
from ._raystream import Picture as Picture
from ._raystream import Queries as Queries
from ._raystream import Rendering as Rendering
from ._raystream import Scene as Scene
from ._raystream import Texture as Texture
from ._raystream import World as World
from ._raystream import __version__ as __version__
from ._raystream import info as info
from ._raystream import open as open
from ._raystream import render as render
from ._raystream import simd as simd

__all__: list[str]
