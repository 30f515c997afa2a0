"""Convert vectors between camera axes and the frame of a pixel's viewing ray."""

from jaxtyping import Float
from torch import Tensor, stack


def camera_from_ray(
    vectors: Float[Tensor, "b 3 h w"], rays: Float[Tensor, "*b 3 h w"]
) -> Float[Tensor, "b 3 h w"]:
    """Rotate vectors by the shortest rotation that takes the optical axis (0, 0, 1) onto each ray.

    With s = r_x v_x + r_y v_y and k = v_z - s / (1 + r_z): R v = (v_x + k r_x, v_y + k r_y, r_z v_z - s).

    Args:
        vectors: vectors in the frame of the ray: z along it, x and y as close to the camera's as possible.
        rays: unit rays, one map for all frames or one for each; none may point straight back.

    Returns:
        The vectors in camera axes, of unchanged length.
    """
    return _turn(vectors, *rays.unbind(dim=-3))


def ray_from_camera(
    vectors: Float[Tensor, "b 3 h w"], rays: Float[Tensor, "*b 3 h w"]
) -> Float[Tensor, "b 3 h w"]:
    """The inverse of `camera_from_ray`."""
    x, y, z = rays.unbind(dim=-3)
    return _turn(vectors, -x, -y, z)


def _turn(vectors: Tensor, x: Tensor, y: Tensor, z: Tensor) -> Tensor:
    v_x, v_y, v_z = vectors.unbind(dim=1)
    across = x * v_x + y * v_y
    share = v_z - across / (1 + z)
    return stack([v_x + share * x, v_y + share * y, z * v_z - across], dim=1)
