"""Cameras, rays, points and normals, and their conventions.

* Camera axes: x right, y down, z forward (OpenCV); millimetres.
* Pixels: the centre of the top-left one is (0, 0); a pixel is (u, v) = (column, row).
* `depth` is measured along the optical axis; a point is `ray / ray_z * depth`. The length of that point,
  the ray distance, is a different quantity.
* `rays` are unit vectors of shape (3, h, w) or (b, 3, h, w). `normals` are unit vectors that face the
  camera along their own ray: n . ray < 0. A plane at 50 mm seen by a pinhole has normals (0, 0, -1).
* `mask` is True where a pixel counts. Sizes are (height, width).

kornia's `depth_to_3d` and `depth_to_normals` support pinholes only, and its normals point away from the
camera; here every function takes the rays of any central camera instead.
"""

from col3d.geometry.camera import Camera, PinholeCamera, RadialCamera
from col3d.geometry.depth import points_from_depth
from col3d.geometry.fisheye import FisheyeCamera
from col3d.geometry.frames import camera_from_ray, ray_from_camera
from col3d.geometry.normals import angle_between, normals_from_depth, unit
from col3d.geometry.omnidirectional import OmnidirectionalCamera
from col3d.geometry.radial_tangential import RadialTangentialCamera

__all__ = [
    "Camera",
    "FisheyeCamera",
    "OmnidirectionalCamera",
    "PinholeCamera",
    "RadialCamera",
    "RadialTangentialCamera",
    "angle_between",
    "camera_from_ray",
    "normals_from_depth",
    "points_from_depth",
    "ray_from_camera",
    "unit",
]
