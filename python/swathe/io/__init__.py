"""Reading the ground and writing rasters: the only package that knows GDAL, OGR and PROJ.

``elevation`` opens heights of any raster format, ``soil`` lays a soil map over them, ``crs`` ties the metres of the
map to the places of the world, ``raster`` writes the results and ``bundled`` is the terrain that needs no files.
"""

from __future__ import annotations
