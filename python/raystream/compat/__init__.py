"""Stand-ins for other libraries' ray queries, so that unchanged programs use raystream.

>>> import raystream.compat.trimesh
>>> raystream.compat.trimesh.install()  # doctest: +SKIP

`compat.trimesh`, `compat.open3d` and `compat.embreex` have an `install` each. They answer where raystream itself
refuses: points in meshes with open edges are judged by the same parity, with one warning.
"""
